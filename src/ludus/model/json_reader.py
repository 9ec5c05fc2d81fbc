"""Build a model from the JSON of a policy file (protocol/POLICY.md §1); errors name the field."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from ludus.errors import PolicyFileError, ProtocolError
from ludus.model.checking import check_model
from ludus.model.json_fields import Fields, is_number, short
from ludus.model.policy_model import (
    Activation,
    Convolution,
    Distribution,
    Gru,
    ImageNetwork,
    Linear,
    Normalisation,
    PolicyModel,
)
from ludus.spec import PolicySpec
from ludus.wire.spec_reader import read_spec

__all__ = ["FORMAT", "VERSION", "from_json"]

FORMAT = "ludus-policy"
VERSION = 1


def from_json(value: Any) -> PolicyModel:
    """Build a model from the JSON of a policy file.

    Raises:
        PolicyFileError: A field is missing, of the wrong type or over a limit, or does not fit the
            others.
    """
    fields = Fields(value, "")
    if fields.get("format") != FORMAT:
        raise fields.error("format", f'expected "{FORMAT}", got {short(fields.get("format"))}')
    version = fields.get("version")
    if version != VERSION:
        raise PolicyFileError(
            f"policy file: version: expected {VERSION}, got {short(version)}",
            hint="upgrade ludus" if is_number(version) and version > VERSION else "export again",
        )
    spec = _read_spec(fields)
    model = PolicyModel(
        policy=spec.name,
        fingerprint=fields.text("fingerprint"),
        observation=spec.observation,
        action=spec.action,
        has_action_mask=spec.has_action_mask,
        normalisation=fields.optional("normalisation", _normalisation),
        images=fields.parts("images", _image),
        memory=fields.optional("memory", _gru),
        layers=fields.parts("layers", _linear),
        distribution=_distribution(fields.part("distribution")),
    )
    check_model(model)
    return model


def _read_spec(fields: Fields) -> PolicySpec:
    """Read policy, entries and components as those of a handshake with one agent."""
    part = {
        "name": fields.text("policy"),
        "observation": fields.get("observation"),
        "action": fields.get("action"),
        "has_action_mask": fields.flag("has_action_mask"),
    }
    try:
        return read_spec(_handshake(part)).policies[0]
    except ProtocolError as error:
        what = error.message.removeprefix("spec.policies[0].")
        raise PolicyFileError(f"policy file: {what}", hint="export the policy again") from error


def _handshake(part: Mapping[str, Any]) -> dict[str, Any]:
    policy: dict[str, Any] = {
        **part,
        "num_agents": 1,
        "agents_per_world": 1,
        "episode": "agent",
        "max_episode_steps": None,
        "agents": [{"world": 0, "path": None}],
        "settings": {},
    }
    worlds = {"num_worlds": 1, "layout": "isolated", "ticks_per_step": 1, "tick_rate": 1.0}
    return {**worlds, "policies": [policy]}


def _normalisation(fields: Fields) -> Normalisation:
    return Normalisation(fields.tensor("shift"), fields.tensor("scale"), fields.number("limit"))


def _image(fields: Fields) -> ImageNetwork:
    convolutions = fields.parts("convolutions", _convolution)
    return ImageNetwork(fields.text("entry"), convolutions, _linear(fields.part("linear")))


def _convolution(fields: Fields) -> Convolution:
    return Convolution(
        weight=fields.tensor("weight"),
        bias=fields.tensor("bias"),
        stride=fields.integer("stride", 1, 1 << 16),
        padding=fields.integer("padding", 0, 1 << 16),
        activation=cast(Activation, fields.text("activation")),
    )


def _linear(fields: Fields) -> Linear:
    activation = cast(Activation, fields.text("activation"))
    return Linear(fields.tensor("weight"), fields.tensor("bias"), activation)


def _gru(fields: Fields) -> Gru:
    if fields.text("kind") != "gru":
        raise fields.error("kind", f'expected "gru", got {short(fields.text("kind"))}')
    return Gru(
        weight_input=fields.tensor("weight_input"),
        weight_hidden=fields.tensor("weight_hidden"),
        bias_input=fields.tensor("bias_input"),
        bias_hidden=fields.tensor("bias_hidden"),
    )


def _distribution(fields: Fields) -> Distribution:
    return Distribution(
        log_std=None if fields.get("log_std") is None else fields.tensor("log_std"),
        log_std_range=fields.pair("log_std_range"),
        is_squashed=fields.flag("is_squashed"),
    )
