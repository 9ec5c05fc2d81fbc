"""Export the policies of a run: convert, write, test, and only then put into place."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ludus.disk import disk_errors, write_atomically
from ludus.engine import EngineKind, InstalledEngine, find_engine
from ludus.engine.exported import is_bevy_game
from ludus.errors import EngineNotFound, RunError, SetupError, TargetError
from ludus.export.convert import outline, to_model
from ludus.export.engines import BevyGame
from ludus.export.parity import (
    ParityReport,
    PolicyFiles,
    has_onnx_runtime,
    measure_parity,
    require_parity,
)
from ludus.export.places import JSON, ONNX, check_place, format_of, place_files
from ludus.export.trained import TrainedPolicy, load_trained
from ludus.model.json_file import write_model
from ludus.model.policy_model import PolicyModel
from ludus.networks.own_network import MakeNetwork
from ludus.runs.run_folder import RunFolder
from ludus.settings.train_config import TrainConfig
from ludus.target import Executable, Scene, Target, parse_target, prepare

__all__ = ["ExportConfig", "Exported", "export_policies", "write_policies"]


@dataclass(frozen=True, kw_only=True)
class ExportConfig:
    """What to export, and where to.

    Attributes:
        run: A run folder, or one of its checkpoints.
        policy: Name of the one policy to export; None exports all.
        to: A file, a folder or a pattern with ``{policy}``; None is the run's folder.
        checkpoint: ``newest``, ``best`` or the path of a checkpoint.
        is_tested: Whether every runtime must compute what was trained.
        godot: Engine to test with; None is the run's, or the one that is found.
        networks: What the run was trained with in the place of Ludus's networks.
    """

    run: Path
    policy: str | None = None
    to: str | None = None
    checkpoint: str = "newest"
    is_tested: bool = True
    godot: Path | None = None
    networks: Mapping[str, MakeNetwork] = field(default_factory=dict[str, MakeNetwork])


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


def export_policies(config: ExportConfig) -> list[Exported]:
    """Write the policies of a run, all or none.

    A ``.ludus.json`` is tested with NumPy and in Godot, or in the Bevy game that was trained; an
    ``.onnx`` with ONNX Runtime; the other runtimes are tested where they are installed.

    Raises:
        CheckpointError: There is no such run or checkpoint, or it is corrupt.
        ConfigError: There is no such policy, or no such format.
        RunError: The format that was named cannot hold a network.
        EngineNotFound: There is no Godot to test with.
        SetupError: The Bevy game to test with cannot be built.
        ParityError: A runtime computes something else than was trained; nothing is written.
        ModuleNotFoundError: ``onnx`` is not installed, and is needed.
    """
    if config.to is not None:
        check_place(config.to)
    trained = load_trained(config.run, config.checkpoint, config.policy, config.networks)
    folder = RunFolder.find(config.run)
    models = {one.spec.name: _model(one) for one in trained}
    others = [name for name, model in models.items() if model is None]
    places = place_files(list(models), config.to, folder.path, others)
    for one, place in zip(trained, places, strict=True):
        if one.spec.name in others and format_of(place) == JSON:
            to_model(one.policy, one.spec)  # says why that is impossible
    formats = {format_of(place) for place in places}
    engine = None
    if config.is_tested:
        engine = _find_engine(formats, config.godot, folder.read_config())
    with tempfile.TemporaryDirectory(prefix="ludus-export-") as name:
        staged = [
            _stage(one, models[one.spec.name], Path(name) / str(index), formats, config.is_tested)
            for index, one in enumerate(trained)
        ]
        reports: list[ParityReport | None] = [None] * len(trained)
        if config.is_tested:
            pairs = zip(trained, staged, strict=True)
            reports = [_test(one, files, engine) for one, files in pairs]
        return [
            Exported(one.spec.name, place, _publish(files, place), report)
            for one, files, place, report in zip(trained, staged, places, reports, strict=True)
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


@dataclass(frozen=True)
class _Staged:
    model: PolicyModel
    files: PolicyFiles


def _model(one: TrainedPolicy) -> PolicyModel | None:
    """Return a policy as ``.ludus.json`` holds it, None if it cannot."""
    try:
        return to_model(one.policy, one.spec)
    except RunError:
        return None


def _stage(
    one: TrainedPolicy, model: PolicyModel | None, folder: Path, formats: set[str], is_tested: bool
) -> _Staged:
    """Write a policy in all formats that are wanted or tested."""
    folder.mkdir()
    json, onnx = folder / f"policy{JSON}", folder / f"policy{ONNX}"
    if model is None:
        from ludus.export.onnx_network import write_network

        frame = outline(one.policy, one.spec)
        write_network(onnx, one.policy, frame)
        return _Staged(frame, PolicyFiles(None, onnx))
    write_model(json, model)
    if ONNX not in formats and not (is_tested and has_onnx_runtime()):
        return _Staged(model, PolicyFiles(json))
    from ludus.export.onnx_file import write_onnx

    write_onnx(onnx, model)
    return _Staged(model, PolicyFiles(json, onnx))


def _test(
    one: TrainedPolicy, staged: _Staged, engine: InstalledEngine | BevyGame | None
) -> ParityReport:
    report = measure_parity(one.policy, staged.model, staged.files, engine, one.recorded)
    require_parity(report)
    return report


def _publish(staged: _Staged, place: Path) -> int:
    """Put the file into place, whole or not at all; return its size."""
    source = staged.files.json if format_of(place) == JSON else staged.files.onnx
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
    except SetupError as error:
        if JSON not in formats:
            return None
        raise SetupError(
            f"the exported policy cannot be tested in its game: {error.message}",
            f"{error.hint}; or export without the test: --no-parity",
        ) from error
    if named is None and isinstance(game, Executable) and is_bevy_game(game.path):
        return BevyGame(game.path)
    kind = game.project.engine_kind if isinstance(game, Scene) else EngineKind.GODOT4
    return _find_godot(formats, named or trained.godot, kind)


def _find_godot(formats: set[str], godot: Path | None, kind: EngineKind) -> InstalledEngine | None:
    try:
        return find_engine(kind, godot)
    except EngineNotFound as error:
        if JSON not in formats and godot is None:
            return None
        raise EngineNotFound(
            f"the exported policy cannot be tested in Godot: {error.message}",
            f"{error.hint}; or export without the test: --no-parity",
        ) from None


def _find_game(trained: TrainConfig) -> Target | None:
    """Return the game of a run; None where that cannot be told any more."""
    try:
        target = parse_target(trained.target, scene=trained.scene)
        return prepare(target)
    except TargetError:
        return None
