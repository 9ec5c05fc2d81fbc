"""PPO and SAC, what they learn from, and the seam for algorithms of one's own."""

# ruff: noqa: E402
from ludus.extras import require_package

require_package("torch")

from ludus.algorithms.learner import Learner, LearnerSettings, LearnerState

__all__ = ["Learner", "LearnerSettings", "LearnerState"]
