"""Random actions on made-up batches; no engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ludus.play.random_actions import STEPS_AT_ONCE, RandomActions
from ludus.spec import AgentSpec, ContinuousAction, DiscreteAction, PolicySpec, Spec
from ludus.spec.batch import Batch

NUM_WORLDS = 8
HERO = PolicySpec(
    "hero",
    (),
    (DiscreteAction("turn", 4), ContinuousAction("force", 2, low=(-1.0, 2.0), high=(1.0, 6.0))),
    tuple(AgentSpec(world, f"A{i}") for world in range(NUM_WORLDS) for i in range(2)),
    agents_per_world=2,
)
SPEC = Spec(NUM_WORLDS, "isolated", 2, 60.0, (HERO,))


def test_a_world_gets_the_same_actions_alone_and_among_others() -> None:
    alone = replace(SPEC, num_worlds=1, policies=(replace(HERO, agents=HERO.agents[:2]),))
    batches = {"hero": Batch.allocate(HERO, 2 * NUM_WORLDS)}
    among, single = RandomActions(SPEC, range(10, 10 + NUM_WORLDS)), RandomActions(alone, [13])
    seen: list[bytes] = []
    for _ in range(2 * STEPS_AT_ONCE + 1):
        together, own = among.act(batches)["hero"], single.act(batches)["hero"]
        np.testing.assert_array_equal(together.discrete[6:8], own.discrete)
        np.testing.assert_array_equal(together.continuous[6:8], own.continuous)
        assert len(np.unique(together.continuous)) == together.continuous.size
        seen.append(own.continuous.tobytes())
    assert len(set(seen)) == len(seen)


def test_actions_cover_their_ranges_and_keep_to_masks() -> None:
    policy = replace(HERO, has_action_mask=True)
    batch = Batch.allocate(policy, 2 * NUM_WORLDS)
    assert batch.action_mask is not None
    batch.action_mask[:] = [False, True, False, True]
    player = RandomActions(replace(SPEC, policies=(policy,)), range(NUM_WORLDS))
    actions = [player.act({"hero": batch})["hero"] for _ in range(50)]
    choices = np.concatenate([action.discrete for action in actions])
    numbers = np.concatenate([action.continuous for action in actions])
    assert set(choices[:, 0].tolist()) == {1, 3}
    assert (numbers >= [-1, 2]).all()
    assert (numbers <= [1, 6]).all()
    assert (np.ptp(numbers, axis=0) > [1.8, 3.6]).all()
