"""Trained policies as files that run anywhere: the format, and inference with NumPy.

Nothing here needs PyTorch. ``protocol/POLICY.md`` is the specification.
"""

from ludus.model.inference import ModelRunner
from ludus.model.json_file import read_model, write_model
from ludus.model.policy_model import PolicyModel

__all__ = ["ModelRunner", "PolicyModel", "read_model", "write_model"]
