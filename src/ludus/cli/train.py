"""``ludus train``: train agents in a game."""

from __future__ import annotations

import itertools
import json
import shlex
import signal
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from ludus.errors import ConfigError
from ludus.settings.merging import lay_over, policy_settings, read_file, to_plain
from ludus.settings.policy_config import ALGORITHM_CONFIGS
from ludus.settings.train_config import Phase, PolicyConfig, TrainConfig
from ludus.spec import PolicySpec

__all__ = ["COMMAND", "TrainCommand", "parse", "run"]

PROGRAM = "ludus train"


@dataclass(frozen=True)
class TrainCommand(TrainConfig):
    """Train agents in a game, and leave a run folder with checkpoints, metrics and a curve.

    Settings come from the scene, then from --config, then from the command line; later ones win.
    --ppo.* and --sac.* set all policies of that algorithm, --policies.NAME.* one policy.
    Ctrl-C saves and stops.

    Attributes:
        target: What to train in: an example, a project folder, a scene, an exported game, an
            address, or gym:ENV_ID for any Gymnasium environment.
        config: TOML file with settings, or the config.json of a run.
        resume: Folder of a run to go on with; its settings hold unless given anew.
        json: Print the result as one JSON object on stdout.
        arguments: What was typed.
    """

    target: tyro.conf.Positional[str] = ""
    policies: Annotated[
        dict[str, tyro.conf.AvoidSubcommands[PolicyConfig]],
        tyro.conf.arg(help_behavior_hint="--policies.NAME.* sets one policy"),
    ] = field(default_factory=dict[str, PolicyConfig])
    schedule: tyro.conf.Suppress[tuple[Phase, ...]] = ()
    config: Path | None = None
    resume: Path | None = None
    json: bool = False
    arguments: tyro.conf.Suppress[tuple[str, ...]] = ()


COMMAND = TrainCommand


def parse(arguments: Sequence[str]) -> TrainCommand:
    """Return what was typed, over the file or the resumed run it names.

    Settings of single policies are read in :func:`run`, when the game has told their names.
    """
    first = _parse(arguments, TrainCommand(), is_final=False)
    base = TrainCommand()
    if first.resume is not None:
        from ludus.runs.run_folder import RunFolder

        folder = RunFolder.find(first.resume)
        base = replace(_as_command(folder.read_config()), resume=folder.path)
    if first.config is not None:
        base = lay_over_command(base, read_file(first.config), str(first.config))
    command = _parse(arguments, base, is_final=False)
    if not command.target:
        raise ConfigError("no target was given", f"name one: {PROGRAM} cartpole")
    return replace(command, arguments=tuple(arguments))


def run(command: TrainCommand) -> int:
    """Train; return 0, or 128 plus the signal that stopped it."""
    from ludus.cli.live import reporter_for
    from ludus.training.loop import train

    with reporter_for(sys.stderr) as reporter:
        result = train(
            as_config(command),
            resume=command.resume,
            configure=lambda policies: configure(command, policies),
            reporter=reporter,
        )
    reporter.finished(result)
    if command.json:
        values: dict[str, Any] = {**asdict(result), "run": str(result.run)}
        sys.stdout.write(json.dumps(values) + "\n")
    if result.signum is None:
        return 0
    name = signal.Signals(result.signum).name
    again = f"{PROGRAM} --resume {shlex.quote(str(result.run))}"
    sys.stderr.write(f"stopped by {name} and saved; go on with: {again}\n")
    return 128 + result.signum


def configure(command: TrainCommand, policies: Mapping[str, PolicySpec]) -> TrainConfig:
    """Return the effective settings, now that the game has told its policies and theirs.

    What was typed is laid once more over what scene and file say of each policy, so that typed
    settings win even where they equal the defaults.
    """
    typed = command.arguments
    settings: dict[str, PolicyConfig] = {}
    for name, policy in policies.items():
        chosen = _untyped_settings(command, policy, _typed_algorithm(command, name))
        base = replace(command, policies={}, **{chosen.algorithm: chosen})
        settings[name] = getattr(_parse(typed, base, is_final=False), chosen.algorithm)
    final = _parse(typed, replace(command, policies=settings), is_final=True)
    return as_config(final)


def _typed_algorithm(command: TrainCommand, policy: str) -> str | None:
    """Return the algorithm that was typed for ``policy``, or for all; None if none was."""
    flags = {f"--policies.{policy}.algorithm", "--algorithm"}
    found: dict[str, str] = {}
    words = [part for word in command.arguments for part in word.split("=", 1)]
    for word, value in itertools.pairwise(words):
        flag = word.replace("_", "-")
        if flag in {name.replace("_", "-") for name in flags}:
            found[flag] = value
    own = found.get(f"--policies.{policy}.algorithm".replace("_", "-"))
    algorithm = own or found.get("--algorithm")
    if algorithm is not None and algorithm not in ALGORITHM_CONFIGS:
        known = " or ".join(ALGORITHM_CONFIGS)
        raise ConfigError(f"policy {policy}: algorithm must be {known}, not {algorithm!r}")
    return algorithm


def as_config(command: TrainCommand) -> TrainConfig:
    """Return the settings of the run without those of the command."""
    return TrainConfig(**{part.name: getattr(command, part.name) for part in fields(TrainConfig)})


def lay_over_command(command: TrainCommand, values: Mapping[str, Any], where: str) -> TrainCommand:
    """Return ``command`` with settings from a file."""
    config = lay_over(as_config(command), values, where)
    return replace(_as_command(config), resume=command.resume)


def _untyped_settings(
    command: TrainCommand, policy: PolicySpec, algorithm: str | None
) -> PolicyConfig:
    """Return what defaults, scene, resumed run and file say of a policy, in this order."""
    file = read_file(command.config) if command.config else {}
    if command.resume is None:
        return policy_settings(TrainConfig(), policy, file, algorithm)
    from ludus.runs.run_folder import RunFolder

    saved = RunFolder.find(command.resume).read_config().policies.get(policy.name)
    before = replace(policy, settings={} if saved is None else to_plain(saved))
    return policy_settings(TrainConfig(), before, file, algorithm)


def _parse(arguments: Sequence[str], base: TrainCommand, *, is_final: bool) -> TrainCommand:
    """Read ``arguments`` over ``base``; settings of single policies only if ``is_final``."""
    kept = list(arguments) if is_final else _without_policies(arguments)
    kept = ["None" if argument == "none" else argument for argument in kept]  # as files write it
    return tyro.cli(TrainCommand, args=kept, default=base, prog=PROGRAM)


def _without_policies(arguments: Sequence[str]) -> list[str]:
    """Leave out ``--policies.…`` flags and their values; the final pass reads and checks them."""
    kept: list[str] = []
    is_left_out = False
    for argument in arguments:
        if argument.startswith("--"):
            is_left_out = argument.startswith("--policies.") and "=" not in argument
            if argument.startswith("--policies."):
                continue
        elif is_left_out:
            continue
        kept.append(argument)
    return kept


def _as_command(config: TrainConfig) -> TrainCommand:
    return TrainCommand(**{part.name: getattr(config, part.name) for part in fields(TrainConfig)})
