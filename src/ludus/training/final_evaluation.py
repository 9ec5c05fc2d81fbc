"""The evaluation at the end of a run, which also tells whether its target return is reached."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping

from ludus.algorithms.learner import Learner
from ludus.errors import RunError
from ludus.play.evaluation import MAX_STEPS, Evaluation, evaluate
from ludus.play.players import trained_player
from ludus.pool.interface import Pool
from ludus.training.progress import Reporter
from ludus.training.trainer import Trainer

__all__ = ["FinalEvaluation"]

log = logging.getLogger(__name__)

CHANCE_ERRORS = 2.0
"""Standard errors that the mean of an evaluation may be below the target return by chance."""
ENDLESS_STEPS = 10_000
"""Steps that the evaluation waits for episodes whose length nothing limits."""


class FinalEvaluation:
    """Plays with the most probable actions of a run's policies.

    Args:
        trainer: Of the run; between updates.
        learners: Of each policy.
        pool: Where it plays; in the middle of episodes afterwards.
        reporter: Is told when it begins.
    """

    def __init__(
        self, trainer: Trainer, learners: Mapping[str, Learner], pool: Pool, reporter: Reporter
    ) -> None:
        self._trainer = trainer
        self._policies = {name: learner.policy for name, learner in learners.items()}
        self._pool = pool
        self._reporter = reporter
        self._found: dict[str, Evaluation] | None = None

    def is_confirmed(self) -> bool:
        """Return whether the target return holds, which drawn actions have reached in training.

        Several policies, and one that plays itself, make each other's returns: theirs is taken as
        it is. The same goes for a run without an evaluation.
        """
        config = self._trainer.config
        if len(self._policies) > 1 or config.league.share or config.target_return is None:
            return True
        found = self._evaluate()
        for of in found.values():
            error = of.std_return / math.sqrt(of.num_episodes)
            if of.mean_return + CHANCE_ERRORS * error < config.target_return:
                log.warning(
                    "target_return %g is reached in training, and %g ± %.2g in an evaluation: "
                    "training goes on (evaluation_episodes 0 leaves this out)",
                    config.target_return, of.mean_return, error,
                )  # fmt: skip
                return False
        self._found = found
        return True

    def play(self) -> dict[str, Evaluation]:
        """Return how the policies play; nothing where that is not asked for, or never ends."""
        return self._evaluate() if self._found is None else self._found

    def _evaluate(self) -> dict[str, Evaluation]:
        config, pool = self._trainer.config, self._pool
        if not config.evaluation_episodes:
            return {}
        self._reporter.evaluating(config.evaluation_episodes)
        self._trainer.finish_lessons()
        seed = (config.seed or 0) + 1_000_003  # worlds that training did not begin with
        has_limits = all(policy.max_episode_steps for policy in pool.policies.values())
        max_steps = MAX_STEPS if has_limits else ENDLESS_STEPS
        try:
            act = trained_player(self._policies, pool, seed)
            return evaluate(act, pool, config.evaluation_episodes, seed=seed, max_steps=max_steps)
        except RunError as error:
            # The run itself is whole; an agent that has learned to survive may play for ever.
            log.warning("no evaluation: %s; %s", error.message, error.hint)
            return {}
