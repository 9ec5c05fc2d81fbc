"""Policies as PyTorch networks: encoders, action distributions, normalisation."""

from ludus.extras import require_package

require_package("torch")
