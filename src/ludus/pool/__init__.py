"""Many engines as one batched environment."""

from ludus.pool.interface import Pool

__all__ = ["Pool"]
