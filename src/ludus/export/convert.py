"""From a trained network to plain arrays: a ``Policy`` becomes a ``PolicyModel``.

One function per part of the network, so that each follows a change of that part alone.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn

from ludus.errors import RunError
from ludus.model.policy_model import (
    Activation,
    Convolution,
    Distribution,
    Gru,
    ImageNetwork,
    Linear,
    Normalisation,
    PolicyModel,
    is_image,
)
from ludus.networks.distributions import LOG_STD_RANGE
from ludus.networks.networks import ImageTorso
from ludus.networks.normalise import LIMIT, RunningNormaliser
from ludus.networks.own_network import OwnTorso
from ludus.networks.policy import Policy
from ludus.spec import Bound, ObservationEntry, PolicySpec

__all__ = ["outline", "to_model"]

ACTIVATIONS: dict[type[nn.Module], Activation] = {
    nn.Tanh: "tanh",
    nn.ReLU: "relu",
    nn.ELU: "elu",
    nn.SiLU: "silu",
}


def to_model(policy: Policy, spec: PolicySpec) -> PolicyModel:
    """Return what ``policy`` computes, as arrays that are its own.

    Args:
        policy: The trained network.
        spec: What it was trained for.

    Raises:
        RunError: The network has a part that the format does not know.
    """
    whole = outline(policy, spec)
    if isinstance(policy.torso, OwnTorso):
        layers = _with_activations([*_own_layers(policy, policy.torso), *policy.actor])
        return dataclasses.replace(whole, layers=tuple(_linear(*pair) for pair in layers))
    images = [entry.name for entry in spec.observation if is_image(entry)]
    return dataclasses.replace(
        whole,
        images=tuple(_image(*pair) for pair in zip(images, policy.torso.images, strict=True)),
        layers=tuple(_linear(*pair) for pair in _with_activations(policy.actor)),
    )


def outline(policy: Policy, spec: PolicySpec) -> PolicyModel:
    """Return all of a policy but convolutions and layers, which the format may not know."""
    head = policy.head
    return PolicyModel(
        policy=spec.name,
        fingerprint=spec.fingerprint(),
        observation=tuple(_entry(entry) for entry in spec.observation),
        action=spec.action,
        has_action_mask=spec.has_action_mask,
        normalisation=_normalisation(policy.encoder.normaliser),
        images=(),
        memory=None if policy.memory is None else _memory(policy.memory),
        layers=(),
        distribution=Distribution(
            log_std=None if head.log_std is None else _array(head.log_std),
            log_std_range=LOG_STD_RANGE,
            is_squashed=head.shape.is_squashed,
        ),
        frames=policy.num_frames,
    )


def _own_layers(policy: Policy, torso: OwnTorso) -> nn.Sequential:
    """Return the layers of a script's network, where the format can hold them."""
    has_more = policy.memory is not None or any(map(is_image, policy.spec.observation))
    if not isinstance(torso.network, nn.Sequential) or has_more:
        raise RunError(
            f"policy {policy.spec.name} has a network that a script made, "
            "which .ludus.json cannot hold",
            "export it to .onnx; an nn.Sequential of linear layers and "
            f"{', '.join(ACTIVATIONS.values())}, without memory or images, fits",
        )
    return torso.network


def _entry(entry: ObservationEntry) -> ObservationEntry:
    """Drop bounds that are infinite for some elements, which JSON cannot hold and nothing needs.

    Gymnasium environments have such; engines cannot.
    """
    low, high = _all_or_none(entry.low, -math.inf), _all_or_none(entry.high, math.inf)
    return dataclasses.replace(entry, low=low, high=high)


def _all_or_none(bound: Bound, unbounded: float) -> Bound:
    is_finite = not isinstance(bound, tuple) or all(map(math.isfinite, bound))
    return bound if is_finite else unbounded


def _normalisation(normaliser: RunningNormaliser | None) -> Normalisation | None:
    if normaliser is None or not len(normaliser.mean):
        return None
    tensors = dict(normaliser.named_buffers())
    return Normalisation(_array(tensors["_shift"]), _array(tensors["_scale"]), LIMIT)


def _memory(cell: nn.GRUCell) -> Gru:
    return Gru(
        weight_input=_array(cell.weight_ih),
        weight_hidden=_array(cell.weight_hh),
        bias_input=_array(cell.bias_ih),
        bias_hidden=_array(cell.bias_hh),
    )


def _image(entry: str, torso: nn.Module) -> ImageNetwork:
    assert isinstance(torso, ImageTorso)
    modules = [module for module in torso.convolutions if not isinstance(module, nn.Flatten)]
    convolutions = tuple(_convolution(*pair) for pair in _with_activations(modules))
    return ImageNetwork(entry, convolutions, _linear(torso.linear, "relu"))


def _convolution(module: nn.Module, activation: Activation) -> Convolution:
    if not isinstance(module, nn.Conv2d) or module.bias is None:
        raise _unknown(module)
    return Convolution(
        weight=_array(module.weight),
        bias=_array(module.bias),
        stride=module.stride[0],
        padding=int(module.padding[0]),
        activation=activation,
    )


def _linear(module: nn.Module, activation: Activation) -> Linear:
    if not isinstance(module, nn.Linear):
        raise _unknown(module)
    return Linear(_array(module.weight), _array(module.bias), activation)


def _with_activations(modules: Iterable[nn.Module]) -> list[tuple[nn.Module, Activation]]:
    """Pair each layer with the non-linearity behind it."""
    pairs: list[tuple[nn.Module, Activation]] = []
    for module in modules:
        activation = ACTIVATIONS.get(type(module))
        if activation is None:
            pairs.append((module, "none"))
        elif not pairs or pairs[-1][1] != "none":
            raise _unknown(module)
        else:
            pairs[-1] = (pairs[-1][0], activation)
    return pairs


def _array(tensor: Tensor) -> NDArray[np.float32]:
    return np.array(tensor.detach().cpu().float().numpy(), np.float32)


def _unknown(module: nn.Module) -> RunError:
    return RunError(
        f"cannot export a network with {module} at this place",
        "the format knows linear layers, convolutions, GRU cells and "
        f"{', '.join(ACTIVATIONS.values())}",
    )
