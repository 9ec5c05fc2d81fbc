"""What other libraries' interfaces cost: pairs of ways to step the same game, in turn.

.venv/libraries/all/bin/python benchmarks/libraries.py [sb3] [rgb_array] [autoreset] [gymnasium]
    [rllib]
"""

# The types of these libraries are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false
from __future__ import annotations

import statistics
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

import ludus

TURNS = 5
SECONDS = 3.0

Turn = Callable[[], int]
"""Plays a little; returns the agents' steps."""


def compare(title: str, first: tuple[str, Turn], second: tuple[str, Turn]) -> None:
    """Print steps/s of both, and the median ratio of neighbouring turns."""
    pairs = [(_rate(first[1]), _rate(second[1])) for _ in range(TURNS + 1)][1:]
    _print_pairs(title, (first[0], second[0]), pairs)


def _print_pairs(title: str, names: tuple[str, str], pairs: list[tuple[float, float]]) -> None:
    ratio = statistics.median(one / other for one, other in pairs)
    one, other = (statistics.median(column) for column in zip(*pairs, strict=True))
    print(f"{title}: {names[0]} {one:,.0f}, {names[1]} {other:,.0f} steps/s; ratio {ratio:.2f}")


def _rate(turn: Turn) -> float:
    start, steps = time.perf_counter(), 0
    while time.perf_counter() - start < SECONDS:
        steps += turn()
    return steps / (time.perf_counter() - start)


def _stepper(envs: Any, num: int, *, is_random: bool = False) -> Turn:
    envs.reset()
    actions = np.random.default_rng(1).integers(0, 2, (20, num)) * is_random

    def turn() -> int:
        for row in actions:
            envs.step(row)
        return 20 * num

    return turn


def sb3() -> None:
    """Compare with our own vector environment."""
    import ludus.sb3

    own, theirs = (make("cartpole", num_worlds=1024) for make in (ludus.make_vec, ludus.sb3.make))
    compare("1,024 cartpoles", ("sb3", _stepper(theirs, 1024)), ("make_vec", _stepper(own, 1024)))
    own.close()
    _print_share(theirs)
    theirs.close()


def _print_share(env: Any, num_steps: int = 200) -> None:
    """Print what the ``VecEnv`` adds in CPU time, which other programs hardly change."""
    inner, spent = env.envs.step, [0.0]

    def step(actions: Any) -> Any:
        start = time.thread_time()
        answer = inner(actions)
        spent[0] += time.thread_time() - start
        return answer

    env.envs.step = step
    actions, start = np.zeros(env.num_envs, np.int64), time.thread_time()
    for _ in range(num_steps):
        env.step(actions)
    added = time.thread_time() - start - spent[0]
    ms = [1000 * seconds / num_steps for seconds in (added, spent[0])]
    print(f"CPU time in Python: {ms[0]:.3f} ms a step beside make_vec's {ms[1]:.3f} ms")


def rgb_array() -> None:
    """Compare steps with and without ``render_mode="rgb_array"``; nothing is drawn.

    One game at a time, since only the one that cannot draw has a core of its own.
    """

    def alone(render_mode: str | None) -> float:
        envs = ludus.make_vec("cartpole", num_worlds=64, render_mode=render_mode)
        turn = _stepper(envs, 64)
        _rate(turn)
        rate = _rate(turn)
        envs.close()
        return rate

    pairs = [(alone("rgb_array"), alone(None)) for _ in range(TURNS)]
    _print_pairs("64 cartpoles", ("rgb_array", "None"), pairs)


def autoreset() -> None:
    """Compare next-step with same-step autoreset with random play, of one world and of 64."""
    for num in (1, 64):
        modes = ("next_step", "same_step")
        pair = [ludus.make_vec("cartpole", num_worlds=num, autoreset_mode=mode) for mode in modes]
        first, second = (
            (mode, _stepper(envs, num, is_random=True))
            for mode, envs in zip(modes, pair, strict=True)
        )
        compare(f"{num} cartpoles at random", first, second)
        for envs in pair:
            envs.close()


def gymnasium_cartpole() -> None:
    """Compare Godot with Gymnasium's own CartPole, both as vector environments."""
    own = ludus.make_vec("cartpole", num_worlds=64)
    theirs = gymnasium.make_vec("CartPole-v1", num_envs=64, vectorization_mode="sync")
    compare("64 cartpoles", ("Godot", _stepper(own, 64)), ("SyncVectorEnv", _stepper(theirs, 64)))
    own.close()
    theirs.close()


def rllib() -> None:
    """Compare our runner with RLlib's on ball_chase, with the same module."""
    import ray
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.env.multi_agent_env_runner import MultiAgentEnvRunner

    from ludus.rllib import LudusEnvRunner, LudusMultiAgentEnv, policy_of

    ray.init(address="local", num_cpus=2, include_dashboard=False, log_to_driver=False)

    def runner(kind: Any, worlds: int, steps: int, engines: int = 1) -> Turn:
        settings: dict[str, Any] = {"target": "ball_chase"}
        if engines > 1:
            settings |= {"num_engines": engines, "num_worlds": worlds // engines}
        config: Any = PPOConfig()
        config = config.environment(LudusMultiAgentEnv, env_config=settings)
        config = config.env_runners(num_env_runners=0, num_envs_per_env_runner=worlds)
        config = config.multi_agent(policies={"chaser"}, policy_mapping_fn=policy_of)
        own = kind(config=config, worker_index=0)

        def turn() -> int:
            own.sample(num_timesteps=steps * worlds)
            return steps * worlds * 16

        return turn

    # Each of the worlds of RLlib's own runner is an engine of its own.
    compare(
        "ball_chase",
        ("LudusEnvRunner with 8 worlds", runner(LudusEnvRunner, 8, 32)),
        ("MultiAgentEnvRunner with 8", runner(MultiAgentEnvRunner, 8, 32)),
    )
    compare(
        "ball_chase",
        ("LudusEnvRunner with 32 worlds", runner(LudusEnvRunner, 32, 32)),
        ("MultiAgentEnvRunner with 1", runner(MultiAgentEnvRunner, 1, 32)),
    )
    compare(
        "ball_chase",
        ("LudusEnvRunner with 2 engines of 32 worlds", runner(LudusEnvRunner, 64, 32, 2)),
        ("MultiAgentEnvRunner with 8", runner(MultiAgentEnvRunner, 8, 32)),
    )
    ray.shutdown()


TABLE = {
    "sb3": sb3,
    "rgb_array": rgb_array,
    "autoreset": autoreset,
    "gymnasium": gymnasium_cartpole,
    "rllib": rllib,
}

if __name__ == "__main__":
    warnings.simplefilter("ignore")
    for name in sys.argv[1:] or TABLE:
        TABLE[name]()
