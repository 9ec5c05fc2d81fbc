"""Export a model of Stable-Baselines3: convert, test, and only then write."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from ludus.errors import PolicyFileError
from ludus.export.config import ExportConfig
from ludus.export.exporting import Exported
from ludus.export.foreign import find_policy, require_json, write_tested
from ludus.export.sb3_model import Sb3Network, to_model
from ludus.export.sb3_zip import read_zip
from ludus.model.policy_model import Normalisation, is_image
from ludus.spec import PolicySpec

__all__ = ["export_model", "export_zip"]

_log = logging.getLogger(__name__)

UNSAFE = (
    "unsafe to ship: the model was trained behind VecNormalize, whose statistics are not in its "
    "zip; in the game it would see other numbers than in training"
)


def export_zip(
    saved: Path,
    spec: PolicySpec,
    path: Path,
    vec_normalize: Any = None,
    *,
    is_tested: bool = True,
    godot: Path | None = None,
) -> Exported:
    """Write a saved model as ``.ludus.json``.

    Args:
        saved: What ``model.save`` wrote.
        spec: Of the game's policy that it was trained for.
        path: The file to write.
        vec_normalize: SB3's ``VecNormalize``, or None.
        is_tested: Whether NumPy and Godot must compute the same.
        godot: Engine to test with; None: the one that is found.

    Raises:
        PolicyFileError: The model cannot be read, does not fit the game, or lacks the statistics
            of its observations.
        EngineNotFound: No Godot was found to test with.
        ParityError: A runtime computes something else; nothing is written.
    """
    require_json(path, "models of SB3")
    model = read_zip(saved)
    if model.is_normalised and vec_normalize is None:
        raise PolicyFileError(
            f"{saved}: {UNSAFE}",
            hint="in Python: env = VecNormalize.load(STATISTICS, ludus.sb3.make(GAME)); "
            "ludus.sb3.export(PPO.load(MODEL, env=env), path)",
        )
    normalisation = _read_normalisation(vec_normalize, spec)
    arrays = to_model(model, spec, normalisation)
    network = Sb3Network(model, spec, normalisation)
    return write_tested(arrays, path, network.answer, is_tested=is_tested, godot=godot)


def export_model(config: ExportConfig) -> Exported:
    """Write the model that ``config.run`` names, for a policy of ``config.game``.

    Raises:
        ConfigError: No game was named, or it has no such policy.
        PolicyFileError, EngineNotFound, ParityError: As :func:`export_zip`.
    """
    spec, path = find_policy(config, "cartpole")
    if read_zip(config.run).is_normalised is None:
        _log.warning(
            "%s does not say whether it was trained behind VecNormalize; if it was, it is unsafe "
            "to ship: use ludus.sb3.export(model, path, vec_normalize) in Python",
            config.run,
        )
    return export_zip(config.run, spec, path, is_tested=config.is_tested, godot=config.godot)


def _read_normalisation(vec_normalize: Any, spec: PolicySpec) -> Normalisation | None:
    if vec_normalize is None or not vec_normalize.norm_obs:
        return None
    names = [entry.name for entry in spec.observation]
    is_dict = isinstance(vec_normalize.obs_rms, dict)
    chosen = set(vec_normalize.norm_obs_keys or names) if is_dict else set(names)
    wrong = [e.name for e in spec.observation if is_image(e) == (e.name in chosen)]
    if wrong:
        raise PolicyFileError(
            f"VecNormalize: norm_obs_keys: a policy file normalises all entries but images, and "
            f"{', '.join(wrong)} is treated otherwise"
        )
    shifts: list[Any] = []
    scales: list[Any] = []
    for entry in spec.observation:
        if entry.name in chosen:
            statistics = vec_normalize.obs_rms[entry.name] if is_dict else vec_normalize.obs_rms
            shifts.append(np.ravel(statistics.mean))
            scales.append(1.0 / np.sqrt(np.ravel(statistics.var) + vec_normalize.epsilon))
    if not shifts:
        return None
    limit = float(vec_normalize.clip_obs)
    shift, scale = (np.concatenate(parts).astype(np.float32) for parts in (shifts, scales))
    return Normalisation(shift, scale, limit)
