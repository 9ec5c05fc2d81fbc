"""PPO and SAC, what they learn from, and the seam for algorithms of one's own."""

from ludus.algorithms.learner import Learner, LearnerSettings, LearnerState

__all__ = ["Learner", "LearnerSettings", "LearnerState"]
