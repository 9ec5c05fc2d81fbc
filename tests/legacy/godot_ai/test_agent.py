from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from ludus.algorithms.replay import Sample
from ludus.errors import ConfigError, SequenceError
from ludus.serve.godot_ai.agent import Agent, AgentSettings
from ludus.serve.godot_ai.fields import Fields
from ludus.serve.godot_ai.transitions import read_replays
from tests.legacy.godot_ai.conftest import replays

SETTINGS = AgentSettings(
    name="hero", state_size=3, action_size=2, batch_size=16, hidden_size=24,
    num_actor_layers=3, num_critic_layers=4, replay_capacity=50,
)  # fmt: skip


def agent(settings: AgentSettings = SETTINGS) -> Agent:
    return Agent(settings, 0, torch.device("cpu"))


def sample(count: int, seed: int = 0) -> Sample:
    submitted = read_replays(Fields({"replays": replays(count, seed=seed)}, "x"), {"hero": agent()})
    assert submitted.first_error is None
    return submitted.transitions["hero"]


def test_settings_that_a_game_does_not_say_are_those_of_godot_ai() -> None:
    config = agent().sac.config
    assert config.hidden_sizes == (24,) * 4
    assert config.critic_hidden_sizes == (24,) * 5
    assert (config.learning_rate, config.discount, config.target_rate) == (3e-4, 0.99, 0.005)
    assert config.target_entropy == -2.0
    assert not config.normalise_observation
    assert config.learning_starts == 0


def test_the_newest_transitions_are_kept() -> None:
    hero = agent()
    hero.add(sample(30))
    hero.add(sample(130, seed=1))
    kept = hero.sac.state().tensors["samples.state"]
    rows = np.array([row["state"] for row in replays(130, seed=1)[-50:]], np.float32)
    assert np.array_equal(kept.numpy(), rows)
    assert hero.num_transitions == 160


def test_transitions_arrive_as_they_were_submitted() -> None:
    hero = agent()
    hero.add(sample(20))
    state = hero.sac._replay.state()  # pyright: ignore[reportPrivateUsage]
    for index, row in enumerate(replays(20)):
        assert state["observation.state"][index].numpy() == pytest.approx(row["state"])
        assert state["next_observation.state"][index].numpy() == pytest.approx(row["state_"])
        assert state["continuous"][index].numpy() == pytest.approx(row["action"])
        assert state["reward"][index].item() == pytest.approx(row["reward"])
        assert bool(state["is_terminated"][index]) == bool(row["done"])


def test_there_must_be_something_to_learn_from() -> None:
    with pytest.raises(SequenceError, match="policy hero has no transitions"):
        agent().sac.learn(1)


def test_learning_stops_when_asked() -> None:
    hero = agent()
    hero.add(sample(40))
    answers = iter([False, False, True])
    metrics = hero.learn(1000, lambda: next(answers))
    assert hero.num_steps == 16
    assert metrics["q_loss"] > 0.0
    assert hero.learn(5, lambda: True) == {}


def test_capacity_below_a_batch() -> None:
    hero = agent(replace(SETTINGS, replay_capacity=4))
    hero.add(sample(40))
    hero.learn(2, lambda: False)
    assert hero.num_steps == 2


def test_what_does_not_fit_into_memory_is_refused() -> None:
    with pytest.raises(ConfigError, match="lower get_replay_capacity"):
        replace(SETTINGS, replay_capacity=10**9)
