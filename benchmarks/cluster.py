"""What a cluster costs, how far it scales, and how much one learner takes in; all need Ray.

    make test-cluster                                        # brings the environment
    PYTHON=.venv/libraries/all/bin/python
    $PYTHON benchmarks/cluster.py overhead --rounds 5        # one Ray worker, no cluster, in turns
    $PYTHON benchmarks/cluster.py scaling --rounds 3         # a game that sleeps, 1 to 16 workers
    $PYTHON benchmarks/cluster.py scaling --rounds 3 --game godot
    $PYTHON benchmarks/cluster.py learner --rounds 3         # workers that replay one rollout
    $PYTHON benchmarks/cluster.py rllib --rounds 3           # RLlib with as many workers

Each prints a table. They need a quiet machine; the first rounds of a process do not count.
"""

# The types of these libraries are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
from __future__ import annotations

import contextlib
import os
import pickle
import statistics
import tempfile
import time
import warnings
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from sleeping import SLEEP_MS, WIDTHS

import ludus
from ludus.addon.new_project import ProjectKind, make_project
from ludus.settings.train_config import TrainConfig
from ludus.workers import opening
from ludus.workers.worker import Worker

WARM_S = 2.0
"""Seconds at the start of each run that do not count."""


@dataclass(frozen=True)
class Overhead:
    """Train with one Ray worker and without a cluster, in turns.

    Attributes:
        rounds: Pairs of runs; the median of their ratios counts.
        seconds: Of each run.
        targets: Games, each with its number of worlds.
        engines: Of the one machine.
    """

    rounds: int = 5
    seconds: float = 10.0
    targets: tuple[str, ...] = ("cartpole:64", "ball_chase:4", "find_coin:50")
    engines: int = 1


@dataclass(frozen=True)
class Scaling:
    """Train with a growing number of workers whose game sleeps.

    Attributes:
        rounds: Runs of each size, in turns; medians count.
        seconds: Of each run.
        workers: How many.
        game: gym (`Sleeping-v0`) or godot (a project that sleeps in each physics tick).
        sleep_ms: Of each step; none: 5, or as much as the largest number of workers needs to take
            half of the cores.
        cluster: Worker processes, or nodes of a Ray cluster on this machine.
    """

    rounds: int = 3
    seconds: float = 10.0
    workers: tuple[int, ...] = (1, 2, 4, 8, 16)
    game: Literal["gym", "godot"] = "gym"
    sleep_ms: float | None = None
    cluster: Literal["local", "ray"] = "local"


@dataclass(frozen=True)
class Learner:
    """Let workers replay what they recorded once: what is left is the learner's own time.

    Attributes:
        rounds: Runs of each size; medians count.
        seconds: Of each run.
        workers: How many replay.
        worlds: Of each worker.
    """

    rounds: int = 3
    seconds: float = 6.0
    workers: int = 4
    worlds: int = 64


@dataclass(frozen=True)
class RLlib:
    """Train on ball_chase with RLlib's MultiAgentEnvRunner and with a cluster, in turns.

    Attributes:
        rounds: Pairs of runs; the median of their ratios counts.
        seconds: Of each run.
        workers: Processes that play, of both.
        worlds: Of each worker of ours, in one engine.
        envs: Of each runner of RLlib, each an engine.
    """

    rounds: int = 3
    seconds: float = 20.0
    workers: tuple[int, ...] = (1, 2)
    worlds: int = 8
    envs: int = 1


def agent_steps_per_s(seconds: float, target: str, **settings: Any) -> float:
    """Train, and return the agent-steps/s by the clock, without the start."""
    begun_s: list[float] = []
    marks: list[tuple[float, int]] = []

    def mark(training: Any) -> None:
        now = time.perf_counter()
        begun_s.append(now)
        if now - begun_s[0] > WARM_S:
            marks.append((now, training.progress.agent_steps))
            if len(marks) > 1 and now - marks[0][0] > seconds:
                training.stop()

    with tempfile.TemporaryDirectory() as runs:
        ludus.train(
            target, runs=Path(runs), name="run", total_steps=10**12, checkpoint_every_s=None,
            evaluation_episodes=0, seed=1, on_update=mark, progress=False, **settings,
        )  # fmt: skip
    first, last = marks[0], marks[-1]
    return (last[1] - first[1]) / (last[0] - first[0])


@contextlib.contextmanager
def ray_cluster(nodes: int) -> Generator[None, None, None]:
    """Start a Ray cluster on this machine: a head that plays nothing, and nodes."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    import ray
    from ray.cluster_utils import Cluster

    head = {"num_cpus": 0, "include_dashboard": False}
    cluster: Any = Cluster(initialize_head=True, connect=True, head_node_args=head)
    try:
        for _ in range(nodes):
            cluster.add_node(num_cpus=1)
        cluster.wait_for_nodes()
        yield
    finally:
        ray.shutdown()
        cluster.shutdown()


def print_table(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a table in Markdown."""
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for row in rows:
        print(f"| {' | '.join(map(str, row))} |")
    print(f"\n{os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f} at the end", flush=True)


# --- one worker beside none ---------------------------------------------------------------------


def measure_overhead(options: Overhead) -> None:
    """Print how fast one Ray worker is beside the local trainer."""
    rows: list[list[object]] = []
    with ray_cluster(1):
        for target in options.targets:
            for overlap in (False, True):
                game, _, worlds = target.partition(":")
                settings: dict[str, Any] = {
                    "num_worlds": int(worlds), "num_engines": options.engines,
                    "ppo": {"overlap": overlap},
                }  # fmt: skip

                def run(target: str = game, of: Any = settings, **cluster: Any) -> float:
                    return agent_steps_per_s(options.seconds, target, **of, **cluster)

                pairs = [
                    (run(cluster="auto", num_machines=1), run()) for _ in range(options.rounds)
                ]
                ratios = sorted(one / other for one, other in pairs)
                spread, alone = (statistics.median(each) for each in zip(*pairs, strict=True))
                rows.append([game, worlds, "overlap" if overlap else "", f"{spread:,.0f}",
                             f"{alone:,.0f}", f"{statistics.median(ratios):.3f}",
                             f"{ratios[0]:.3f} to {ratios[-1]:.3f}"])  # fmt: skip
                print(*rows[-1], flush=True)
    print_table(["game", "worlds", "", "one Ray worker", "no cluster", "ratio", "of pairs"], rows)


# --- weak scaling -------------------------------------------------------------------------------


def measure_scaling(options: Scaling) -> None:
    """Print agent-steps/s by the number of workers, and their share of perfect scaling."""
    with tempfile.TemporaryDirectory() as folder:
        target = "gym:sleeping:Sleeping-v0"
        if options.game == "godot":
            target = str(_sleeping_game(Path(folder) / "sleeping"))
        os.environ[SLEEP_MS] = "0"
        step_ms = 1000 / agent_steps_per_s(2.0, target, **_one_world(), cluster="local:1")
        cores = os.cpu_count() or 1
        sleep_ms = options.sleep_ms
        if sleep_ms is None:
            sleep_ms = max(5.0, step_ms * max(options.workers) / (0.5 * cores))
        os.environ[SLEEP_MS] = f"{sleep_ms:.3f}"
        print(
            f"a step without sleep takes {step_ms:.2f} ms; sleep is {sleep_ms:.1f} ms", flush=True
        )
        nodes = max(options.workers)
        with ray_cluster(nodes) if options.cluster == "ray" else contextlib.nullcontext():
            _print_scaling(options, target)


def _print_scaling(options: Scaling, target: str) -> None:
    speeds: dict[int, list[float]] = {num: [] for num in options.workers}
    for _ in range(options.rounds):
        for num, of in speeds.items():
            cluster: dict[str, Any] = {"cluster": f"local:{num}"}
            if options.cluster == "ray":
                cluster = {"cluster": "auto", "num_machines": num}
            of.append(agent_steps_per_s(options.seconds, target, **_one_world(), **cluster))
            print(f"{num} workers: {of[-1]:,.1f}", flush=True)
    first = statistics.median(speeds[options.workers[0]]) / options.workers[0]
    rows = [
        [num, f"{statistics.median(of):,.0f}", f"{statistics.median(of) / num / first:.3f}",
         f"{min(of):,.0f} to {max(of):,.0f}"]
        for num, of in speeds.items()
    ]  # fmt: skip
    print_table(["workers", "agent-steps/s", "weak scaling", "of rounds"], rows)


def _one_world() -> dict[str, Any]:
    return {"num_worlds": 1, "num_engines": 1, "is_pinned": False}


def _sleeping_game(folder: Path) -> Path:
    """Make a project whose physics ticks sleep as long as the environment variable says."""
    make_project(folder, ProjectKind.TWO_D)
    (folder / "sleep.gd").write_text(
        "extends Node\n\n\nfunc _physics_process(_delta: float) -> void:\n"
        f'\tOS.delay_usec(int(float(OS.get_environment("{SLEEP_MS}")) * 1000.0))\n'
    )
    with (folder / "project.godot").open("a") as settings:
        settings.write('\n[autoload]\n\nSleep="*res://sleep.gd"\n')
    return folder


# --- the learner's ceiling ----------------------------------------------------------------------


class Replaying:
    """A :class:`~ludus.workers.interface.Machine` that plays once, and hands that out for ever.

    What it hands out is pickled once and unpickled each time, as if it came through a pipe.
    """

    report_bytes = 0

    def __init__(self, config: TrainConfig, index: int, log_dir: Path | None) -> None:
        self.name = f"machine {index}"
        self._worker = Worker(config, index, log_dir)
        self._report: bytes | None = None
        self._answer = pickle.dumps(self._worker.spec, protocol=5)

    def send(self, method: str, *arguments: Any) -> None:
        """Answer with the first full report if there is one."""
        is_play = method == "play" and arguments[0].num_steps
        if is_play and self._report is not None:
            self._answer = self._report
            return
        self._answer = pickle.dumps(getattr(self._worker, method)(*arguments), protocol=5)
        if is_play:
            self._report = self._answer
            type(self).report_bytes = len(self._answer)

    def receive(self) -> Any:
        """Unpickle the answer."""
        return pickle.loads(self._answer)

    def close(self) -> None:
        """End the worker."""
        self._worker.close()


NETWORKS: dict[str, dict[str, Any]] = {
    "64, 64": {"hidden_sizes": (64, 64)},
    "256, 256": {"hidden_sizes": (256, 256)},
}


def measure_learner(options: Learner) -> None:
    """Print how many agent-steps/s one learner takes in, by observation and network."""
    opening.ProcessMachine = Replaying  # pyright: ignore[reportAttributeAccessIssue]
    rows: list[list[object]] = []
    for game in (*(f"Wide-{width}" for width in WIDTHS), "Pixels"):
        for network, ppo in NETWORKS.items():
            # Pictures are large, and go through a convolution: fewer worlds, or no update ends.
            worlds = options.worlds if game != "Pixels" else max(1, options.worlds // 8)
            speeds = [
                agent_steps_per_s(
                    options.seconds, f"gym:sleeping:{game}-v0", num_worlds=worlds, num_engines=1,
                    cluster=f"local:{options.workers}", ppo=ppo,
                )
                for _ in range(options.rounds)
            ]  # fmt: skip
            speed = statistics.median(speeds)
            step_bytes = Replaying.report_bytes / (worlds * 32)
            rows.append([game, network, f"{speed:,.0f}", f"{step_bytes:,.0f}",
                         f"{speed * step_bytes / 1e6:,.1f}",
                         f"{min(speeds):,.0f} to {max(speeds):,.0f}"])  # fmt: skip
            print(*rows[-1], flush=True)
    print_table(
        ["observation", "units", "agent-steps/s", "bytes a step", "MB/s", "of rounds"], rows
    )


# --- RLlib --------------------------------------------------------------------------------------


def measure_rllib(options: RLlib) -> None:
    """Print agent-steps/s of training on ball_chase, RLlib's and ours with as many workers."""
    rows: list[list[object]] = []
    for num in options.workers:
        pairs = [
            (
                agent_steps_per_s(
                    options.seconds, "ball_chase", num_worlds=options.worlds, num_engines=1,
                    cluster=f"local:{num}",
                ),
                _rllib_steps_per_s(options, num),
            )
            for _ in range(options.rounds)
        ]  # fmt: skip
        ours, theirs = (statistics.median(each) for each in zip(*pairs, strict=True))
        ratios = sorted(one / other for one, other in pairs)
        rows.append([num, f"{ours:,.0f}", f"{theirs:,.0f}", f"{statistics.median(ratios):.1f}",
                     f"{ratios[0]:.1f} to {ratios[-1]:.1f}"])  # fmt: skip
        print(*rows[-1], flush=True)
    print_table(["workers", "Ludus", "RLlib", "ratio", "of pairs"], rows)


def _rllib_steps_per_s(options: RLlib, workers: int) -> float:
    """Train with RLlib's own runners, network sizes and batches as ours have by default."""
    import ray
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    from ludus.rllib import LudusMultiAgentEnv, policy_of

    ray.init(address="local", num_cpus=workers + 1, include_dashboard=False, log_to_driver=False)
    config: Any = PPOConfig()
    config = (
        config.environment(LudusMultiAgentEnv, env_config={"target": "ball_chase"})
        .env_runners(num_env_runners=workers, num_envs_per_env_runner=options.envs)
        .multi_agent(policies={"chaser"}, policy_mapping_fn=policy_of)
        .rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[64, 64]))
        .training(
            # Steps of the environment; its 16 agents make as many transitions as ours, 4,096 for
            # each worker. RLlib compares the minibatch, of transitions, with them.
            train_batch_size_per_learner=256 * options.envs * workers, minibatch_size=1024,
            num_epochs=4,
        )
        .experimental(_validate_config=False)
    )  # fmt: skip
    algorithm = config.build_algo()
    try:
        start, steps = time.perf_counter(), 0
        algorithm.train()
        while time.perf_counter() - start < WARM_S:
            algorithm.train()
        start = time.perf_counter()
        while time.perf_counter() - start < options.seconds:
            result = algorithm.train()
            steps += sum(result["env_runners"]["num_agent_steps_sampled"].values())
        return steps / (time.perf_counter() - start)
    finally:
        algorithm.stop()
        ray.shutdown()


def main(
    options: Annotated[Overhead, tyro.conf.subcommand("overhead")]
    | Annotated[Scaling, tyro.conf.subcommand("scaling")]
    | Annotated[Learner, tyro.conf.subcommand("learner")]
    | Annotated[RLlib, tyro.conf.subcommand("rllib")],
) -> None:
    """Measure what the command line says."""
    warnings.simplefilter("ignore")
    if isinstance(options, Overhead):
        measure_overhead(options)
    elif isinstance(options, Scaling):
        measure_scaling(options)
    elif isinstance(options, Learner):
        measure_learner(options)
    else:
        measure_rllib(options)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes))
