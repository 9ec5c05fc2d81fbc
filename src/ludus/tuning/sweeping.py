"""``ludus sweep``: look for settings with which a game is learned better, or in fewer steps.

::

    runs/sweep-<target>-<date>/
        sweep.json          what is varied, and the settings of all trials
        study.db            Optuna's study
        trials/trial-000/   the run of each trial; with several seeds also trial-000-1 and so on
        best.toml           the best settings, for ``ludus train --config``
        sweep.png           scores by trial and by setting

The first trial has the settings as they are, those of the scene among them, to compare with. A
sweep that was killed goes on: the trial that was under way is resumed from its checkpoint, or
begins again if it had none. A trial fails if a loss became NaN, or if its settings do not fit.
"""

from __future__ import annotations

import json
import logging
import shutil
import time
from collections import ChainMap
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ludus.disk import disk_errors, read_json, write_atomically
from ludus.errors import (
    ConfigError,
    DivergenceError,
    LudusError,
    RunError,
    SetupError,
    TargetError,
)
from ludus.locks import LockHeld, file_lock
from ludus.runs.run_folder import RunFolder
from ludus.runs.trust import PROGRAM_SETTINGS, make_mark, require_trust
from ludus.settings.merging import Layer, merge, resolve
from ludus.settings.plain import MARK, flatten_settings, plain_settings, to_plain
from ludus.settings.policy_config import ALGORITHM_CONFIGS, PolicyConfig
from ludus.settings.train_config import TrainConfig
from ludus.training.hooks import Hooks, Training
from ludus.training.loop import open_training_pool, train
from ludus.training.progress import RunResult
from ludus.tuning.picture import draw_sweep
from ludus.tuning.space import Range, nest, read_space

__all__ = ["Objective", "Sweep", "SweepConfig", "Trial", "run_sweep"]

Objective = Literal["return", "steps"]
"""``return``: the highest mean return at the end; ``steps``: the fewest agent steps until every
policy's mean return reaches ``target_return``."""

REPORTS = 20
"""Shares of a run after which a trial is compared with others, and ended if it is worse."""
LOCK_TIMEOUT_S = 1.0
AS_IS = "as-is"
"""Attribute of the trial that varies nothing: what it has of the settings that others vary."""

_DISCOUNTS = "0.95,0.98,0.99,0.995"
USUAL_SPACE: dict[str, dict[str, str]] = {
    "ppo": {
        "ppo.learning_rate": "log:1e-4:5e-3", "ppo.entropy_coefficient": "log:1e-4:3e-2",
        "ppo.epochs": "2:10", "ppo.discount": _DISCOUNTS,
    },
    "sac": {
        "sac.learning_rate": "log:1e-4:5e-3", "sac.batch_size": "64,128,256,512",
        "sac.discount": _DISCOUNTS,
    },
}  # fmt: skip
"""By algorithm: what is varied where nothing was named."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SweepConfig:
    """What a sweep varies, and what it looks for.

    Attributes:
        space: What is varied: dotted name of a setting to ``LOW:HIGH``, ``log:LOW:HIGH`` or
            ``A,B,C``; empty: ``USUAL_SPACE`` of the algorithms that the policies have.
        layers: Settings of all trials.
        objective: What is better; None: ``steps`` where the settings have a ``target_return``.
        seeds: Runs of each trial, at least 1; each has another seed, and their median counts. One
            lucky run is easily the best of many that are no better.
    """

    space: Mapping[str, str]
    layers: tuple[Layer, ...]
    objective: Objective | None = None
    seeds: int = 1


@dataclass(frozen=True)
class Trial:
    """One run of a sweep.

    Attributes:
        number: From 0; 0 has the settings as they are.
        values: What was varied, by dotted name; without settings that policies disagree on in
            trial 0.
        state: ``complete``, ``pruned`` (ended early, as it was worse than others) or ``failed``.
        score: Mean return or agent steps, the median over its seeds; None if it failed.
        reached: Whether every policy reached ``target_return`` in more than half of its runs; None
            without one.
        path: Folder of the run; with several seeds, of the first.
    """

    number: int
    values: Mapping[str, Any]
    state: Literal["complete", "pruned", "failed"]
    score: float | None
    reached: bool | None
    path: Path


@dataclass(frozen=True)
class Sweep:
    """A sweep and its trials.

    Attributes:
        path: Its folder.
        objective: What is better.
        trials: In the order they began, without those that did not end.
        signum: Signal that interrupted it; None if none did.
    """

    path: Path
    objective: Objective
    trials: tuple[Trial, ...]
    signum: int | None = None

    @property
    def best(self) -> Trial | None:
        """The best trial that was complete; None before the first one."""
        complete = [trial for trial in self.trials if trial.state == "complete"]
        sign = 1.0 if self.objective == "steps" else -1.0
        return min(complete, key=lambda trial: sign * (trial.score or 0.0), default=None)


OnTrial = Callable[[Trial], None]


@dataclass
class _Watch:
    """Reports the first run of a trial to Optuna, and stops it where others were better by then.

    Later runs have their say in the median: an unlucky one shall not end a trial that did well.
    """

    trial: Any
    total_steps: int
    sign: float
    is_pruned: bool = False
    _reported: int = field(default=0)

    def on_update(self, training: Training) -> None:
        progress = training.progress
        assert progress is not None
        returns = [own.get("mean_return") for own in progress.policies.values()]
        part = int(progress.agent_steps / self.total_steps * REPORTS)
        if None in returns or part <= self._reported:
            return
        self._reported = part
        mean = float(np.mean([value or 0.0 for value in returns]))
        self.trial.report(self.sign * mean, part)
        if self.trial.should_prune():
            self.is_pruned = True
            training.stop()


def run_sweep(
    config: SweepConfig | None,
    trials: int,
    *,
    resume: Path | None = None,
    on_trial: OnTrial | None = None,
) -> Sweep:
    """Run trials until there are ``trials`` of them, and leave the best settings and a picture.

    Args:
        config: What is varied; None with ``resume``.
        trials: How many in all, those of a resumed sweep included.
        resume: Folder of a sweep to go on with.
        on_trial: Called after each trial.

    Raises:
        SetupError: Optuna is missing.
        ConfigError: Settings do not fit as they are; a proposal that does not is a failed trial.
        RunError: Another process runs this sweep, or a file cannot be written.
        EngineError: An engine failed for good; ``resume`` goes on.
    """
    if trials < 1:
        raise ConfigError(f"trials must be at least 1, not {trials}")
    optuna = _optuna()
    folder, config = _open_folder(config, resume)
    with _locked(folder):
        return _Runner(optuna, folder, config).run(trials, on_trial)


class _Runner:
    def __init__(self, optuna: Any, folder: Path, config: SweepConfig) -> None:
        self._optuna = optuna
        self._folder = folder
        self._space = read_space(config.space)
        self._layers = config.layers
        self._base = merge(config.layers)
        self._objective: Objective = _objective(config.objective, self._base)
        self._seed = self._base.seed or 0
        self._seeds = config.seeds
        is_steps = self._objective == "steps"
        self._sign = -1.0 if is_steps else 1.0
        self._study: Any = optuna.create_study(
            study_name="ludus",
            storage=f"sqlite:///{folder / 'study.db'}",
            load_if_exists=True,
            direction="minimize" if is_steps else "maximize",
            sampler=optuna.samplers.TPESampler(seed=self._seed),
            pruner=optuna.pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=REPORTS // 4),
        )

    def run(self, trials: int, on_trial: OnTrial | None) -> Sweep:
        self._take_up()
        signum = None
        while signum is None and len(self._trials()) < trials:
            signum = self._run_trial(on_trial)
        sweep = Sweep(self._folder, self._objective, tuple(self._trials()), signum)
        if sweep.best is not None:
            _write_best(self._folder / "best.toml", sweep.best.values)
            draw_sweep(self._folder / "sweep.png", sweep, self._space)
        return sweep

    def _take_up(self) -> None:
        """Ask for the settings as they are first, and again for trials that were cut off."""
        if not self._study.trials:
            current = self._current_values()
            params = self._as_params(current) if self._contains(current) else {}
            self._study.enqueue_trial(params, user_attrs={AS_IS: current})
        # Another order of draws than before the interruption would repeat proposals.
        self._study.sampler.reseed_rng()
        for trial in self._study.get_trials(states=(self._optuna.trial.TrialState.RUNNING,)):
            if "run" in trial.user_attrs:
                num_ended = len(trial.user_attrs.get("outcomes", []))
                _discard_unless_begun(self._run_path(trial.user_attrs["run"], num_ended))
            self._study.tell(trial.number, state=self._optuna.trial.TrialState.FAIL)
            self._study.set_user_attr(f"again-{trial.number}", True)
            self._study.enqueue_trial(trial.params, user_attrs=trial.user_attrs)

    def _current_values(self) -> dict[str, Any]:
        """Return what is varied as the game is trained without a sweep.

        Settings that policies disagree on are left out.
        """
        policies = _policies_of(self._layers, self._base)
        config = replace(self._base, policies=policies)
        plain = flatten_settings(to_plain(config))
        current: dict[str, Any] = {}
        for name in self._space:
            algorithm, _, setting = name.partition(".")
            if name == "algorithm":
                found = [own.algorithm for own in policies.values()]
            elif algorithm in ALGORITHM_CONFIGS:
                users = [of for of, own in policies.items() if own.algorithm == algorithm]
                found = [plain[f"policies.{of}.{setting}"] for of in users]
            else:
                found = [plain.get(name)]
            found = found or [plain[name]]  # nobody uses this algorithm
            if all(value == found[0] for value in found):
                current[name] = found[0]
        return current

    def _contains(self, values: Mapping[str, Any]) -> bool:
        """Return whether the sweep could propose these values."""
        return all(
            name in values and domain.holds(values[name]) for name, domain in self._space.items()
        )

    def _propose(self, trial: Any) -> dict[str, Any]:
        """Return the settings that a trial changes, and let Optuna know all that it varies."""
        current = trial.user_attrs.get(AS_IS)
        if current is not None and not self._contains(current):
            return {}
        values = {name: domain.suggest(trial, name) for name, domain in self._space.items()}
        return values if current is None else {}

    def _as_params(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return values as Optuna knows them."""
        return {
            name: value if isinstance(self._space[name], Range) else json.dumps(value)
            for name, value in values.items()
        }

    def _run_trial(self, on_trial: OnTrial | None) -> int | None:
        """Run one trial; return the signal that interrupted it, if any."""
        trial: Any = self._study.ask()
        values = self._propose(trial)
        run = trial.user_attrs.get("run") or f"trial-{trial.number:03}"
        trial.set_user_attr("run", run)
        outcomes: list[Any] = trial.user_attrs.get("outcomes", [])
        watch = _Watch(trial, self._base.total_steps, self._sign)
        try:
            while len(outcomes) < self._seeds and not watch.is_pruned:
                hooks = Hooks() if outcomes else Hooks(on_update=watch.on_update)
                result = self._train(trial.number, run, len(outcomes), values, hooks)
                if result.signum is not None:
                    return result.signum  # the trial goes on when the sweep is resumed
                outcomes.append(self._score(result))
                trial.set_user_attr("outcomes", outcomes)
        except DivergenceError as error:
            self._fail(trial, error)
        except (ConfigError, TargetError) as error:
            if AS_IS in trial.user_attrs:
                raise
            # Raises if the proposal is not to blame, as when an engine is missing: all would fail.
            _policies_of(self._layers, self._base)
            self._fail(trial, error)
        else:
            self._tell(trial, outcomes, is_pruned=watch.is_pruned)
        if on_trial is not None:
            on_trial(self._trials()[-1])
        return None

    def _fail(self, trial: Any, error: LudusError) -> None:
        """Record a trial that has no score."""
        name = f"trial {trial.number}"  # errors of settings begin with it
        log.warning("%s failed: %s", name, error.message.removeprefix(f"{name}: "))
        self._study.tell(trial, state=self._optuna.trial.TrialState.FAIL)

    def _tell(self, trial: Any, outcomes: Sequence[Any], *, is_pruned: bool) -> None:
        """Record a trial that has ended, by the score and success of each of its runs."""
        score = float(np.median([score for score, _ in outcomes]))
        reached = [reached for _, reached in outcomes]
        trial.set_user_attr("score", score)
        trial.set_user_attr("reached", None if None in reached else sum(reached) > len(reached) / 2)
        if is_pruned:
            self._study.tell(trial, state=self._optuna.trial.TrialState.PRUNED)
        else:
            self._study.tell(trial, score)

    def _run_path(self, trial: str, run: int) -> Path:
        """Return the folder of one of the runs of a trial."""
        return self._folder / "trials" / (f"{trial}-{run}" if run else trial)

    def _train(
        self, number: int, trial: str, run: int, values: Mapping[str, Any], hooks: Hooks
    ) -> RunResult:
        own = Layer(f"trial {number}", nest(values))
        path = self._run_path(trial, run)
        place: dict[str, Any] = {"runs": str(path.parent), "name": path.name}
        seed = self._seed + int(trial.removeprefix("trial-")) * self._seeds + run
        place |= {"seed": seed, "evaluation_episodes": 0}
        return train(
            (*self._layers, own, Layer("sweep", place)),
            resume=path if _has_begun(path) else None,
            hooks=hooks,
        )

    def _score(self, result: RunResult) -> tuple[float, bool | None]:
        """Return the score of a run, and whether it reached the target return."""
        mean = float(np.mean(list(result.mean_return.values()))) if result.mean_return else -np.inf
        target = self._base.target_return
        reached = None if target is None else result.stop_reason == "target_return"
        if self._objective == "return":
            return mean, reached
        if reached or target is None:
            return float(result.agent_steps), reached
        # Beyond the limit, the nearer the better, so that there is a way down to it.
        missing = min(1.0, (target - mean) / max(abs(target), 1e-9))
        return self._base.total_steps * (1.0 + max(0.0, missing)), reached

    def _trials(self) -> list[Trial]:
        """Return the trials that have ended."""
        states = {"COMPLETE": "complete", "PRUNED": "pruned", "FAIL": "failed"}
        found: list[Trial] = []
        for trial in self._study.trials:
            if trial.state.name not in states or f"again-{trial.number}" in self._study.user_attrs:
                continue
            values = trial.user_attrs.get(AS_IS) or {
                name: value if isinstance(self._space[name], Range) else json.loads(value)
                for name, value in trial.params.items()
            }
            found.append(
                Trial(
                    number=trial.number,
                    values=values,
                    state=states[trial.state.name],  # pyright: ignore[reportArgumentType]
                    score=trial.user_attrs.get("score"),
                    reached=trial.user_attrs.get("reached"),
                    path=self._folder / "trials" / trial.user_attrs.get("run", ""),
                )
            )
        return found


def _has_begun(path: Path) -> bool:
    """Return whether a run has a checkpoint to go on from; it writes one before its first step."""
    store = RunFolder(path).checkpoints()
    return bool(store.paths() or store.kept())


def _discard_unless_begun(path: Path) -> None:
    """Remove the folder of a run that was cut off too early to be resumed.

    Raises:
        RunError: Another process trains in it, or it cannot be removed.
    """
    if not path.exists() or _has_begun(path):
        return
    with RunFolder(path).locked():  # but not during removal: Windows keeps a file that is open
        log.info("%s has no checkpoint, so this run begins again", path)
    with disk_errors(f"the run folder {path}"):
        shutil.rmtree(path)


def _objective(asked: Objective | None, base: TrainConfig) -> Objective:
    if asked == "steps" and base.target_return is None:
        raise ConfigError(
            "the objective steps needs a target_return, whose steps are counted",
            "set target_return, or the objective return",
        )
    if asked is not None:
        return asked
    return "return" if base.target_return is None else "steps"


def _open_folder(config: SweepConfig | None, resume: Path | None) -> tuple[Path, SweepConfig]:
    """Return the folder of a sweep, new or resumed, and what it varies."""
    if resume is not None:
        return resume, _read_config(resume)
    assert config is not None
    if config.seeds < 1:
        raise ConfigError(f"seeds must be at least 1, not {config.seeds}")
    base = merge(config.layers)
    _objective(config.objective, base)
    if not config.space:
        algorithms = {own.algorithm for own in _policies_of(config.layers, base).values()}
        usual = [USUAL_SPACE[algorithm] for algorithm in sorted(algorithms)]
        config = replace(config, space=dict(ChainMap(*usual)))
        log.info("varies what is usual: %s", ", ".join(config.space))
    read_space(config.space)
    named = f"sweep-{RunFolder.stem(base.target)}-{time.strftime('%Y%m%d-%H%M%S')}"
    folder = base.runs / (base.name or named)
    values = {
        "space": dict(config.space),
        "objective": config.objective,
        "seeds": config.seeds,
        "layers": [
            {**vars(layer), "values": plain_settings(layer.values)} for layer in config.layers
        ],
        **_programs_of(base),
    }
    values[MARK] = make_mark(values)
    with disk_errors(f"the sweep {folder}"):
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            raise RunError(
                f"the sweep {folder} exists already", f"ludus sweep --resume {folder} goes on"
            ) from None
        write_atomically(folder / "sweep.json", json.dumps(values, indent=2).encode() + b"\n")
    return folder, config


def _policies_of(layers: Sequence[Layer], base: TrainConfig) -> Mapping[str, PolicyConfig]:
    """Return the settings of each policy, of which only the open game tells what its scene sets."""
    with open_training_pool(replace(base, num_worlds=1, num_engines=1)) as pool:
        return resolve(layers, pool.policies).config.policies


def _read_config(folder: Path) -> SweepConfig:
    try:
        values: Any = read_json(folder / "sweep.json")
        layers = tuple(Layer(**layer) for layer in values["layers"])
        seeds = values.get("seeds", 1)
        config = SweepConfig(dict(values["space"]), layers, values["objective"], seeds)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RunError(
            f"{folder} cannot be resumed as a sweep: {type(error).__name__}: {error}",
            "name a folder that ludus sweep has made",
        ) from None
    require_trust(folder / "sweep.json", _programs_of(merge(config.layers)))
    return config


def _programs_of(config: TrainConfig) -> dict[str, Any]:
    plain = to_plain(config)
    return {name: plain[name] for name in PROGRAM_SETTINGS}


@contextmanager
def _locked(folder: Path) -> Generator[None, None, None]:
    try:
        with file_lock(folder / ".lock", LOCK_TIMEOUT_S):
            yield
    except LockHeld:
        raise RunError(f"the sweep {folder} is being run by another process") from None


def _optuna() -> Any:
    try:
        import optuna
    except ImportError as error:
        raise SetupError("optuna is not installed", "pip install optuna") from error
    module: Any = optuna
    module.logging.set_verbosity(module.logging.ERROR)
    return module


def _write_best(path: Path, values: Mapping[str, Any]) -> None:
    """Write settings as TOML, which JSON's values are, too, but for null."""
    lines = [f"{name} = {json.dumps(value)}" for name, value in values.items() if value is not None]
    with disk_errors(str(path)):
        write_atomically(path, ("\n".join(lines) + "\n").encode())
