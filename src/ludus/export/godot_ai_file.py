"""Checkpoints of godot-ai, ``checkpoints/NAME.pt``: networks of actor and critics, a temperature.

PyTorch reads them with ``weights_only=True``: nothing that a file holds is run. A network is linear
layers with ReLU between them, as ours are, so that only names differ::

    policy_state_dict           network.network.0.weight …     policy.actor.0.weight …
    double_q_state_dict         network1.network.0.weight …    critic.first.0.weight …
                                network2.network.0.weight …    critic.second.0.weight …
    target_double_q_state_dict  as double_q_state_dict         target.first.0.weight …
    log_alpha_state_dict        a number                       log_temperature
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, cast

import torch
from torch import Tensor

from ludus.errors import CheckpointError
from ludus.export.trained import TrainedPolicy
from ludus.networks.policy import Policy
from ludus.networks.tensors import load_tensors
from ludus.settings.policy_config import SACConfig
from ludus.spec import AgentSpec, ContinuousAction, ObservationEntry, PolicySpec

__all__ = ["STATE", "GodotAiCheckpoint", "godot_ai_spec", "load_godot_ai", "read_godot_ai"]

STATE = "state"
"""The one entry of what an agent of godot-ai observes."""

_ACTOR, _CRITICS, _TARGETS = (
    "policy_state_dict",
    "double_q_state_dict",
    "target_double_q_state_dict",
)
_TEMPERATURE = "log_alpha_state_dict"
_NETWORKS = {
    (_ACTOR, "network"): "policy.actor",
    (_CRITICS, "network1"): "critic.first",
    (_CRITICS, "network2"): "critic.second",
    (_TARGETS, "network1"): "target.first",
    (_TARGETS, "network2"): "target.second",
}
MAX_FILE_BYTES = 1 << 31


@dataclass(frozen=True)
class GodotAiCheckpoint:
    """What a file holds.

    Attributes:
        state_size: Numbers that the agent observes.
        action_size: Numbers that it does.
        hidden_size: Units of each hidden layer.
        num_actor_layers: Hidden layers of the actor after the first.
        num_critic_layers: The same of the critics.
        tensors: As a state of SAC names them, ``float32``.
    """

    state_size: int
    action_size: int
    hidden_size: int
    num_actor_layers: int
    num_critic_layers: int
    tensors: dict[str, Tensor]


def read_godot_ai(path: Path) -> GodotAiCheckpoint:
    """Read a checkpoint of godot-ai.

    Raises:
        CheckpointError: It cannot be read, or is something else; the text names file and field.
    """
    saved = _load(path)
    tensors: dict[str, Tensor] = {}
    sizes: dict[str, list[int]] = {}
    for (field, network), ours in _NETWORKS.items():
        layers = _layers(saved, field, network, path)
        sizes[ours] = _sizes(layers, f"{field}: {network}", path)
        for number, (weight, bias) in enumerate(layers):
            tensors[f"{ours}.{2 * number}.weight"] = weight
            tensors[f"{ours}.{2 * number}.bias"] = bias
    temperature = _floats(saved.get(_TEMPERATURE), _TEMPERATURE, path)
    if temperature.numel() != 1:
        raise _misfit(path, _TEMPERATURE, f"it holds {temperature.numel()} numbers, expected 1")
    tensors["log_temperature"] = temperature.reshape(1)
    actor, critic = sizes["policy.actor"], sizes["critic.first"]
    if actor[-1] % 2:
        raise _misfit(path, _ACTOR, f"it puts out {actor[-1]} numbers, expected mean and deviation")
    expected = [actor[0] + actor[-1] // 2, *critic[1:-1], 1]
    for ours in ("critic.first", "critic.second", "target.first", "target.second"):
        if sizes[ours] != expected:
            what = f"its layers are {sizes[ours]}, expected {expected}"
            raise _misfit(path, _CRITICS if ours.startswith("critic") else _TARGETS, what)
    hidden = {*actor[1:-1], *critic[1:-1]}
    if len(hidden) != 1:
        raise _misfit(path, _ACTOR, f"hidden layers have {sorted(hidden)} units, expected one size")
    return GodotAiCheckpoint(
        state_size=actor[0],
        action_size=actor[-1] // 2,
        hidden_size=hidden.pop(),
        num_actor_layers=len(actor) - 3,
        num_critic_layers=len(critic) - 3,
        tensors=tensors,
    )


def godot_ai_spec(name: str, state_size: int, action_size: int) -> PolicySpec:
    """Return what an agent of godot-ai observes and does."""
    return PolicySpec(
        name=name,
        observation=(ObservationEntry(STATE, "float32", (state_size,)),),
        action=(ContinuousAction("action", action_size),),
        agents=(AgentSpec(0, None),),
    )


def load_godot_ai(path: Path, name: str) -> TrainedPolicy:
    """Return the policy in a checkpoint of godot-ai; errors as :func:`read_godot_ai`.

    Args:
        path: The file.
        name: What the policy shall be called.
    """
    saved = read_godot_ai(path)
    spec = godot_ai_spec(name, saved.state_size, saved.action_size)
    config = SACConfig(
        hidden_sizes=(saved.hidden_size,) * (saved.num_actor_layers + 1),
        activation="relu",
        normalise_observation=False,
    )
    policy = Policy(spec, config)
    load_tensors(policy, saved.tensors, "policy.")
    return TrainedPolicy(spec, policy.eval(), {})


def _load(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise _misfit(path, "size", f"more than {MAX_FILE_BYTES} bytes")
        loaded = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise CheckpointError(f"{path} cannot be read: {error.strerror}") from None
    except (RuntimeError, UnpicklingError, EOFError, ValueError, KeyError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise _misfit(path, "file", f"it holds more than arrays, or is broken: {reason}") from None
    if not isinstance(loaded, dict):
        raise _misfit(path, "file", f"it holds a {type(loaded).__name__}, expected a dictionary")
    return cast("dict[str, Any]", loaded)


def _layers(
    saved: dict[str, Any], field: str, network: str, path: Path
) -> list[tuple[Tensor, Tensor]]:
    """Return weight and bias of each linear layer; between them, ReLU has no parameters."""
    values: Any = saved.get(field)
    if not isinstance(values, dict):
        raise _misfit(path, field, "it is missing" if values is None else "it is no dictionary")
    parameters = cast("dict[str, Any]", values)
    num_networks = 1 if field == _ACTOR else 2
    num_layers = len(parameters) // (2 * num_networks)
    names = [
        f"{network}.network.{2 * number}.{kind}"
        for number in range(num_layers)
        for kind in ("weight", "bias")
    ]
    missing = [name for name in names if name not in parameters]
    if missing or len(parameters) != 2 * num_networks * num_layers or num_layers < 2:
        known = ", ".join(map(str, list(parameters)[:3]))
        what = missing[0] if missing else f"{network}.network.0.weight and so on"
        raise _misfit(path, f"{field}: {what}", f"it is missing; there are {known}, …")
    tensors = [_floats(parameters[name], f"{field}: {name}", path) for name in names]
    return list(zip(tensors[::2], tensors[1::2], strict=True))


def _floats(value: Any, where: str, path: Path) -> Tensor:
    if not isinstance(value, Tensor) or not value.is_floating_point():
        raise _misfit(path, where, "it is missing" if value is None else "it holds no numbers")
    numbers = value.detach().float()
    if not bool(torch.isfinite(numbers).all()):
        raise _misfit(path, where, "it holds NaN or infinity")
    return numbers


def _sizes(layers: list[tuple[Tensor, Tensor]], where: str, path: Path) -> list[int]:
    """Return the number of inputs, and of units of each layer."""
    sizes = [int(layers[0][0].shape[-1])]
    for number, (weight, bias) in enumerate(layers):
        shapes = [list(weight.shape), list(bias.shape)]
        units = int(bias.numel())
        if shapes != [[units, sizes[-1]], [units]]:
            what = f"weight and bias are {shapes}, expected {[[units, sizes[-1]], [units]]}"
            raise _misfit(path, f"{where}.network.{2 * number}", what)
        sizes.append(units)
    return sizes


def _misfit(path: Path, field: str, what: str) -> CheckpointError:
    return CheckpointError(
        f"{path} is not a checkpoint of godot-ai: {field}: {what}",
        hint=f"its server writes checkpoints/NAME.pt with {_ACTOR}, {_CRITICS}, {_TARGETS} and "
        f"{_TEMPERATURE}; read with PyTorch {torch.__version__}",
    )
