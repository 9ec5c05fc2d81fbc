"""From a model of Stable-Baselines3 to a policy file that computes the same.

Two readings of the same weights: :func:`to_model` makes arrays of POLICY.md of them, and
:class:`Sb3Network` computes what SB3 does, which the arrays are tested against.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ludus.errors import PolicyFileError
from ludus.export.inputs import ParityInputs
from ludus.export.runtimes import Answers, most_probable
from ludus.export.sb3_zip import Sb3Model
from ludus.model.policy_model import (
    Convolution,
    Distribution,
    ImageNetwork,
    Linear,
    Normalisation,
    PolicyModel,
    is_image,
)
from ludus.spec import ObservationEntry, PolicySpec

__all__ = ["Sb3Network", "to_model"]

_TRUNKS = {
    "actor_critic": "mlp_extractor.policy_net",
    "sac": "actor.latent_pi",
    "dqn": "q_net.q_net",
}
_OWNERS = {"actor_critic": ("pi_", ""), "sac": ("actor.",), "dqn": ("q_net.",)}
"""Prefixes of the extractor of features, in order of preference."""
_FLAT = "observation"
_NATURE_CNN = ((8, 4), (4, 2), (3, 1))
"""Kernel and stride of the convolutions; not told by the weights."""
_FUNCTIONS: dict[str, Any] = {
    "tanh": torch.tanh, "relu": torch.relu, "elu": nn.functional.elu, "silu": nn.functional.silu,
}  # fmt: skip
LOG_STD_RANGE = (-20.0, 2.0)
"""Of SAC (``stable_baselines3.sac.policies.LOG_STD_MIN`` and ``LOG_STD_MAX``)."""


def to_model(saved: Sb3Model, spec: PolicySpec, normalisation: Normalisation | None) -> PolicyModel:
    """Return a policy file's arrays for a saved model.

    Args:
        saved: The model.
        spec: Of the game's policy.
        normalisation: Of the joined vector, as ``VecNormalize`` did it.

    Raises:
        PolicyFileError: The weights do not fit the game, or a part is unknown.
    """
    parts = _Parts(saved, spec)
    layers = [Linear(_array(w), _array(b), saved.activation) for w, b in parts.hidden]
    weight, bias = (_array(part) for part in parts.head)
    log_std = None if parts.log_std is None else _array(parts.log_std)
    if saved.kind == "actor_critic" and spec.continuous_size:
        # SB3's means are actions; those of a policy file lie between -1 and 1.
        middle, half = _middle_and_half(spec)
        weight, bias = weight / half[:, None], (bias - middle) / half
        log_std = None if log_std is None else log_std - np.log(half)
    layers.append(Linear(_float32(weight), _float32(bias), "none"))
    columns = _columns(spec, parts.image_sizes)
    first = layers[0]
    if first.weight.shape[1] != len(columns):
        raise PolicyFileError(
            f"the first layer takes {first.weight.shape[1]} numbers, the game's observation has "
            f"{len(columns)}",
            hint="VecFrameStack and other wrappers that change observations cannot be exported",
        )
    layers[0] = Linear(np.ascontiguousarray(first.weight[:, columns]), first.bias, first.activation)
    return PolicyModel(
        policy=spec.name,
        fingerprint=spec.fingerprint(),
        observation=spec.observation,
        action=spec.action,
        has_action_mask=spec.has_action_mask,
        normalisation=normalisation,
        images=tuple(_image(entry, parts) for entry in spec.observation if is_image(entry)),
        memory=None,
        layers=tuple(layers),
        distribution=Distribution(
            log_std=_float32(np.zeros(0) if log_std is None else log_std)
            if saved.kind != "sac"
            else None,
            log_std_range=LOG_STD_RANGE,
            is_squashed=saved.kind == "sac",
        ),
    )


class _Parts:
    """The weights of the actor, sorted."""

    def __init__(self, saved: Sb3Model, spec: PolicySpec) -> None:
        self._weights, self._kind = saved.weights, saved.kind
        self._is_flat = [entry.name for entry in spec.observation] == [_FLAT]
        _check_action(saved, spec)
        layers = self._sequence(_TRUNKS[saved.kind])
        self.log_std: Tensor | None = None
        if saved.kind == "actor_critic":
            self.hidden, self.head = layers, self._layer("action_net")
            if spec.continuous_size:
                self.log_std = self._get("log_std")
        elif saved.kind == "sac":
            mean, log_std = self._layer("actor.mu"), self._layer("actor.log_std")
            self.hidden = layers
            self.head = (torch.cat([mean[0], log_std[0]]), torch.cat([mean[1], log_std[1]]))
        else:
            self.hidden, self.head = layers[:-1], layers[-1]
        widths = [weight.shape for weight, _ in (*self.hidden, self.head)]
        if any(len(shape) != 2 for shape in widths) or any(
            after[1] != before[0] for before, after in pairwise(widths)
        ):
            raise PolicyFileError(f"{_TRUNKS[saved.kind]}: its layers do not follow each other")
        images = [entry for entry in spec.observation if is_image(entry)]
        self.images = {entry.name: self._image(entry) for entry in images}
        self.image_sizes = {name: len(linear[1]) for name, (_, linear) in self.images.items()}

    def _get(self, name: str) -> Tensor:
        if name not in self._weights:
            raise PolicyFileError(f"policy.pth has no {name!r}; policies of this kind do")
        return self._weights[name]

    def _layer(self, name: str) -> tuple[Tensor, Tensor]:
        return self._get(f"{name}.weight"), self._get(f"{name}.bias")

    def _sequence(self, prefix: str) -> list[tuple[Tensor, Tensor]]:
        pattern = re.compile(rf"{re.escape(prefix)}\.(\d+)\.weight")
        found = (pattern.fullmatch(name) for name in self._weights)
        numbers = sorted(int(match[1]) for match in found if match)
        if numbers != list(range(0, 2 * len(numbers), 2)):
            raise PolicyFileError(f"{prefix}: a layer other than linear ones stands between them")
        return [self._layer(f"{prefix}.{number}") for number in numbers]

    def _image(
        self, entry: ObservationEntry
    ) -> tuple[list[tuple[Tensor, Tensor]], tuple[Tensor, Tensor]]:
        inner = "" if self._is_flat else f"extractors.{entry.name}."
        for owner in _OWNERS[self._kind]:
            prefix = f"{owner}features_extractor.{inner}"
            if f"{prefix}cnn.0.weight" in self._weights:
                break
        else:
            raise PolicyFileError(
                f"policy.pth has no convolutions for the image {entry.name!r}",
                hint="CnnPolicy or MultiInputPolicy look at images; MlpPolicy flattens them",
            )
        layers = self._sequence(f"{prefix}cnn")
        kernels = [tuple(weight.shape[2:]) for weight, _ in layers]
        if kernels != [(kernel, kernel) for kernel, _ in _NATURE_CNN]:
            raise PolicyFileError(f"{prefix}cnn: kernels are {kernels}, unlike those of NatureCNN")
        return layers, self._layer(f"{prefix}linear.0")


class Sb3Network:
    """Computes what a saved model does, as Stable-Baselines3 does it.

    Args:
        saved: The model.
        spec: Of the game's policy.
        normalisation: As for :func:`to_model`.
    """

    def __init__(
        self, saved: Sb3Model, spec: PolicySpec, normalisation: Normalisation | None
    ) -> None:
        self._parts, self._saved, self._spec = _Parts(saved, spec), saved, spec
        self._normalisation = normalisation
        self._function = _FUNCTIONS[saved.activation]

    @torch.inference_mode()
    def answer(self, inputs: ParityInputs) -> Answers:
        """Answer as :func:`ludus.export.runtimes.answer_with_torch` does."""
        return Answers.of_steps([self._step(*inputs.at(i)) for i in range(inputs.num_steps)])

    def _step(
        self, observation: Mapping[str, NDArray[Any]], mask: NDArray[np.bool_] | None
    ) -> tuple[NDArray[Any], ...]:
        x = self._features(observation)
        for weight, bias in self._parts.hidden:
            x = self._function(nn.functional.linear(x, weight, bias))
        raw = nn.functional.linear(x, *self._parts.head).numpy()
        spec, size = self._spec, self._spec.continuous_size
        discrete = most_probable(raw, spec.nvec, mask)
        low, high = spec.continuous_bounds()
        middle, half = _middle_and_half(spec)
        mean, log_std = raw[:, len(raw[0]) - size :], np.zeros((len(raw), size), np.float32)
        if self._saved.kind == "sac":
            mean, own = raw[:, :size], raw[:, size:]
            log_std = np.clip(own, *LOG_STD_RANGE)
            outputs, continuous = raw, middle + half * np.tanh(mean)
        elif size:
            assert self._parts.log_std is not None
            log_std = log_std + self._parts.log_std.numpy() - np.log(half)
            outputs, continuous = (mean - middle) / half, np.clip(mean, low, high)
        else:
            outputs, continuous = raw, log_std
        return _float32(outputs), _float32(log_std), discrete, _float32(continuous)

    def _features(self, observation: Mapping[str, NDArray[Any]]) -> Tensor:
        """Flatten and join the entries in the order of a ``gymnasium.spaces.Dict``."""
        vectors = self._normalised(observation)
        features = [
            self._image(entry.name, observation[entry.name])
            if is_image(entry)
            else torch.as_tensor(vectors[entry.name])
            for entry in sorted(self._spec.observation, key=lambda entry: entry.name)
        ]
        return torch.cat(features, 1)

    def _normalised(self, observation: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        flat: dict[str, NDArray[Any]] = {}
        start = 0
        for entry in self._spec.observation:
            if is_image(entry):
                continue
            values = observation[entry.name].reshape(-1, entry.size).astype(np.float32)
            if self._normalisation is not None:
                part, limit = slice(start, start + entry.size), self._normalisation.limit
                values = (values - self._normalisation.shift[part]) * self._normalisation.scale[
                    part
                ]
                values = np.clip(values, -limit, limit)
            flat[entry.name] = values
            start += entry.size
        return flat

    def _image(self, name: str, pixels: NDArray[Any]) -> Tensor:
        layers, linear = self._parts.images[name]
        x = torch.as_tensor(np.moveaxis(pixels, -1, 1).copy()).float() / 255
        for (weight, bias), (_, stride) in zip(layers, _NATURE_CNN, strict=True):
            x = torch.relu(nn.functional.conv2d(x, weight, bias, stride))
        return torch.relu(nn.functional.linear(x.flatten(1), *linear))


def _check_action(saved: Sb3Model, spec: PolicySpec) -> None:
    is_right = {
        "actor_critic": not (spec.nvec and spec.continuous_size),
        "sac": not spec.nvec,
        "dqn": len(spec.nvec) == 1 and not spec.continuous_size,
    }
    if not is_right[saved.kind]:
        parts = ", ".join(part.name for part in spec.action)
        raise PolicyFileError(f"the model is of {saved.kind}, which has no actions such as {parts}")


def _image(entry: ObservationEntry, parts: _Parts) -> ImageNetwork:
    layers, (weight, bias) = parts.images[entry.name]
    convolutions = tuple(
        Convolution(_array(kernel), _array(offset), stride, 0, "relu")
        for (kernel, offset), (_, stride) in zip(layers, _NATURE_CNN, strict=True)
    )
    return ImageNetwork(entry.name, convolutions, Linear(_array(weight), _array(bias), "relu"))


def _columns(spec: PolicySpec, image_sizes: Mapping[str, int]) -> NDArray[np.int64]:
    """Return for each feature of a policy file its place among the features of SB3.

    SB3 joins all entries by name; a policy file joins the vectors, then the images.
    """
    sizes = {entry.name: image_sizes.get(entry.name, entry.size) for entry in spec.observation}
    starts, start = dict[str, int](), 0
    for name in sorted(sizes):
        starts[name] = start
        start += sizes[name]
    ordered = sorted(spec.observation, key=is_image)
    places = [starts[entry.name] + np.arange(sizes[entry.name]) for entry in ordered]
    return np.concatenate(places)


def _middle_and_half(spec: PolicySpec) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low, high = (bound.astype(np.float64) for bound in spec.continuous_bounds())
    return (low + high) / 2, (high - low) / 2


def _array(tensor: Tensor) -> NDArray[np.float32]:
    return _float32(tensor.detach().numpy())


def _float32(values: NDArray[Any]) -> NDArray[np.float32]:
    return np.array(values, np.float32)
