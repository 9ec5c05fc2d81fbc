"""What was seen often is worth nothing, and what is new is worth going to."""

from __future__ import annotations

import torch

from ludus.algorithms.curiosity import Curiosity
from ludus.networks.networks import Inputs
from ludus.networks.policy import Policy
from ludus.settings.train_config import PPOConfig
from ludus.spec import AgentSpec, DiscreteAction, ObservationEntry, PolicySpec

SPEC = PolicySpec(
    "hero",
    (ObservationEntry("place", "float32", (3,)),),
    (DiscreteAction("move", 2),),
    (AgentSpec(0, "x"), AgentSpec(1, "x")),
)
CONFIG = PPOConfig(hidden_sizes=(8,), minibatch_size=64, epochs=2, curiosity=1.0)
NUM_STEPS = 32


def curiosity() -> Curiosity:
    with torch.random.fork_rng(devices=[]):  # pyright: ignore[reportUnknownMemberType]
        torch.manual_seed(0)  # pyright: ignore[reportUnknownMemberType]
        return Curiosity(Policy(SPEC, CONFIG), CONFIG, num_agents=2)


def places(*share_of_new: float) -> Inputs:
    """Return what two agents see: one place, and in the second half what is ``new`` to each."""
    seen = torch.zeros(NUM_STEPS + 1, 2, 3)
    seen[..., 0] = 1.0
    for agent, share in enumerate(share_of_new):
        seen[NUM_STEPS // 2 :, agent] = torch.tensor([1.0 - share, share, share])
    return Inputs(seen.flatten(0, 1))


def all_active() -> torch.Tensor:
    return torch.ones(NUM_STEPS + 1, 2, dtype=torch.bool)


def test_what_leads_to_something_new_has_the_greater_advantage() -> None:
    curious, generator = curiosity(), torch.Generator().manual_seed(0)
    novelties: list[float] = []
    for _ in range(60):
        curious.advantage(places(0.0, 0.0), all_active(), CONFIG)
        novelties.append(curious.learn(CONFIG, 1e-3, generator))
    assert novelties[-1] < 0.01 * novelties[0]
    advantage = curious.advantage(places(0.0, 1.0), all_active(), CONFIG)
    old, new = advantage[: NUM_STEPS // 2].mean(0)
    assert new > old + 0.5


def test_nothing_follows_where_an_agent_is_gone() -> None:
    is_active = all_active()
    is_active[NUM_STEPS // 2 :, 1] = False
    advantage = curiosity().advantage(places(1.0, 1.0), is_active, CONFIG)
    assert bool((advantage[NUM_STEPS // 2 - 1 :, 1] == 0).all())
    assert bool((advantage[: NUM_STEPS // 2 - 1] > 0).all())


def test_goes_on_as_it_was_saved() -> None:
    first, other = curiosity(), Curiosity(Policy(SPEC, CONFIG), CONFIG, num_agents=2)
    generator = torch.Generator().manual_seed(0)
    first.advantage(places(0.0, 1.0), all_active(), CONFIG)
    first.learn(CONFIG, 1e-3, generator)
    other.load_state({name: value.clone() for name, value in first.state().items()})
    state = generator.get_state()
    results: list[tuple[torch.Tensor, float]] = []
    for each in (first, other):
        generator.set_state(state)
        each.advantage(places(0.0, 1.0), all_active(), CONFIG)
        novelty = each.learn(CONFIG, 1e-3, generator)
        results.append((each.advantage(places(1.0, 1.0), all_active(), CONFIG), novelty))
    assert torch.equal(results[0][0], results[1][0])
    assert results[0][1] == results[1][1]
