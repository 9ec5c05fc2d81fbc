"""Any message of a game raises documented errors only."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ludus.errors import GameError, ProtocolError
from ludus.legacy.gdrl.declaring import group_agents
from ludus.legacy.gdrl.messages import is_env_info, read_call, read_env_info, read_reset, read_step
from ludus.legacy.gdrl.time_limits import TimeLimits
from tests.legacy.gdrl.fake_game import INFO, STEP

NUMBERS = st.integers() | st.floats() | st.booleans() | st.none()
JUNK = st.recursive(
    NUMBERS | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=8,
)
SPACE = st.fixed_dictionaries(
    {},
    optional={
        "size": st.integers(-1, 4) | st.lists(st.integers(-1, 4), max_size=4) | JUNK,
        "space": st.sampled_from(["box", "discrete", "ball"]),
        "action_type": st.sampled_from(["discrete", "continuous", "both"]),
        "low": NUMBERS,
        "high": NUMBERS,
    },
)
SPACES = st.dictionaries(st.sampled_from(["obs", "camera_2d", "", "a b"]), SPACE | JUNK, max_size=2)
INTRODUCTIONS = st.fixed_dictionaries(
    {"type": st.just("env_info")},
    optional={
        "n_agents": st.integers(-1, 3) | JUNK,
        "observation_space": SPACES | st.lists(SPACES, max_size=3) | JUNK,
        "action_space": SPACES | st.lists(SPACES, max_size=3) | JUNK,
        "agent_policy_names": st.lists(st.text(max_size=3), max_size=3) | JUNK,
    },
)
OBSERVATION = st.dictionaries(st.sampled_from(["obs", "camera_2d"]), st.lists(NUMBERS) | JUNK)
STEPS = st.fixed_dictionaries(
    {"type": st.sampled_from(["step", "reset", "call"])},
    optional={
        "obs": st.lists(OBSERVATION | JUNK, max_size=3) | JUNK,
        "reward": st.lists(NUMBERS, max_size=3) | JUNK,
        "done": st.lists(st.booleans() | JUNK, max_size=3) | JUNK,
        "returns": JUNK,
    },
)


def encoded(message: Any) -> bytes:
    return json.dumps(message).encode()


@pytest.mark.slow
@settings(max_examples=300)
@given(message=INTRODUCTIONS | JUNK)
def test_any_introduction_is_read_or_refused(message: Any) -> None:
    try:
        is_env_info(encoded(message))
        policies = group_agents(read_env_info(encoded(message)))
    except (ProtocolError, GameError) as error:
        assert len(str(error)) < 800
        return
    rows = sorted(row for policy in policies for row in policy.rows)
    assert rows == list(range(message["n_agents"]))


@pytest.mark.slow
@settings(max_examples=300)
@given(message=STEPS | JUNK)
def test_any_answer_is_read_or_refused(message: Any) -> None:
    (policy,) = group_agents(read_env_info(encoded(INFO)))
    readers: list[Callable[[bytes], Any]] = [
        lambda data: read_step(data, 2).observations,
        lambda data: read_reset(data, 2),
    ]
    for read in readers:
        try:
            observed = policy.read(read(encoded(message)))["obs"]
        except (ProtocolError, GameError) as error:
            assert len(str(error)) < 800
        else:
            assert np.isfinite(observed).all()
    with contextlib.suppress(ProtocolError):
        assert isinstance(read_call(encoded(message)), list)


@settings(max_examples=200)
@given(data=st.binary(max_size=80))
def test_any_bytes_are_refused(data: bytes) -> None:
    readers: list[Callable[[bytes], Any]] = [
        read_env_info,
        read_call,
        lambda message: read_step(message, 1),
    ]
    for read in readers:
        with pytest.raises(ProtocolError):
            read(data)


@settings(max_examples=200)
@given(pixels=JUNK | st.binary(max_size=24).map(bytes.hex))
def test_any_image_is_checked(pixels: Any) -> None:
    space = {"camera_2d": {"size": [4, 1, 2], "space": "box"}}
    told = {**INFO, "observation_space": [space, space]}
    (policy,) = group_agents(read_env_info(encoded(told)))
    try:
        first, _ = policy.read([{"camera_2d": pixels}] * 2)["camera_2d"]
    except GameError:
        return
    assert first.tobytes() == bytes.fromhex(pixels)


def test_a_picture_may_have_an_alpha_channel_that_the_game_does_not_declare() -> None:
    """Godot's OpenGL renderer gives four channels, Vulkan three."""
    space = {"camera_2d": {"size": [3, 1, 2], "space": "box"}}
    told = {**INFO, "observation_space": [space, space]}
    (policy,) = group_agents(read_env_info(encoded(told)))
    images = policy.read([{"camera_2d": "010203ff040506ff"}, {"camera_2d": "010203040506"}])
    assert images["camera_2d"].tolist() == [[[[1, 2, 3], [4, 5, 6]]]] * 2
    with pytest.raises(GameError, match="has no picture") as error:
        policy.read([{"camera_2d": None}])
    assert "show_window" in error.value.hint


@settings(max_examples=200)
@given(choice=JUNK | st.integers(-1, 4))
def test_any_discrete_observation_is_checked(choice: Any) -> None:
    space = {"lane": {"size": 3, "space": "discrete"}}
    told = {**INFO, "observation_space": [space, space]}
    (policy,) = group_agents(read_env_info(encoded(told)))
    try:
        first, _ = policy.read([{"lane": choice}] * 2)["lane"]
    except GameError:
        return
    assert first.sum() == 1.0 and first.shape == (3,)


def test_a_step_in_fuzzing_is_a_step() -> None:
    """The strategies above are close to what is right."""
    assert read_step(encoded(STEP), 2).rewards == [0.5, 1.0]


@settings(max_examples=200)
@given(
    steps=st.lists(st.booleans(), max_size=60),
    limit=st.integers(1, 40),
    ticks=st.integers(1, 8),
)
def test_agents_that_stand_aside_come_back(steps: list[bool], limit: int, ticks: int) -> None:
    limits = TimeLimits(1, 4 * ticks + limit, ticks)
    limits.restart()
    was_active, num_aside = True, 0
    for has_ended in steps:
        (terminated,), (truncated,), (is_active,) = limits.take([has_ended])
        assert not (terminated and truncated)
        assert was_active or not terminated
        assert was_active or is_active or not truncated
        if has_ended:
            assert was_active == terminated
        num_aside = 0 if is_active else num_aside + 1
        assert num_aside <= 5 + 3 // ticks
        was_active = is_active
