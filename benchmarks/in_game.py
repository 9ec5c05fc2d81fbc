"""Measure policies inside real Godot and print the table of docs/in_game.md.

Run on a quiet machine: `python benchmarks/in_game.py [--quick] [--godot3]`.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from ludus.engine import EngineKind, ensure_imported, find_engine, read_project
from ludus.engine.bundled import runnable_bundled_root
from ludus.model import PolicyModel, write_model
from ludus.model.policy_model import (
    Activation,
    Convolution,
    Distribution,
    Gru,
    ImageNetwork,
    Linear,
)
from ludus.spec import DiscreteAction, ObservationEntry

NUM_ACTIONS = 4
HEAD = (
    "| policy | agents | network, µs per agent | with observation and action, µs per agent |\n"
    "|---|---|---|---|"
)


@dataclass(frozen=True)
class Options:
    """What to measure.

    Attributes:
        quick: Short rounds, to see that it works.
        godot3: Godot 3 (docs/godot3.md) instead of Godot 4.
    """

    quick: bool = False
    godot3: bool = False


class Weights:
    """Random arrays of a fixed seed."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng(0)

    def array(self, *shape: int) -> np.ndarray[Any, np.dtype[np.float32]]:
        """Return numbers that keep the next layer's near one."""
        scale = np.sqrt(np.prod(shape[1:]) or 1)
        return (self._rng.standard_normal(shape) / scale).astype(np.float32)

    def layers(self, sizes: tuple[int, ...], activation: Activation) -> tuple[Linear, ...]:
        """Return dense layers, the last without activation."""
        made = [Linear(self.array(b, a), self.array(b), activation) for a, b in pairwise(sizes)]
        return (*made[:-1], Linear(made[-1].weight, made[-1].bias, "none"))

    def gru(self, inputs: int, size: int) -> Gru:
        """Return a memory."""
        rows = 3 * size
        weights = self.array(rows, inputs), self.array(rows, size)
        return Gru(*weights, self.array(rows), self.array(rows))

    def image(self) -> ImageNetwork:
        """Return the network that training builds over 84 × 84 × 1."""
        shapes = [(32, 1, 8, 4), (64, 32, 4, 2), (64, 64, 3, 1)]
        convolutions = tuple(
            Convolution(self.array(n, c, k, k), self.array(n), stride, 0, "relu")
            for n, c, k, stride in shapes
        )
        linear = Linear(self.array(256, 3136), self.array(256), "relu")
        return ImageNetwork("observation", convolutions, linear)


def models() -> dict[str, PolicyModel]:
    """Return what is measured, by name of the file."""
    weights = Weights()
    vector = ObservationEntry("observation", "float32", (32,))
    pixels = ObservationEntry("observation", "uint8", (84, 84, 1))
    sizes = (32, 64, 64, NUM_ACTIONS)

    def model(
        entry: ObservationEntry,
        layers: tuple[Linear, ...],
        images: tuple[ImageNetwork, ...] = (),
        memory: Gru | None = None,
    ) -> PolicyModel:
        return PolicyModel(
            policy="bench",
            fingerprint="",
            observation=(entry,),
            action=(DiscreteAction("action", NUM_ACTIONS),),
            has_action_mask=False,
            normalisation=None,
            images=images,
            memory=memory,
            layers=layers,
            distribution=Distribution(np.zeros(0, np.float32)),
        )

    return {
        "1 MLP 32-64-64-4 tanh": model(vector, weights.layers(sizes, "tanh")),
        "2 MLP 32-64-64-4 relu": model(vector, weights.layers(sizes, "relu")),
        "3 GRU 32-64, then 64-4": model(
            vector, weights.layers((64, NUM_ACTIONS), "tanh"), memory=weights.gru(32, 64)
        ),
        "4 CNN 84×84×1 (Mnih et al. 2015), then 256-64-4": model(
            pixels, weights.layers((256, 64, NUM_ACTIONS), "relu"), images=(weights.image(),)
        ),
    }


def measure(folder: Path, options: Options) -> list[dict[str, Any]]:
    """Run the engine and return its lines."""
    kind = EngineKind.GODOT3 if options.godot3 else EngineKind.GODOT4
    engine = find_engine(kind)
    project = read_project(runnable_bundled_root(kind))
    ensure_imported(engine, project)
    script = Path(__file__).with_name("in_game3.gd" if options.godot3 else "in_game.gd")
    display = "--no-window" if options.godot3 else "--headless"
    command = [str(engine.executable(headless=True)), display, "--path", str(project.root)]
    budget_us = 50_000 if options.quick else 2_000_000
    user_args = ["--", f"--models={folder}", f"--budget-us={budget_us}"]
    done = subprocess.run(
        [*command, "-s", str(script), *user_args], capture_output=True, text=True, check=True
    )
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def main(options: Options) -> None:
    """Measure all policies and print the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title, model in models().items():
            write_model(folder / f"{title}.json", model)
        print(HEAD)
        for line in measure(folder, options):
            title = line["file"][2:].removesuffix(".json")
            figures = f"{line['network_us']:.1f} | {line['all_us']:.1f}"
            print(f"| {title} | {line['agents']} | {figures} |", flush=True)


if __name__ == "__main__":
    main(tyro.cli(Options))
