"""Export the policies of a run: convert, write, test, and only then put into place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ludus.disk import disk_errors, write_atomically
from ludus.engine import EngineKind, InstalledEngine, find_engine
from ludus.engine.exported import is_bevy_game
from ludus.errors import RunError, SetupError, TargetError
from ludus.export.config import ExportConfig
from ludus.export.convert import outline, to_model
from ludus.export.engines import BevyGame
from ludus.export.godot_ai_file import load_godot_ai
from ludus.export.parity import (
    ParityReport,
    PolicyFiles,
    has_onnx_runtime,
    measure_parity,
    require_parity,
)
from ludus.export.places import JSON, ONNX, check_place, format_of, place_files
from ludus.export.trained import TrainedPolicy, load_trained
from ludus.locks import TemporaryFolder
from ludus.model.json_file import write_model
from ludus.model.policy_model import PolicyModel
from ludus.networks.own_network import MakeNetwork
from ludus.runs.run_folder import RunFolder
from ludus.runs.saved import trained_config
from ludus.settings.train_config import TrainConfig
from ludus.target import Executable, Scene, Target, parse_target, prepare

__all__ = ["ExportConfig", "Exported", "export_policies", "write_policies"]


PT = ".pt"
"""How checkpoints of godot-ai end."""


@dataclass(frozen=True)
class Exported:
    """A policy that was written.

    Attributes:
        policy: Its name.
        path: The file.
        num_bytes: Size of the file.
        parity: How far every runtime is from PyTorch; None if that was not tested.
    """

    policy: str
    path: Path
    num_bytes: int
    parity: ParityReport | None


def export_policies(
    config: ExportConfig, networks: Mapping[str, MakeNetwork] | None = None
) -> list[Exported]:
    """Write the policies of a run, all or none.

    A ``.ludus.json`` is tested with NumPy and in Godot, or in the Bevy game that was trained; an
    ``.onnx`` with ONNX Runtime; the other runtimes are tested where they are installed.

    Raises:
        CheckpointError: There is no such run or checkpoint, or it is corrupt.
        ConfigError: There is no such policy, or no such format.
        RunError: The format that was named cannot hold a network.
        EngineNotFound: No Godot was found to test with.
        SetupError: The Bevy game to test with cannot be built.
        ParityError: A runtime computes something else than was trained; nothing is written.
        ModuleNotFoundError: ``onnx`` is not installed, and is needed.
    """
    if config.to is not None:
        check_place(config.to)
    if config.run.suffix == PT and config.run.is_file():
        return _export(
            [load_godot_ai(config.run, config.run.stem)], config, config.run.parent, None
        )
    trained = load_trained(config.run, config.checkpoint, config.policy, networks)
    folder = RunFolder.find(config.run)
    settings = trained_config(config.run, godot=config.godot) if config.is_tested else None
    return _export(trained, config, folder.path, settings)


def _export(
    trained: Sequence[TrainedPolicy],
    config: ExportConfig,
    folder: Path,
    settings: TrainConfig | None,
) -> list[Exported]:
    """Write policies: into ``folder`` unless told otherwise, tested in the game of ``settings``."""
    models = {one.spec.name: _model(one) for one in trained}
    others = [name for name, model in models.items() if model is None]
    places = place_files(list(models), config.to, folder, others)
    for one, place in zip(trained, places, strict=True):
        if one.spec.name in others and format_of(place) == JSON:
            to_model(one.policy, one.spec)  # says why that is impossible
    formats = {format_of(place) for place in places}
    engine = None
    if config.is_tested:
        engine = _find_engine(formats, config.godot, settings or TrainConfig())
    with TemporaryFolder("export") as temporary:
        staged: list[tuple[PolicyFiles, ParityReport | None]] = []
        for index, one in enumerate(trained):
            place = temporary.path / str(index)
            model, files = _stage(one, models[one.spec.name], place, formats, config.is_tested)
            report = None
            if config.is_tested:
                report = measure_parity(one.policy, model, files, engine, one.recorded)
                require_parity(report)
            staged.append((files, report))
        return [
            Exported(one.spec.name, place, _publish(files, place), report)
            for one, (files, report), place in zip(trained, staged, places, strict=True)
        ]


def write_policies(run: Path, folder: Path, checkpoint: str = "newest") -> dict[str, Path]:
    """Write all policies of a run as ``.ludus.json``, untested; return the files by policy.

    Args:
        run: A run folder, or one of its checkpoints.
        folder: Where to; it exists.
        checkpoint: As in :class:`ExportConfig`.

    Raises:
        CheckpointError: There is no such run or checkpoint, or it is corrupt.
    """
    config = ExportConfig(run=run, to=str(folder), checkpoint=checkpoint, is_tested=False)
    return {exported.policy: exported.path for exported in export_policies(config)}


def _model(one: TrainedPolicy) -> PolicyModel | None:
    """Return a policy as ``.ludus.json`` holds it, None if it cannot."""
    try:
        return to_model(one.policy, one.spec)
    except RunError:
        return None


def _stage(
    one: TrainedPolicy, model: PolicyModel | None, folder: Path, formats: set[str], is_tested: bool
) -> tuple[PolicyModel, PolicyFiles]:
    """Write a policy in all formats that are wanted or tested."""
    folder.mkdir()
    json, onnx = folder / f"policy{JSON}", folder / f"policy{ONNX}"
    if model is None:
        from ludus.export.onnx_network import write_network

        frame = outline(one.policy, one.spec)
        write_network(onnx, one.policy, frame)
        return frame, PolicyFiles(None, onnx)
    write_model(json, model)
    if ONNX not in formats and not (is_tested and has_onnx_runtime()):
        return model, PolicyFiles(json)
    from ludus.export.onnx_file import write_onnx

    write_onnx(onnx, model)
    return model, PolicyFiles(json, onnx)


def _publish(files: PolicyFiles, place: Path) -> int:
    """Put the file into place, whole or not at all; return its size."""
    source = files.json if format_of(place) == JSON else files.onnx
    assert source is not None
    data = source.read_bytes()
    with disk_errors(str(place)):
        place.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(place, data)
    return len(data)


def _find_engine(
    formats: set[str], named: Path | None, trained: TrainConfig
) -> InstalledEngine | BevyGame | None:
    """Return the engine to test with: the run's, or the one named; ONNX files can do without."""
    try:
        game = _find_game(trained)
        if named is None and isinstance(game, Executable) and is_bevy_game(game.path):
            return BevyGame(game.path)
        kind = game.project.engine_kind if isinstance(game, Scene) else EngineKind.GODOT4
        return find_engine(kind, named or trained.godot)
    except SetupError as error:
        if JSON not in formats:
            return None
        raise type(error)(
            f"the exported policy cannot be tested: {error.message}",
            f"{error.hint}; or export without the test: --no-parity",
        ) from error


def _find_game(trained: TrainConfig) -> Target | None:
    """Return the game of a run; None if it is gone."""
    try:
        return prepare(parse_target(trained.target, scene=trained.scene))
    except TargetError:
        return None
