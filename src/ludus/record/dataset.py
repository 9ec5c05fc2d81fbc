"""Minari datasets: every step of complete episodes, played by a policy, a person or at random."""

from __future__ import annotations

import importlib
import re
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from ludus.datasets import dataset_names, require_minari
from ludus.errors import ConfigError, EngineCrashed, RunError, TargetError
from ludus.play.evaluation import MAX_STEPS
from ludus.play.hand import hand_player
from ludus.play.interactive import CLOSED_BY_HAND, require_screen
from ludus.play.players import Act
from ludus.play.quota import Quota
from ludus.pool import PoolConfig, open_pool
from ludus.pool.interface import Pool
from ludus.record.recording import RecordConfig, check_players, make_player, with_run
from ludus.session import LaunchOptions
from ludus.spec import PolicySpec
from ludus.spec.batch import ActionBatch, Batch
from ludus.spec.spaces import action_space, actions_of, observation_of, observation_space
from ludus.target import Legacy, check_accepted, parse_target
from ludus.version import __version__

__all__ = ["RecordedDataset", "record_dataset"]

NUM_EPISODES = 10
"""Of each policy, unless told otherwise."""


@dataclass(frozen=True)
class RecordedDataset:
    """A dataset that was written.

    Attributes:
        name: What ``minari.load_dataset`` takes.
        policy: Whose episodes.
        num_episodes: How many.
        num_steps: Steps in sum.
    """

    name: str
    policy: str
    num_episodes: int
    num_steps: int


def record_dataset(config: RecordConfig) -> list[RecordedDataset]:
    """Play complete episodes and write them as a Minari dataset for each policy.

    Observations, images too, are stored without loss. With several policies the name of each is
    put before the version: ``tag/play-v0`` becomes ``tag/play-chaser-v0``. A person plays where
    neither a policy nor random play was asked for; the window's end ends the dataset.

    Raises:
        SetupError: Minari or h5py is missing, or a person has no screen.
        ConfigError: The name is not one, is taken, or settings contradict each other.
        TargetError: The target cannot be run.
        EngineError: The game failed; nothing is written.
        RunError: Episodes don't end, or the dataset cannot be written.
    """
    minari = require_minari()
    config = with_run(config)
    check_players(config)
    assert config.dataset is not None
    is_by_hand = not (config.policy or config.is_random)
    target = parse_target(config.target, scene=config.scene, godot=config.godot)
    check_accepted("record", target)
    if is_by_hand and isinstance(target, Legacy):
        raise TargetError(
            f"nobody can play {target.name} by hand while its steps are recorded",
            hint="use --policy or --random",
        )
    if is_by_hand:
        require_screen()
    launch = LaunchOptions(is_windowed=is_by_hand, is_real_time=is_by_hand)
    with open_pool(target, PoolConfig.of(config, launch=launch, is_pinned=not is_by_hand)) as pool:
        names = dataset_names(config.dataset, pool.policies)
        _require_free(minari, names.values())
        act = hand_player(pool) if is_by_hand else make_player(config)(pool)
        num_wanted = config.num_episodes or NUM_EPISODES
        recorders = {
            name: _Recorder(spec, pool.num_agents(name), num_wanted)
            for name, spec in pool.policies.items()
        }
        patience = None if is_by_hand else MAX_STEPS
        try:
            _play(pool, act, recorders, seed=config.seed, patience=patience)
        except EngineCrashed as error:
            if not is_by_hand or error.process_exit_code != CLOSED_BY_HAND:
                raise
        specs = dict(pool.policies)
    return [
        _write(minari, names[name], config, specs[name], recorder)
        for name, recorder in recorders.items()
    ]


def _play(
    pool: Pool,
    act: Act,
    recorders: Mapping[str, _Recorder],
    *,
    seed: int,
    patience: int | None,
) -> None:
    """Play until all episodes have been recorded.

    Raises:
        RunError: ``patience`` steps one after another ended no episode that was wanted.
    """
    batches = pool.reset(seed)
    for name, recorder in recorders.items():
        recorder.begin(batches[name])
    while not all(recorder.is_complete for recorder in recorders.values()):
        actions = act(batches)
        batches = pool.step(actions)
        for name, recorder in recorders.items():
            recorder.record(actions[name], batches[name])
            if not recorder.is_complete and recorder.num_steps_waited == patience:
                raise RunError(
                    f"policy {name}: {len(recorder.episodes)} of {recorder.num_wanted} episodes "
                    f"ended, and none in the last {patience} steps",
                    "set max_episode_steps, in the game or with --max-episode-steps",
                )


class _Recorder:
    """Keeps the steps of every slot of one policy until its episode ends.

    Attributes:
        episodes: Those that ended and count, as Minari has them.
        num_wanted: How many there shall be.
        num_steps_waited: Steps since the last of them.
    """

    def __init__(self, spec: PolicySpec, num_slots: int, num_wanted: int) -> None:
        self.episodes: list[dict[str, Any]] = []
        self.num_wanted = num_wanted
        self.num_steps_waited = 0
        self._spec = spec
        self._steps: list[list[_Step]] = [[] for _ in range(num_slots)]
        self._batch: Batch | None = None
        self._quota: Quota | None = None

    @property
    def is_complete(self) -> bool:
        """Whether there are as many episodes as were asked for."""
        return self._quota is not None and self._quota.is_met

    def begin(self, batch: Batch) -> None:
        """Take the first observations."""
        self._batch = batch
        self._quota = Quota(batch, self.num_wanted)

    def record(self, actions: ActionBatch, batch: Batch) -> None:
        """Take actions and what came of them."""
        before, quota = self._batch, self._quota
        assert before is not None
        assert quota is not None
        self._batch = batch
        self.num_steps_waited += 1
        acted = before.active.nonzero()[0]
        for slot in acted.tolist():
            if quota.wants(slot):
                self._steps[slot].append(_Step(before, actions, batch, slot))
        ended = acted[batch.terminated[acted] | batch.truncated[acted]]
        finals = {int(slot): row for row, slot in enumerate(batch.final_index)}
        for slot in ended[quota.take(ended)].tolist():
            self._end(slot, {
                name: values[finals[slot]].copy()
                for name, values in batch.final_observation.items()
            })  # fmt: skip
            self.num_steps_waited = 0

    def _end(self, slot: int, final: Mapping[str, NDArray[Any]]) -> None:
        steps, self._steps[slot] = self._steps[slot], []
        entries = {
            name: np.stack([*(step.observation[name] for step in steps), values])
            for name, values in final.items()
        }
        discrete = np.stack([step.discrete for step in steps])
        continuous = np.stack([step.continuous for step in steps])
        infos = None
        if steps[0].mask is not None:
            masks = [step.mask for step in steps if step.mask is not None]
            infos = {"action_mask": np.stack([*masks, np.ones_like(masks[-1])])}
        self.episodes.append({
            "observations": observation_of(self._spec, entries),
            "actions": actions_of(self._spec, ActionBatch(discrete, continuous)),
            "rewards": [step.reward for step in steps],
            "terminations": [step.terminated for step in steps],
            "truncations": [step.truncated for step in steps],
            "infos": infos,
        })  # fmt: skip


class _Step:
    """One step of one slot; copies."""

    def __init__(self, before: Batch, actions: ActionBatch, after: Batch, slot: int) -> None:
        self.observation = {name: part[slot].copy() for name, part in before.observation.items()}
        mask = before.action_mask
        self.mask = None if mask is None else mask[slot].copy()
        self.discrete = actions.discrete[slot].copy()
        self.continuous = actions.continuous[slot].copy()
        self.reward = float(after.reward[slot])
        self.terminated = bool(after.terminated[slot])
        self.truncated = bool(after.truncated[slot])


def _require_free(minari: Any, names: Iterable[str]) -> None:
    taken = minari.list_local_datasets()
    for name in names:
        if name in taken:
            raise ConfigError(
                f"the dataset {name} exists already",
                f"choose another version, or remove it: minari delete {name}",
            )


def _write(
    minari: Any, name: str, config: RecordConfig, spec: PolicySpec, recorder: _Recorder
) -> RecordedDataset:
    if not recorder.episodes:
        raise RunError(
            f"policy {spec.name}: no episode has ended, so there is nothing to write",
            "set max_episode_steps, or play an episode to its end",
        )
    collector: Any = importlib.import_module("minari.data_collector")
    buffers = [
        collector.EpisodeBuffer(id=number, **one) for number, one in enumerate(recorder.episodes)
    ]
    who = "random play" if config.is_random else "a person"
    if config.policy:
        who = ", ".join(str(path) for path in config.policy)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about authors and addresses that are not known here
            minari.create_dataset_from_buffers(
                name,
                buffers,
                env=_Described(config, spec),
                algorithm_name=who,
                description=f"Policy {spec.name} of {config.target}, by Ludus {__version__}.",
                data_format="hdf5",
                jpeg_encoding=False,
            )
    except (OSError, ValueError, AssertionError) as error:
        raise RunError(f"cannot write the dataset {name}: {error}") from error
    num_steps = sum(len(one["rewards"]) for one in recorder.episodes)
    return RecordedDataset(name, spec.name, len(buffers), num_steps)


class _Described(gymnasium.Env[Any, Any]):
    """Tells Minari of an environment without starting it: its spaces, and how it is made."""

    def __init__(self, config: RecordConfig, spec: PolicySpec) -> None:
        self.observation_space = observation_space(spec)
        self.action_space = action_space(spec)
        path = Path(config.target)
        settings = {
            "target": str(path.resolve()) if path.exists() else config.target,
            "policy": spec.name,
            "scene": None if config.scene is None else str(config.scene),
            "layout": config.layout,
            "ticks_per_step": config.ticks_per_step,
            "max_episode_steps": config.max_episode_steps,
        }
        stem = re.sub(r"[^\w-]+", "-", path.stem).strip("-") or "game"
        self.spec = EnvSpec(
            id=f"ludus/{stem}-v0",
            entry_point="ludus.libraries:make",
            kwargs={name: value for name, value in settings.items() if value is not None},
            disable_env_checker=True,
        )
