"""What the checks share: the target, its settings, a running engine and a recording of it."""

from __future__ import annotations

import contextlib
from collections.abc import Generator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import cast

from ludus.check.finding import Finding, Status, info
from ludus.check.recording import Recording, record
from ludus.check.scripts import Script, find_scripts
from ludus.errors import EngineError, UsageError
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.session import EngineSession, LaunchOptions
from ludus.settings.checks import ABOVE_0, AT_LEAST_0, AT_LEAST_1, ONLY_1, setting
from ludus.settings.pool_config import GameConfig, Layout
from ludus.spec import Spec
from ludus.target import Address, Legacy, Play, Scene, check_accepted, parse_target, prepare

__all__ = ["NO_SEEDS", "CheckConfig", "CheckContext", "OneEngineOnly"]

NO_SEEDS = "no seed reaches this game, whose protocol has none"


@dataclass(frozen=True, kw_only=True)
class CheckConfig(GameConfig):
    """What to check, and how thoroughly.

    Attributes:
        target: A bundled example, a project folder, a scene, an exported game, or gym:ENV_ID.
        num_worlds: Worlds to play in.
        num_steps: Steps of random play.
        seed: Seed of world 0 and of its actions.
        num_layout_worlds: Worlds for the comparison of the layouts.
        timing_s: Seconds for which each layout is timed.
        launch: How games are started and watched.
    """

    target: str | Path
    num_worlds: int = setting(4, AT_LEAST_1)
    num_engines: int = setting(1, ONLY_1)
    num_steps: int = setting(300, AT_LEAST_1)
    seed: int = setting(0, AT_LEAST_0)
    num_layout_worlds: int = setting(32, AT_LEAST_1)
    timing_s: float = setting(1.0, ABOVE_0)
    launch: LaunchOptions = field(default_factory=LaunchOptions)


class OneEngineOnly(UsageError):  # noqa: N818 - reads as what happened
    """A check needs another process, and the game was started by hand."""


class CheckContext:
    """A target under examination; a context manager that ends all engines.

    Raises:
        TargetError: There is no such target.
    """

    def __init__(self, config: CheckConfig) -> None:
        self.config = config
        target = parse_target(config.target, scene=config.scene, godot=config.godot)
        check_accepted("check", target)
        # An example is not built again for each engine.
        self._target = prepare(target)
        self._shared: dict[bool, EnginePool] = {}

    @property
    def spec(self) -> Spec:
        """What the game declares with ``num_worlds`` worlds in the layout that it asks for."""
        return self.recording.spec

    @cached_property
    def recording(self) -> Recording:
        """Random play in a fresh engine."""
        with self.main_pool() as pool:
            session = pool.sessions[0]
            if isinstance(session, EngineSession):
                self.engine_version = session.hello.engine
            return record(pool, self.config.seed, self.config.num_steps)

    engine_version: str = "unknown"
    """Name and version of the engine, once there is a recording; other sessions have none."""

    def main_pool(self) -> AbstractContextManager[EnginePool]:
        """Lend the engine that checks share; after an error the next one gets a new engine."""
        return self._lend(is_lone=False)

    def lone_pool(self) -> AbstractContextManager[EnginePool]:
        """Lend the other engine that checks share, which has one world, in the default layout.

        Raises:
            OneEngineOnly: The game was started by hand.
        """
        return self._lend(is_lone=True)

    @contextlib.contextmanager
    def _lend(self, is_lone: bool) -> Generator[EnginePool]:
        if is_lone not in self._shared:
            self._shared[is_lone] = (
                self._open_other(replace(self.config, num_worlds=1))
                if is_lone
                else open_pool(self._target, PoolConfig.of(self.config))
            )
        try:
            yield self._shared[is_lone]
        except EngineError:
            self.close()
            raise

    @contextlib.contextmanager
    def other_pool(
        self,
        num_worlds: int | None = None,
        layout: str | None = None,
        max_episode_steps: int | None = None,
    ) -> Generator[EnginePool]:
        """Start another engine for one check.

        Raises:
            OneEngineOnly: The game was started by hand.
        """
        config = replace(
            self.config,
            num_worlds=num_worlds or self.config.num_worlds,
            layout=cast(Layout, layout) if layout else self.config.layout,
            max_episode_steps=max_episode_steps or self.config.max_episode_steps,
        )
        with self._open_other(config) as pool:
            yield pool

    def _open_other(self, config: CheckConfig) -> EnginePool:
        if isinstance(self._target, Address | Play):
            raise OneEngineOnly(
                "not checked: it needs another process, and this game was started by hand",
                hint="name the project instead",
            )
        return open_pool(self._target, PoolConfig.of(config))

    @cached_property
    def scripts(self) -> tuple[Script, ...]:
        """The scripts of the scene, if the target is one of a Godot project; else none."""
        game = self._target
        return find_scripts(game.project.root, game.path) if isinstance(game, Scene) else ()

    @property
    def is_legacy(self) -> bool:
        """Whether the game is of an older system: one world, which no seed reaches."""
        return isinstance(self._target, Legacy)

    def excuse(self, finding: Finding) -> Finding:
        """Return a finding that two episodes differ as information where no seed equates them."""
        if not self.is_legacy or finding.status in (Status.OK, Status.INFO):
            return finding
        return info(finding.title, f"cannot be told: {NO_SEEDS}", **finding.data)

    def close(self) -> None:
        """End the shared engines; may be called twice."""
        while self._shared:
            self._shared.popitem()[1].close()

    def __enter__(self) -> CheckContext:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
