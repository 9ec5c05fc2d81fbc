"""How an environment was made, so that it can be made once more elsewhere: pickle, and its spec."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from gymnasium.envs.registration import EnvSpec

from ludus.errors import ArgumentError
from ludus.libraries.registration import ENVIRONMENT_IDS

__all__ = ["Recipe", "reduce_env"]


@dataclass(frozen=True)
class Recipe:
    """A call of a function that starts a game.

    Attributes:
        function: Such as ``make`` or ``make_vec``.
        target: As given; the path of something on disk is absolute.
        settings: All other arguments that were given.
        module: Where the function is.
        num_envs: How many environments came of it.
    """

    function: str
    target: str
    settings: dict[str, Any]
    module: str = "ludus.libraries"
    num_envs: int = 1

    @classmethod
    def of(
        cls,
        function: str,
        target: str | Path,
        settings: dict[str, Any],
        module: str = "ludus.libraries",
    ) -> Recipe:
        """Return the recipe of a call; it holds in other working folders, too."""
        path = Path(target).expanduser()
        is_path = isinstance(target, Path) or "/" in str(target)
        name = str(path.absolute()) if is_path and path.exists() else str(target)
        given = {key: value for key, value in settings.items() if value is not None}
        return cls(function, name, given, module)

    @property
    def spec(self) -> EnvSpec:
        """What ``gymnasium.make`` rebuilds the environment from, without ``import ludus``."""
        settings = dict(self.settings)
        if self.function == "make_vec":  # as Gymnasium counts
            settings["num_envs"] = self.num_envs
            del settings["num_worlds"]
        known = {example: env_id for env_id, example in ENVIRONMENT_IDS.items()}
        name = re.sub(r"[^\w.-]+", "-", Path(self.target).stem)
        return EnvSpec(
            id=known.get(self.target, f"ludus/{name}-v0"),
            entry_point="ludus.libraries:make",
            vector_entry_point="ludus.libraries:make_registered_vec",
            kwargs={"target": self.target, **settings},
            disable_env_checker=True,
            order_enforce=False,
        )

    def make(self) -> Any:
        """Make the environment once more."""
        return getattr(import_module(self.module), self.function)(self.target, **self.settings)


def reduce_env(env: object, recipe: Recipe | None) -> tuple[Any, ...]:
    """Return what pickles an environment: its recipe, not its state; engines start anew.

    Raises:
        ArgumentError: It was not made by ``ludus.make`` or ``ludus.make_vec``.
    """
    if recipe is None:
        raise ArgumentError(
            f"this {type(env).__name__} cannot be pickled: it was made from a running pool",
            hint="make it with ludus.make or ludus.make_vec",
        )
    return Recipe.make, (recipe,)
