"""``ludus.sweep``: ``ludus sweep`` for scripts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ludus.arguments import check_arguments
from ludus.runs.run_folder import stack_layers
from ludus.settings.merging import PYTHON, Layer
from ludus.settings.plain import plain_settings
from ludus.tuning.sweeping import Objective, OnTrial, Sweep, SweepConfig, run_sweep

__all__ = ["sweep"]


@check_arguments
def sweep(
    target: str | Path = "",
    space: Mapping[str, str] | None = None,
    *,
    trials: int = 30,
    seeds: int = 1,
    objective: Objective | None = None,
    config: str | Path | None = None,
    resume: str | Path | None = None,
    on_trial: OnTrial | None = None,
    **settings: Any,
) -> Sweep:
    """Train many times, with settings that Optuna proposes.

    >>> found = ludus.sweep(                                         # doctest: +SKIP
    ...     "pendulum", {"ppo.learning_rate": "log:1e-4:1e-2"}, trials=20, target_return=-200.0
    ... )
    >>> found.best.values                                            # doctest: +SKIP

    Args:
        target: What to train in (docs/targets.md).
        space: What is varied: dotted names of settings to ``LOW:HIGH``, ``log:LOW:HIGH`` or
            ``A,B,C``; None: learning rate, discount and a few more of the algorithm's settings.
        trials: How many in all, those of a resumed sweep included.
        seeds: Runs of each trial, with another seed each; their median counts.
        objective: ``"return"`` looks for the highest mean return at the end, ``"steps"`` for the
            fewest agent steps until ``target_return``; None is ``"steps"`` where there is one.
        config: TOML file with settings, or the ``config.json`` of a run.
        resume: Folder of a sweep to go on with, in place of ``target``, ``space`` and settings.
        on_trial: Called after each trial.
        settings: Of all trials; fields of :class:`ludus.TrainConfig`.

    Raises:
        ArgumentError: An argument has the wrong type.
        SetupError: Optuna is missing.
        ConfigError: A setting is unknown, or does not fit; one that was proposed fails its trial.
        RunError: Another process runs this sweep, or a file cannot be written.
        EngineError: An engine failed for good; ``resume`` goes on.
    """
    named = {"target": str(target)} if target else {}
    last = Layer(PYTHON, {**named, **plain_settings(settings)})
    layers = stack_layers(last, config=None if config is None else Path(config))
    varied = (
        None if resume is not None else SweepConfig(dict(space or {}), layers, objective, seeds)
    )
    folder = None if resume is None else Path(resume)
    return run_sweep(varied, trials, resume=folder, on_trial=on_trial)
