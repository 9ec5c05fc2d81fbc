"""The simulations of docs/simulations.md work as they stand there."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import ludus
from ludus.check import CheckConfig, Status, run_checks
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.spec.batch import ActionBatch
from tests.godot_project import write_project

pytestmark = [pytest.mark.engine, pytest.mark.games]
PAGE = (Path(__file__).parents[2] / "docs/simulations.md").read_text()


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    chase, wall = re.findall(r"```gdscript\n(.*?)```", PAGE, re.DOTALL)
    (scene,) = re.findall(r"```\n(\[gd_scene.*?)```", PAGE, re.DOTALL)
    scenes = {"chase.tscn": scene, "wall.tscn": scene.replace("chase", "wall")}
    files = {"chase.gd": chase, "wall.gd": wall, **scenes}
    return write_project(tmp_path_factory.mktemp("page"), files, main="chase")


@pytest.fixture
def chase(project: Path) -> Iterator[EnginePool]:
    with open_pool(project / "chase.tscn", PoolConfig(num_worlds=8)) as pool:
        yield pool


def test_the_chase(chase: EnginePool) -> None:
    """A chaser that runs towards the runner, who stands still, always catches him."""
    assert [policy.agents[0].path for policy in chase.spec.policies] == ["chaser0", "runner0"]
    batches = chase.reset(0)
    caught = np.zeros(8, bool)
    for _ in range(80):
        actions = {name: ActionBatch.zeros(own, 8) for name, own in chase.policies.items()}
        own, other = batches["chaser"].observation["places"].T.copy()
        chaser, runner = actions["chaser"].discrete, actions["runner"].discrete
        assert chaser is not None and runner is not None
        chaser[:, 0] = 1 + np.sign(other - own)
        runner[:] = 1
        batches = chase.step(actions)
        ended = batches["chaser"].terminated
        assert (ended == batches["runner"].terminated).all()
        np.testing.assert_allclose(batches["chaser"].reward, np.where(ended, 1.0, -0.01), atol=1e-6)
        np.testing.assert_allclose(batches["runner"].reward, np.where(ended, -1.0, 0.01), atol=1e-6)
        caught |= ended
    assert caught.all()


@pytest.mark.parametrize("layout", ["isolated", "grid"])
def test_the_wall_is_seen_where_it_is(project: Path, layout: str) -> None:
    with contextlib.closing(
        ludus.make_vec(project / "wall.tscn", num_worlds=3, layout=layout)
    ) as envs:
        first = envs.reset(seed=0)[0]["distance"].copy()
        assert ((first > 149 / 500) & (first < 201 / 500)).all() and len(set(first[:, 0])) == 3
        for step in range(1, 4):
            seen = envs.step(np.ones((3, 1), np.float32))[0]["distance"]
            np.testing.assert_allclose(seen, first - step * 5 / 500, atol=1e-3)


@pytest.mark.parametrize("name", ["chase", "wall"])
def test_both_pass_the_checks(project: Path, name: str) -> None:
    config = CheckConfig(
        target=project / f"{name}.tscn",
        num_worlds=3,
        num_steps=40,
        num_layout_worlds=4,
        timing_s=0.05,
    )
    findings = run_checks(config).findings
    assert [f.title for _, f in findings if f.status is Status.FAIL] == []
