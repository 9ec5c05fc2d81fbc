"""The policies that come with the examples play them well, inside a real Godot, without Python."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from ludus.engine import InstalledEngine
from ludus.engine.bundled import bundled_root
from ludus.model import PolicyModel, read_model, write_model
from ludus.model.policy_model import Distribution, Linear
from ludus.play.in_engine import play_in_engine
from ludus.play.interactive import PlayConfig
from ludus.settings.train_config import PPOConfig
from ludus.spec import ContinuousAction, ObservationEntry

pytestmark = pytest.mark.engine

NUM_ROUNDS = 200
NUM_REPORTS = 2 * NUM_ROUNDS
"""Each of two zombies reports a round."""
MAX_FILE_BYTES = 1_000_000
NOT_FOUND = -60.0
"""Return of a hero that has not touched the target within its 60 steps; any other is higher."""
SOLDIER_WON = 27.9
"""A soldier that has killed both zombies has a return of 28; any other has less than 15."""
SHIPPED = [("find_coin", "hero"), ("find_coin", "target"), ("zombies", "soldier")]


def shipped(game: str, policy: str) -> Path:
    return bundled_root() / "examples" / game / f"{policy}.ludus.json"


def write_untrained(path: Path, policy: str, num_inputs: int, component: ContinuousAction) -> None:
    """Write a policy that acts at random, as one does that has not learnt yet."""
    nothing = np.zeros((component.size, num_inputs), np.float32)
    model = PolicyModel(
        policy=policy,
        fingerprint="",
        observation=(ObservationEntry("observation", "float32", (num_inputs,)),),
        action=(component,),
        has_action_mask=False,
        normalisation=None,
        images=(),
        memory=None,
        layers=(Linear(nothing, np.zeros(component.size, np.float32), "none"),),
        distribution=Distribution(np.full(component.size, PPOConfig().initial_log_std, np.float32)),
    )
    write_model(path, model)


@pytest.fixture
def seeded_godot(godot4: InstalledEngine, tmp_path: Path) -> Path:
    """A Godot whose worlds, which draw their seeds themselves, draw the same in every run."""
    script, program = tmp_path / "seed.gd", tmp_path / "seeded"
    script.write_text("extends SceneTree\nfunc _init() -> void:\n\tseed(1)\n")
    godot = godot4.executable(headless=True)
    program.write_text(
        f"""#!/bin/sh
case " $* " in *" --import "* | *" --version "*) exec '{godot}' "$@" ;; esac
exec '{godot}' -s '{script}' "$@"
"""
    )
    program.chmod(0o755)
    return program


def returns_of(game: str, policy: str, others: dict[str, Path], godot: Path) -> list[float]:
    """Play the scene with its own policies, but ``others`` from files and by chance."""
    returns: defaultdict[str, list[float]] = defaultdict(list)

    def hear(name: str, _number: int, episode_return: float, _length: int) -> None:
        returns[name].append(episode_return)

    config = PlayConfig(
        target=game,
        scene=f"res://examples/{game}/trained.tscn",
        is_headless=True,
        num_episodes=NUM_REPORTS,
        godot=godot,
    )
    play_in_engine(config, others, hear, is_stochastic=True)
    assert len(returns[policy]) >= NUM_ROUNDS - 1
    return returns[policy]


@pytest.mark.parametrize(("game", "policy"), SHIPPED)
def test_files_are_small_and_for_the_policy_they_are_named_after(game: str, policy: str) -> None:
    path = shipped(game, policy)
    assert path.stat().st_size < MAX_FILE_BYTES
    assert read_model(path).policy == policy


@pytest.mark.training
def test_the_hero_finds_a_target_that_moves_at_random(tmp_path: Path, seeded_godot: Path) -> None:
    target = tmp_path / "target.ludus.json"
    write_untrained(target, "target", 251, ContinuousAction("move", 2))
    returns = returns_of("find_coin", "hero", {"target": target}, seeded_godot)
    assert np.mean(np.array(returns) > NOT_FOUND) >= 0.85


@pytest.mark.training
def test_the_target_gets_away_from_the_hero(seeded_godot: Path) -> None:
    hero = shipped("find_coin", "hero")
    returns = returns_of("find_coin", "target", {"hero": hero}, seeded_godot)
    assert np.mean(np.array(returns) < -NOT_FOUND) <= 0.55


@pytest.mark.training
def test_the_soldier_wins_against_zombies_that_move_at_random(
    tmp_path: Path, seeded_godot: Path
) -> None:
    zombie = tmp_path / "zombie.ludus.json"
    write_untrained(zombie, "zombie", 514, ContinuousAction("act", 3))
    returns = returns_of("zombies", "soldier", {"zombie": zombie}, seeded_godot)
    assert np.mean(np.array(returns) > SOLDIER_WON) >= 0.75
