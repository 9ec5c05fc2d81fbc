"""Warnings while a policy trains: each when it is due, once, and in no other case."""

from __future__ import annotations

import json
import logging
import math
import re
from pathlib import Path
from typing import Any

import pytest

from ludus.play.evaluation import Evaluation
from ludus.spec import AgentSpec, ContinuousAction, DiscreteAction, ObservationEntry, PolicySpec
from ludus.training import diagnosis
from ludus.training.diagnosis import BLIND_UPDATES, TROUBLES, Diagnosis
from ludus.training.loop import train

ROOT = Path(__file__).parents[2]


def spec(name: str, action: DiscreteAction | ContinuousAction) -> PolicySpec:
    entries = (ObservationEntry("o", "float32", (2,)),)
    return PolicySpec(name, entries, (action,), (AgentSpec(0, "x"),))


DISCRETE = {"hero": spec("hero", DiscreteAction("a", 2))}
CONTINUOUS = {"hero": spec("hero", ContinuousAction("a", 1, -1.0, 1.0))}
HEALTHY = {
    "is_learning": 1.0, "episodes": 500.0, "has_reward": 1.0, "explained_variance": 0.5,
    "entropy": 0.5, "action_std": 0.5, "min_return": 0.0, "max_return": 10.0, "mean_return": 3.0,
}  # fmt: skip


def warned(
    caplog: pytest.LogCaptureFixture, of: Diagnosis, *updates: dict[str, float], steps: int = 50_000
) -> list[str]:
    """Return the kinds that were reported while the policy had these metrics in turn."""
    caplog.clear()
    for changes in updates:
        of.check({"hero": HEALTHY | changes}, steps)
    return [re.findall(r"#([\w-]+)\)", record.getMessage())[0] for record in caplog.records]


SILENT = {"has_reward": 0.0, "min_return": 0.0, "max_return": 0.0, "mean_return": 0.0}
EQUAL = {"min_return": 5.0, "max_return": 5.0, "mean_return": 5.0}


@pytest.mark.parametrize(
    ("kind", "changes"),
    [
        ("no-reward-yet", SILENT),
        ("equal-returns", EQUAL),
        ("equal-returns", SILENT | {"has_reward": 1.0}),  # rewards that add up to 0
        ("entropy-collapsed", {"entropy": 0.01}),
        ("blind-critic", {"explained_variance": 0.01}),
    ],
)
def test_each_trouble_is_reported_once(
    caplog: pytest.LogCaptureFixture, kind: str, changes: dict[str, float]
) -> None:
    of = Diagnosis(DISCRETE)
    assert warned(caplog, of, *[changes] * (2 * BLIND_UPDATES)) == [kind]
    assert caplog.records[0].getMessage().startswith("policy hero: ")


@pytest.mark.parametrize(
    "changes",
    [
        {},
        SILENT | {"episodes": 99.0},  # too early to say
        SILENT | {"is_learning": 0.0},
        {"entropy": 0.01, "mean_return": 9.0},  # it has learnt
        {"entropy": 0.0, "min_return": 10.0, "mean_return": 10.0},  # all of the last window equal
    ],
)
def test_nothing_else_is_reported(
    caplog: pytest.LogCaptureFixture, changes: dict[str, float]
) -> None:
    of = Diagnosis(DISCRETE)
    assert warned(caplog, of, {"episodes": 1.0}, *[changes] * (2 * BLIND_UPDATES)) == []


def test_a_critic_may_be_blind_for_a_while(caplog: pytest.LogCaptureFixture) -> None:
    blind = [{"explained_variance": -0.2}] * (BLIND_UPDATES - 1)
    assert warned(caplog, Diagnosis(DISCRETE), *blind, {}, *blind) == []


def test_endless_episodes_are_judged_by_steps(caplog: pytest.LogCaptureFixture) -> None:
    of = Diagnosis(DISCRETE)
    metrics = {"is_learning": 1.0, "episodes": 0.0, "has_reward": 0.0}
    of.check({"hero": metrics}, 99_999)
    assert not caplog.records
    of.check({"hero": metrics}, 100_000)
    assert "#no-reward-yet" in caplog.text


def test_continuous_actions_collapse_by_their_deviation(caplog: pytest.LogCaptureFixture) -> None:
    assert warned(caplog, Diagnosis(CONTINUOUS), {"entropy": -3.0, "action_std": 0.03}) == []
    assert warned(caplog, Diagnosis(CONTINUOUS), {"action_std": 0.01}) == ["entropy-collapsed"]


def evaluation(*returns: float) -> dict[str, Evaluation]:
    return {"hero": Evaluation.of(list(returns), [1] * len(returns))}


def test_an_evaluation_far_below_training_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    trained = {"hero": [0.0, 0.0, 0.0, 450.0] * 25}
    of = Diagnosis(DISCRETE)
    warned(caplog, of, {"min_return": 0.0, "max_return": 450.0})
    of.compare(evaluation(*[100.0] * 20), trained)  # as much as many an episode of training
    assert not caplog.records
    of.compare(evaluation(*[0.0] * 20), trained)
    assert "#evaluation-below-training" in caplog.text


def test_a_noisy_evaluation_is_not_reported(caplog: pytest.LogCaptureFixture) -> None:
    of = Diagnosis(DISCRETE)
    warned(caplog, of, {"min_return": 0.0, "max_return": 450.0})
    of.compare(evaluation(0.0, 0.0, 0.0, 100.0), {"hero": [0.0, 0.0, 0.0, 450.0]})
    assert not caplog.records


def test_a_resumed_run_repeats_no_warning(caplog: pytest.LogCaptureFixture) -> None:
    first, second = Diagnosis(DISCRETE), Diagnosis(DISCRETE)
    assert warned(caplog, first, EQUAL) == ["equal-returns"]
    second.load_state(json.loads(json.dumps(first.state())))
    assert warned(caplog, second, EQUAL) == []
    assert math.isclose(second.state()["histories"]["hero"]["low"], 5.0)


def test_a_run_warns_in_its_log(small: Any, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, diagnosis.__name__):
        result = train(small("gym:Terminated-v0"))
    assert caplog.text.count("policy agent: every episode so far had the same return") == 1
    assert "#equal-returns" in (result.path / "train.log").read_text()


def test_the_page_has_a_section_for_each_trouble() -> None:
    page = (ROOT / "docs/it-does-not-learn.md").read_text()
    headings = {name.lower().replace(" ", "-") for name in re.findall(r"^## (.+)$", page, re.M)}
    assert headings >= TROUBLES.keys()
