"""``python -m tests.campaign``: rounds of random faults until the time is over.

A finding prints the promise that was broken, what was decided in its round, and the command that
plays this round again.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import random
import shutil
import sys
import time
import traceback
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from ludus.engine import EngineKind, find_engine
from ludus.engine.bevy_build import build_bevy_example
from ludus.errors import LudusError
from tests.campaign.faults import FAULTS
from tests.campaign.faults.full_disk import can_mount
from tests.campaign.rounds import Finding, Round, campaign_folder
from tests.campaign.trainer import preload

ENGINES = ("godot4", "godot3", "bevy")
MAX_FINDINGS = 10
NEEDS_RAY = {"nodes"}
NEEDS_GAME = {"kill-with-game", "kill-engine", "stop", "stop-engine", "lies", "policies"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Play rounds; return 1 if a promise was broken."""
    options = _parse(arguments)
    folder = campaign_folder()
    wanted = set(options.faults) or set(FAULTS)
    engines = [name for name in options.engines if name != "gym" and wanted & NEEDS_GAME]
    targets, left_out = find_targets(engines, folder)
    faults = _choose_faults(options.faults, targets)
    left_out += [f"{name}: Ray is not installed" for name in NEEDS_RAY - set(faults) & wanted]
    for reason in left_out:
        _say(f"left out: {reason}")
    if not can_mount():
        _say("no file system can be mounted here; full disks are limits of file sizes")
    preload()
    numbers = [options.round] if options.round is not None else range(1 << 62)
    counts: Counter[str] = Counter()
    findings: list[str] = []
    end = time.monotonic() + 60.0 * options.minutes
    for number in numbers:
        if time.monotonic() > end or len(findings) == MAX_FINDINGS:
            break
        one = play(
            options.seed, number, faults, targets, folder, is_verbose=options.round is not None
        )
        counts += one[0]
        if one[1]:
            findings.append(one[1])
            again = f"--seed {options.seed} --round {number} --engines {','.join(targets)}"
            again += f" --faults {','.join(faults)}" if options.faults else ""
            _say(f"FINDING in round {number}: {one[1]}\nagain: python -m tests.campaign {again}")
    _say(", ".join(f"{count:,} {what}" for what, count in sorted(counts.items())))
    if options.totals:
        _add_to(options.totals, {"seed": options.seed, "findings": len(findings), **counts})
    if findings:
        _say(f"{len(findings)} findings; the folders of their rounds are in {folder}")
    else:
        shutil.rmtree(folder)
    return 1 if findings else 0


def play(
    seed: int,
    number: int,
    faults: Sequence[str],
    targets: dict[str, str],
    folder: Path,
    *,
    is_verbose: bool = False,
) -> tuple[Counter[str], str]:
    """Play one round.

    Returns:
        What happened in it, and the finding; an empty text without one.
    """
    fault = draw_fault(seed, number, faults)
    the_round = Round(seed, number, targets, folder)
    finding = ""
    started = time.monotonic()
    try:
        FAULTS[fault][1](the_round)
    except Finding as broken:
        finding = str(broken)
    except Exception:  # of the campaign itself, or of a promise that cannot even be checked
        finding = traceback.format_exc()
    finally:
        the_round.close(keep=bool(finding))
    decided = "; ".join(the_round.decisions)
    if is_verbose:
        _say(f"{fault} ({time.monotonic() - started:.1f} s): {decided}")
    if finding:
        finding = f"{fault}: {decided}\n{finding}"
    return the_round.counts + Counter({"rounds": 1}), finding


def draw_fault(seed: int, number: int, faults: Sequence[str]) -> str:
    """Return the fault of a round."""
    weights = [FAULTS[fault][0] for fault in faults]
    return random.Random(f"fault {seed}/{number}").choices(faults, weights)[0]


def find_targets(engines: Sequence[str], folder: Path) -> tuple[dict[str, str], list[str]]:
    """Return what trainers train in, by engine, and which engines are missing, and why."""
    targets = {"gym": "gym:CartPole-v1"}
    left_out: list[str] = []
    for name in engines:
        try:
            targets.setdefault(name, _find_target(name, folder))
        except (LudusError, ValueError) as error:
            left_out.append(f"{name}: {error}")
    return targets, left_out


def _find_target(engine: str, folder: Path) -> str:
    if engine != "bevy":
        find_engine(EngineKind(engine))
        return f"{engine}:cartpole"
    # Where `make` builds; from another checkout, or while that one is built, it may be replaced.
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    os.environ.setdefault("CARGO_TARGET_DIR", str(cache / "ludus" / "cargo"))
    return str(shutil.copy2(build_bevy_example("cartpole"), folder / "bevy-cartpole"))


def _choose_faults(wanted: Sequence[str], targets: dict[str, str]) -> list[str]:
    if unknown := set(wanted) - FAULTS.keys():
        raise SystemExit(f"there is no fault {unknown.pop()}; faults: {', '.join(FAULTS)}")
    has_game = any(engine in targets for engine in ENGINES)
    missing = {
        *(() if has_game else NEEDS_GAME),
        *(() if importlib.util.find_spec("ray") else NEEDS_RAY),
    }
    return [name for name in wanted or FAULTS if name not in missing]


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    def split(text: str) -> list[str]:
        return [part for part in text.split(",") if part]

    parser = argparse.ArgumentParser(prog="python -m tests.campaign", description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0, help="begin no round after that")
    parser.add_argument("--seed", type=int, default=0, help="of everything that is drawn")
    parser.add_argument("--round", type=int, help="play this one only, and say what it decides")
    parser.add_argument("--faults", type=split, default=[], help="only these: kill,damage,…")
    parser.add_argument("--engines", type=split, default=list(ENGINES), help="only these games")
    parser.add_argument("--totals", type=Path, help="file that gets a line with the sums")
    return parser.parse_args(arguments)


def _add_to(path: Path, values: dict[str, int]) -> None:
    with path.open("a") as file:
        file.write(json.dumps(values) + "\n")


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
