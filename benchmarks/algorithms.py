"""Compare PPO and SAC with Stable-Baselines3: same tasks, same hyperparameters, one process.

Stable-Baselines3 and MuJoCo are no dependencies of Ludus. Put them beside it, with the PyTorch and
Gymnasium that Ludus uses::

    uv pip install --target /tmp/sb3 --no-deps "stable-baselines3>=2,<3" pandas python-dateutil \
        pytz six mujoco mujoco-core etils absl-py glfw pyopengl fsspec importlib_resources zipp
    PYTHONPATH=/tmp/sb3 python benchmarks/algorithms.py speed
    PYTHONPATH=/tmp/sb3 python benchmarks/algorithms.py curves --task pendulum-sac --seeds 5

``speed`` needs a quiet machine; ours and theirs take turns, and medians count.
"""

from __future__ import annotations

import warnings
from typing import Annotated

import tyro
from algorithms_curves import Curves, measure_curves
from algorithms_speed import Speed, measure_speed


def main(
    options: Annotated[Speed, tyro.conf.subcommand("speed")]
    | Annotated[Curves, tyro.conf.subcommand("curves")],
) -> None:
    """Measure what the command line says."""
    warnings.filterwarnings("ignore", module="stable_baselines3")
    if isinstance(options, Speed):
        measure_speed(options)
    else:
        measure_curves(options)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes))
