"""Wrong arguments of public functions: one clear error each, whatever came."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import ludus
from ludus.errors import ArgumentError, UsageError

ODD: tuple[Any, ...] = (3, -1, 1.5, True, "x", b"x", [], ["x"], {}, object(), None)
GAME = "gym:CartPole-v1"
SMALL: dict[str, Any] = {
    "num_worlds": 2, "num_engines": 1, "seed": 3, "total_steps": 16, "evaluation_episodes": 0,
    "ppo": {"rollout_steps": 8, "hidden_sizes": [8]}, "progress": False,
}  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> ludus.Run:
    return ludus.train(GAME, runs=tmp_path_factory.mktemp("runs"), name="run", **SMALL)


MESSAGES: list[tuple[Callable[..., Any], dict[str, Any], str]] = [
    (ludus.load_policy, {"path": 3}, "load_policy: path must be a text or a path, not 3"),
    (ludus.load_policy, {"path": "x", "policy": 3}, "policy must be a text or None, not 3"),
    (ludus.load_policy, {"path": "x", "networks": 3}, "networks must be a dictionary or None"),
    (ludus.load_policy, {"path": "x", "seed": 1.5}, r"seed must be a whole number, not 1\.5"),
    (ludus.load_policy, {"path": "x", "seed": -1}, r"seed must be an integer from 0 to 2\*\*63"),
    (ludus.evaluate, {"target": None}, "evaluate: target must be a text or a path, not None"),
    (ludus.evaluate, {"target": GAME, "policy": 3}, "policy must be a text or a path or a list"),
    (ludus.evaluate, {"target": GAME, "policy": [3]}, r"or None, not \[3\]"),
    (ludus.evaluate, {"target": GAME, "pool": 3}, "pool must be what ludus.open_pool returns"),
    (ludus.train, {"target": GAME, "resume": 3}, "resume must be a text or a path or None"),
    (ludus.train, {"target": GAME, "on_update": 3}, "on_update must be a function or None, not 3"),
    (ludus.train, {"target": GAME, "progress": "no"}, "progress must be True or False or None"),
    (ludus.sweep, {"target": GAME, "space": 3}, "space must be a dictionary or None, not 3"),
    (ludus.sweep, {"objective": "x"}, "objective must be 'return' or 'steps' or None, not 'x'"),
    (ludus.make, {"target": 3}, "make: target must be a text or a path, not 3"),
    (ludus.make_vec, {"target": GAME, "others": 3}, "others must be a dictionary or None, not 3"),
    (ludus.open_pool, {"target": GAME, "config": 3}, "config must be PoolConfig or None, not 3"),
]


@pytest.mark.parametrize(
    ("function", "arguments", "message"), MESSAGES, ids=[message for *_, message in MESSAGES]
)
def test_a_wrong_argument_is_named(
    function: Callable[..., Any], arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        function(**arguments)


def test_it_is_a_type_error_too() -> None:
    path: Any = 3
    with pytest.raises(TypeError):
        ludus.load_policy(path)
    with pytest.raises(ArgumentError):
        ludus.load_policy(path)


def _calls(run: ludus.Run, folder: Path) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    acting: dict[str, Any] = {"seed": 0, "stochastic": False}
    own: dict[str, Any] = {"networks": None, "learners": None, "on_update": None, "resume": None}
    env: dict[str, Any] = {"target": GAME, "policy": None, "others": None, "render_mode": None}
    return {
        "load_policy": (
            ludus.load_policy,
            {"path": run.path, "policy": None, "checkpoint": "newest", "networks": None, "seed": 0},
        ),
        "evaluate": (
            ludus.evaluate,
            {"target": run.path, "policy": None, "episodes": 1, "pool": None, **acting},
        ),
        "train": (
            ludus.train,
            {"target": GAME, "config": None, "pool": None, **own, "runs": folder, **SMALL},
        ),
        "run.evaluate": (run.evaluate, {"episodes": 1, **acting}),
        "run.export": (
            run.export,
            {"to": None, "policy": None, "checkpoint": "newest", "parity": False},
        ),
        "make": (ludus.make, env),
        "make_vec": (ludus.make_vec, {**env, "num_worlds": 1, "autoreset_mode": "same_step"}),
        "open_pool": (ludus.open_pool, {"target": GAME, "config": None}),
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "load_policy",
        "evaluate",
        "train",
        "run.evaluate",
        "run.export",
        "make",
        "make_vec",
        "open_pool",
    ],
)
def test_no_value_of_any_argument_raises_anything_else(
    name: str, run: ludus.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # some values are names of new files
    function, right = _calls(run, tmp_path)[name]
    num_refused = 0
    for argument in right:
        for value in ODD:
            try:
                answer = function(**{**right, argument: value})
            except ludus.LudusError:
                num_refused += 1
            else:
                if hasattr(answer, "close"):
                    answer.close()
    assert num_refused > 2 * len(right)
