"""``ludus train``: train agents in a game."""

from __future__ import annotations

import json
import shlex
import signal
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields, is_dataclass, make_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeVar, Union, get_type_hints

import tyro

from ludus.cli.bridge_flags import BridgeFlags, take_bridge_flags
from ludus.errors import ConfigError, did_you_mean
from ludus.settings.merging import Layer, merge, resolve
from ludus.settings.policy_config import ALGORITHM_CONFIGS
from ludus.settings.train_config import Phase, PPOConfig, SACConfig, TrainConfig
from ludus.settings.world_parameters import Lesson, Parameter

__all__ = ["COMMAND", "TrainCommand", "parse", "parse_settings", "run"]

PROGRAM = "ludus train"
POLICIES = "policies"


class _Unchecked:
    """Leaves checks to the merge, which alone knows what other layers say."""

    def __post_init__(self) -> None:
        pass


@dataclass(frozen=True)
class _PPOFlags(_Unchecked, PPOConfig):
    """Flags of every policy trained with PPO."""


@dataclass(frozen=True)
class _SACFlags(_Unchecked, SACConfig):
    """Flags of every policy trained with SAC."""


@dataclass(frozen=True)
class TrainCommand(_Unchecked, BridgeFlags, TrainConfig):
    """Train agents in a game, and write a run folder with checkpoints, metrics and a curve.

    Settings come from the scene, then from --config, then from the command line; later ones win.
    --ppo.* and --sac.* set all policies of that algorithm, --policies.NAME.* one policy.
    Ctrl-C saves and stops.

    A game of a legacy bridge takes the settings of the bridge as flags, too, such as
    --action-space "Discrete(2)"; the page "Targets" of the docs lists them.

    Attributes:
        target: What to train in: an example, a project folder, a scene, an exported game, an
            address, or gym:ENV_ID for any Gymnasium environment.
        config: TOML file with settings, or the config.json of a run.
        resume: Folder of a run to continue, with its settings unless others are given.
        explain: Print every setting, its value and where it comes from, and train nothing.
        json: Print the result as one JSON object on stdout.
        layers: What file, resumed run and command line say, earlier ones first.
    """

    target: tyro.conf.Positional[str] = ""
    ppo: _PPOFlags = field(default_factory=_PPOFlags)
    sac: _SACFlags = field(default_factory=_SACFlags)
    policies: Annotated[
        dict[str, Any],
        tyro.conf.arg(help_behavior_hint="--policies.NAME.* sets one policy"),
    ] = field(default_factory=dict[str, Any])
    schedule: tyro.conf.Suppress[tuple[Phase, ...]] = ()
    randomise: tyro.conf.Suppress[dict[str, Parameter]] = field(
        default_factory=dict[str, Parameter]
    )
    curriculum: tyro.conf.Suppress[tuple[Lesson, ...]] = ()
    config: Path | None = None
    resume: Path | None = None
    explain: bool = False
    json: bool = False
    layers: tyro.conf.Suppress[tuple[Layer, ...]] = ()


COMMAND = TrainCommand
Command = TypeVar("Command", bound=TrainCommand)


def parse(arguments: Sequence[str]) -> TrainCommand:
    """Return what was typed, and all layers of settings below it."""
    from ludus.runs.run_folder import RunFolder, stack_layers

    command, typed = parse_settings(arguments, TrainCommand, PROGRAM)
    folder = None if command.resume is None else RunFolder.find(command.resume)
    layers = stack_layers(typed, config=command.config, run=folder)
    return replace(command, resume=None if folder is None else folder.path, layers=layers)


def parse_settings(
    arguments: Sequence[str], kind: type[Command], program: str
) -> tuple[Command, Layer]:
    """Return what was typed, and the layer of its settings.

    Args:
        arguments: What was typed.
        kind: The command: this one, or one that has its flags, too.
        program: Its name.
    """
    arguments, bridge = take_bridge_flags(arguments)
    flags = _flags(arguments)
    policies = {flag.split(".")[1]: _policy_flags() for flag in flags if _is_of_policy(flag)}
    default = kind(policies=policies)
    _check_groups(flags, default)
    command = tyro.cli(
        kind,
        args=["None" if argument == "none" else argument for argument in arguments],  # as in files
        default=default,
        prog=program,
    )
    typed = _typed(command, flags) | ({"bridge": bridge} if bridge else {})
    return command, Layer("command line", typed)


def run(command: TrainCommand) -> int:
    """Train; return 0, or 128 plus the signal that stopped it."""
    from ludus.training.live import reporter_for
    from ludus.training.loop import train

    if command.explain:
        return _explain(command)
    with reporter_for(sys.stderr) as reporter:
        result = train(command.layers, resume=command.resume, reporter=reporter)
    reporter.finished(result)
    if command.json:
        values: dict[str, Any] = asdict(result)
        values = {"run": str(values.pop("path"))} | values
        sys.stdout.write(json.dumps(values) + "\n")
    if result.signum is None:
        return 0
    name = signal.Signals(result.signum).name
    again = f"{PROGRAM} --resume {shlex.quote(str(result.path))}"
    sys.stderr.write(f"stopped by {name} and saved; go on with: {again}\n")
    return 128 + result.signum


def _explain(command: TrainCommand) -> int:
    """Open the game as small as possible, to learn its policies, and print all settings."""
    from ludus.training.loop import open_training_pool

    small = replace(merge(command.layers), num_worlds=1, num_engines=1)
    with open_training_pool(small) as pool:
        rows = resolve(command.layers, pool.policies).rows()
    texts = [(name, "none" if value is None else json.dumps(value), origin)
             for name, value, origin in rows]  # fmt: skip
    widths = [max(len(row[column]) for row in texts) for column in (0, 1)]
    for name, value, origin in texts:
        sys.stdout.write(f"{name:<{widths[0]}}  {value:<{widths[1]}}  {origin}\n")
    return 0


def _flags(arguments: Sequence[str]) -> list[str]:
    """Return the names of the settings whose flags were typed, dots between them and _ for -."""
    words = [word.partition("=")[0] for word in arguments if word.startswith("--")]
    return [word.removeprefix("--").replace("-", "_") for word in words]


def _is_of_policy(flag: str) -> bool:
    return flag.count(".") == 2 and flag.startswith(f"{POLICIES}.")


def _check_groups(flags: Sequence[str], command: TrainCommand) -> None:
    """Refuse unknown settings of a group; tyro has no hint for short ones such as --ppo.lr."""
    for flag in flags:
        group, _, name = flag.rpartition(".")
        holder: Any = command
        for part in group.split("."):
            of_policy = holder is command.policies
            holder = command.policies.get(part) if of_policy else getattr(holder, part, None)
        if not is_dataclass(holder):
            continue
        names = [each.name for each in fields(holder)]
        if name not in names and name.removeprefix("no_") not in names:
            known = [each.replace("_", "-") for each in names]
            name = name.replace("_", "-")
            hint = did_you_mean(name, known, f"settings of --{group}")
            raise ConfigError(f"unknown setting --{group}.{name}", hint)


def _typed(command: TrainCommand, flags: Sequence[str]) -> dict[str, Any]:
    """Return the settings that were typed, as the values of a layer."""
    typed: dict[str, Any] = {"target": command.target} if command.target else {}
    known = get_type_hints(TrainConfig)
    for flag in flags:
        *path, last = flag.split(".")
        holder: Any = command
        values = typed
        if (path or [last])[0].removeprefix("no_") not in known:
            continue  # of the command itself
        for part in path:
            holder = command.policies[part] if holder is command.policies else getattr(holder, part)
            values = values.setdefault(part, {})
        name = last if hasattr(holder, last) else last.removeprefix("no_")
        values[name] = getattr(holder, name)
    return typed


def _policy_flags() -> Any:
    """Return the flags of one policy, whose algorithm only its game may tell."""
    hints: dict[str, list[Any]] = {}
    for of in ALGORITHM_CONFIGS.values():
        for name, hint in get_type_hints(of).items():
            hints.setdefault(name, []).append(hint)
    kind = make_dataclass(
        "PolicyFlags",
        [(name, Union[*of, None], None) for name, of in hints.items()],
        frozen=True,
    )
    return kind()
