"""Specs read from JSON: what is wrong is named with its place (PROTOCOL.md §4)."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest
from hypothesis import given

from ludus.errors import ProtocolError
from ludus.spec import Spec
from ludus.wire.frames import FrameType, decode_json, encode_json
from ludus.wire.spec_reader import read_spec
from tests.wire.golden import load
from tests.wire.strategies import specs

POLICIES = load("spec_policies").content
HERO = "spec.policies[0]"
TARGET = "spec.policies[1]"
BIG = 10**4000

# path of the value, its replacement, where the error says it is, what the error says
MISTAKES: list[tuple[list[Any], Any, str, str]] = [
    (["num_worlds"], 0, "spec.num_worlds", "expected 1 to 65536, got 0"),
    (["num_worlds"], 65_537, "spec.num_worlds", "expected 1 to 65536"),
    (["num_worlds"], 1.5, "spec.num_worlds", "expected an integer"),
    (["num_worlds"], True, "spec.num_worlds", "expected an integer"),
    (["num_worlds"], "2", "spec.num_worlds", "expected an integer"),
    (["num_worlds"], float("inf"), "spec.num_worlds", "expected an integer"),
    (["layout"], "ring", "spec.layout", "expected one of isolated, grid, got 'ring'"),
    (["layout"], None, "spec.layout", "expected a text"),
    (["ticks_per_step"], 0, "spec.ticks_per_step", "expected 1 to"),
    (["tick_rate"], "60", "spec.tick_rate", "expected a number"),
    (["tick_rate"], 0, "spec.tick_rate", "expected a positive number, got 0"),
    (["tick_rate"], float("inf"), "spec.tick_rate", "finite"),
    (["tick_rate"], BIG, "spec.tick_rate", "finite"),
    (["scene"], 5, "spec.scene", "expected a text"),
    (["policies"], [], "spec.policies", "expected 1 to 64 items, got 0"),
    (["policies"], [None] * 65, "spec.policies", "expected 1 to 64 items, got 65"),
    (["policies"], {}, "spec.policies", "expected a list, got {}"),
    (["policies", 1], 3, TARGET, "expected an object, got 3"),
    (["policies", 1, "name"], "hero", "spec.policies", "two items have the same name"),
    (["policies", 0, "name"], "", f"{HERO}.name", "expected a name of 1 to 128 characters"),
    (["policies", 0, "name"], "x" * 129, f"{HERO}.name", "expected a name of 1 to 128 characters"),
    (["policies", 0, "name"], "@league", f"{HERO}.name", "not beginning with @, got '@league'"),
    (["policies", 0, "name"], "a/policy.x", f"{HERO}.name", "without / and \\"),
    (["policies", 0, "name"], "..\\x", f"{HERO}.name", "without / and \\"),
    (["policies", 0, "name"], "a\x1b[2J", f"{HERO}.name", "without control characters"),
    (["policies", 0, "name"], "a\ud800", f"{HERO}.name", "without control characters"),
    (["policies", 0, "name"], "a\u202eb", f"{HERO}.name", "without control characters"),
    (["policies", 0, "name"], " a", f"{HERO}.name", "without a space at either end"),
    (["policies", 0, "action", 0, "name"], "a\n", f"{HERO}.action[0].name", "control"),
    (["policies", 0, "observation", 0, "name"], "\x00", f"{HERO}.observation[0].name", "control"),
    (["policies", 0, "num_agents"], 3, f"{HERO}.num_agents", "the list of agents has 2"),
    (["policies", 0, "agents"], [], f"{HERO}.agents", "expected 1 to 65536 items"),
    (["policies", 0, "agents_per_world"], 0, f"{HERO}.agents_per_world", "expected 1 to"),
    (["policies", 0, "agents_per_world"], 2, f"{HERO}.agents_per_world", "2 worlds"),
    (["policies", 0, "agents", 1, "world"], 2, f"{HERO}.agents[1].world", "expected 0 to 1"),
    (["policies", 0, "agents", 0, "world"], 1, f"{HERO}.agents[0].world", "expected 0"),
    (["policies", 0, "agents", 1, "path"], 7, f"{HERO}.agents[1].path", "text or null"),
    (["policies", 0, "episode"], "day", f"{HERO}.episode", "expected one of agent, world"),
    (["policies", 0, "max_episode_steps"], 0, f"{HERO}.max_episode_steps", "expected 1 to"),
    (["policies", 0, "has_action_mask"], 1, f"{HERO}.has_action_mask", "true or false"),
    (["policies", 1, "has_action_mask"], True, f"{TARGET}.has_action_mask", "no discrete action"),
    (["policies", 0, "settings"], None, f"{HERO}.settings", "expected an object"),
    (["policies", 0, "action"], [], f"{HERO}.action", "expected 1 to"),
    (["policies", 0, "action", 0, "n"], 0, f"{HERO}.action[0].n", "expected 1 to"),
    (["policies", 0, "action", 0, "kind"], "both", f"{HERO}.action[0].kind", "expected one of"),
    (["policies", 0, "action", 1, "size"], 0, f"{HERO}.action[1].size", "expected 1 to"),
    (["policies", 0, "action", 1, "low"], None, f"{HERO}.action[1].low", "missing"),
    (["policies", 0, "action", 1, "low"], "a", f"{HERO}.action[1].low", "expected a number"),
    (["policies", 0, "action", 1, "low"], 2.0, f"{HERO}.action[1].low", "above high"),
    (["policies", 0, "action", 1, "high"], BIG, f"{HERO}.action[1].high", "finite"),
    (["policies", 0, "action", 2, "high"], [1.0, 2.0], f"{HERO}.action[2].high", "1 numbers"),
    (["policies", 0, "action", 2, "name"], "move", f"{HERO}.action", "two items"),
    (["policies", 0, "observation"], [], f"{HERO}.observation", "expected 1 to 64 items"),
    (["policies", 0, "observation", 1, "name"], "aim", f"{HERO}.observation", "two items"),
    (["policies", 0, "observation", 0, "dtype"], "f4", f"{HERO}.observation[0].dtype", "float32"),
    (["policies", 0, "observation", 0, "shape"], [], f"{HERO}.observation[0].shape", "1 to 8"),
    (["policies", 0, "observation", 0, "shape"], [1] * 9, f"{HERO}.observation[0].shape", "1 to 8"),
    (["policies", 0, "observation", 0, "shape"], [0], f"{HERO}.observation[0].shape", "positive"),
    (["policies", 0, "observation", 0, "shape"], [BIG] * 8, f"{HERO}.observation[0].shape", ""),
    (["policies", 0, "observation", 0, "shape"], 3, f"{HERO}.observation[0].shape", "a list"),
    (["policies", 0, "observation", 0, "low"], [0.0], f"{HERO}.observation[0].low", "3 numbers"),
    (["policies", 0, "observation", 0, "high"], -5, f"{HERO}.observation[0].low", "above high"),
    (["policies", 1, "observation", 0, "low"], BIG, f"{TARGET}.observation[0].low", "finite"),
    (["policies", 1, "observation", 0, "shape"], [1 << 25], "spec", "BATCH"),
]


def replaced(path: list[Any], value: Any) -> dict[str, Any]:
    spec = copy.deepcopy(POLICIES)
    place: Any = spec
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return spec


def test_the_example_is_right() -> None:
    assert read_spec(POLICIES).to_json() == POLICIES


@pytest.mark.parametrize(
    ("path", "value", "where", "what"),
    MISTAKES,
    ids=[f"{'.'.join(map(str, path))}-{i}" for i, (path, *_) in enumerate(MISTAKES)],
)
def test_a_mistake_is_named_with_its_place(
    path: list[Any], value: Any, where: str, what: str
) -> None:
    with pytest.raises(ProtocolError) as caught:
        read_spec(replaced(path, value))
    assert caught.value.message.startswith(f"{where}: ")
    assert what in caught.value.message


def every_required_key(value: Any, where: str) -> list[tuple[list[Any], str]]:
    optional = {"scene", "low", "high", "settings"}
    found: list[tuple[list[Any], str]] = []
    for key, part in value.items():
        if key not in optional:
            found.append(([key], f"{where}.{key}"))
        if isinstance(part, list) and part and isinstance(part[0], dict):
            inner = every_required_key(part[0], f"{where}.{key}[0]")
            found += [([key, 0, *path], place) for path, place in inner]
    return found


@pytest.mark.parametrize(("path", "where"), every_required_key(POLICIES, "spec"))
def test_a_missing_key_is_named(path: list[Any], where: str) -> None:
    spec = copy.deepcopy(POLICIES)
    place: Any = spec
    for key in path[:-1]:
        place = place[key]
    del place[path[-1]]
    with pytest.raises(ProtocolError) as caught:
        read_spec(spec)
    assert caught.value.message == f"{where}: missing"


@pytest.mark.parametrize("value", [None, [], "spec", 3])
def test_a_spec_is_an_object(value: Any) -> None:
    with pytest.raises(ProtocolError, match=r"^spec: expected an object"):
        read_spec(value)


def test_whole_floats_are_integers() -> None:
    floats = json.loads(json.dumps(POLICIES), parse_int=float)
    assert read_spec(floats) == read_spec(POLICIES)


@given(specs())
def test_round_trip(spec: Spec) -> None:
    frame = encode_json_spec(spec)
    assert read_spec(decode_json(frame[8:], "SPEC")) == spec


def encode_json_spec(spec: Spec) -> bytes:
    return encode_json(FrameType.SPEC, spec.to_json())


@given(specs())
def test_the_fingerprint_is_of_the_network_only(spec: Spec) -> None:
    for policy in spec.policies:
        value = policy.to_json()
        value |= {"settings": {}, "max_episode_steps": 77}
        whole = {**spec.to_json(), "policies": [value], "scene": "res://other.tscn"}
        assert read_spec(whole).policies[0].fingerprint() == policy.fingerprint()


@pytest.mark.parametrize("name", ["héros", "敵", "a b", "red.1", "$x$", "[b]", "x" * 128])
def test_other_names_are_allowed(name: str) -> None:
    assert read_spec(replaced(["policies", 0, "name"], name)).policies[0].name == name


def test_control_characters_of_places_are_escaped() -> None:
    spec = read_spec(replaced(["policies", 0, "agents", 0, "path"], "a\x1b[2J\ud800"))
    assert spec.policies[0].agents[0].path == r"a\x1b[2J\ud800"
    assert read_spec(replaced(["scene"], "res://\x07.tscn")).scene == r"res://\x07.tscn"
