"""Do isolated worlds and the grid play the same episodes, and how much faster is the grid?"""

from __future__ import annotations

import contextlib
import time

from ludus.check.causes import name_causes
from ludus.check.context import CheckContext
from ludus.check.episodes import Comparison, Verdict, compare_episodes
from ludus.check.finding import Finding, fail, info, ok
from ludus.check.recording import Recording, record
from ludus.errors import ConfigError, TargetError
from ludus.play.players import random_player
from ludus.pool import EnginePool

__all__ = ["check_layouts"]

TITLE = "isolated worlds and the grid play the same episodes"
LAYOUTS = {"isolated": "isolated", "grid": "in the grid"}
"""How to say that a game runs in a layout."""
SCRIPT_STEPS = 64
WORTH_IT = 1.5
"""How many times as fast another layout has to be to be suggested; less may be noise."""
NUM_SLICES = 8
GRID_HINT = (
    "use coordinates local to the scene's root (position, not global_position), and make "
    "LudusWorld.spacing larger than the reach of anything in the scene"
)


def check_layouts(context: CheckContext) -> list[Finding]:
    """Play in both layouts and compare the episodes and the speed."""
    num = context.config.num_layout_worlds
    own = context.spec.layout
    other = "isolated" if own == "grid" else "grid"
    pools: dict[str, EnginePool] = {}
    with contextlib.ExitStack() as stack:
        try:
            pools[own] = stack.enter_context(context.other_pool(num_worlds=num))
            pools[other] = stack.enter_context(context.other_pool(num_worlds=num, layout=other))
        except (TargetError, ConfigError) as error:
            how = LAYOUTS[other] if own in pools else f"in {num} worlds"
            return [info(TITLE, f"this game does not run {how}: {error.message}")]
        isolated, grid = (
            record(pools[layout], context.config.seed, context.config.num_steps)
            for layout in LAYOUTS
        )
        speeds = _agent_steps_per_s([pools[layout] for layout in LAYOUTS], context)
    comparison = compare_episodes(isolated, grid)
    return [_verdict(comparison, grid, context), _speed(*speeds, num, comparison, own)]


def _verdict(comparison: Comparison, grid: Recording, context: CheckContext) -> Finding:
    detail = f"{grid.spec.num_worlds} worlds, {grid.num_steps} steps: {comparison.describe()}"
    if comparison.verdict is not Verdict.DIFFERENT:
        return ok(TITLE, detail, **comparison.to_json())
    if context.spec.layout == "grid":
        hint = name_causes(context.scripts, GRID_HINT)
        return fail(TITLE, detail, hint, **comparison.to_json())
    hint = name_causes(context.scripts, f"stay isolated; or {GRID_HINT}")
    return info(
        "the grid and isolated worlds play different episodes", detail, hint, **comparison.to_json()
    )


def _speed(
    isolated: float, grid: float, num_worlds: int, comparison: Comparison, own: str
) -> Finding:
    title = f"the grid is {grid / isolated:.2g} times as fast as isolated worlds"
    detail = f"{grid:,.0f} and {isolated:,.0f} agent-steps/s with {num_worlds} worlds in one engine"
    hint = ""
    if own != "grid" and grid > WORTH_IT * isolated and comparison.verdict is not Verdict.DIFFERENT:
        hint = "set LudusWorld.layout to Grid"
    if own == "grid" and isolated > WORTH_IT * grid:
        hint = "set LudusWorld.layout to Isolated, or compare with more worlds"
    data = {
        "num_worlds": num_worlds,
        "isolated_agent_steps_per_s": isolated,
        "grid_agent_steps_per_s": grid,
        "ratio": grid / isolated,
    }
    return info(title, detail, hint, **data)


def _agent_steps_per_s(pools: list[EnginePool], context: CheckContext) -> tuple[float, float]:
    """Time random play in turn, so that other load on the machine hits both; the best counts."""
    players = [_TimedPlay(pool, context.config.seed) for pool in pools]
    slice_s = context.config.timing_s / NUM_SLICES
    slices = [[player.agent_steps_per_s(slice_s) for player in players] for _ in range(NUM_SLICES)]
    isolated, grid = (max(speeds) for speeds in zip(*slices, strict=True))
    return isolated, grid


class _TimedPlay:
    """Random play whose actions are drawn in advance, unless masks depend on the game."""

    def __init__(self, pool: EnginePool, seed: int) -> None:
        spec = pool.spec
        self._pool = pool
        self._act = random_player(pool, seed)
        self._batches = pool.reset(seed)
        self._num_agents = sum(policy.num_agents for policy in spec.policies)
        is_masked = any(policy.has_action_mask for policy in spec.policies)
        self._drawn = [] if is_masked else [self._act(self._batches) for _ in range(SCRIPT_STEPS)]

    def agent_steps_per_s(self, seconds: float) -> float:
        """Play for some seconds, at least one step, and return the speed."""
        num_steps, began, elapsed = 0, time.perf_counter(), 0.0
        while elapsed < seconds or not num_steps:
            step = num_steps % SCRIPT_STEPS
            actions = self._drawn[step] if self._drawn else self._act(self._batches)
            self._batches = self._pool.step(actions)
            num_steps += 1
            elapsed = time.perf_counter() - began
        return num_steps * self._num_agents / elapsed
