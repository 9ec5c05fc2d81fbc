"""Models that another library trained: for which policy of a game, and tested before written."""

from __future__ import annotations

from pathlib import Path

from ludus.disk import disk_errors, write_atomically
from ludus.engine import EngineKind, find_engine
from ludus.errors import ConfigError
from ludus.export.config import ExportConfig
from ludus.export.exporting import Exported
from ludus.export.parity import PolicyFiles, Reference, measure_parity, require_parity
from ludus.export.places import JSON, format_of, place_files
from ludus.libraries.vector import choose_policy
from ludus.locks import TemporaryFolder
from ludus.model.json_file import write_model
from ludus.model.policy_model import PolicyModel
from ludus.pool import PoolConfig, open_pool
from ludus.spec import PolicySpec

__all__ = ["find_policy", "require_json", "write_tested"]


def find_policy(config: ExportConfig, example: str) -> tuple[PolicySpec, Path]:
    """Return the policy of ``config.game`` that a model is for, and the file to write.

    Raises:
        ConfigError: No game was named (``example`` shows one), or it has no such policy.
    """
    if config.game is None:
        raise ConfigError(
            f"{config.run} does not say which game it was trained in", hint=f"--game {example}"
        )
    with open_pool(config.game, PoolConfig(godot=config.godot)) as pool:
        spec = choose_policy(pool, config.policy)
    to = config.to or f"{config.run.parent}/"
    (path,) = place_files([spec.name], to, config.run.parent)
    return spec, path


def require_json(path: Path, models: str) -> None:
    """Refuse another format than ``.ludus.json``.

    Raises:
        ConfigError: It is another one.
    """
    if format_of(path) != JSON:
        raise ConfigError(f"cannot write {path}: {models} become {JSON} files")


def write_tested(
    model: PolicyModel,
    path: Path,
    reference: Reference,
    *,
    is_tested: bool = True,
    godot: Path | None = None,
) -> Exported:
    """Write a policy file, whole or not at all.

    Args:
        model: What to write.
        path: Where to.
        reference: Answers as the original does.
        is_tested: Whether NumPy and Godot must compute the same.
        godot: Engine to test with; None: the one that is found.

    Raises:
        EngineNotFound: No Godot was found to test with.
        ParityError: A runtime computes something else; nothing is written.
    """
    with TemporaryFolder("export") as temporary:
        file = temporary.path / f"policy{JSON}"
        write_model(file, model)
        report = None
        if is_tested:
            engine = find_engine(EngineKind.GODOT4, godot)
            report = measure_parity(reference, model, PolicyFiles(file), engine, {})
            require_parity(report)
        data = file.read_bytes()
    with disk_errors(str(path)):
        write_atomically(path, data)
    return Exported(model.policy, path, len(data), report)
