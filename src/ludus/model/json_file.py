"""Policies as JSON files, ``*.ludus.json`` (protocol/POLICY.md §1)."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.disk import write_atomically
from ludus.errors import PolicyFileError
from ludus.model.checking import check_model
from ludus.model.json_reader import FORMAT, VERSION, from_json
from ludus.model.policy_model import (
    Convolution,
    Distribution,
    Gru,
    ImageNetwork,
    Linear,
    Normalisation,
    PolicyModel,
)
from ludus.wire.frames import parse_json

__all__ = ["MAX_FILE_BYTES", "from_json", "read_model", "to_json", "write_model"]

MAX_FILE_BYTES = 1 << 28


def read_model(path: str | Path) -> PolicyModel:
    """Read a policy file.

    Raises:
        PolicyFileError: The file is missing, too large, malformed, or its parts do not fit each
            other; the message names path and field.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise PolicyFileError(f"cannot read policy file {path}: {error.strerror}") from error
    if len(data) > MAX_FILE_BYTES:
        raise PolicyFileError(f"{path}: more than {MAX_FILE_BYTES} bytes")
    try:
        return from_json(parse_json(data))
    except ValueError as error:
        hint = "`ludus export` writes policy files"
        raise PolicyFileError(f"{path}: not JSON: {error}", hint) from error
    except PolicyFileError as error:
        raise PolicyFileError(f"{path}: {error.message}", error.hint) from error


def write_model(path: str | Path, model: PolicyModel) -> None:
    """Write a policy file; readers see the old one or the new one, whatever happens.

    Raises:
        PolicyFileError: The model contradicts itself, or the file cannot be written.
    """
    path = Path(path)
    text = json.dumps(to_json(model), separators=(",", ":"), allow_nan=False) + "\n"
    try:
        write_atomically(path, text.encode())
    except OSError as error:
        raise PolicyFileError(f"cannot write policy file {path}: {error.strerror}") from error


def to_json(model: PolicyModel) -> dict[str, Any]:
    """Return the object of POLICY.md §1.

    Raises:
        PolicyFileError: The model contradicts itself.
    """
    check_model(model)
    return {
        "format": FORMAT,
        "version": VERSION,
        "policy": model.policy,
        "fingerprint": model.fingerprint,
        "observation": [entry.to_json() for entry in model.observation],
        "action": [part.to_json() for part in model.action],
        "has_action_mask": model.has_action_mask,
        "normalisation": _normalisation(model.normalisation) if model.normalisation else None,
        "images": [_image(image) for image in model.images],
        "memory": _gru(model.memory) if model.memory else None,
        "layers": [_layer(layer) for layer in model.layers],
        "distribution": _distribution(model.distribution),
    }


def _tensor(array: NDArray[np.float32]) -> dict[str, Any]:
    data = np.ascontiguousarray(array, "<f4").tobytes()
    return {"shape": list(array.shape), "data": base64.b64encode(data).decode("ascii")}


def _layer(layer: Linear | Convolution) -> dict[str, Any]:
    return {
        "weight": _tensor(layer.weight),
        "bias": _tensor(layer.bias),
        "activation": layer.activation,
    }


def _convolution(layer: Convolution) -> dict[str, Any]:
    return {**_layer(layer), "stride": layer.stride, "padding": layer.padding}


def _image(image: ImageNetwork) -> dict[str, Any]:
    convolutions = [_convolution(layer) for layer in image.convolutions]
    return {
        "entry": image.entry,
        "convolutions": convolutions,
        "linear": _layer(image.linear),
    }


def _gru(memory: Gru) -> dict[str, Any]:
    return {
        "kind": "gru",
        "weight_input": _tensor(memory.weight_input),
        "weight_hidden": _tensor(memory.weight_hidden),
        "bias_input": _tensor(memory.bias_input),
        "bias_hidden": _tensor(memory.bias_hidden),
    }


def _normalisation(normalisation: Normalisation) -> dict[str, Any]:
    return {
        "shift": _tensor(normalisation.shift),
        "scale": _tensor(normalisation.scale),
        "limit": float(normalisation.limit),
    }


def _distribution(distribution: Distribution) -> dict[str, Any]:
    log_std = distribution.log_std
    return {
        "log_std": None if log_std is None else _tensor(log_std),
        "log_std_range": [float(bound) for bound in distribution.log_std_range],
        "is_squashed": distribution.is_squashed,
    }
