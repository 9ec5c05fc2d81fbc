from tests.training.fixtures import one_thread, small

__all__ = ["one_thread", "small"]
