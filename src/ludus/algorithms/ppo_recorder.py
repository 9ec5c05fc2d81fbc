"""What acts for PPO, and records one rollout of all agents with one network."""

from __future__ import annotations

import torch
from torch import Tensor

from ludus.algorithms.learner import LearnerSettings
from ludus.algorithms.recorder import Recording, stream_seed
from ludus.algorithms.rollout import Rollout
from ludus.networks.policy import Policy
from ludus.networks.tensors import as_tensor, as_tensors
from ludus.settings.policy_config import PPOConfig
from ludus.spec.batch import ActionBatch, Batch

__all__ = ["PPORecorder"]


class PPORecorder:
    """Acts and records for PPO; a :class:`~ludus.algorithms.recorder.Recorder`.

    Args:
        policy: What acts.
        config: Its settings.
        settings: Slots of each engine, and the seed.

    Attributes:
        policy: What acts.
        rollout: What was recorded.
        number: Rollouts before this one.
        is_exploring: Always False.
        steps: Steps recorded of each engine.
        first_memory: ``float32[agents, memory_size]``, what was remembered when the rollout began.
    """

    def __init__(self, policy: Policy, config: PPOConfig, settings: LearnerSettings) -> None:
        self.policy = policy
        self.rollout = Rollout(policy.input_spec, config.rollout_steps, settings.engine_rows)
        self.number = 0
        self.is_exploring = False
        self.steps = [0] * len(settings.engine_rows)
        self._settings = settings
        self._rows = settings.engine_rows
        self._device = policy.device
        self._generator = torch.Generator(self._device)
        self._noise = [self._make_noise(rows) for rows in self._rows]
        # Views made beforehand, so that nothing is indexed while stepping.
        self._step_noise = [list(noise) for noise in self._noise]
        self._frames = [policy.make_frame_stack(rows.stop - rows.start) for rows in self._rows]
        num_agents = self.rollout.num_agents
        self._memory = torch.zeros(num_agents, policy.memory_size, device=self._device)
        self.first_memory = self._memory.clone()
        self._num_taken = 0

    def _make_noise(self, rows: slice) -> Tensor:
        shape = (self.rollout.num_steps, rows.stop - rows.start, self.policy.head.num_noise)
        return torch.zeros(shape, device=self._device)

    @property
    def num_steps_left(self) -> int:
        """Steps of every engine until the rollout is complete."""
        return self.rollout.num_steps - min(self.steps)

    def begin(self, engine: int, batch: Batch) -> None:
        """Take the first observations of an engine that was reset; drops unfinished rollouts."""
        self.steps[engine] = 0
        self._num_taken = 0
        self.rollout.forget()
        self._memory[self._rows[engine]] = 0.0
        self.first_memory.copy_(self._memory)
        self._frames[engine].forget()
        self.rollout.views[engine][0].write_state(self._frames[engine].push_batch(batch))

    @torch.inference_mode()
    def act(self, engine: int) -> ActionBatch:
        """Return actions for the last observations; views that the next rollout overwrites."""
        step = self.steps[engine]
        if step == 0:
            self._draw_noise(engine)
        view, device, policy = self.rollout.views[engine][step], self._device, self.policy
        is_on_cpu = device.type == "cpu"
        tensors = view.tensors if is_on_cpu else as_tensors(view.observation, device)
        mask = as_tensor(view.mask, device) if self.rollout.has_mask else None
        state = self._memory[self._rows[engine]] if policy.memory_size else None
        outputs, state = policy.act_on(policy.encoder(tensors), state)
        if state is not None:
            self._memory[self._rows[engine]] = state
        noise = self._step_noise[engine][step]
        discrete, continuous = policy.head.sample(outputs, noise, mask)
        view.discrete[...] = discrete.cpu().numpy()
        if not policy.head.size:
            return ActionBatch(view.discrete, view.continuous)
        view.continuous[...] = continuous.cpu().numpy()
        return ActionBatch(view.discrete, policy.head.to_bounds(continuous).cpu().numpy())

    def _draw_noise(self, engine: int) -> None:
        """Draw the noise of one engine's whole rollout, which depends on nothing but its number."""
        number = self._settings.first_engine + engine
        self._generator.manual_seed(stream_seed(self._settings.seed, self.number, number))
        self.policy.head.fill_noise(self._noise[engine], self._generator)

    def record(self, engine: int, batch: Batch) -> None:
        """Take the outcome of the last actions, and the observations to act on next."""
        step, batch = self.steps[engine], self._frames[engine].push_batch(batch)
        views = self.rollout.views[engine]
        views[step].write_outcome(batch)
        views[step + 1].write_state(batch)
        if len(batch.final_index):
            self.rollout.add_finals(engine, step, batch)
        if self.policy.memory_size:
            goes_on = views[step].is_active & ~(batch.terminated | batch.truncated)
            keep = as_tensor(goes_on, self._device).unsqueeze(1)
            self._memory[self._rows[engine]] *= keep
        self.steps[engine] = step + 1

    def restart(self) -> None:
        """Begin the next rollout where this one ended."""
        self.number += 1
        self.rollout.restart(min(self.steps))  # fewer in a worker that began in mid-rollout
        self.first_memory.copy_(self._memory)
        self.steps = [0] * len(self.steps)
        self._num_taken = 0

    # --- across machines ------------------------------------------------------------------------

    def follow(self, number: int, is_exploring: bool) -> None:
        """Begin the rollout ``number``, if that is another one."""
        if number != self.number:
            self.restart()
            self.number = number

    def take(self) -> Recording:
        """Return the steps since the last time; views that the next rollout overwrites."""
        start, self._num_taken = self._num_taken, min(self.steps)
        part = self.rollout.take(start, self._num_taken)
        if self.policy.memory_size and start == 0:
            part["first_memory"] = self.first_memory.cpu().numpy()
        return part

    def put(self, engines: range, part: Recording) -> None:
        """Take what :meth:`take` of the recorder of some of the engines returned."""
        start = self.steps[engines[0]]
        num_steps = self.rollout.put(engines, start, part)
        for engine in engines:
            self.steps[engine] += num_steps
        if "first_memory" in part and start == 0:
            rows = slice(self._rows[engines[0]].start, self._rows[engines[-1]].stop)
            self.first_memory[rows] = as_tensor(part["first_memory"].copy(), self._device)

    def lose(self, engines: range, num_steps: int) -> None:
        """Note that nobody knows what some of the engines did in some steps."""
        self.rollout.lose(engines, self.steps[engines[0]], num_steps)
        for engine in engines:
            self.steps[engine] += num_steps

    def forget(self) -> None:
        """Drop what was recorded: every engine was reset elsewhere."""
        self.steps = [0] * len(self.steps)
        self.rollout.forget()
