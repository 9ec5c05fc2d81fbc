"""What computes the actions of a loaded policy: PyTorch, or ONNX Runtime."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ludus.errors import PolicyFileError, UsageError
from ludus.export.trained import spec_from_json
from ludus.extras import require_package
from ludus.networks.policy import Policy
from ludus.networks.tensors import as_tensor, as_tensors
from ludus.spec.batch import ActionBatch

__all__ = ["NetworkRunner", "OnnxRunner"]

Memory = NDArray[np.float32] | None


class NetworkRunner:
    """Asks a network of PyTorch, as :class:`~ludus.model.ModelRunner` asks a policy file.

    Attributes:
        num_frames: How many observations it takes together.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self.num_frames = policy.num_frames

    @torch.inference_mode()
    def act(
        self,
        observation: Mapping[str, NDArray[Any]],
        action_mask: NDArray[np.bool_] | None = None,
        memory: Memory = None,
        generator: np.random.Generator | None = None,
    ) -> tuple[ActionBatch, Memory]:
        """Return the actions of ``n`` agents, and their next memory, None without one."""
        policy, device = self._policy, self._policy.device
        inputs = policy.encoder(as_tensors(observation, device))
        state: Tensor | None = None
        if policy.memory_size:
            if memory is None:
                memory = np.zeros((len(inputs), policy.memory_size), np.float32)
            state = as_tensor(memory, device)
        outputs, state = policy.act_on(inputs, state)
        noise: Tensor | None = None
        if generator is not None:
            draws = torch.Generator(device).manual_seed(int(generator.integers(1 << 62)))
            noise = torch.empty(len(inputs), policy.head.num_noise, device=device)
            policy.head.fill_noise(noise, draws)
        mask = None if action_mask is None else as_tensor(action_mask, device)
        discrete, continuous = policy.head.sample(outputs, noise, mask)
        batch = ActionBatch(discrete.cpu().numpy(), policy.head.to_bounds(continuous).cpu().numpy())
        return batch, None if state is None else state.cpu().numpy().copy()


class OnnxRunner:
    """Asks an ``.onnx`` file of ``ludus export``, on the CPU; only the most probable actions.

    Attributes:
        spec: What the policy observes and does.
        num_frames: How many observations it takes together.

    Raises:
        PolicyFileError: The file cannot be read, or was not exported by Ludus.
    """

    def __init__(self, path: Path) -> None:
        require_package("onnxruntime")
        import onnxruntime

        if not path.is_file():
            hint = "`ludus export` writes policy files"
            raise PolicyFileError(f"cannot read policy file {path}: it does not exist", hint)

        runtime = cast(Any, onnxruntime)
        try:
            self._session = runtime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
            metadata = self._session.get_modelmeta().custom_metadata_map
            values = json.loads(metadata["spec"])
            named = {"name": metadata["policy"], "episode": "agent"}
            unsaid: dict[str, Any] = {"max_episode_steps": None, "settings": {}}
            self.spec = spec_from_json({**named, **unsaid, **values})
            self.num_frames = int(values.get("frames", 1))
        except Exception as error:  # ONNX Runtime's own errors have no common base
            raise PolicyFileError(
                f"{path} is not a policy that Ludus has exported: {type(error).__name__}: {error}",
                "ludus export RUN --to hero.onnx writes one",
            ) from None
        self._inputs = {value.name: value.shape for value in self._session.get_inputs()}
        self._outputs = [value.name for value in self._session.get_outputs()]

    def act(
        self,
        observation: Mapping[str, NDArray[Any]],
        action_mask: NDArray[np.bool_] | None = None,
        memory: Memory = None,
        generator: np.random.Generator | None = None,
    ) -> tuple[ActionBatch, Memory]:
        """Return the actions of ``n`` agents, and their next memory, None without one."""
        if generator is not None:
            raise UsageError(
                "an .onnx file takes the most probable actions only",
                "load the run or its .ludus.json to draw actions",
            )
        num = len(next(iter(observation.values())))
        feed: dict[str, Any] = dict(observation)
        if "action_mask" in self._inputs:
            everything = np.ones((num, self.spec.mask_size), np.bool_)
            feed["action_mask"] = everything if action_mask is None else action_mask
        if "memory" in self._inputs:
            size = self._inputs["memory"][1]
            feed["memory"] = np.zeros((num, size), np.float32) if memory is None else memory
        answer = dict(zip(self._outputs, self._session.run(None, feed), strict=True))
        batch = ActionBatch(
            answer.get("discrete", np.zeros((num, 0), np.int64)),
            answer.get("continuous", np.zeros((num, 0), np.float32)),
        )
        return batch, answer.get("memory_out")
