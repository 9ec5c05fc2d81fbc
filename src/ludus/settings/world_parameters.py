"""Settings about the parameters of worlds: how they are drawn, and lessons that change them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from ludus.errors import ConfigError
from ludus.settings.checks import AT_LEAST_1, Settings, optional, require, setting

__all__ = ["Lesson", "Parameter", "Sampler", "Value", "check_lessons", "check_parameters"]

Value = int | float | bool | str


@dataclass(frozen=True)
class Sampler(Settings):
    """A distribution that a parameter is drawn from; exactly one of these.

    Attributes:
        uniform: Lower and upper end.
        normal: Mean and standard deviation.
        choice: Values, each as likely as the others.
    """

    uniform: tuple[float, ...] | None = None
    normal: tuple[float, ...] | None = None
    choice: tuple[Value, ...] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("uniform", "normal"):
            pair: tuple[float, ...] | None = getattr(self, name)
            if pair is not None:
                is_pair = len(pair) == 2 and all(map(math.isfinite, pair))
                require(is_pair, name, "two finite numbers", list(pair))
        if self.uniform is not None:
            low, high = self.uniform
            require(low <= high, "uniform", "a lower and an upper end", [low, high])
        if self.normal is not None:
            require(self.normal[1] >= 0, "normal", "a mean and a deviation from 0", self.normal)
        require(self.choice is None or len(self.choice) > 0, "choice", "a list of values", [])

    @property
    def num_forms(self) -> int:
        """How many distributions are named; a parameter needs 1."""
        return sum(form is not None for form in (self.uniform, self.normal, self.choice))


# A whole number stays one, and a table comes last, as only that can be a sampler.
Parameter = int | float | bool | str | Sampler
"""What a world's parameter is: always this value, or drawn."""


@dataclass(frozen=True)
class Lesson(Settings):
    """A part of training that is easier, or at least other, than the whole task.

    Attributes:
        name: For people; the number of the lesson if empty.
        parameters: Of the worlds, by name, in this lesson.
        until_return: The lesson ends when the mean return of its last ``return_window`` episodes
            reaches this, for every policy.
        until_steps: The lesson ends after this many agent steps.
    """

    name: str = ""
    parameters: dict[str, Parameter] = field(default_factory=dict[str, Parameter])
    until_return: float | None = None
    until_steps: int | None = setting(None, optional(AT_LEAST_1))

    def __post_init__(self) -> None:
        super().__post_init__()
        check_parameters("parameters", self.parameters)

    @property
    def has_end(self) -> bool:
        """Whether a threshold ends it."""
        return self.until_return is not None or self.until_steps is not None


def check_parameters(where: str, parameters: Mapping[str, Parameter]) -> None:
    """Raise a ``ConfigError`` unless every sampler names one distribution, every number is finite.

    Args:
        where: Name of the setting.
        parameters: By name.
    """
    for name, value in parameters.items():
        if isinstance(value, Sampler):
            is_right = value.num_forms == 1
        else:
            is_right = not isinstance(value, float) or math.isfinite(value)
        require(is_right, f"{where}.{name}", "a finite value, or a table with uniform, normal or "
                "choice", value)  # fmt: skip


def check_lessons(lessons: tuple[Lesson, ...]) -> None:
    """Raise a ``ConfigError`` unless every lesson but the last one has an end."""
    for number, lesson in enumerate(lessons, 1):
        where = f"curriculum: lesson {lesson.name or number}"
        if number < len(lessons) and not lesson.has_end:
            raise ConfigError(f"{where} never ends", "set until_return or until_steps")
        if number == len(lessons) and lesson.has_end:
            raise ConfigError(
                f"{where} is the last one and cannot end",
                "leave out until_return and until_steps, or add the lesson that follows it",
            )
