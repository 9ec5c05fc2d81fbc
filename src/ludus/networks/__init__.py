"""Policies as PyTorch networks: encoders, action distributions, normalisation."""
