"""Actions for tests that are about something else."""

from __future__ import annotations

from ludus.pool import EnginePool
from ludus.spec.batch import ActionBatch

__all__ = ["zeros"]


def zeros(pool: EnginePool) -> dict[str, ActionBatch]:
    """Return zero actions for all slots of all engines."""
    return {
        name: ActionBatch.zeros(policy, pool.num_agents(name))
        for name, policy in pool.policies.items()
    }
