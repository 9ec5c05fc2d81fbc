"""How a game is opened: the settings that every command has which opens one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, get_args

from ludus.session import LaunchOptions
from ludus.settings.checks import AT_LEAST_0, AT_LEAST_1, Settings, one_of, optional, setting

__all__ = ["GameConfig", "Layout", "PoolConfig"]

Layout = Literal["scene", "isolated", "grid"]
DEFAULT_RESTARTS = 3
LAYOUT = one_of(get_args(Layout))


@dataclass(frozen=True, kw_only=True)
class GameConfig(Settings):
    """Worlds and engines of a game; the base of the settings of ``train``, ``check`` and so on.

    Attributes:
        scene: Scene of the project, such as res://level.tscn; the main scene if not given.
        num_worlds: Worlds in each engine.
        num_engines: Game processes side by side.
        layout: "scene" uses the layout that the scene asks for, "isolated" gives each world its own
            physics space, "grid" puts all worlds into one.
        ticks_per_step: Physics ticks per decision; if not given, the agents' own setting.
        max_episode_steps: Steps after which episodes are truncated; if not given, the agents' own
            setting.
        godot: Godot executable to use; if not given, Ludus looks for one.
        is_pinned: Give each engine its own core, which no other pool of this user has, if enough
            are free and no quota (of a container) limits this process. Otherwise the system
            chooses.
        token_file: File with the token, at least 16 characters, that a game on another machine was
            started with (--ludus-token-file); not needed for games on this machine.
        bridge: Settings of a target that is a game of a legacy bridge, such as
            ``{"action_space": "Discrete(2)"}``; a space may be an object of Gymnasium or a text.
            :func:`ludus.make` and the commands take them by their own names.
    """

    scene: str | Path | None = None
    num_worlds: int = setting(1, AT_LEAST_1)
    num_engines: int = setting(1, AT_LEAST_1)
    layout: Layout = field(default="scene", metadata={"check": LAYOUT})
    ticks_per_step: int | None = setting(None, optional(AT_LEAST_1))
    max_episode_steps: int | None = setting(None, optional(AT_LEAST_1))
    godot: Path | None = None
    is_pinned: bool = True
    token_file: Path | None = None
    bridge: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True, kw_only=True)
class PoolConfig(GameConfig):
    """Everything that :func:`ludus.open_pool` can be told.

    Attributes:
        log_dir: Folder for the engines' output.
        max_restarts: How often, in all, an engine that died or froze is started again.
        spin_us: How long both sides poll for a message before they block, microseconds; None:
            3000 where a core is left beside the engines, else 0. After six empty or interrupted
            polls, that side blocks for 0.1 s, doubling up to 1 s: another process needs the core.
        launch: How games are started and watched.
        first_engine: Number of the first engine, where others are on other machines.
    """

    log_dir: Path | None = None
    max_restarts: int = setting(DEFAULT_RESTARTS, AT_LEAST_0)
    spin_us: int | None = setting(None, optional(AT_LEAST_0))
    launch: LaunchOptions = field(default_factory=LaunchOptions)
    first_engine: int = setting(0, AT_LEAST_0)

    @classmethod
    def of(cls, config: GameConfig, **more: Any) -> PoolConfig:
        """Return the part of a command's settings that concerns its pool, and ``more``.

        A command without the setting ``max_restarts`` reports a crash and starts nothing again.
        """
        names = [part.name for part in fields(cls) if hasattr(config, part.name)]
        values: dict[str, Any] = {
            "max_restarts": 0,
            **{name: getattr(config, name) for name in names},
        }
        return cls(**values | more)
