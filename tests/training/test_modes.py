from __future__ import annotations

import pytest

from ludus.errors import ConfigError
from ludus.settings.train_config import Phase, PolicyConfig, PPOConfig, TrainConfig
from ludus.training.modes import ModeSchedule

BOTH: dict[str, PolicyConfig] = {"hero": PPOConfig(), "foe": PPOConfig()}


def modes(schedule: ModeSchedule, updates: int) -> list[str]:
    return list(schedule.at(updates).values())


def test_without_a_schedule_the_settings_hold() -> None:
    config = TrainConfig(policies={"hero": PPOConfig(mode="deterministic"), "foe": PPOConfig()})
    schedule = ModeSchedule(config)
    assert modes(schedule, 0) == modes(schedule, 1000) == ["deterministic", "train"]
    assert [schedule.is_change(updates) for updates in (0, 1, 1000)] == [True, False, False]


def test_policies_take_turns() -> None:
    schedule = ModeSchedule(TrainConfig(policies=BOTH, alternate_every=3))
    learning = [modes(schedule, updates).index("train") for updates in range(9)]
    assert learning == [0, 0, 0, 1, 1, 1, 0, 0, 0]
    assert modes(schedule, 0) == ["train", "frozen"]
    changes = [updates for updates in range(13) if schedule.is_change(updates)]
    assert changes == [0, 3, 6, 9, 12]


def test_only_policies_that_learn_take_turns() -> None:
    policies: dict[str, PolicyConfig] = {**BOTH, "judge": PPOConfig(mode="deterministic")}
    schedule = ModeSchedule(TrainConfig(policies=policies, alternate_every=1))
    assert modes(schedule, 0) == ["train", "frozen", "deterministic"]
    assert modes(schedule, 1) == ["frozen", "train", "deterministic"]
    assert modes(schedule, 2) == modes(schedule, 0)


def test_phases_repeat() -> None:
    phases = (Phase(2, {"foe": "frozen"}), Phase(1, {"hero": "deterministic"}))
    schedule = ModeSchedule(TrainConfig(policies=BOTH, schedule=phases))
    expected = [["train", "frozen"]] * 2 + [["deterministic", "train"]]
    assert [modes(schedule, updates) for updates in range(6)] == expected * 2
    assert [schedule.is_change(updates) for updates in range(4)] == [True, False, True, True]


def test_a_phase_of_an_unknown_policy_is_refused() -> None:
    config = TrainConfig(policies=BOTH, schedule=(Phase(2, {"heroe": "frozen"}),))
    with pytest.raises(ConfigError, match="there is no policy heroe") as info:
        ModeSchedule(config)
    assert info.value.hint == "policies of the game: hero, foe"


def test_turns_beside_a_schedule_are_refused() -> None:
    with pytest.raises(ConfigError, match="alternate_every must be none beside a schedule"):
        TrainConfig(alternate_every=3, schedule=(Phase(2),))
