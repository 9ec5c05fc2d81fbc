"""Recordings and their comparison, on made-up frames; no engine."""

from __future__ import annotations

import numpy as np
import pytest

from ludus.check.difference import first_difference
from ludus.check.episodes import Verdict, compare_episodes
from ludus.check.finding import Status
from ludus.check.frame_rules import RULES, apply_rule
from ludus.check.observations import ranges
from ludus.check.recording import Frame, Recording
from ludus.spec import (
    AgentSpec,
    ContinuousAction,
    DiscreteAction,
    ObservationEntry,
    PolicySpec,
    Spec,
)
from ludus.spec.batch import Batch

NUM_WORLDS = 8


def make_spec(*, has_action_mask: bool = False) -> Spec:
    policy = PolicySpec(
        "hero",
        (ObservationEntry("place", "float32", (2,)), ObservationEntry("item", "int64", (1,))),
        (DiscreteAction("turn", 4), ContinuousAction("force", 2, low=(-1.0, 2.0), high=(1.0, 6.0))),
        tuple(AgentSpec(world, f"A{i}") for world in range(NUM_WORLDS) for i in range(2)),
        agents_per_world=2,
        has_action_mask=has_action_mask,
    )
    return Spec(NUM_WORLDS, "isolated", 2, 60.0, (policy,))


def make_recording(num_steps: int = 40, noise: float = 0.0) -> Recording:
    """Agents that walk in a circle; every tenth step ends the episode of world 0."""
    spec = make_spec()
    frames: list[Frame] = []
    for step in range(num_steps + 1):
        batch = Batch.allocate(spec.policies[0], 2 * NUM_WORLDS)
        phase = np.arange(2 * NUM_WORLDS) + 0.1 * step
        batch.observation["place"][:] = np.stack([np.cos(phase), np.sin(phase)], axis=1) + noise
        batch.observation["item"][:] = step
        batch.active[:] = True
        if step and step % 10 == 0:
            batch.terminated[:2] = True
            batch.final_index = np.array([0, 1])
            batch.final_observation = {k: v[:2].copy() for k, v in batch.observation.items()}
        frames.append(Frame(2 * step, {"hero": batch}))
    return Recording(spec, 5, tuple(frames))


def test_the_first_difference_is_found_to_the_bit() -> None:
    one, two = make_recording(), make_recording()
    assert first_difference(one, two) is None
    assert one.digest() == two.digest()
    place = two.frames[7].batches["hero"].observation["place"]
    place[5, 1] = np.nextafter(place[5, 1], np.float32(np.inf))
    found = first_difference(one, two)
    assert found is not None
    assert (found.step, found.tick, found.slot, found.element) == (7, 14, 5, (1,))
    assert (found.world, found.agent) == (2, "A1")
    assert one.digest() != two.digest()
    assert first_difference(one.world(1), two.world(1)) is None
    assert first_difference(one.world(2), two.world(2)) is not None


def test_an_end_in_one_run_only_is_a_difference() -> None:
    one, two = make_recording(), make_recording()
    two.frames[3].batches["hero"].terminated[4] = True
    found = first_difference(one, two)
    assert found is not None
    assert (found.step, found.what, found.values) == (3, "terminated", (0.0, 1.0))


def test_first_ends_are_steps_of_worlds() -> None:
    assert make_recording().first_ends().tolist() == [10] + [41] * (NUM_WORLDS - 1)


def test_rounding_is_close_and_an_offset_is_different() -> None:
    plain = make_recording()
    assert compare_episodes(plain, make_recording()).verdict is Verdict.EQUAL
    close = compare_episodes(plain, make_recording(noise=1e-6))
    assert close.verdict is Verdict.CLOSE
    assert close.close_steps == 40
    other = compare_episodes(plain, make_recording(noise=0.1))
    assert other.verdict is Verdict.DIFFERENT
    assert "the first observation" in other.reason


def test_a_jump_in_many_worlds_is_different_and_in_one_is_not() -> None:
    plain = make_recording()
    for num_worlds, verdict in ((1, Verdict.CLOSE), (NUM_WORLDS, Verdict.DIFFERENT)):
        jumping = make_recording(noise=1e-7)
        for frame in jumping.frames[20:]:
            frame.batches["hero"].observation["place"][: 2 * num_worlds] += 0.5
        comparison = compare_episodes(plain, jumping)
        assert comparison.verdict is verdict, comparison.reason
        assert comparison.close_steps == 19


def test_correct_frames_keep_every_rule() -> None:
    for title, (rule, hint) in RULES.items():
        assert apply_rule(make_recording(), title, rule, hint).status is Status.OK


@pytest.mark.parametrize(
    ("title", "changes"),
    [
        ("terminated and truncated are never both true", {"terminated": True, "truncated": True}),
        ("final observations exactly where an episode ended", {"terminated": True}),
        ("outcomes only for agents that acted", {"reward": 1.0}),
        ("inactive agents observe zeros", {"active": False}),
        ("agents become inactive only at the end of an episode", {"active": False}),
    ],
)
def test_every_rule_can_be_broken(title: str, changes: dict[str, float]) -> None:
    recording = make_recording()
    if "outcomes" in title:
        recording.frames[3].batches["hero"].active[6] = False
    for name, value in changes.items():
        getattr(recording.frames[4].batches["hero"], name)[6] = value
    rule, hint = RULES[title]
    found = apply_rule(recording, title, rule, hint)
    assert found.status is Status.FAIL
    assert (found.data["step"], found.data["slot"]) == (4, 6)
    assert "world 3" in found.detail


def test_ranges_are_short() -> None:
    assert ranges([0, 1, 2, 5, 7, 8]) == "0–2, 5, 7–8"
    assert ranges([]) == ""
