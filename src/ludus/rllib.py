"""Games in RLlib (Ray's new API stack): an environment, and a runner that fills it fast.

>>> from ray.rllib.algorithms.ppo import PPOConfig
>>> import ludus.rllib
>>> config = (                                                          # doctest: +SKIP
...     PPOConfig()
...     .environment(ludus.rllib.LudusMultiAgentEnv, env_config={"target": "tag"})
...     .env_runners(env_runner_cls=ludus.rllib.LudusEnvRunner, num_envs_per_env_runner=64)
...     .multi_agent(policies={"chaser", "runner"}, policy_mapping_fn=ludus.rllib.policy_of)
... )
"""

# Ray's types are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownParameterType=false

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.errors import UsageError
from ludus.extras import missing_extra
from ludus.libraries.making import open_game
from ludus.pool import EnginePool
from ludus.spec import PolicySpec
from ludus.spec.batch import ActionBatch, Batches
from ludus.spec.spaces import action_space, observation_of, observation_space, to_action_batch

if TYPE_CHECKING:  # Ray declares other types than it takes
    import torch

    from ludus.pettingzoo import LudusParallelEnv, parallel_env

    class MultiAgentEnv(Any): ...

    class MultiAgentEnvRunner(Any): ...

    class SingleAgentEpisode(Any): ...

    Columns: Any
    NUM_AGENT_STEPS_SAMPLED: Any
    NUM_AGENT_STEPS_SAMPLED_LIFETIME: Any
    NUM_ENV_STEPS_SAMPLED: Any
    NUM_ENV_STEPS_SAMPLED_LIFETIME: Any
    NUM_EPISODES: Any
    NUM_EPISODES_LIFETIME: Any
    NUM_MODULE_STEPS_SAMPLED: Any
    NUM_MODULE_STEPS_SAMPLED_LIFETIME: Any
    SAMPLE_TIMER: Any
    WEIGHTS_SEQ_NO: Any
else:
    try:
        import torch
        from ray.rllib.core.columns import Columns
        from ray.rllib.env.multi_agent_env import MultiAgentEnv
        from ray.rllib.env.multi_agent_env_runner import MultiAgentEnvRunner
        from ray.rllib.env.single_agent_episode import SingleAgentEpisode
        from ray.rllib.utils.metrics import (
            NUM_AGENT_STEPS_SAMPLED,
            NUM_AGENT_STEPS_SAMPLED_LIFETIME,
            NUM_ENV_STEPS_SAMPLED,
            NUM_ENV_STEPS_SAMPLED_LIFETIME,
            NUM_EPISODES,
            NUM_EPISODES_LIFETIME,
            NUM_MODULE_STEPS_SAMPLED,
            NUM_MODULE_STEPS_SAMPLED_LIFETIME,
            SAMPLE_TIMER,
            WEIGHTS_SEQ_NO,
        )

        from ludus.pettingzoo import LudusParallelEnv, parallel_env
    except ImportError as error:
        raise missing_extra("ray[rllib]", "rllib") from error

__all__ = ["LudusEnvRunner", "LudusMultiAgentEnv", "policy_of"]


def policy_of(agent_id: str, episode: Any = None, **_: Any) -> str:
    """Map an agent to the module with the name of its policy: a ``policy_mapping_fn``."""
    return agent_id.rpartition("_")[0]


class LudusMultiAgentEnv(MultiAgentEnv):
    """One world with all of its agents, as :class:`ludus.pettingzoo.LudusParallelEnv` has them.

    Args:
        config: ``{"target": …}`` and settings of :func:`ludus.make`.
    """

    def __init__(self, config: Mapping[str, Any]) -> None:
        settings = dict(config)
        self.game: LudusParallelEnv = parallel_env(settings.pop("target"), **settings)
        self.possible_agents = self.game.possible_agents
        self.agents = []
        self.observation_spaces = self.game.observation_spaces
        self.action_spaces = self.game.action_spaces
        super().__init__()

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
        """Begin an episode of the world."""
        answer = self.game.reset(seed, options)
        self.agents = list(self.game.agents)
        return answer

    def step(self, action_dict: dict[str, Any]) -> tuple[Any, ...]:
        """Act once; ``"__all__"`` is true when no agent is left."""
        observations, rewards, terminated, truncated, infos = self.game.step(action_dict)
        self.agents = list(self.game.agents)
        is_over = not self.agents
        terminated["__all__"] = is_over and not any(truncated.values())
        truncated["__all__"] = is_over and any(truncated.values())
        return observations, rewards, terminated, truncated, infos

    def render(self) -> Any:
        """Return a picture; see :meth:`ludus.LudusEnv.render`."""
        return self.game.render()

    def close(self) -> None:
        """End the engine."""
        self.game.close()


@dataclass
class _Group:
    """Agents of one policy that one module acts for: rows of the policy's batch."""

    policy: PolicySpec
    module_id: str
    rows: NDArray[np.int64]
    agents: list[str]
    worlds: NDArray[np.int64]


@dataclass
class _Fragment:
    """What a group saw and did, a list element for each step; arrays ``[rows, …]``."""

    observations: list[Any] = field(default_factory=list[Any])
    actions: list[Any] = field(default_factory=list[Any])
    inputs: list[Any] = field(default_factory=list[Any])
    logps: list[Any] = field(default_factory=list[Any])
    rewards: list[Any] = field(default_factory=list[Any])
    terminated: list[Any] = field(default_factory=list[Any])
    truncated: list[Any] = field(default_factory=list[Any])
    active: list[Any] = field(default_factory=list[Any])
    finals: dict[tuple[int, int], Any] = field(default_factory=dict[tuple[int, int], Any])


class _Worlds:
    """What RLlib asks of the environment of a runner."""

    def __init__(self, pool: EnginePool) -> None:
        self.pool = pool
        self.num_envs = pool.num_worlds
        self.envs = [self]
        slots = [
            (f"{name}_{slot}", policy)
            for name, policy in pool.policies.items()
            for slot in range(policy.agents_per_world)
        ]
        self.possible_agents = [agent for agent, _ in slots]
        observations = {agent: observation_space(policy) for agent, policy in slots}
        self.single_observation_space = self.observation_space = spaces.Dict(observations)
        actions = {agent: action_space(policy) for agent, policy in slots}
        self.single_action_space = self.action_space = spaces.Dict(actions)

    @property
    def unwrapped(self) -> _Worlds:
        return self

    def get_observation_space(self, agent: str) -> spaces.Space[Any]:
        return self.observation_space[agent]

    def get_action_space(self, agent: str) -> spaces.Space[Any]:
        return self.action_space[agent]

    def close(self) -> None:
        self.pool.close()


class LudusEnvRunner(MultiAgentEnvRunner):
    """Steps many worlds at once, and hands over ready episodes.

    RLlib's own runner loops over agents and environments in Python, in dictionaries. This one asks
    each module once a step for all of its agents, and makes episodes of arrays at the end of a
    fragment. ``num_envs_per_env_runner`` is the number of worlds in each engine;
    ``env_config`` holds ``"target"``, maybe ``"num_engines"``, and settings of
    :func:`ludus.make_vec`. A step of all agents of one world is one env step.

    It needs modules without memory, observations that are one array, and policies without action
    masks; connectors between environment and module of one's own, and callbacks of single steps and
    episodes, are not called.

    Raises:
        UsageError: One of these is asked for.
    """

    env: Any  # None before make_env

    def make_env(self) -> None:
        """Start the engines."""
        if self.env is not None:
            self.env.close()
        settings = dict(self.config.env_config)
        self.num_envs = self.config.num_envs_per_env_runner
        settings.setdefault("num_worlds", self.num_envs)
        pool, _ = open_game("make_vec", settings.pop("target"), settings, None)
        self.env = _Worlds(pool)
        self.num_envs = pool.num_worlds
        self._check_config(pool)
        self._groups = self._group(pool)
        self._batches: Batches = {}
        self._needs_initial_reset = True

    def sample(
        self,
        *,
        num_timesteps: int | None = None,
        num_episodes: int | None = None,
        explore: bool | None = None,
        random_actions: bool = False,
        force_reset: bool = False,
    ) -> list[SingleAgentEpisode]:
        """Play, and return the episodes of single agents, whole ones and pieces.

        Args:
            num_timesteps: Env steps at least; by default a fragment, as the configuration says.
            num_episodes: Agents' episodes at least, from a reset on, whole ones only.
            explore: Whether actions are drawn; by default as the configuration says.
            random_actions: Draw them from the action space.
            force_reset: Begin new episodes first.
        """
        explore = bool(self.config.explore) if explore is None else explore
        self.metrics.log_value(WEIGHTS_SEQ_NO, self._weights_seq_no, window=1)
        if num_episodes is None and self.config.batch_mode == "complete_episodes":
            num_episodes = self.num_envs
        if num_episodes is None and num_timesteps is None:
            num_timesteps = self.num_envs * self.config.get_rollout_fragment_length(
                self.worker_index or 0
            )
        with self.metrics.log_time(SAMPLE_TIMER):
            if force_reset or num_episodes is not None or self._needs_initial_reset:
                self._begin()
            fragments = [_Fragment() for _ in self._groups]
            num_steps = num_ended = 0
            while (
                num_ended < num_episodes
                if num_episodes is not None
                else num_steps * self.num_envs < (num_timesteps or 0)
            ):
                num_ended += self._step(fragments, explore, random_actions)
                num_steps += 1
            self._needs_initial_reset = num_episodes is not None
            episodes = self._build(fragments, only_whole=num_episodes is not None)
        self._log_steps(num_steps, fragments)
        return episodes

    def get_metrics(self) -> Any:
        """Return the metrics since the last call."""
        return self.metrics.reduce()

    def _check_config(self, pool: EnginePool) -> None:
        for policy in pool.policies.values():
            if isinstance(observation_space(policy), spaces.Dict):
                names = ", ".join(entry.name for entry in policy.observation)
                raise UsageError(
                    f"policy {policy.name!r} observes several arrays ({names}), and LudusEnvRunner "
                    "gives modules one",
                    hint="put them into one entry called observation; or use RLlib's own runner "
                    "with LudusMultiAgentEnv and the connector FlattenObservations",
                )
            if policy.has_action_mask:
                raise UsageError(
                    f"policy {policy.name!r} has action masks, and LudusEnvRunner gives modules "
                    "none",
                    hint="use RLlib's own runner with LudusMultiAgentEnv and a module that masks "
                    "like ActionMaskingTorchRLModule of RLlib's examples (docs/libraries/rllib.md)",
                )
        if self.config._env_to_module_connector or self.config._module_to_env_connector:
            raise UsageError(
                "LudusEnvRunner calls no connectors between environment and module",
                hint="use RLlib's own runner with LudusMultiAgentEnv",
            )

    def _group(self, pool: EnginePool) -> list[_Group]:
        """Divide the rows of all policies among the modules."""
        groups: list[_Group] = []
        for name, policy in pool.policies.items():
            size = policy.agents_per_world
            agents = [f"{name}_{slot}" for slot in range(size)] * pool.num_worlds
            modules = [self.config.policy_mapping_fn(agent, None) for agent in agents[:size]]
            by_row = np.array(modules * pool.num_worlds)
            for module_id in dict.fromkeys(modules):
                rows = np.flatnonzero(by_row == module_id)
                own = [agents[row] for row in rows]
                groups.append(_Group(policy, module_id, rows, own, rows // size))
        return groups

    def _begin(self) -> None:
        if self.module is not None and self.module.is_stateful():
            raise UsageError(
                "LudusEnvRunner has no place for the state of a module",
                hint="use RLlib's own runner with LudusMultiAgentEnv; or `ludus train`",
            )
        is_first = not self._batches
        self._batches = self.env.pool.reset(self._seed if is_first else None)
        count = itertools.count(1 if is_first else self._next_id)
        self._ids = [[next(count) for _ in group.rows] for group in self._groups]
        self._next_id = next(count)
        self._started = [np.zeros(len(group.rows), np.int64) for group in self._groups]
        self._returns = [np.zeros(len(group.rows)) for group in self._groups]

    def _step(self, fragments: list[_Fragment], explore: bool, random_actions: bool) -> int:
        """Play one step of all worlds; return how many episodes of agents have ended."""
        actions = {
            name: ActionBatch.zeros(policy, self.env.pool.num_agents(name))
            for name, policy in self.env.pool.policies.items()
        }
        for group, fragment in zip(self._groups, fragments, strict=True):
            batch = self._batches[group.policy.name]
            seen = _array_of(group.policy, batch.observation)[group.rows]
            chosen, inputs, logps = self._act(group, seen, explore, random_actions)
            own = to_action_batch(group.policy, self._for_env(group, chosen), len(group.rows))
            actions[group.policy.name].discrete[group.rows] = own.discrete
            actions[group.policy.name].continuous[group.rows] = own.continuous
            fragment.observations.append(seen)
            fragment.actions.append(chosen)
            fragment.inputs.append(inputs)
            fragment.logps.append(logps)
            fragment.active.append(batch.active[group.rows])
        self._batches = self.env.pool.step(actions)
        return sum(
            self._take(group, fragment)
            for group, fragment in zip(self._groups, fragments, strict=True)
        )

    def _act(
        self, group: _Group, seen: NDArray[Any], explore: bool, random_actions: bool
    ) -> tuple[NDArray[Any], NDArray[Any] | None, NDArray[Any] | None]:
        """Return actions, the inputs of their distribution, and their log probabilities."""
        if random_actions or self.module is None:
            space = action_space(group.policy)
            return np.stack([space.sample() for _ in group.rows]), None, None
        module = self.module[group.module_id]
        forward = module.forward_exploration if explore else module.forward_inference
        with torch.inference_mode():
            inputs = forward({Columns.OBS: torch.as_tensor(seen, device=self._device)})[
                Columns.ACTION_DIST_INPUTS
            ]
            if explore:
                distribution = module.get_exploration_action_dist_cls().from_logits(inputs)
            else:
                kind = module.get_inference_action_dist_cls()
                distribution = kind.from_logits(inputs).to_deterministic()
            chosen = distribution.sample()
            logps = distribution.logp(chosen).cpu().numpy() if explore else None
        return chosen.cpu().numpy(), inputs.cpu().numpy(), logps

    def _for_env(self, group: _Group, actions: NDArray[Any]) -> NDArray[Any]:
        """Stretch or cut numbers to the bounds of the game, as the configuration says."""
        if not group.policy.continuous_size:
            return actions
        low, high = group.policy.continuous_bounds()
        if self.config.normalize_actions:
            actions = low + (actions + 1.0) * (high - low) / 2.0
        return np.clip(actions, low, high)

    def _take(self, group: _Group, fragment: _Fragment) -> int:
        """Keep what came of a group's actions; return how many of its episodes have ended."""
        batch, rows = self._batches[group.policy.name], group.rows
        terminated, truncated = batch.terminated[rows], batch.truncated[rows]
        fragment.rewards.append(batch.reward[rows])
        fragment.terminated.append(terminated)
        fragment.truncated.append(truncated)
        ended = (terminated | truncated) & fragment.active[-1]
        if not ended.any():
            return 0
        step = len(fragment.rewards) - 1
        place = np.searchsorted(batch.final_index, rows)
        final = _array_of(group.policy, batch.final_observation)
        for row in ended.nonzero()[0]:
            fragment.finals[step, int(row)] = final[place[row]]
        return int(ended.sum())

    def _build(self, fragments: list[_Fragment], *, only_whole: bool) -> list[SingleAgentEpisode]:
        episodes: list[SingleAgentEpisode] = []
        for index, (group, fragment) in enumerate(zip(self._groups, fragments, strict=True)):
            if fragment.rewards:
                episodes += self._build_group(index, group, fragment, only_whole)
        return episodes

    def _build_group(
        self, index: int, group: _Group, fragment: _Fragment, only_whole: bool
    ) -> list[SingleAgentEpisode]:
        last = _array_of(group.policy, self._batches[group.policy.name].observation)
        arrays = {
            "observations": np.stack([*fragment.observations, last[group.rows]]),
            "actions": np.stack(fragment.actions),
            "rewards": np.stack(fragment.rewards),
        }
        outputs = {
            name: np.stack(parts)
            for name, parts in (
                (Columns.ACTION_DIST_INPUTS, fragment.inputs),
                (Columns.ACTION_LOGP, fragment.logps),
            )
            if parts[0] is not None
        }
        active = np.stack(fragment.active)
        terminated, truncated = np.stack(fragment.terminated), np.stack(fragment.truncated)
        episodes: list[SingleAgentEpisode] = []
        for row in range(len(group.rows)):
            for start, end in _pieces(active[:, row], (terminated | truncated)[:, row]):
                is_terminated = bool(terminated[end - 1, row])
                is_truncated = bool(truncated[end - 1, row]) and not is_terminated
                is_whole = is_terminated or is_truncated
                seen = arrays["observations"][start : end + 1, row].copy()
                if is_whole:
                    seen[-1] = fragment.finals[end - 1, row]
                rewards = arrays["rewards"][start:end, row]
                name = f"{self.worker_index or 0}-{index}-{self._ids[index][row]}"
                episode = SingleAgentEpisode(
                    name,
                    observations=seen,
                    actions=arrays["actions"][start:end, row],
                    rewards=rewards,
                    infos=[{}] * (end - start + 1),
                    terminated=is_terminated,
                    truncated=is_truncated,
                    extra_model_outputs={
                        name: values[start:end, row] for name, values in outputs.items()
                    },
                    t_started=int(self._started[index][row]),
                    len_lookback_buffer=0,
                    agent_id=group.agents[row],
                    module_id=group.module_id,
                    multi_agent_episode_id=name,
                )
                self._started[index][row] += end - start
                self._returns[index][row] += float(rewards.sum())
                if is_whole:
                    self._log_episode(index, group, row)
                if is_whole or not only_whole:
                    episodes.append(episode)
        return episodes

    def _log_episode(self, index: int, group: _Group, row: int) -> None:
        """Log one agent's episode that has ended, and begin to count the next one."""
        length, total = int(self._started[index][row]), float(self._returns[index][row])
        agent = group.agents[row]
        self._log_episode_metrics(
            length, total, 0.0, {agent: total}, {group.module_id: total}, {agent: length}
        )
        self.metrics.log_value(NUM_EPISODES, 1, reduce="sum")
        self.metrics.log_value(NUM_EPISODES_LIFETIME, 1, reduce="lifetime_sum")
        self._ids[index][row] = self._next_id
        self._next_id += 1
        self._started[index][row] = 0
        self._returns[index][row] = 0.0

    def _log_steps(self, num_steps: int, fragments: list[_Fragment]) -> None:
        agents: defaultdict[str, int] = defaultdict(int)
        modules: defaultdict[str, int] = defaultdict(int)
        for group, fragment in zip(self._groups, fragments, strict=True):
            counts = np.sum(fragment.active, axis=0) if fragment.active else np.zeros(0, np.int64)
            modules[group.module_id] += int(counts.sum())
            for agent, count in zip(group.agents, counts.tolist(), strict=False):
                agents[agent] += count
        num_env_steps = num_steps * self.num_envs
        self.num_env_steps_sampled_lifetime += num_env_steps
        log = self.metrics.log_value
        log(NUM_ENV_STEPS_SAMPLED, num_env_steps, reduce="sum")
        log(
            NUM_ENV_STEPS_SAMPLED_LIFETIME,
            num_env_steps,
            reduce="lifetime_sum",
            with_throughput=True,
        )
        for keys, counts in (
            ((NUM_AGENT_STEPS_SAMPLED, NUM_AGENT_STEPS_SAMPLED_LIFETIME), agents),
            ((NUM_MODULE_STEPS_SAMPLED, NUM_MODULE_STEPS_SAMPLED_LIFETIME), modules),
        ):
            for name, count in counts.items():
                log((keys[0], name), count, reduce="sum")
                log((keys[1], name), count, reduce="lifetime_sum")


def _array_of(policy: PolicySpec, entries: dict[str, NDArray[Any]]) -> NDArray[Any]:
    """Return observations, which are one array here."""
    return cast(NDArray[Any], observation_of(policy, entries))


def _pieces(active: NDArray[np.bool_], ended: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the runs of steps that belong to one episode each, as ``(first, end)``."""
    steps = active.nonzero()[0]
    if not len(steps):
        return []
    is_last = ended[steps] | (np.diff(steps, append=math.inf) > 1)
    ends = np.union1d(steps[is_last] + 1, steps[-1:] + 1)
    starts = [int(steps[0]), *(int(steps[np.searchsorted(steps, end)]) for end in ends[:-1])]
    return list(zip(starts, ends.tolist(), strict=True))
