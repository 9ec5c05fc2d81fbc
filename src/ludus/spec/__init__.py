"""The declarations of a game about its agents, and the arrays that follow from them."""

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
    spec_difference,
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
    "spec_difference",
]
