"""``HELLO`` and ``WELCOME``: versions, capabilities, settings (PROTOCOL.md §3). No I/O."""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ludus.errors import EngineStartError
from ludus.wire.json_object import JsonObject

__all__ = ["CAPABILITIES", "PROTOCOL_MAX", "PROTOCOL_MIN", "EngineConfig", "Hello", "welcome"]

PROTOCOL_MIN = 1
PROTOCOL_MAX = 1
_MAX_INT32 = 2**31 - 1
CAPABILITIES = frozenset({"call", "ceiling", "metrics", "rebuild", "requests", "reset_worlds"})


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
        token: Secret shared with the trainer, empty on loopback.
        training: Training settings of a game that guides its training, as unchecked JSON for
            :func:`ludus.wire.training.read_training`; None for other games.
    """

    protocol: tuple[int, int]
    engine: str
    addon: str
    capabilities: frozenset[str]
    token: str = field(repr=False, default="")
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
            token=reader.text("token", default=""),
            training=reader.optional("training"),
        )

    def has_token(self, token: str) -> bool:
        """Return whether the engine sent ``token``; the time taken reveals nothing about it."""
        # JSON can carry half of a surrogate pair, which strict UTF-8 cannot.
        ours, theirs = (text.encode(errors="surrogatepass") for text in (token, self.token))
        return hmac.compare_digest(ours, theirs)

    def agree(self) -> int:
        """Return the highest protocol version that both sides speak.

        Raises:
            EngineStartError: There is none; the text says which side to upgrade.
        """
        low, high = self.protocol
        version = min(high, PROTOCOL_MAX)
        if version >= max(low, PROTOCOL_MIN):
            return version
        if high < PROTOCOL_MIN:
            side, hint = "the game's add-on is too old", "run `ludus addon install PROJECT`"
        else:
            side, hint = "the Python package is too old", "run `pip install --upgrade ludus-rl`"
        raise EngineStartError(
            f"{side}: the game speaks protocol {low} to {high}, ludus {PROTOCOL_MIN} to "
            f"{PROTOCOL_MAX}",
            hint=hint,
        )


def welcome(
    version: int,
    hello: Hello,
    config: EngineConfig,
    token: str = "",
    more: frozenset[str] = frozenset(),
) -> dict[str, Any]:
    """Return the answer to a ``HELLO``.

    Args:
        version: Protocol version that :meth:`Hello.agree` returned.
        hello: The greeting.
        config: What to ask of the engine.
        token: Secret shared with the engine.
        more: Capabilities of this conversation in addition to :data:`CAPABILITIES`.
    """
    from ludus.version import __version__

    return {
        "protocol": version,
        "client": f"ludus {__version__}",
        "capabilities": sorted(hello.capabilities & (CAPABILITIES | more)),
        "token": token,
        "config": config.to_json(),
    }
