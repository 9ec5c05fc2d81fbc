"""Games as environments of Stable-Baselines3, and its models as agents in games.

>>> import ludus.sb3
>>> from stable_baselines3 import PPO
>>> env = ludus.sb3.make("cartpole", num_worlds=64)                     # doctest: +SKIP
>>> model = PPO("MlpPolicy", env, n_steps=64).learn(100_000)            # doctest: +SKIP
>>> ludus.sb3.export(model, "cart.ludus.json")                          # doctest: +SKIP
"""

# Stable-Baselines3's types are incomplete.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.errors import UsageError
from ludus.extras import missing_extra
from ludus.libraries import LudusVectorEnv, make_vec
from ludus.locks import TemporaryFolder

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise missing_extra("stable-baselines3", "sb3") from error

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.vec_env import VecNormalize

    from ludus.export.parity import ParityReport

__all__ = ["LudusVecEnv", "export", "make"]

_GOES_ON: dict[str, Any] = {"TimeLimit.truncated": False}


def make(target: str | Path, **settings: Any) -> LudusVecEnv:
    """Start a game as a ``VecEnv``.

    Args:
        target: A bundled example (``"cartpole"``), a project folder, a ``.tscn``, an exported game,
            or any other word that docs/targets.md lists.
        settings: As for :func:`ludus.make_vec`, such as ``num_worlds=64``, ``num_engines=2``,
            ``policy="chaser"``, ``render_mode="rgb_array"``.

    Raises:
        UsageError: SB3 has no such actions, or what :func:`ludus.make_vec` raises.
        TargetError: The target cannot be run.
        EngineNotFound: There is no engine to run it with.
        EngineError: An engine did not start.
    """
    if "autoreset_mode" in settings:
        raise UsageError("a VecEnv of SB3 resets in the same step; leave autoreset_mode out")
    envs = make_vec(target, **settings)
    try:
        return LudusVecEnv(envs)
    except BaseException:
        envs.close()
        raise


class LudusVecEnv(VecEnv):
    """All agents of one policy as a ``VecEnv``.

    ``infos`` are the same empty dictionaries in every step; only environments whose episode ended
    get one of their own, with ``"terminal_observation"`` and ``"TimeLimit.truncated"``. To make
    1,024 dictionaries a step would take longer than the step.

    Args:
        envs: What is stepped; with same-step autoreset. Closed with this environment.

    Raises:
        UsageError: Actions are of both kinds, which SB3 does not know.
    """

    def __init__(self, envs: LudusVectorEnv) -> None:
        if isinstance(envs.single_action_space, spaces.Dict):
            kinds = ", ".join(part.name for part in envs.policy.action)
            raise UsageError(
                f"Stable-Baselines3 has no actions of both kinds ({kinds})",
                hint="`ludus train`, RLlib and TorchRL have; or make all parts discrete, or all "
                "continuous, in the game",
            )
        self.envs = envs
        self._infos: list[dict[str, Any]] = [dict(_GOES_ON) for _ in range(envs.num_envs)]
        self._masks: NDArray[np.bool_] | None = None
        if envs.policy.has_action_mask:
            self._masks = np.ones((envs.num_envs, envs.policy.mask_size), np.bool_)
        self._actions: Any = None
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> Any:
        """Begin new episodes, once with the seeds and options that were set.

        Options are those of :meth:`ludus.LudusEnv.reset`: ``{"parameters": {…}}``.
        """
        options: dict[str, Any] = {}
        if any(self._options):
            chosen = self._options[:: self.envs.policy.agents_per_world]
            options["parameters"] = [one.get("parameters") for one in chosen]
        observations, infos = self.envs.reset(seed=self._seeds, options=options)
        self._take(infos)
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions until :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Act in all environments; observations, rewards, dones and infos."""
        observations, rewards, terminated, truncated, step_infos = self.envs.step(self._actions)
        self._take(step_infos)
        infos = self._infos.copy()
        finals = step_infos.get("final_obs")
        if finals is None:
            return observations, rewards, terminated, infos
        dones = terminated | truncated
        for row in dones.nonzero()[0]:
            infos[row] = {
                "terminal_observation": finals[row],
                "TimeLimit.truncated": bool(truncated[row] and not terminated[row]),
            }
        return observations, rewards, dones, infos

    def action_masks(self) -> NDArray[np.bool_]:
        """Return ``bool[num_envs, sum(nvec)]``, which sb3-contrib's MaskablePPO asks for.

        Raises:
            AttributeError: The game has no masks.
        """
        if self._masks is None:
            raise AttributeError(f"the policy {self.envs.policy.name!r} has no action masks")
        return self._masks

    def close(self) -> None:
        """End the engines."""
        self.envs.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return a picture for each environment, with ``render_mode="rgb_array"``."""
        return self.envs.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the environment once for each of ``indices``."""
        if attr_name == "action_masks":
            masks = self.action_masks()
            return [lambda row=row: masks[row] for row in self._get_indices(indices)]
        return [getattr(self.envs, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: environments share what they are made of.

        Raises:
            UsageError: Always.
        """
        raise UsageError(
            f"{attr_name} cannot be set for single environments of a game",
            hint='reset options reach the game: set_options({"parameters": {…}})',
        )

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call ``action_masks`` or ``render``; other methods belong to all environments at once.

        Raises:
            AttributeError: It is another method.
        """
        rows: Iterable[int] = self._get_indices(indices)
        if method_name == "action_masks":
            masks = self.action_masks()
            return [masks[row] for row in rows]
        if method_name == "render":
            images = self.get_images()
            return [images[row] for row in rows]
        raise AttributeError(f"environments of a game have no method {method_name!r} of their own")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each: there is no ``gymnasium.Wrapper`` around single environments."""
        return [False for _ in self._get_indices(indices)]

    def _take(self, infos: dict[str, Any]) -> None:
        if self._masks is not None:
            self._masks = infos["action_mask"]
        if "active" in infos:
            row = int(np.argmin(infos["active"]))
            raise UsageError(
                f"the agent of environment {row} is inactive, which Stable-Baselines3 cannot know",
                hint="agents come and go in this game, or wait for each other: use `ludus train`, "
                "ludus.pettingzoo or ludus.rllib",
            )


def export(
    model: BaseAlgorithm,
    path: str | Path,
    vec_normalize: VecNormalize | None = None,
    *,
    is_tested: bool = True,
) -> ParityReport | None:
    """Write the agent of an SB3 model for its game, as ``.ludus.json``.

    The policies ``MlpPolicy``, ``CnnPolicy`` and ``MultiInputPolicy`` of PPO, A2C, MaskablePPO, SAC
    and DQN can be written.

    Args:
        model: Trained in :class:`LudusVecEnv`, maybe behind SB3's wrappers.
        path: The file to write.
        vec_normalize: The statistics it was trained with; by default those around its environment.
            They become part of the file.
        is_tested: Whether NumPy and a real Godot must compute what the model computes, before
            anything is written.

    Returns:
        How far they are apart, or None.

    Raises:
        UsageError: The model was not trained in a game, or has parts that the format does not know;
            or it was trained with normalised observations whose statistics are not there.
        ParityError: They compute something else; nothing is written.
    """
    from ludus.export.sb3_export import export_zip

    envs = _game_of(model)
    with TemporaryFolder("sb3") as temporary:
        saved = temporary.path / "model.zip"
        model.save(saved)
        return export_zip(
            saved,
            envs.policy,
            Path(path),
            vec_normalize or model.get_vec_normalize_env(),
            is_tested=is_tested,
        ).parity


def _game_of(model: BaseAlgorithm) -> LudusVectorEnv:
    env: Any = model.get_env()
    inner = None if env is None else env.unwrapped
    if not isinstance(inner, LudusVecEnv):
        raise UsageError(
            "the model's environment was not made by ludus.sb3.make, so its spec is not known",
            hint="load it with one: PPO.load(MODEL, env=ludus.sb3.make(…)); without VecNormalize "
            "`ludus export MODEL.zip --game GAME` does it",
        )
    return inner.envs
