"""What a game declares about its agents, and the arrays that follow from it."""

from ludus.spec.engine_spec import (
    DTYPES,
    ActionComponent,
    AgentSpec,
    Bound,
    ContinuousAction,
    DiscreteAction,
    EpisodeMode,
    ObservationEntry,
    PolicySpec,
    Spec,
)

__all__ = [
    "DTYPES",
    "ActionComponent",
    "AgentSpec",
    "Bound",
    "ContinuousAction",
    "DiscreteAction",
    "EpisodeMode",
    "ObservationEntry",
    "PolicySpec",
    "Spec",
]
