"""What a cluster costs, how far it scales, and how much one learner takes in; all need Ray.

    make test-cluster                                        # brings the environment
    PYTHON=.venv/libraries/all/bin/python
    $PYTHON benchmarks/cluster.py overhead                   # one Ray worker, no cluster, in turns
    $PYTHON benchmarks/cluster.py scaling                    # a game that sleeps, 1 to 32 workers
    $PYTHON benchmarks/cluster.py scaling --game godot
    $PYTHON benchmarks/cluster.py learner                    # workers that replay one rollout
    $PYTHON benchmarks/cluster.py rllib                      # RLlib with as many workers

Each prints a table. They need a quiet machine; the first seconds of each run do not count.
"""

from __future__ import annotations

import warnings
from typing import Annotated

import tyro
from cluster_learner import Learner, measure_learner
from cluster_overhead import Overhead, measure_overhead
from cluster_rllib import RLlib, measure_rllib
from cluster_scaling import Scaling, measure_scaling


def main(
    options: Annotated[Overhead, tyro.conf.subcommand("overhead")]
    | Annotated[Scaling, tyro.conf.subcommand("scaling")]
    | Annotated[Learner, tyro.conf.subcommand("learner")]
    | Annotated[RLlib, tyro.conf.subcommand("rllib")],
) -> None:
    """Measure what the command line says."""
    warnings.simplefilter("ignore")
    match options:
        case Overhead():
            measure_overhead(options)
        case Scaling():
            measure_scaling(options)
        case Learner():
            measure_learner(options)
        case RLlib():
            measure_rllib(options)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes))
