"""The tiny environments of tests/training, for processes that import this module by name."""

from tests.training.environments import register

register()
