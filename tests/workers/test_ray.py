"""Workers on the nodes of a Ray cluster on this machine; what goes wrong is in test_ray_faults."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import psutil
import pytest

import ludus
from ludus.cli.main import main
from ludus.engine.cache import require_cache_root
from ludus.errors import ConfigError
from ludus.settings.merging import Layer
from ludus.training.hooks import Training
from ludus.training.loop import train
from ludus.tuning.sweeping import SweepConfig, run_sweep
from ludus.version import __version__
from ludus.workers.parcel import find_parcel, has_parcel
from tests.training.test_on_engine import pennies
from tests.workers.machines import assert_equal, newest
from tests.workers.ray_cluster import add_node, large_rollout, on_ray, require_no_actors
from tests.workers.test_equal_bits import PPO, config

__all__ = ["pennies"]

pytestmark = [
    pytest.mark.cluster,
    # The nodes start with the first test, and see the engines that it sees.
    pytest.mark.engine,
    # What Ray does on its own account.
    pytest.mark.filterwarnings("default"),
]


def test_layouts_give_the_checkpoint_of_one_process(cluster: Any, tmp_path: Path) -> None:
    joined = [add_node(cluster) for _ in range(2)]
    try:
        # A worker takes seconds to start; test_equal_bits has each case with each layout.
        for case, nums in (("ppo", (1, 4)), ("sac", (2,))):
            alone = train(config(case, tmp_path / case, None))
            for num in nums:
                layout = {"num_machines": num, "num_engines": 4 // num, "name": f"{num} machines"}
                spread = train(on_ray(case, tmp_path / case, **layout))
                assert_equal(newest(alone.path), newest(spread.path))
                assert spread.evaluation == alone.evaluation
    finally:
        for node in joined:
            cluster.remove_node(node)


def test_more_machines_than_there_are_is_refused(cluster: Any, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"num_machines is 9, and the cluster has \d machines"):
        train(on_ray("ppo", tmp_path, num_machines=9))


def test_a_project_is_sent_once(cluster: Any, tmp_path: Path, pennies: Any) -> None:
    """A game on every node, since no number of machines is given."""
    config = pennies(cluster="auto", total_steps=640, evaluation_episodes=4)
    parcel = find_parcel(config.target, None, None)
    assert parcel is not None
    played: set[str] = set()

    def look(_: Training) -> None:
        games = psutil.process_iter(["cmdline"])
        played.update(" ".join(game.info["cmdline"] or []) for game in games)

    run = ludus.train(config, on_update=look, progress=False)
    assert run.stop_reason == "total_steps"
    assert {name: of.num_episodes for name, of in run.evaluation.items()} == {"even": 4, "odd": 4}
    kept = require_cache_root() / "games" / parcel.digest
    assert any(str(kept) in command for command in played)
    assert not any(config.target in command for command in played)
    assert has_parcel(parcel.digest)
    shutil.rmtree(kept)


def test_a_sweep_runs_every_trial_on_the_cluster(cluster: Any, tmp_path: Path) -> None:
    settings = {
        "target": "gym:tests.workers.environments:Identity-discrete-v0", "cluster": "auto",
        "num_machines": 1, "num_engines": 2, "num_worlds": 3, "total_steps": 96, "seed": 5,
        "runs": str(tmp_path), "name": "sweep", "ppo": PPO,
    }  # fmt: skip
    space = {"ppo.learning_rate": "log:1e-4:1e-2"}
    sweep = run_sweep(SweepConfig(space, (Layer("test", settings),)), 2)
    assert [trial.state for trial in sweep.trials] == ["complete"] * 2
    assert len({trial.score for trial in sweep.trials}) > 1
    require_no_actors(cluster)


def test_a_rollout_that_is_larger_than_the_object_store(cluster: Any, tmp_path: Path) -> None:
    assert train(large_rollout(tmp_path)).stop_reason == "total_steps"


def test_the_cluster_is_checked(cluster: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cluster", "check", "cartpole", "--seconds", "1", "--json"]) == 0
    reports = json.loads(capsys.readouterr().out)
    assert len(reports) >= 2
    for report in reports:
        assert report["error"] == ""
        assert report["facts"]["ludus"] == __version__
        assert report["facts"]["engines"]
        assert report["agent_steps_per_s"] > 100
        assert report["megabytes_per_s"] > 1
