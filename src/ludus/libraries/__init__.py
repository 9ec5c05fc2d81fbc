"""Games as standard environments: ``gymnasium.Env`` and ``gymnasium.vector.VectorEnv``."""

from ludus.libraries.making import make, make_registered_vec, make_vec
from ludus.libraries.single import LudusEnv
from ludus.libraries.vector import LudusVectorEnv

__all__ = ["LudusEnv", "LudusVectorEnv", "make", "make_registered_vec", "make_vec"]
