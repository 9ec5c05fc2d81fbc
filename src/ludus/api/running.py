"""``ludus.train``: a training run from Python, with the settings of the command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from ludus.algorithms.learners import MakeLearner, OwnParts
from ludus.api.evaluating import evaluate
from ludus.arguments import check_arguments
from ludus.export.config import ExportConfig
from ludus.export.exporting import export_policies
from ludus.networks.own_network import MakeNetwork
from ludus.play.evaluation import Evaluation
from ludus.play.players import Stochastic
from ludus.pool import Pool
from ludus.runs.metrics import read_metrics
from ludus.runs.run_folder import RunFolder, stack_layers
from ludus.settings.merging import PYTHON, Layer, python_layer
from ludus.settings.plain import plain_settings
from ludus.settings.train_config import TrainConfig
from ludus.training import loop
from ludus.training.hooks import Hooks, OnTrainingEpisode, OnUpdate
from ludus.training.live import reporter_for_script
from ludus.training.progress import RunResult

__all__ = ["Run", "train"]


class Run(RunResult):
    """A training run that has ended; the files are in the folder ``path``."""

    _own: OwnParts
    _pool: Pool | None

    @classmethod
    def of(cls, result: RunResult, own: OwnParts, pool: Pool | None) -> Run:
        """Return a result with what a script can do next."""
        run = cls(**{part.name: getattr(result, part.name) for part in fields(RunResult)})
        object.__setattr__(run, "_own", own)
        object.__setattr__(run, "_pool", pool)
        return run

    @property
    def metrics(self) -> list[dict[str, Any]]:
        """One dictionary per update, as docs/metrics.md describes; read from ``metrics.jsonl``."""
        return read_metrics(RunFolder(self.path).metrics)

    def evaluate(
        self,
        episodes: int = 20,
        *,
        seed: int = 0,
        stochastic: Stochastic = False,
        **settings: Any,
    ) -> dict[str, Evaluation]:
        """Play complete episodes with the newest checkpoint; see :func:`ludus.evaluate`."""
        return evaluate(
            self.path,
            episodes=episodes,
            seed=seed,
            stochastic=stochastic,
            networks=self._own.networks,
            pool=self._pool,
            **settings,
        )

    @check_arguments
    def export(
        self,
        to: str | Path | None = None,
        *,
        policy: str | None = None,
        checkpoint: str = "newest",
        parity: bool = True,
    ) -> dict[str, Path]:
        """Write trained policies as files for games and other runtimes, as ``ludus export`` does.

        Args:
            to: A file, if there is one policy; a folder; or a pattern such as
                ``models/{policy}.onnx``. None is the run's folder, as ``.ludus.json``, or as
                ``.onnx`` where that format cannot hold the network.
            policy: Export this one only.
            checkpoint: ``"newest"``, ``"best"`` (the highest mean return), or one of the run's.
            parity: Test that the files compute what was trained.

        Returns:
            The files, by policy.

        Raises:
            CheckpointError: No checkpoint can be loaded.
            ParityError: A runtime computes something else than was trained.
            RunError: The format that was asked for cannot hold the network.
        """
        config = ExportConfig(
            run=self.path,
            policy=policy,
            to=None if to is None else str(to),
            checkpoint=checkpoint,
            is_tested=parity,
        )
        exported = export_policies(config, self._own.networks)
        return {one.policy: one.path for one in exported}


@check_arguments
def train(
    target: str | Path | TrainConfig = "",
    *,
    config: str | Path | None = None,
    resume: str | Path | None = None,
    pool: Pool | None = None,
    on_update: OnUpdate | None = None,
    on_episode: OnTrainingEpisode | None = None,
    networks: Mapping[str, MakeNetwork] | None = None,
    learners: Mapping[str, MakeLearner] | None = None,
    progress: bool | None = None,
    **settings: Any,
) -> Run:
    """Train agents in a game, leave a run folder, evaluate; what ``ludus train`` does.

    >>> run = ludus.train(                                           # doctest: +SKIP
    ...     "tag",
    ...     total_steps=200_000,
    ...     ppo={"hidden_sizes": [128, 128]},
    ...     policies={"runner": {"entropy_coefficient": 0.02}},
    ... )
    >>> run.evaluation["chaser"].mean_return                         # doctest: +SKIP

    Ctrl-C and SIGTERM end training early with a checkpoint; ``run.signum`` says so.

    Args:
        target: What to train in (docs/targets.md), or all settings as a struct.
        config: TOML file with settings, or the ``config.json`` of a run.
        resume: Folder of a run to go on with; its settings hold unless given again.
        pool: Train in these engines and leave them open; None opens what ``target`` names.
        on_update: Called after every update with the :class:`~ludus.training.hooks.Training`,
            which can stop the run and change settings.
        on_episode: Called with the same and an :class:`~ludus.training.hooks.Episode` for each
            episode of training that ends.
        networks: Makers of ``torch.nn.Module`` by policy, in the place of Ludus's network
            (docs/python.md).
        learners: Makers of learners by policy, in the place of PPO and SAC (docs/python.md).
        progress: Whether to show progress; None shows it in notebooks and on terminals.
        settings: Fields of :class:`ludus.TrainConfig`, which are the flags of ``ludus train``;
            nested ones as dictionaries or structs: ``ppo={"learning_rate": 3e-4}``.

    Raises:
        ArgumentError: An argument has the wrong type.
        UsageError: A callback, network or learner names something that the game does not have.
        ConfigError: A setting is unknown or does not fit.
        CheckpointError: The run to resume has no checkpoint that fits.
        DivergenceError: A loss became NaN; the state lies in the run folder under ``diverged``.
        RunError: A file cannot be written.
        EngineError: An engine failed for good; a checkpoint was written.
    """
    last = _python_layer(target, settings)
    folder = None if resume is None else RunFolder.find(Path(resume))
    layers = stack_layers(last, config=None if config is None else Path(config), run=folder)
    own = OwnParts(networks or {}, learners or {})
    with reporter_for_script(progress) as reporter:
        result = loop.train(
            layers,
            pool=pool,
            resume=None if folder is None else folder.path,
            reporter=reporter,
            hooks=Hooks(on_update, on_episode),
            own=own,
        )
        reporter.finished(result)
    return Run.of(result, own, pool)


def _python_layer(target: str | Path | TrainConfig, settings: Mapping[str, Any]) -> Layer:
    if isinstance(target, TrainConfig):
        whole = python_layer(target)
        return Layer(PYTHON, {**whole.values, **plain_settings(settings)})
    named = {"target": str(target)} if target else {}
    return Layer(PYTHON, {**named, **plain_settings(settings)})
