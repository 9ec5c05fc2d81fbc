from tests.training.fixtures import one_thread
from tests.workers.ray_cluster import cluster

__all__ = ["cluster", "one_thread"]
