"""Say what looks wrong with the learning of a policy while it trains, and what to try.

Each kind of trouble is reported once in a run; ``docs/it-does-not-learn.md`` explains them all.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ludus.play.evaluation import Evaluation
from ludus.spec import PolicySpec

__all__ = ["Diagnosis"]

log = logging.getLogger(__name__)

PAGE = "docs/it-does-not-learn.md"

MIN_EPISODES = 100
"""What never happens in 100 episodes happens in less than 3 % of them (rule of three, 95 %)."""

MIN_STEPS = 100_000
"""The same in agent steps, for games whose episodes hardly ever end."""

LOW_ENTROPY = 0.02
"""Share of the highest entropy: the policy of two alternatives takes one of them in 99.8 %."""

LOW_STD = 0.02
"""Deviation of continuous actions whose bounds are -1 and 1: 1 % of what they could be."""

LOW_EXPLAINED_VARIANCE = 0.05
"""A critic that explains less of the returns helps no more than none."""

BLIND_UPDATES = 50
"""Updates in a row with such a critic. New critics of `tag` had at most five."""

MIN_DEVIATIONS = 3.0
"""Standard errors between two means that are not chance."""

TROUBLES = {
    "no-reward-yet": "no reward other than 0 yet; reward steps on the way, or begin with lessons "
    "nearer to the goal",
    "equal-returns": "every episode so far had the same return; check that rewards depend on what "
    "the agent does, and that its actions reach the game (ludus check)",
    "entropy-collapsed": "it takes nearly the same actions each time, and returns are in the lower "
    "half of what it has reached; raise entropy_coefficient, or lower learning_rate",
    "blind-critic": "the critic predicts none of the returns; check that observations show what "
    "rewards depend on, or set frame_stack or memory_size",
    "evaluation-below-training": "the most probable actions earn far less than drawn ones; "
    "ludus evaluate RUN --stochastic plays as in training, longer training or a lower "
    "entropy_coefficient narrow the gap",
}
"""What is reported of a policy by kind, which is its heading on the page."""


@dataclass
class _History:
    """What has been seen of one policy so far.

    Attributes:
        has_reward: Whether it ever got a reward other than 0.
        low: Lowest return so far.
        high: Highest return so far.
        num_blind: Updates in a row in which its critic explained nothing.
    """

    has_reward: bool = False
    low: float = math.inf
    high: float = -math.inf
    num_blind: int = 0

    @property
    def has_equal_returns(self) -> bool:
        return math.isclose(self.low, self.high, rel_tol=1e-6)

    def take(self, metrics: Mapping[str, float]) -> None:
        """Take the metrics of an update."""
        self.low = min(self.low, metrics.get("min_return", math.inf))
        self.high = max(self.high, metrics.get("max_return", -math.inf))
        # Algorithms of scripts may not say whether there was a reward.
        has_return = self.low < self.high or self.low not in {0.0, math.inf}
        self.has_reward |= bool(metrics.get("has_reward", has_return))
        explained = metrics.get("explained_variance")
        if explained is not None:
            is_blind = self.has_reward and explained < LOW_EXPLAINED_VARIANCE
            self.num_blind = self.num_blind + 1 if is_blind else 0


class Diagnosis:
    """Watches the policies of one run.

    Args:
        specs: Of the policies.
    """

    def __init__(self, specs: Mapping[str, PolicySpec]) -> None:
        self._specs = specs
        self._histories = {name: _History() for name in specs}
        self._told: set[str] = set()

    def check(self, policies: Mapping[str, Mapping[str, float]], agent_steps: int) -> None:
        """Warn of what the metrics of an update show in policies that learn."""
        found: dict[str, list[str]] = {}
        for name, metrics in policies.items():
            if metrics["is_learning"]:
                self._histories[name].take(metrics)
                for kind in self._find(name, metrics, agent_steps):
                    found.setdefault(kind, []).append(name)
        for kind, names in found.items():
            self._tell(kind, names)

    def compare(
        self, evaluation: Mapping[str, Evaluation], returns: Mapping[str, Sequence[float]]
    ) -> None:
        """Warn if the evaluation is far below the last returns of training.

        Only for the only policy of a game: others play differently in an evaluation, too.
        """
        if len(self._specs) > 1:
            return
        for name, of in evaluation.items():
            trained = np.asarray(returns[name])
            if not len(trained):
                continue
            gap = float(trained.mean()) - of.mean_return
            error = math.hypot(
                of.std_return / math.sqrt(of.num_episodes), trained.std() / math.sqrt(len(trained))
            )
            gain = float(trained.mean()) - min(self._histories[name].low, of.min_return)
            if gap > max(0.5 * gain, MIN_DEVIATIONS * error):
                self._tell("evaluation-below-training", [name])

    def state(self) -> dict[str, Any]:
        """Return what a resumed run goes on with, as JSON values."""
        histories = {name: asdict(of) for name, of in self._histories.items() if of.low <= of.high}
        return {"histories": histories, "told": sorted(self._told)}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Go on from :meth:`state`."""
        for name, values in state["histories"].items():
            self._histories[name] = _History(**values)
        self._told = set(state["told"])

    def _find(self, name: str, metrics: Mapping[str, float], agent_steps: int) -> list[str]:
        """Return the kinds of trouble that one policy has."""
        history = self._histories[name]
        is_late = metrics["episodes"] >= MIN_EPISODES or agent_steps >= MIN_STEPS
        if not is_late:
            return []
        if not history.has_reward:
            return ["no-reward-yet"]
        found: list[str] = []
        if history.has_equal_returns:
            found.append("equal-returns")
        middle = (history.low + history.high) / 2
        if metrics.get("mean_return", middle) < middle and self._has_collapsed(name, metrics):
            found.append("entropy-collapsed")
        if history.num_blind >= BLIND_UPDATES:
            found.append("blind-critic")
        return found

    def _has_collapsed(self, name: str, metrics: Mapping[str, float]) -> bool:
        spec = self._specs[name]
        if spec.continuous_size:  # the entropy of a Gaussian has no zero to compare with
            return metrics.get("action_std", math.inf) < LOW_STD
        highest = sum(math.log(n) for n in spec.nvec)
        return metrics.get("entropy", math.inf) < LOW_ENTROPY * highest

    def _tell(self, kind: str, names: Sequence[str]) -> None:
        if kind in self._told:
            return
        self._told.add(kind)
        whose = f"polic{'y' if len(names) == 1 else 'ies'} {', '.join(names)}"
        log.warning("%s: %s (%s#%s)", whose, TROUBLES[kind], PAGE, kind)
