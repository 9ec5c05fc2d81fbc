"""What loading a trained policy leaves alone."""

from __future__ import annotations

from pathlib import Path

import torch

from ludus.runs.saved import load_policies
from tests.export.trained_runs import SIMPLE, SMALL, make_policy, make_run


def test_loading_draws_nothing_from_the_stream_of_a_run(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", {"hero": make_policy(SIMPLE, SMALL)}, config=SMALL)
    before = torch.get_rng_state()
    load_policies(run, {"hero": SIMPLE})
    assert torch.equal(torch.get_rng_state(), before)
