"""Many engines as one batched environment."""

from ludus.pool.engine_pool import EnginePool
from ludus.pool.interface import Pool
from ludus.pool.opening import open_pool
from ludus.settings.pool_config import PoolConfig

__all__ = ["EnginePool", "Pool", "PoolConfig", "open_pool"]
