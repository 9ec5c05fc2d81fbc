"""Read a model of Stable-Baselines3 without running anything that is in its file.

``model.save`` writes a zip: ``policy.pth``, which PyTorch reads with ``weights_only=True``, and
``data``, JSON whose fields are plain, or pickles in base64 with a few plain keys beside. Of those
only the plain keys are looked at: to unpickle a file is to run what its author wrote.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, Literal, cast

import torch
from torch import Tensor

from ludus.errors import PolicyFileError
from ludus.model.policy_model import Activation

__all__ = ["Sb3Model", "read_zip"]

Kind = Literal["actor_critic", "sac", "dqn"]

MAX_DATA_BYTES = 1 << 26
MAX_WEIGHTS_BYTES = 1 << 29

_KINDS: dict[str, tuple[Kind, Activation]] = {
    "stable_baselines3.common.policies": ("actor_critic", "tanh"),
    "sb3_contrib.common.maskable.policies": ("actor_critic", "tanh"),
    "stable_baselines3.sac.policies": ("sac", "relu"),
    "stable_baselines3.dqn.policies": ("dqn", "relu"),
}
"""Kind of policy and its usual activation, by the module of its class."""

_ACTIVATIONS: dict[str, Activation] = {"Tanh": "tanh", "ReLU": "relu", "ELU": "elu", "SiLU": "silu"}
_EXTRACTORS = "stable_baselines3.common.torch_layers"


@dataclass(frozen=True)
class Sb3Model:
    """What matters of a saved model.

    Attributes:
        kind: Which policies it belongs to.
        activation: Behind its hidden layers.
        weights: Parameters by name, float32.
        is_normalised: Whether it was trained behind ``VecNormalize``; None: the file does not tell.
    """

    kind: Kind
    activation: Activation
    weights: Mapping[str, Tensor]
    is_normalised: bool | None


def read_zip(path: Path) -> Sb3Model:
    """Read a model.

    Raises:
        PolicyFileError: It is no such file, or has a part that cannot be read without unpickling or
            that no policy file can hold; the text names the field.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            data = json.loads(_member(archive, "data", MAX_DATA_BYTES, path))
            weights = _member(archive, "policy.pth", MAX_WEIGHTS_BYTES, path)
    except OSError as error:
        raise PolicyFileError(f"{path} cannot be read: {error.strerror}") from error
    except (zipfile.BadZipFile, ValueError, RecursionError) as error:
        raise PolicyFileError(f"{path} is not a model of Stable-Baselines3: {error}") from error
    if not isinstance(data, dict):
        raise _misfit(path, "data", "it is no JSON object")
    fields = cast(dict[str, Any], data)
    kind, activation = _read_kind(fields, path)
    return Sb3Model(
        kind,
        _read_activation(fields, path) or activation,
        _read_weights(weights, path),
        fields.get("_last_original_obs") is not None if kind == "actor_critic" else None,
    )


def _member(archive: zipfile.ZipFile, name: str, limit: int, path: Path) -> bytes:
    try:
        with archive.open(name) as file:
            content = file.read(limit + 1)
    except KeyError:
        raise _misfit(path, name, "the zip has no such file") from None
    if len(content) > limit:
        raise _misfit(path, name, f"it has more than {limit} bytes")
    return content


def _read_weights(content: bytes, path: Path) -> dict[str, Tensor]:
    try:
        loaded = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except (RuntimeError, UnpicklingError, EOFError, ValueError) as error:
        reason = f"it holds more than arrays, or is broken: {str(error).splitlines()[0]}"
        raise _misfit(path, "policy.pth", reason) from error
    if not isinstance(loaded, dict):
        raise _misfit(path, "policy.pth", "it is no dictionary of arrays")
    weights: dict[str, Tensor] = {}
    for name, value in cast(dict[Any, Any], loaded).items():
        if not isinstance(name, str) or not isinstance(value, Tensor):
            raise _misfit(path, f"policy.pth[{name!r}]", "it is no array")
        weights[name] = value.float()
    return weights


def _read_kind(data: Mapping[str, Any], path: Path) -> tuple[Kind, Activation]:
    module = _part(data, "policy_class").get("__module__")
    if module not in _KINDS:
        raise _misfit(
            path,
            "policy_class.__module__",
            f"it is {module!r}; policy files hold what {', '.join(_KINDS)} make",
        )
    if data.get("use_sde"):
        raise _misfit(path, "use_sde", "state-dependent exploration has no place in a policy file")
    return _KINDS[module]


def _read_activation(data: Mapping[str, Any], path: Path) -> Activation | None:
    """Return the activation in ``policy_kwargs``, and refuse what changes the network otherwise."""
    settings = _part(data, "policy_kwargs")
    extractor = str(settings.get("features_extractor_class", _EXTRACTORS))
    if _EXTRACTORS not in extractor:
        raise _misfit(path, "policy_kwargs.features_extractor_class", f"it is {extractor}")
    if str(settings.get("normalize_images", True)) != "True":
        raise _misfit(path, "policy_kwargs.normalize_images", "pixels are always divided by 255")
    for name in ("features_extractor_kwargs", "squash_output"):
        if str(settings.get(name, False)) not in ("False", "None", "{}"):
            raise _misfit(path, f"policy_kwargs.{name}", f"it is {settings[name]}")
    text = settings.get("activation_fn")
    if text is None:
        return None
    name = str(text).rpartition(".")[2].rstrip("'>")
    if not str(text).startswith("<class 'torch.nn.modules.activation.") or name not in _ACTIVATIONS:
        expected = ", ".join(_ACTIVATIONS)
        raise _misfit(path, "policy_kwargs.activation_fn", f"it is {text}, expected {expected}")
    return _ACTIVATIONS[name]


def _part(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = data.get(name)
    return cast(dict[str, Any], value) if isinstance(value, dict) else {}


def _misfit(path: Path, field: str, reason: str) -> PolicyFileError:
    return PolicyFileError(f"{path}: {field}: {reason}")
