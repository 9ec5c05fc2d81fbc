"""Environments in other processes, in notebooks and under asyncio; real Godot."""

from __future__ import annotations

import asyncio
import multiprocessing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import ludus
from ludus.errors import SequenceError

pytestmark = [
    pytest.mark.engine,
    # Python's own advice against fork, which these tests are about.
    pytest.mark.filterwarnings("ignore:.*use of fork.* may lead to deadlocks:DeprecationWarning"),
]

METHODS = ["spawn", "forkserver", "fork"]


@pytest.fixture
def env(oracle: Path) -> Iterator[ludus.LudusEnv]:
    env = ludus.make(oracle)
    yield env
    env.close()


def play(env: ludus.LudusEnv) -> list[list[float]]:
    """Play the first steps of one episode; return what was observed."""
    return [env.reset(seed=5)[0].tolist()] + [env.step(action)[0].tolist() for action in range(4)]


def make_and_play(target: Path, answers: Any) -> None:
    env = ludus.make(target)
    answers.put(play(env))
    env.close()


def play_and_close(env: ludus.LudusEnv, answers: Any) -> None:
    answers.put(play(env))
    env.close()


def try_to_use(env: ludus.LudusEnv, answers: Any) -> None:
    try:
        env.reset(seed=5)
    except SequenceError as error:
        answers.put(str(error))
    env.close()


def in_child(method: str, function: Callable[..., None], *args: Any) -> Any:
    """Return what a function puts into a queue in another process, which must end by itself."""
    context: Any = multiprocessing.get_context(method)
    answers = context.Queue()
    child = context.Process(target=function, args=(*args, answers))
    child.start()
    answer = answers.get(timeout=100)
    child.join(30)
    assert child.exitcode == 0
    return answer


@pytest.mark.parametrize("method", METHODS)
def test_a_child_process_makes_a_game_beside_its_parents(
    method: str, env: ludus.LudusEnv, oracle: Path
) -> None:
    seen = play(env)
    assert in_child(method, make_and_play, oracle) == seen
    assert play(env) == seen


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_a_pickled_environment_starts_a_game_of_its_own(method: str, env: ludus.LudusEnv) -> None:
    seen = play(env)
    assert in_child(method, play_and_close, env) == seen
    assert play(env) == seen


def test_a_forked_copy_cannot_disturb_its_parents_game(env: ludus.LudusEnv) -> None:
    seen = play(env)
    refusal = in_child("fork", try_to_use, env)
    assert "is a forked copy of it" in refusal
    assert "hint: start a game in the forked process" in refusal
    assert play(env) == seen
    assert env.pool.num_restarts == 0


@pytest.mark.parametrize("method", METHODS)
def test_async_vector_env_of_gymnasium_takes_our_ids(method: str) -> None:
    def make() -> gymnasium.Env[Any, Any]:
        return gymnasium.make("ludus:ludus/CartPole-v0")

    envs = gymnasium.vector.AsyncVectorEnv([make, make], context=method)
    single = make()
    try:
        observations, _ = envs.reset(seed=[3, 4])
        for seed, row in zip([3, 4], observations, strict=True):
            np.testing.assert_array_equal(single.reset(seed=seed)[0], row)
    finally:
        envs.close()
        single.close()


def test_environments_step_in_threads_of_a_running_loop(env: ludus.LudusEnv, oracle: Path) -> None:
    async def main() -> None:
        seen = play(env)  # a call that blocks the loop is allowed
        other = await asyncio.to_thread(ludus.make, oracle)
        try:
            both = await asyncio.gather(*(asyncio.to_thread(play, one) for one in (env, other)))
        finally:
            other.close()
        assert both == [seen, seen]

    asyncio.run(main())


CELLS = [
    "import asyncio, ludus",
    "envs = ludus.make_vec({oracle!r}, num_worlds=2)\n"
    "observations, infos = envs.reset(seed=5)\nprint(envs.step([1, 2])[0][:, 2])",
    # A notebook's cells run in a loop, and may await.
    "(answer,) = await asyncio.gather(asyncio.to_thread(envs.step, [3, 4]))\n"
    "print(answer[0][:, 2])",
    "envs.close()",
    "run = ludus.train({oracle!r}, runs={runs!r}, num_worlds=2, num_engines=1, total_steps=64,\n"
    "    evaluation_episodes=2, ppo=dict(rollout_steps=8, hidden_sizes=[8]))\n"
    "print(run.agent_steps)",
]


@pytest.mark.slow
@pytest.mark.timeout(400, func_only=True)
def test_a_notebook_plays_awaits_and_shows_a_training_run(oracle: Path, tmp_path: Path) -> None:
    import nbclient
    import nbformat

    values = {"oracle": str(oracle), "runs": str(tmp_path)}
    v4: Any = nbformat.v4
    cells = [v4.new_code_cell(cell.format(**values)) for cell in CELLS]
    notebook = v4.new_notebook(cells=cells)
    nbclient.NotebookClient(notebook, timeout=300).execute(cwd=str(tmp_path))
    outputs = [output for cell in notebook.cells for output in cell.outputs]
    printed = "".join(output.text for output in outputs if output.get("name") == "stdout")
    assert printed.splitlines() == ["[1. 2.]", "[3. 4.]", "64"]
    shown = [output for output in outputs if output.output_type == "display_data"]
    assert len(shown) == 1, "one output, which is drawn again and again"
    text = shown[0].data["text/plain"]
    assert text.startswith(f"training {oracle} into {tmp_path}")
    assert "64 agent steps" in text
    assert "│ oracle │        2 │" in text
