"""Games as standard environments: ``gymnasium.Env`` and ``gymnasium.vector.VectorEnv``."""

from ludus.envs.making import make, make_registered_vec, make_vec
from ludus.envs.single import LudusEnv
from ludus.envs.vector import LudusVectorEnv

__all__ = ["LudusEnv", "LudusVectorEnv", "make", "make_registered_vec", "make_vec"]
