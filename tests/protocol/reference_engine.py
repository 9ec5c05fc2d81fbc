#!/usr/bin/env python3
"""An engine written from PROTOCOL.md alone, with a small game; an example for other engines.

It uses Python's standard library only and imports nothing of Ludus. It is an example for
the engine side of Unity, Unreal or another engine: frames, arrays, requests and answers, the game,
one connection, launch arguments. Sections (§) are those of ``protocol/PROTOCOL.md``.

The game: in each world a walker stands on a line of places and must reach the goal at one of its
ends. It sees where it stands and on which side the goal lies; it steps left, waits, or steps right.

    reference_engine.py --ludus-connect=ADDRESS[,ADDRESS…]
    reference_engine.py --ludus-listen=tcp:127.0.0.1:0
"""

from __future__ import annotations

import collections
import contextlib
import hmac
import json
import logging
import math
import os
import queue
import random
import secrets
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn, cast

Json = dict[str, Any]

_log = logging.getLogger("reference engine")

# --- §1 Frames -----------------------------------------------------------------------------------

HELLO, WELCOME, SPEC, RESET, STEP, BATCH, CALL, RESULT, PING, PONG, ERROR, CLOSE = range(1, 13)
CHALLENGE, PROOF = 13, 14
VERSION = 2
HEADER = struct.Struct("<IBBH")  # payload_bytes, type, flags, reserved
LIMITS = {
    **dict.fromkeys((HELLO, CHALLENGE, PROOF), 1 << 16),
    **dict.fromkeys((WELCOME, SPEC, CALL, RESULT, ERROR), 1 << 24),
    **dict.fromkeys((RESET, STEP, BATCH), 1 << 28),
    **dict.fromkeys((PING, PONG), 1 << 20),
    CLOSE: 0,
}
FRAME_TIMEOUT_S = 30.0  # for the rest of a frame that has begun
CONNECT_TIMEOUT_S = 10.0
GREETING_TIMEOUT_S = 60.0
CLIENT_TIMEOUT_S = 10.0  # for the greeting of a client of a listening engine
MAX_PENDING = 64
MIN_TOKEN_LENGTH = 16
LISTEN_TIMEOUT_S = 600.0


class ProtocolError(Exception):
    """Something that ends the connection with ``ERROR``; the code is one of §9."""

    def __init__(self, code: str, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.content = {"code": code, "message": message, "hint": hint}


class DisconnectedError(Exception):
    """The trainer has left; the exit code tells how, §11."""

    def __init__(self, message: str, exit_code: int = 0, *, is_proven: bool = True) -> None:
        super().__init__(message)
        self.exit_code = exit_code
        self.is_proven = is_proven  # whether it is the trainer, §3 "Strangers"


def pack_frame(frame_type: int, payload: bytes = b"") -> bytes:
    """Return one whole frame, header included."""
    return HEADER.pack(len(payload), frame_type, 0, 0) + payload


def pack_json(frame_type: int, content: Json) -> bytes:
    """Return one whole frame that carries a JSON object; NaN is refused with ``ValueError``."""
    return pack_frame(frame_type, json.dumps(content, allow_nan=False).encode())


def parse_header(header: bytes) -> tuple[int, int]:
    """Return (payload_bytes, type) of an 8-byte header, or raise before anything is allocated."""
    payload_bytes, frame_type, flags, reserved = HEADER.unpack(header)
    if frame_type not in LIMITS or flags or reserved:
        raise ProtocolError("frame", f"no frame has the header {header.hex()}")
    if payload_bytes > LIMITS[frame_type]:
        raise ProtocolError("frame", f"{payload_bytes} bytes in a frame of type {frame_type}")
    return payload_bytes, frame_type


def parse_json(payload: bytes) -> Json:
    """Return the JSON object that a payload carries."""
    try:
        content = json.loads(payload)
    except ValueError as error:
        raise ProtocolError("frame", f"payload is not JSON: {error}") from error
    if not isinstance(content, dict):
        raise ProtocolError("frame", "payload is not a JSON object")
    return cast(Json, content)


class Connection:
    """Frames over one socket, with a deadline for every wait."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected
        if connected.family != socket.AF_UNIX:
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, frame: bytes) -> None:
        """Send one whole frame."""
        self._socket.settimeout(FRAME_TIMEOUT_S)
        try:
            self._socket.sendall(frame)
        except OSError as error:
            raise DisconnectedError(str(error)) from error

    def receive(self, timeout_s: float) -> tuple[int, bytes]:
        """Wait for a frame to begin, then for the rest of it; return its type and payload."""
        first = self._read(1, timeout_s)
        deadline = time.monotonic() + FRAME_TIMEOUT_S
        header = first + self._read(HEADER.size - 1, FRAME_TIMEOUT_S)
        payload_bytes, frame_type = parse_header(header)
        return frame_type, self._read(payload_bytes, deadline - time.monotonic())

    def close(self) -> None:
        """Close the socket; a thread that reads from it wakes up."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()

    def _read(self, num_bytes: int, timeout_s: float) -> bytes:
        data = bytearray()
        deadline = time.monotonic() + timeout_s
        while len(data) < num_bytes:
            try:
                self._socket.settimeout(max(deadline - time.monotonic(), 0.001))
                piece = self._socket.recv(num_bytes - len(data))
            except TimeoutError as error:
                message = f"the trainer sent nothing for {timeout_s:g} s"
                raise ProtocolError("timeout", message) from error
            except OSError as error:
                raise DisconnectedError(str(error)) from error
            if not piece:
                raise DisconnectedError("the trainer closed the connection")
            data += piece
        return bytes(data)


# --- §4 What arrays the frames carry --------------------------------------------------------------

Rows = list[list[Any]]  # one flat list of numbers per slot
FORMATS = {"float32": "f", "uint8": "B", "int64": "q"}


@dataclass(frozen=True)
class Layout:
    """The sizes of one policy's arrays, as its spec gives them."""

    name: str
    num_agents: int
    entries: list[tuple[str, str, int]]  # name, dtype, elements of one agent
    num_discrete: int
    num_continuous: int
    has_mask: bool

    @classmethod
    def of(cls, policy: Json) -> Layout:
        """Read the sizes off one policy of a ``SPEC``."""
        action: list[Json] = policy["action"]
        return cls(
            name=policy["name"],
            num_agents=policy["num_agents"],
            entries=[(e["name"], e["dtype"], math.prod(e["shape"])) for e in policy["observation"]],
            num_discrete=sum(component["kind"] == "discrete" for component in action),
            num_continuous=sum(component.get("size", 0) for component in action),
            has_mask=policy["has_action_mask"],
        )


def pack_array(dtype: str, values: Sequence[Any]) -> bytes:
    """Return little-endian numbers, padded with zeros to a multiple of 8 bytes."""
    data = struct.pack(f"<{len(values)}{FORMATS[dtype]}", *values)
    return data + bytes(-len(data) % 8)


def pack_rows(dtype: str, rows: Rows) -> bytes:
    """Return one padded array of all rows, one behind the other."""
    return pack_array(dtype, [number for row in rows for number in row])


# --- §5 to §7 Requests and answers ----------------------------------------------------------------

LEAVE, CONTINUE, RESEED = range(3)  # what a RESET does with a world


@dataclass(frozen=True)
class ResetRequest:
    """A ``RESET``: per world its seed, one of the three actions above, its new parameters."""

    seeds: list[int]
    actions: list[int]
    parameters: Any = None  # null, an object for all, or a list with an object or null per world

    def parameters_of(self, world: int) -> Json | None:
        """Return all parameters that this world is to have; None where it keeps those it has."""
        chosen: Any = self.parameters
        return chosen[world] if isinstance(self.parameters, list) else chosen


def parse_reset(payload: bytes) -> ResetRequest:
    """Read a ``RESET``."""
    try:
        num_worlds, parameters_bytes = struct.unpack_from("<II", payload)
        numbers = struct.unpack_from(f"<{num_worlds}Q{num_worlds}B", payload, 8)
    except struct.error as error:
        raise ProtocolError("frame", f"RESET is too short: {error}") from error
    start = 8 + 9 * num_worlds
    start += -start % 8
    if len(payload) != start + parameters_bytes:
        raise ProtocolError("frame", f"RESET of {len(payload)} bytes has a wrong size")
    seeds, actions = list(numbers[:num_worlds]), list(numbers[num_worlds:])
    try:
        parameters = json.loads(payload[start:]) if parameters_bytes else None
    except ValueError as error:
        raise ProtocolError("frame", f"parameters are not JSON: {error}") from error
    if any(action > RESEED for action in actions):
        raise ProtocolError("frame", f"RESET has the actions {actions}, each must be 0, 1 or 2")
    if isinstance(parameters, list) and len(cast(list[Any], parameters)) != num_worlds:
        raise ProtocolError("frame", "RESET needs one element of its parameters per world")
    return ResetRequest(seeds, actions, parameters)


def parse_step(layouts: Sequence[Layout], payload: bytes) -> dict[str, tuple[Rows, Rows]]:
    """Read a ``STEP``; return by policy the discrete and the continuous rows, one per slot."""
    chosen: dict[str, tuple[Rows, Rows]] = {}
    offset = 0
    try:
        for layout in layouts:
            both: list[Rows] = []
            sizes = (("int64", layout.num_discrete), ("float32", layout.num_continuous))
            for dtype, width in sizes:
                count = layout.num_agents * width
                form = struct.Struct(f"<{count}{FORMATS[dtype]}")
                numbers = list(form.unpack_from(payload, offset))
                offset += form.size + -form.size % 8
                starts = range(0, count, width or 1)
                both.append([numbers[start : start + width] for start in starts])
            chosen[layout.name] = (both[0], both[1])
    except struct.error as error:
        raise ProtocolError("frame", f"STEP is too short: {error}") from error
    if offset != len(payload):
        raise ProtocolError("frame", f"STEP of {len(payload)} bytes, {offset} were expected")
    return chosen


@dataclass
class PolicyBatch:
    """What one policy contributes to a ``BATCH``; every list has one element per slot."""

    observation: dict[str, Rows]
    reward: list[float]
    terminated: list[int]
    truncated: list[int]
    active: list[int]
    action_mask: Rows = field(default_factory=list[list[Any]])
    final_slots: list[int] = field(default_factory=list[int])
    final_observation: dict[str, Rows] = field(default_factory=dict[str, Rows])


def pack_batch(
    head: tuple[int, int, int, int, int], layouts: Sequence[Layout], batches: Sequence[PolicyBatch]
) -> bytes:
    """Return a whole ``BATCH``; its head is (tick, engine_us, bridge_us, wait_us, flags)."""
    parts = [struct.pack("<QIIII", *head)]
    for layout, batch in zip(layouts, batches, strict=True):
        parts += [pack_rows(dtype, batch.observation[name]) for name, dtype, _ in layout.entries]
        parts.append(pack_array("float32", batch.reward))
        parts += [pack_array("uint8", batch.terminated), pack_array("uint8", batch.truncated)]
        parts.append(pack_array("uint8", batch.active))
        if layout.has_mask:
            parts.append(pack_rows("uint8", batch.action_mask))
    for layout, batch in zip(layouts, batches, strict=True):
        slots = struct.pack(f"<{len(batch.final_slots)}I", *batch.final_slots)
        parts.append(struct.pack("<II", len(batch.final_slots), 0))
        parts.append(slots + bytes(-len(slots) % 8))
        for name, dtype, _ in layout.entries:
            parts.append(pack_rows(dtype, batch.final_observation.get(name, [])))
    return pack_frame(BATCH, b"".join(parts))


# --- The game -------------------------------------------------------------------------------------


DEFAULT_LENGTH = 9


class Walker:
    """One world: a walker on a line of places, with the goal at one end."""

    def __init__(self) -> None:
        self.length = DEFAULT_LENGTH
        self.steps = 0
        self._seed = 0
        self._episode = 0
        self._place = 0
        self._goal = 0

    def set_parameters(self, parameters: Json) -> None:
        """Take parameters from a ``RESET``, §5; those that are not named have their defaults."""
        length = parameters.get("length", DEFAULT_LENGTH)
        if not isinstance(length, int) or not 3 <= length <= 1000:
            raise ProtocolError("game", f"parameter `length` is {length!r}, expected 3 to 1000")
        self.length = length

    def begin(self, seed: int | None) -> None:
        """Begin an episode, with a new random stream if a seed is given.

        §5: the draws of episode k depend on the seed and k only, however long the others were.
        """
        if seed is not None:
            self._seed, self._episode = seed, 0
        stream = random.Random(f"{self._seed}:{self._episode}")
        self._episode += 1
        self.steps = 0
        self._goal = stream.choice((0, self.length - 1))
        self._place = stream.randrange(1, self.length - 1)

    def move(self, action: int) -> float:
        """Play one step, 0 left, 1 wait, 2 right; return its reward."""
        self._place = min(max(self._place + action - 1, 0), self.length - 1)
        self.steps += 1
        return 1.0 if self.is_at_goal() else -0.05

    def is_at_goal(self) -> bool:
        """Tell whether the walker has reached the goal."""
        return self._place == self._goal

    def observe(self) -> list[float]:
        """Return the place and the side of the goal, both from -1 (left) to 1 (right)."""
        end = self.length - 1
        return [2.0 * self._place / end - 1.0, 1.0 if self._goal == end else -1.0]

    def get_place(self) -> int:
        """Return the place, 0 at the left end; a trainer may ask for it with ``CALL``."""
        return self._place


METHODS: dict[str, Callable[[Walker], Any]] = {"get_place": Walker.get_place}
TICK_RATE = 60.0
MAX_EPISODE_STEPS = 50


class Game:
    """All worlds of this engine, played in lock-step."""

    def __init__(self, config: Json) -> None:
        # The worlds share nothing, not even a space in which they could lie apart from each other.
        if config.get("scene") is not None or config.get("layout") == "grid":
            raise ProtocolError("config", "this game has no other scene, and no grid of worlds")
        self.worlds = [Walker() for _ in range(config.get("num_worlds") or 1)]
        self.ticks_per_step = config.get("ticks_per_step") or 1
        self.max_episode_steps = config.get("max_episode_steps") or MAX_EPISODE_STEPS
        self.tick = 0

    def spec(self) -> Json:
        """Return the ``SPEC``, §4; it does not change while the connection lasts."""
        observation = {"name": "place_and_goal", "dtype": "float32", "shape": [2]}
        policy: Json = {
            "name": "walker",
            "num_agents": len(self.worlds),
            "agents_per_world": 1,
            "episode": "agent",
            "max_episode_steps": self.max_episode_steps,
            "observation": [observation | {"low": -1.0, "high": 1.0}],
            "action": [{"name": "move", "kind": "discrete", "n": 3}],
            "has_action_mask": False,
            "agents": [{"world": i, "path": "Walker"} for i in range(len(self.worlds))],
            "settings": {},
        }
        return {
            "num_worlds": len(self.worlds),
            "layout": "isolated",
            "ticks_per_step": self.ticks_per_step,
            "tick_rate": TICK_RATE,
            "scene": "walker",
            "policies": [policy],
        }

    def reset(self, request: ResetRequest) -> PolicyBatch:
        """Begin the episodes that a ``RESET`` asks for; the other worlds stay as they are."""
        if len(request.seeds) != len(self.worlds):
            message = f"RESET of {len(request.seeds)} worlds, there are {len(self.worlds)}"
            raise ProtocolError("frame", message)
        for index, (world, action) in enumerate(zip(self.worlds, request.actions, strict=True)):
            if action != LEAVE:
                if (parameters := request.parameters_of(index)) is not None:
                    world.set_parameters(parameters)
                world.begin(request.seeds[index] if action == RESEED else None)
        return self._batch([0.0] * len(self.worlds))

    def step(self, actions: Rows) -> PolicyBatch:
        """Let every walker act once; those whose episode ends begin their next one at once."""
        if not all(0 <= action < 3 for (action,) in actions):
            raise ProtocolError("frame", "an action is out of range, expected 0, 1 or 2")
        self.tick += self.ticks_per_step
        pairs = zip(self.worlds, actions, strict=True)
        batch = self._batch([world.move(action) for world, (action,) in pairs])
        final: Rows = []
        for slot, world in enumerate(self.worlds):
            terminated = world.is_at_goal()
            if terminated or world.steps >= self.max_episode_steps:
                batch.terminated[slot] = int(terminated)
                batch.truncated[slot] = int(not terminated)  # never both
                batch.final_slots.append(slot)
                final.append(world.observe())
                world.begin(None)
                batch.observation["place_and_goal"][slot] = world.observe()
        batch.final_observation["place_and_goal"] = final
        return batch

    def call(self, request: Json) -> Json:
        """Answer a ``CALL``, §8; an error in it does not end the connection."""
        answer: Json = {"id": request.get("id")}
        target: Json = request.get("target") or {}
        index = target.get("world", -1)
        method = METHODS.get(str(request.get("method")))
        if not isinstance(index, int) or not 0 <= index < len(self.worlds):
            return answer | {"error": f"there is no target {json.dumps(target)}"}
        if method is None or request.get("arguments"):
            return answer | {"error": f"world {index} has no such method {request.get('method')}"}
        return answer | {"value": method(self.worlds[index])}

    def _batch(self, reward: list[float]) -> PolicyBatch:
        zeros = [0] * len(self.worlds)
        observation = {"place_and_goal": [world.observe() for world in self.worlds]}
        return PolicyBatch(observation, reward, zeros[:], zeros[:], [1] * len(self.worlds))


# --- §2, §3 One connection ------------------------------------------------------------------------


def make_proof(token: str, side: str, engine_nonce: str, trainer_nonce: str) -> str:
    """Return the proof that a side, ``trainer`` or ``engine``, knows the token."""
    nonces = bytes.fromhex(engine_nonce) + bytes.fromhex(trainer_nonce)
    return hmac.digest(token.encode(), f"ludus 2 {side}".encode() + nonces, "sha256").hex()


def is_trainer(token: str, nonces: tuple[str, str], proof: str) -> bool:
    """Tell whether a proof is the trainer's, for the nonces of engine and trainer."""
    try:
        expected = make_proof(token, "trainer", *nonces)
    except ValueError:  # a nonce that is not hexadecimal
        return False
    return hmac.compare_digest(expected.encode(), proof.encode(errors="replace"))


def shake_hands(connection: Connection, token: str, timeout_s: float) -> None:
    """Introduce this engine, and let both sides prove that they know the token, §3."""
    if not token:
        raise ProtocolError("token", "there is no token, so that a trainer cannot prove itself")
    nonce = secrets.token_hex(32)
    hello = {
        "protocol": {"min": VERSION, "max": VERSION},
        "addon": "0.1.0",
        "engine": {"name": "reference", "version": "1.0"},
        "capabilities": ["call", "rebuild", "reset_worlds"],
        "nonce": nonce,
    }
    connection.send(pack_json(HELLO, hello))
    frame_type, payload = connection.receive(timeout_s)
    if frame_type not in (CHALLENGE, ERROR):
        raise_unexpected(frame_type, payload)
    answer = parse_json(payload)
    nonces = nonce, str(answer.get("nonce"))
    is_proven = is_trainer(token, nonces, str(answer.get("proof")))
    if frame_type == ERROR:
        message = str(answer.get("message"))
        raise DisconnectedError(message, exit_code=1, is_proven=is_proven)
    if not is_proven:
        raise ProtocolError("token", "the token of the trainer is not the one of this game")
    connection.send(pack_json(PROOF, {"proof": make_proof(token, "engine", *nonces)}))


def raise_unexpected(frame_type: int, payload: bytes) -> NoReturn:
    """Raise what a frame means that is no request: the end, or a violation."""
    if frame_type == CLOSE:
        raise DisconnectedError("it said CLOSE")
    if frame_type == ERROR:
        raise DisconnectedError(str(parse_json(payload).get("message")), exit_code=1)
    raise ProtocolError("sequence", f"a frame of type {frame_type} is not allowed now")


def serve(connection: Connection) -> NoReturn:
    """Serve a trainer that has proved itself; raises ``DisconnectedError`` when it leaves."""
    frame_type, payload = connection.receive(GREETING_TIMEOUT_S)
    if frame_type != WELCOME:
        raise_unexpected(frame_type, payload)
    welcome = parse_json(payload)
    if welcome.get("protocol") != VERSION:
        raise ProtocolError("version", f"this engine speaks protocol {VERSION} only")
    config: Json = welcome.get("config") or {}
    game = Game(config)
    spec = game.spec()
    layouts = [Layout.of(policy) for policy in spec["policies"]]
    connection.send(pack_json(SPEC, spec))
    idle_timeout_s = float(config.get("idle_timeout_s") or 3600.0)
    is_reset = False
    while True:
        started = time.perf_counter_ns()
        frame_type, payload = connection.receive(idle_timeout_s)
        received = time.perf_counter_ns()
        if frame_type == PING:
            connection.send(pack_frame(PONG, payload))
        elif frame_type == CALL:
            connection.send(pack_json(RESULT, game.call(parse_json(payload))))
        elif frame_type == RESET or (frame_type == STEP and is_reset):
            is_reset = True
            if frame_type == RESET:
                batch = game.reset(parse_reset(payload))
            else:
                actions, _ = parse_step(layouts, payload)["walker"]
                batch = game.step(actions)
            bridge_us = (time.perf_counter_ns() - received) // 1000
            wait_us = min((received - started) // 1000, 2**32 - 1)
            head = (game.tick, 0, bridge_us, wait_us, int(frame_type == RESET))
            connection.send(pack_batch(head, layouts, [batch]))
        else:
            raise_unexpected(frame_type, payload)


def tell_failure(connection: Connection, error: ProtocolError) -> None:
    """Send ``ERROR``, if the trainer still listens, and close."""
    _log.error("%s", error)
    with contextlib.suppress(DisconnectedError):
        connection.send(pack_json(ERROR, error.content))
    connection.close()


# --- §10 Addresses and launch arguments -----------------------------------------------------------


def parse_address(address: str) -> tuple[socket.AddressFamily, Any]:
    """Return what ``tcp:HOST:PORT`` or ``unix:PATH`` means to a socket."""
    scheme, _, rest = address.partition(":")
    if scheme == "unix":
        return socket.AF_UNIX, rest
    host, _, port = rest.rpartition(":")
    if scheme != "tcp" or not port.isdigit():
        raise SystemExit(f"{address} is not an address; expected tcp:HOST:PORT or unix:PATH")
    return socket.AF_INET, (host, int(port))


def find_token(token_file: str | None, *, is_local: bool) -> str:
    """Return the token that a trainer must know, §3; empty if there is none."""
    if token_file is not None:
        return Path(token_file).read_text().strip()
    if token := os.environ.get("LUDUS_TOKEN"):
        return token
    folders = {"darwin": "~/Library/Caches", "win32": os.environ.get("LOCALAPPDATA", "")}
    cache = folders.get(sys.platform, os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    file = Path(cache).expanduser() / "ludus" / "token"
    if not is_local or not file.is_file():
        return ""
    if sys.platform != "win32" and file.stat().st_mode & 0o077:
        raise SystemExit(f"others may read {file}, so the token in it is no secret; delete it")
    return file.read_text().strip()


def is_on_this_machine(address: str) -> bool:
    """Tell whether only this machine can reach an address."""
    return address.startswith(("unix:", "tcp:localhost:", "tcp:127."))


def connect(addresses: str, token_file: str | None) -> Connection:
    """Connect to the first address that answers."""
    reasons: list[str] = []
    for address in addresses.split(","):
        family, where = parse_address(address)
        connected = socket.socket(family, socket.SOCK_STREAM)
        connected.settimeout(CONNECT_TIMEOUT_S)
        try:
            connected.connect(where)
        except OSError as error:
            connected.close()
            reasons.append(f"{address}: {error}")
            continue
        connection = Connection(connected)
        try:
            token = find_token(token_file, is_local=is_on_this_machine(address))
            shake_hands(connection, token, GREETING_TIMEOUT_S)
        except ProtocolError as error:
            tell_failure(connection, error)
            raise SystemExit(1) from error
        return connection
    raise SystemExit(f"no trainer listens: {'; '.join(reasons)}")


def listen(address: str, token_file: str | None) -> Connection:
    """Listen, print the address, and return the first trainer that proves itself, §3."""
    family, where = parse_address(address)
    is_local = is_on_this_machine(address)
    proven: queue.SimpleQueue[Connection | DisconnectedError] = queue.SimpleQueue()
    pending: collections.deque[Connection] = collections.deque()

    def greet(client: Connection) -> None:
        try:
            # Now, since a trainer on this machine may have written its token just before.
            token = find_token(token_file, is_local=is_local)
            shake_hands(client, token, CLIENT_TIMEOUT_S)
            proven.put(client)
        except DisconnectedError as error:
            if error.exit_code and error.is_proven:
                proven.put(error)
            else:
                client.close()
                _log.warning("dropped a client that has proved nothing: %a", str(error))
        except ProtocolError as error:
            tell_failure(client, error)

    if not is_local and len(find_token(token_file, is_local=False)) < MIN_TOKEN_LENGTH:
        raise SystemExit("other machines need --ludus-token-file with at least 16 characters")
    with socket.create_server(where, family=family) as listener:
        if family == socket.AF_INET:
            host, port = listener.getsockname()
            address = f"tcp:{host}:{port}"
        sys.stdout.write(f"listening on {address}\n")
        sys.stdout.flush()
        listener.settimeout(0.02)
        deadline = time.monotonic() + LISTEN_TIMEOUT_S
        while proven.empty() and time.monotonic() < deadline:
            with contextlib.suppress(TimeoutError):
                pending.append(Connection(listener.accept()[0]))
                threading.Thread(target=greet, args=(pending[-1],), daemon=True).start()
            if len(pending) > MAX_PENDING:
                pending.popleft().close()
    if proven.empty():
        raise SystemExit("no trainer has connected")
    trainer = proven.get()
    for client in pending:
        if client is not trainer:
            client.close()
    if isinstance(trainer, DisconnectedError):
        raise trainer
    return trainer


def main(arguments: Sequence[str]) -> int:
    """Run the engine as its launch arguments say, §11; return its exit code."""
    given = {name: value for name, _, value in (text.partition("=") for text in arguments)}
    token_file = given.get("--ludus-token-file")
    try:
        if "--ludus-listen" in given:
            connection = listen(given["--ludus-listen"], token_file)
        elif "--ludus-connect" in given:
            connection = connect(given["--ludus-connect"], token_file)
        else:
            sys.stderr.write(__doc__ or "")
            return 1
        try:
            serve(connection)
        except ProtocolError as error:
            tell_failure(connection, error)
            return 1
    except DisconnectedError as reason:
        _log.warning("the trainer has left: %s", reason)
        return reason.exit_code


if __name__ == "__main__":
    logging.basicConfig(format="%(name)s: %(message)s")
    sys.exit(main(sys.argv[1:]))
