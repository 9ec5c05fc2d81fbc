"""What a training run can be told: one struct = command line = TOML file = scene settings.

How the layers are laid over each other is the business of :mod:`ludus.settings.merging`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from ludus.errors import ConfigError
from ludus.settings.policy_config import Mode, PolicyConfig, PPOConfig, SACConfig, require

__all__ = ["LeagueConfig", "PPOConfig", "Phase", "PolicyConfig", "SACConfig", "TrainConfig"]


@dataclass(frozen=True)
class LeagueConfig:
    """Self-play against past selves.

    In a share of the worlds one side learns and every other side is played by a policy of the
    past. A side is a policy; where there is only one policy, each agent of a world is a side.

    Attributes:
        share: Share of the worlds that are played so; 0 is no self-play.
        pool_size: Past selves of each policy to keep.
        snapshot_every_updates: Updates between two past selves.
        sampling: "uniform" draws every past self as often, "recent" newer ones more often,
            "rating" those more often whose rating is nearest to that of the side that learns.
        max_opponents: Past selves of each policy that play at the same time.
        elo_factor: How far one game moves a rating (K).
    """

    share: float = 0.0
    pool_size: int = 10
    snapshot_every_updates: int = 20
    sampling: Literal["uniform", "recent", "rating"] = "uniform"
    max_opponents: int = 4
    elo_factor: float = 16.0

    def __post_init__(self) -> None:
        require(0 <= self.share <= 1, "share", "from 0 to 1", self.share)
        require(self.elo_factor > 0, "elo_factor", "above 0", self.elo_factor)
        for name in ("pool_size", "snapshot_every_updates", "max_opponents"):
            require(getattr(self, name) >= 1, name, "at least 1", getattr(self, name))


@dataclass(frozen=True)
class Phase:
    """Part of a schedule of modes.

    Attributes:
        updates: How many updates it lasts.
        modes: Mode by policy; policies that are not named train.
    """

    updates: int = 1
    modes: dict[str, Mode] = field(default_factory=dict[str, Mode])

    def __post_init__(self) -> None:
        require(self.updates >= 1, "updates", "at least 1", self.updates)


@dataclass(frozen=True)
class TrainConfig:
    """Settings of a training run.

    Attributes:
        target: What to train in: an example, a project folder, a scene, an exported game, an
            address, or gym:ENV_ID for any Gymnasium environment.
        scene: Scene of the project, res://…; none is the project's own.
        num_worlds: Worlds in each engine.
        num_engines: Game processes side by side.
        layout: "scene" is what the scene asks for; "isolated" gives each world its own physics
            space, "grid" puts all into one.
        ticks_per_step: Physics ticks per decision; none is what the agents say.
        max_episode_steps: Steps after which episodes are truncated; none is what the agents say.
        godot: Engine to use; none finds one.
        max_restarts: How often, in all, an engine that died or froze is started again.
        seed: Seed of worlds, networks and sampling; none draws one, and notes it.
        total_steps: Agent steps after which training ends.
        max_time_s: Seconds of training after which it ends; none is no limit.
        target_return: Training ends when every policy's mean return reaches it; none never.
        return_window: Episodes that the mean return is taken over.
        checkpoint_every_s: Seconds between checkpoints; none leaves it to checkpoint_every_updates.
        checkpoint_every_updates: Updates between checkpoints; none leaves it to checkpoint_every_s.
        keep_checkpoints: Newest checkpoints to keep; the best one is kept besides.
        keep_every_updates: Updates between checkpoints that are kept for ever, besides; none keeps
            no such ones.
        exact_resume: Reset all worlds after each checkpoint, so that a resumed run repeats an
            uninterrupted one to the bit where the engine is deterministic. Cuts episodes short,
            and needs checkpoint_every_updates, as clocks are not deterministic.
        evaluation_episodes: Episodes of the evaluation at the end; 0 leaves it out.
        runs: Folder that run folders are made in.
        name: Name of the run folder; empty makes one from target, date and time.
        device: PyTorch device of networks and updates, such as cpu or cuda; auto is cuda where
            there is one.
        precision: "bfloat16" computes updates in mixed precision, "float32" does not; auto mixes
            on cuda only.
        compile: Compile the networks' updates with torch.compile; takes a minute at the start.
        torch_threads: Threads PyTorch may use; engines need the other cores.
        algorithm: Algorithm of every policy; none is what the scene says, or else ppo.
        ppo: Settings of every policy trained with PPO.
        sac: Settings of every policy trained with SAC.
        policies: Settings of single policies by name, over those of their algorithm.
        alternate_every: Policies learn in turn, for so many updates each, while the others act
            frozen; none lets all learn at once.
        schedule: Phases of modes, one after the other and over again; a table of a settings file.
        league: Self-play against past selves.
    """

    target: str = ""
    scene: str | None = None
    num_worlds: int = 64
    num_engines: int = 2
    layout: Literal["scene", "isolated", "grid"] = "scene"
    ticks_per_step: int | None = None
    max_episode_steps: int | None = None
    godot: Path | None = None
    max_restarts: int = 3
    seed: int | None = None
    total_steps: int = 2_000_000
    max_time_s: float | None = None
    target_return: float | None = None
    return_window: int = 100
    checkpoint_every_s: float | None = 15.0
    checkpoint_every_updates: int | None = None
    keep_checkpoints: int = 3
    keep_every_updates: int | None = None
    exact_resume: bool = False
    evaluation_episodes: int = 20
    runs: Path = Path("runs")
    name: str = ""
    device: str = "auto"
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    compile: bool = False
    torch_threads: int = 1
    algorithm: Literal["ppo", "sac"] | None = None
    ppo: PPOConfig = field(default_factory=PPOConfig)
    sac: SACConfig = field(default_factory=SACConfig)
    policies: dict[str, PolicyConfig] = field(default_factory=dict[str, PolicyConfig])
    alternate_every: int | None = None
    schedule: tuple[Phase, ...] = ()
    league: LeagueConfig = field(default_factory=LeagueConfig)

    def __post_init__(self) -> None:
        for name in ("num_worlds", "num_engines", "total_steps", "return_window",
                     "keep_checkpoints", "torch_threads"):  # fmt: skip
            require(getattr(self, name) >= 1, name, "at least 1", getattr(self, name))
        for name in (
            "ticks_per_step",
            "max_episode_steps",
            "checkpoint_every_updates",
            "keep_every_updates",
            "alternate_every",
        ):
            value = getattr(self, name)
            require(value is None or value >= 1, name, "at least 1 or none", value)
        for name in ("max_time_s", "checkpoint_every_s"):
            value = getattr(self, name)
            require(value is None or value > 0, name, "above 0 or none", value)
        require(self.evaluation_episodes >= 0, "evaluation_episodes", "at least 0",
                 self.evaluation_episodes)  # fmt: skip
        require(self.seed is None or 0 <= self.seed < 2**63, "seed", "from 0 to 2^63 - 1",
                 self.seed)  # fmt: skip
        require(re.fullmatch(r"[^/\\\0]*", self.name) is not None and self.name not in {".", ".."},
                 "name", "a folder name", self.name)  # fmt: skip
        require(self.alternate_every is None or not self.schedule, "alternate_every",
                "none beside a schedule", self.alternate_every)  # fmt: skip
        self._check_exact_resume()

    def _check_exact_resume(self) -> None:
        if self.exact_resume and (
            self.checkpoint_every_s is not None or self.checkpoint_every_updates is None
        ):
            raise ConfigError(
                "exact_resume needs checkpoints at fixed updates, not at times of the clock",
                "set checkpoint_every_s to none and checkpoint_every_updates to a number",
            )
