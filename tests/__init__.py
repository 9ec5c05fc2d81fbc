"""Tests; packages so that they can share fakes and reference implementations."""
