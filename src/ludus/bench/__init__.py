"""Measure how fast a game steps, how fast it could, and where the time goes."""

from ludus.bench.measure import BenchConfig, bench
from ludus.bench.report import BenchReport

__all__ = ["BenchConfig", "BenchReport", "bench"]
