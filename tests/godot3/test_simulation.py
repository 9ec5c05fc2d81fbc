"""What holds for games in code only in Godot 3; the rest is in ``tests/godot``."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

import numpy as np
import pytest

import ludus
from ludus.engine import InstalledEngine
from ludus.errors import LudusError
from ludus.pool import PoolConfig, open_pool
from tests.godot.test_simulation_leaks import WARNING, last_words
from tests.godot3.simulation_games import write_project

pytestmark = pytest.mark.engine
PAGE = (Path(__file__).parents[2] / "docs/godot3.md").read_text()
# Scripts that refer to each other stay in memory until the end; Godot 3 says so of every game.
SCRIPTS = ("GDScript", "GDScriptNativeClass")


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulations3")
    write_project(folder)
    return folder


@pytest.mark.parametrize("layout", ["isolated", "grid"])
def test_the_wall_of_the_page_is_seen_where_it_is(project: Path, layout: str) -> None:
    (wall,) = re.findall(r"```gdscript\n(extends LudusSimulation.*?)```", PAGE, re.DOTALL)
    (project / "wall.gd").write_text(wall)
    (project / "wall.tscn").write_text(
        (project / "rounds.tscn").read_text().replace("rounds", "wall")
    )
    with contextlib.closing(
        ludus.make_vec(project / "wall.tscn", num_worlds=3, layout=layout)
    ) as envs:
        first = envs.reset(seed=0)[0]["distance"].copy()
        assert ((first > 149 / 500) & (first < 201 / 500)).all() and len(set(first[:, 0])) == 3
        for step in range(1, 4):
            seen = envs.step(np.ones((3, 1), np.float32))[0]["distance"]
            np.testing.assert_allclose(seen, first - step * 5 / 500, atol=1e-3)


def leaked(lines: list[str]) -> list[str]:
    """Return the classes of the objects that were never freed, without scripts."""
    found = [line.split(":")[1].strip() for line in lines if line.startswith("Leaked instance:")]
    assert found, "Godot has told nothing"
    return [name for name in found if name not in SCRIPTS]


@pytest.mark.parametrize("name", ["rounds", "fall", "clean"])
@pytest.mark.parametrize("layout", ["isolated", "grid"])
def test_nothing_is_left_behind(
    godot3: InstalledEngine, project: Path, name: str, layout: str
) -> None:
    lines = last_words(godot3, project, name, layout)
    assert leaked(lines) == []
    assert [line for line in lines if "behind" in line] == []


def test_a_beginning_that_never_ends_leaves_nothing(godot3: InstalledEngine, project: Path) -> None:
    assert leaked(last_words(godot3, project, "endless", "isolated")) == []


@pytest.mark.parametrize("layout", ["isolated", "grid"])
def test_what_is_left_behind_is_told_once(
    godot3: InstalledEngine, project: Path, layout: str
) -> None:
    lines = last_words(godot3, project, "leaky", layout)
    told = [line for line in lines if "ludus" in line and "behind" in line]
    assert len(told) == 1
    assert told[0].startswith(WARNING)
    assert leaked(lines).count("Physics2DDirectBodyStateSW") == 4
    assert leaked(lines).count("BulletPhysicsDirectBodyState") == 4


def test_more_spaces_than_bullet_can_move_are_refused(project: Path) -> None:
    for num_worlds, is_refused in ((126, False), (127, True)):
        with open_pool(
            project / "crowd.tscn", PoolConfig(num_worlds=num_worlds, layout="isolated")
        ) as pool:
            if not is_refused:
                assert pool.reset(1)["watcher"].active.all()
                continue
            with pytest.raises(LudusError, match="127 3D spaces: Bullet can keep 126"):
                pool.reset(1)
