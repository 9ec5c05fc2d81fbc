"""What a script can do while a run goes on: look at it, stop it, change its settings."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, NamedTuple

from ludus.errors import ConfigError
from ludus.runs.run_folder import RunFolder
from ludus.settings.merging import Layer, resolve
from ludus.settings.plain import plain_settings, to_plain
from ludus.settings.policy_config import CHANGEABLE as CHANGEABLE_OF_POLICY
from ludus.settings.train_config import CHANGEABLE, TrainConfig
from ludus.training.progress import Progress

if TYPE_CHECKING:
    from ludus.training.trainer import Trainer

__all__ = ["Episode", "Hooks", "OnTrainingEpisode", "OnUpdate", "Training"]


CALLBACK = "callback"
"""Origin of settings that a script has changed."""


class Episode(NamedTuple):
    """An episode of training that ended.

    Attributes:
        policy: Whose.
        number: Of this policy's episodes in the run, from 1.
        episode_return: Undiscounted sum of the rewards.
        length: Agent steps.
    """

    policy: str
    number: int
    episode_return: float
    length: int


class Training:
    """A run that goes on, as the callbacks of :func:`ludus.train` see it.

    Attributes:
        folder: Where the run is; ``folder.path``.
        config: Settings in effect.
        is_stopping: Whether :meth:`stop` was called.
    """

    def __init__(self, trainer: Trainer, folder: RunFolder, origins: Mapping[str, str]) -> None:
        self.folder = folder
        self.is_stopping = False
        self._trainer = trainer
        self._origins = origins
        self._changed: TrainConfig | None = None

    @property
    def config(self) -> TrainConfig:
        """Settings in effect, or from the next step on."""
        return self._changed or self._trainer.config

    @property
    def progress(self) -> Progress | None:
        """How far the run is, with the metrics of every policy; None before the first update."""
        return self._trainer.progress

    def stop(self) -> None:
        """End training before the next step, with a checkpoint and the evaluation."""
        self.is_stopping = True

    def change(self, **settings: Any) -> None:
        """Change settings from the next step on; ``config.json`` records them.

        >>> training.change(ppo={"learning_rate": 1e-4})               # doctest: +SKIP
        >>> training.change(policies={"runner": {"mode": "frozen"}})   # doctest: +SKIP

        Args:
            settings: As for :func:`ludus.train`. Limits and intervals of checkpoints can change,
                and of policies what neither network nor rollout depends on, such as
                ``learning_rate``, ``entropy_coefficient``, ``clip_range`` and ``mode``.

        Raises:
            ConfigError: A setting is unknown, does not fit, or cannot change while a run goes on.
        """
        before = self.config
        layers = [
            Layer(str(self.folder.path), to_plain(before), is_saved=True),
            Layer(CALLBACK, plain_settings(settings)),
        ]
        resolved = resolve(layers, self._trainer.specs)
        after = resolved.config
        fixed = {part.name for part in fields(TrainConfig)} - CHANGEABLE
        _require_equal(before, after, fixed - {"ppo", "sac", "policies"})
        for name, own in after.policies.items():
            fixed = {part.name for part in fields(own)} - CHANGEABLE_OF_POLICY
            _require_equal(before.policies[name], own, fixed, f"policy {name}: ")
        changed = {name: of for name, of in resolved.origins.items() if of == CALLBACK}
        self._origins = {**self._origins, **changed}
        self._changed = after

    @property
    def has_changed(self) -> bool:
        """Whether :meth:`apply` has something to do."""
        return self._changed is not None

    def apply(self) -> None:
        """Put changed settings into effect; between two steps."""
        changed, self._changed = self._changed, None
        if changed is not None:
            self._trainer.change(changed)
            self.folder.write_config(changed, self._origins)


OnUpdate = Callable[[Training], None]
"""Called after every update, when its metrics have been written."""

OnTrainingEpisode = Callable[[Training, Episode], None]
"""Called for every episode of training that ends."""


@dataclass(frozen=True)
class Hooks:
    """The callbacks of a run.

    Attributes:
        on_update: Called after every update.
        on_episode: Called for every episode that ends.
    """

    on_update: OnUpdate | None = None
    on_episode: OnTrainingEpisode | None = None


def _require_equal(before: Any, after: Any, names: Collection[str], where: str = "") -> None:
    for name in names:
        if getattr(before, name) != getattr(after, name):
            raise ConfigError(
                f"{CALLBACK}: {where}{name} cannot change while a run goes on",
                "it shapes networks, statistics or the run; start a new run for another value",
            )
