"""``HELLO`` and ``WELCOME``: versions, capabilities, settings (PROTOCOL.md §3). No I/O."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ludus.errors import EngineStartError
from ludus.wire.json_object import JsonObject

__all__ = [
    "CAPABILITIES",
    "PROTOCOL_MAX",
    "PROTOCOL_MIN",
    "EngineConfig",
    "GreetingRefused",
    "Hello",
    "welcome",
]

PROTOCOL_MIN = 1
PROTOCOL_MAX = 2
_MAX_INT32 = 2**31 - 1
CAPABILITIES = frozenset({"call", "ceiling", "metrics", "rebuild", "requests", "reset_worlds"})


class GreetingRefused(EngineStartError):  # noqa: N818 - reads as what happened
    """A greeting that cannot be answered.

    Args:
        code: Its code in an ``ERROR`` (PROTOCOL.md §9).
        message: What is wrong.
        hint: What to do.
    """

    def __init__(self, code: str, message: str, hint: str = "") -> None:
        super().__init__(message, hint)
        self.code = code


@dataclass(frozen=True)
class EngineConfig:
    """What the trainer asks of an engine (``config`` of PROTOCOL.md §3).

    Attributes:
        scene: Scene to make worlds of; None: the game's own.
        num_worlds: Worlds in this engine.
        first_world: Index of its first world among all engines.
        layout: ``"scene"`` (what the scene asks for), ``"isolated"`` or ``"grid"``.
        ticks_per_step: Physics ticks per decision; None: as the agents declare.
        max_episode_steps: Steps until truncation; None: as the agents declare.
        idle_timeout_s: How long the engine waits for the next request, seconds.
        spin_us: How long it polls for the next request before it blocks, microseconds.
    """

    scene: str | None = None
    num_worlds: int = 1
    first_world: int = 0
    layout: str = "scene"
    ticks_per_step: int | None = None
    max_episode_steps: int | None = None
    idle_timeout_s: int = 3600
    spin_us: int = 0

    def to_json(self) -> dict[str, Any]:
        """Return the object of PROTOCOL.md §3."""
        return dict(self.__dict__)


@dataclass(frozen=True)
class Hello:
    """An engine's greeting.

    Attributes:
        protocol: Lowest and highest version it speaks.
        engine: Name and version, for example ``"godot 4.6.3"``.
        addon: Version of the add-on.
        capabilities: Features it has.
        nonce: What the trainer's proof is about (:mod:`ludus.wire.proof`); empty in protocol 1.
        training: Training settings of a game that guides its training, as unchecked JSON for
            :func:`ludus.wire.training.read_training`; None for other games.
    """

    protocol: tuple[int, int]
    engine: str
    addon: str
    capabilities: frozenset[str]
    nonce: str = ""
    training: Any = None

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Hello:
        """Read a ``HELLO``.

        Raises:
            ProtocolError: A key is missing or of the wrong type.
        """
        reader = JsonObject(value, "HELLO")
        versions, engine = reader.child("protocol"), reader.child("engine")
        return cls(
            protocol=(
                versions.integer("min", 0, _MAX_INT32),
                versions.integer("max", 0, _MAX_INT32),
            ),
            engine=f"{engine.text('name')} {engine.text('version')}",
            addon=reader.text("addon"),
            capabilities=frozenset(str(item) for item in reader.items("capabilities")),
            nonce=reader.text("nonce", default=""),
            training=reader.optional("training"),
        )

    @property
    def upgrade(self) -> str:
        """How the game gets the newest add-on, as a hint."""
        if self.engine.startswith("bevy "):
            return "build the game with the newest bevy_ludus"
        return "run `ludus addon install PROJECT`"

    def agree(self) -> int:
        """Return the highest protocol version that both sides speak.

        Raises:
            GreetingRefused: There is none; the text says which side to upgrade.
        """
        low, high = self.protocol
        version = min(high, PROTOCOL_MAX)
        if version >= max(low, PROTOCOL_MIN):
            return version
        if high < PROTOCOL_MIN:
            side, hint = "the game's add-on is too old", self.upgrade
        else:
            side, hint = "the Python package is too old", "run `pip install --upgrade ludus-rl`"
        raise GreetingRefused(
            "version",
            f"{side}: the game speaks protocol {low} to {high}, ludus {PROTOCOL_MIN} to "
            f"{PROTOCOL_MAX}",
            hint,
        )


def welcome(
    version: int,
    hello: Hello,
    config: EngineConfig,
    more: frozenset[str] = frozenset(),
) -> dict[str, Any]:
    """Return the answer to a ``HELLO``.

    Args:
        version: Protocol version that :meth:`Hello.agree` returned.
        hello: The greeting.
        config: What to ask of the engine.
        more: Capabilities of this conversation in addition to :data:`CAPABILITIES`.
    """
    from ludus.version import __version__

    return {
        "protocol": version,
        "client": f"ludus {__version__}",
        "capabilities": sorted(hello.capabilities & (CAPABILITIES | more)),
        "config": config.to_json(),
    }
