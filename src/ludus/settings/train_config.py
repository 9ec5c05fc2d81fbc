"""Settings of a training run: one struct = command line = TOML file = scene settings.

How the layers are laid over each other is the business of :mod:`ludus.settings.merging`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from ludus.errors import ConfigError
from ludus.settings.checks import (
    ABOVE_0,
    AT_LEAST_0,
    AT_LEAST_1,
    FROM_0_TO_1,
    Check,
    Settings,
    optional,
    require,
    setting,
)
from ludus.settings.policy_config import Mode, PolicyConfig, PPOConfig, SACConfig
from ludus.settings.pool_config import DEFAULT_RESTARTS, GameConfig
from ludus.settings.world_parameters import Lesson, Parameter, check_lessons, check_parameters

__all__ = ["CHANGEABLE", "ImitationConfig", "LeagueConfig", "PPOConfig", "Phase", "PolicyConfig",
           "SACConfig", "Sink", "TrainConfig"]  # fmt: skip

Sink = Literal["wandb", "mlflow", "trackio"]
"""What metrics can be sent to, beside ``metrics.jsonl`` and TensorBoard."""


SEED = Check("from 0 to 2^63 - 1", lambda seed: 0 <= seed < 2**63)
LOCAL = r"local:([1-9][0-9]{0,2})"
"""How a number of worker processes of this machine is asked for."""

CLUSTER = Check(
    "local:N (N worker processes, 1 to 999), auto, or HOST:PORT of a Ray cluster",
    lambda cluster: re.fullmatch(rf"{LOCAL}|auto|(?!local:)\S+:[0-9]+", cluster) is not None,
)
FOLDER_NAME = Check(
    "a folder name",
    lambda name: (
        re.fullmatch(r"[^/\\\0\ud800-\udfff]*", name) is not None and name not in {".", ".."}
    ),
)


@dataclass(frozen=True)
class ImitationConfig(Settings):
    """How the demonstrations of ``imitate`` are learned from.

    Attributes:
        epochs: Passes over all demonstrations before training begins (behaviour cloning); 0 clones
            nothing.
        learning_rate: Step size of Adam while cloning.
        weight: Weight of the demonstrations' loss in that of PPO at the start; 0 ends imitation
            with cloning.
        decay: Factor by which that weight changes with each update.
    """

    epochs: int = setting(100, AT_LEAST_0)
    learning_rate: float = setting(1e-3, ABOVE_0)
    weight: float = setting(0.1, AT_LEAST_0)
    decay: float = setting(0.95, FROM_0_TO_1)


@dataclass(frozen=True)
class LeagueConfig(Settings):
    """Self-play against past selves.

    In a share of the worlds one side learns, and past versions of the policies play all other
    sides. A side is a policy; where there is only one policy, each agent of a world is a side.

    Attributes:
        share: Share of the worlds that are played like this; 0 turns self-play off.
        pool_size: Past selves of each policy to keep.
        snapshot_every_updates: Updates between two past selves.
        sampling: "uniform" draws all past selves equally often, "recent" prefers newer ones,
            "rating" those whose rating is closest to that of the side that learns.
        max_opponents: Past selves of each policy that play at the same time.
        elo_factor: How far one game moves a rating (K).
    """

    share: float = setting(0.0, FROM_0_TO_1)
    pool_size: int = setting(10, AT_LEAST_1)
    snapshot_every_updates: int = setting(20, AT_LEAST_1)
    sampling: Literal["uniform", "recent", "rating"] = "uniform"
    max_opponents: int = setting(4, AT_LEAST_1)
    elo_factor: float = setting(16.0, ABOVE_0)


@dataclass(frozen=True)
class Phase(Settings):
    """Part of a schedule of modes.

    Attributes:
        updates: How many updates it lasts.
        modes: Mode by policy; policies that are not named keep their own.
    """

    updates: int = setting(1, AT_LEAST_1)
    modes: dict[str, Mode] = field(default_factory=dict[str, Mode])


@dataclass(frozen=True, kw_only=True)
class TrainConfig(GameConfig):
    """Settings of a training run.

    Attributes:
        target: What to train in: an example, a project folder, a scene, an exported game, an
            address, or gym:ENV_ID for any Gymnasium environment.
        max_restarts: How many times, in total, engines that died or froze are restarted; on a
            cluster, in total per machine.
        cluster: Where the games are played: local:N for N worker processes of this machine, auto or
            HOST:PORT for the machines of a Ray cluster; if not given, this process plays itself.
        num_machines: Machines of the Ray cluster to play on, each with num_engines engines; all of
            them if not given.
        seed: Seed of worlds, networks and sampling; random if not given; saved in
            config.json.
        total_steps: Agent steps after which training ends.
        max_time_s: Seconds of training after which it ends, those before it was resumed included;
            no limit if not given.
        target_return: Training ends when the mean return of every policy reaches this, and with one
            policy, the evaluation reaches it too, but for chance.
        return_window: Number of episodes that the mean return covers.
        checkpoint_every_s: Seconds between checkpoints; with none, only checkpoint_every_updates
            counts.
        checkpoint_every_updates: Updates between checkpoints; if not given, only checkpoint_every_s
            counts.
        keep_checkpoints: How many of the newest checkpoints to keep; the best one is kept as well.
        keep_every_updates: Updates between checkpoints that are kept for good; if not given, no
            others are kept.
        exact_resume: Reset all worlds after each checkpoint, so that a resumed run repeats an
            uninterrupted one bit for bit if the engine is deterministic. Cuts episodes short, and
            needs checkpoint_every_updates, because clocks are not deterministic.
        evaluation_episodes: Episodes of the evaluation at the end; 0 skips it.
        track: Also send metrics to Weights & Biases (wandb), MLflow (mlflow) or Trackio (trackio).
        runs: Folder in which run folders are made.
        name: Name of the run folder; if empty, it is the target with date and time.
        device: PyTorch device of networks and updates, such as cpu or cuda; auto tries both for
            each policy where there is a GPU, and takes the faster.
        precision: "bfloat16" computes updates in mixed precision, "float32" does not; auto mixes
            on cuda only.
        compile: Compile the networks' updates with torch.compile; takes a minute at the start.
        torch_threads: Threads PyTorch may use; engines need the other cores.
        algorithm: Algorithm of every policy; if not given, the one that the scene names, or else
            ppo.
        ppo: Settings of every policy trained with PPO.
        sac: Settings of every policy trained with SAC.
        policies: Settings of single policies by name, over those of their algorithm.
        alternate_every: Let policies learn in turn, for this many updates each, while the others
            act frozen; if not given, all learn at once.
        schedule: Phases of modes, repeated in order; a table of a settings file.
        league: Self-play against past selves.
        imitate: Minari dataset of the game, as ludus record --dataset writes it, whose actions PPO
            policies learn before and while they train.
        imitation: How policies learn from the demonstrations.
        randomise: Parameters of the worlds, by name: a value, or how it is drawn for each episode;
            a table of a settings file.
        curriculum: Lessons with parameters of their own, in order; tables of a settings file.
    """

    target: str = field(default="", kw_only=False)
    scene: str | None = None
    num_worlds: int = setting(64, AT_LEAST_1)
    num_engines: int = setting(2, AT_LEAST_1)
    max_restarts: int = setting(DEFAULT_RESTARTS, AT_LEAST_0)
    cluster: str | None = setting(None, optional(CLUSTER))
    num_machines: int | None = setting(None, optional(AT_LEAST_1))
    seed: int | None = setting(None, optional(SEED))
    total_steps: int = setting(2_000_000, AT_LEAST_1)
    max_time_s: float | None = setting(None, optional(ABOVE_0))
    target_return: float | None = None
    return_window: int = setting(100, AT_LEAST_1)
    checkpoint_every_s: float | None = setting(15.0, optional(ABOVE_0))
    checkpoint_every_updates: int | None = setting(None, optional(AT_LEAST_1))
    keep_checkpoints: int = setting(3, AT_LEAST_1)
    keep_every_updates: int | None = setting(None, optional(AT_LEAST_1))
    exact_resume: bool = False
    evaluation_episodes: int = setting(20, AT_LEAST_0)
    track: tuple[Sink, ...] = ()
    runs: Path = Path("runs")
    name: str = setting("", FOLDER_NAME)
    device: str = "auto"
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    compile: bool = False
    torch_threads: int = setting(1, AT_LEAST_1)
    algorithm: Literal["ppo", "sac"] | None = None
    ppo: PPOConfig = field(default_factory=PPOConfig)
    sac: SACConfig = field(default_factory=SACConfig)
    policies: dict[str, PolicyConfig] = field(default_factory=dict[str, PolicyConfig])
    alternate_every: int | None = setting(None, optional(AT_LEAST_1))
    schedule: tuple[Phase, ...] = ()
    league: LeagueConfig = field(default_factory=LeagueConfig)
    imitate: str | None = None
    imitation: ImitationConfig = field(default_factory=ImitationConfig)
    randomise: dict[str, Parameter] = field(default_factory=dict[str, Parameter])
    curriculum: tuple[Lesson, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        check_parameters("randomise", self.randomise)
        check_lessons(self.curriculum)
        require(self.alternate_every is None or not self.schedule, "alternate_every",
                "none beside a schedule", self.alternate_every)  # fmt: skip
        is_ray = self.cluster is not None and re.fullmatch(LOCAL, self.cluster) is None
        require(is_ray or self.num_machines is None, "num_machines",
                "none without a Ray cluster (cluster)", self.num_machines)  # fmt: skip
        if self.exact_resume and (
            self.checkpoint_every_s is not None or self.checkpoint_every_updates is None
        ):
            raise ConfigError(
                "exact_resume needs checkpoints at fixed updates, not at times of the clock",
                "set checkpoint_every_s to none and checkpoint_every_updates to a number",
            )


CHANGEABLE = frozenset({
    "total_steps", "max_time_s", "target_return", "checkpoint_every_s", "checkpoint_every_updates",
    "keep_every_updates", "evaluation_episodes",
})  # fmt: skip
"""Settings of the run itself that may change while it goes on."""
