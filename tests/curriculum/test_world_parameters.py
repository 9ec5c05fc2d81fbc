"""How parameters are drawn, and which settings are refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ludus import TrainConfig
from ludus.curriculum.lessons import Lessons
from ludus.curriculum.world_parameters import WorldParameters
from ludus.errors import ConfigError
from ludus.settings.merging import Layer, merge
from ludus.settings.plain import read_file, to_plain
from ludus.settings.world_parameters import Lesson, Parameter, Sampler
from ludus.wire.reset import ResetAction, ResetRequest
from ludus.wire.spec_reader import read_spec
from tests.wire.golden import load

SPEC = read_spec(load("spec_flat").content)
SEEDS = range(SPEC.num_worlds)
FILE = """\
[randomise]
gravity = { uniform = [5, 15] }
mass = { normal = [1.0, 0.1] }
map = { choice = ["small", 2, true] }
wind = 2

[[curriculum]]
name = "near"
parameters = { distance = 1.5 }
until_return = 0.8
until_steps = 1000

[[curriculum]]
"""


def test_a_settings_file_is_read_and_saved(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(FILE)
    config = merge([Layer("file", read_file(tmp_path / "a.toml"))])
    assert config.randomise == {
        "gravity": Sampler(uniform=(5.0, 15.0)),
        "mass": Sampler(normal=(1.0, 0.1)),
        "map": Sampler(choice=("small", 2, True)),
        "wind": 2,
    }
    near = Lesson("near", {"distance": 1.5}, until_return=0.8, until_steps=1000)
    assert config.curriculum == (near, Lesson())
    assert merge([Layer("config.json", to_plain(config))]) == config


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[randomise]\na = {uniform = [2, 1]}", "uniform must be a lower and an upper end"),
        ("[randomise]\na = {uniform = [1]}", "uniform must be two finite numbers"),
        ("[randomise]\na = {normal = [0, -1]}", "a mean and a deviation from 0"),
        ("[randomise]\na = {choice = []}", "choice must be a list of values"),
        ("[randomise]\na = {}", "randomise.a must be a finite value, or a table with uniform"),
        ("[randomise]\na = {uniform = [0, 1], choice = [1]}", "randomise.a must be a finite value"),
        ("[randomise]\na = [0, 1]", "randomise.a must be .* or a table with uniform, normal or"),
        ("[randomise]\na = nan", "randomise.a must be a finite value"),
        ("[randomise]\na = {uniforn = [0, 1]}", "unknown setting uniforn"),
        ("[[curriculum]]\nname = 'a'\n[[curriculum]]", "lesson a never ends"),
        ("[[curriculum]]\nuntil_steps = 3", "lesson 1 is the last one and cannot end"),
        ("[[curriculum]]\nuntil_steps = 0", "until_steps must be at least 1"),
        ("curriculum = [1]", "curriculum must be a table with parameters"),
    ],
)  # fmt: skip
def test_mistakes_name_the_setting(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(ConfigError, match=message):
        merge([Layer("a.toml", read_file(tmp_path / "a.toml"))])


def drawn(parameters: dict[str, Parameter], count: int) -> list[dict[str, Any]]:
    own = WorldParameters(parameters, SPEC, SEEDS)
    own.complete(ResetRequest.all_worlds(SPEC.num_worlds, 11))
    return [own.draw(0) for _ in range(count)]


def test_samplers_have_their_distributions() -> None:
    parameters: dict[str, Parameter] = {
        "uniform": Sampler(uniform=(-2.0, 6.0)),
        "normal": Sampler(normal=(3.0, 0.5)),
        "choice": Sampler(choice=("a", 1, True, 2.5)),
        "fixed": "b",
    }
    draws = drawn(parameters, 4000)
    uniform = np.array([draw["uniform"] for draw in draws])
    assert uniform.min() >= -2
    assert uniform.max() <= 6
    assert abs(uniform.mean() - 2) < 0.2
    assert abs(uniform.std() - 8 / math.sqrt(12)) < 0.1
    normal = np.array([draw["normal"] for draw in draws])
    assert abs(normal.mean() - 3) < 0.05
    assert abs(normal.std() - 0.5) < 0.03
    for value in ("a", 1, True, 2.5):
        count = sum(draw["choice"] is value or draw["choice"] == value for draw in draws)
        assert 0.2 < count / 4000 < 0.55  # 1 equals True
    assert {draw["fixed"] for draw in draws} == {"b"}


def test_worlds_that_are_left_alone_draw_nothing() -> None:
    own = WorldParameters({"a": Sampler(uniform=(0.0, 1.0))}, SPEC, SEEDS)
    own.complete(ResetRequest.all_worlds(SPEC.num_worlds, 1))
    actions = np.full(SPEC.num_worlds, ResetAction.LEAVE, np.uint8)
    actions[0] = ResetAction.NEXT_EPISODE
    own.take_sums()
    completed = own.complete(ResetRequest(np.zeros(SPEC.num_worlds, np.uint64), actions))
    assert isinstance(completed.parameters, list)
    assert completed.parameters[0]
    assert set(map(type, completed.parameters[1:])) <= {type(None)}
    assert own.take_sums() == {"a": (1, completed.parameters[0]["a"])}
    assert own.take_sums() == {}


def test_constants_need_no_second_message() -> None:
    begun = np.ones(SPEC.num_worlds, np.bool_)
    fixed = WorldParameters({"a": 1.0}, SPEC, SEEDS)
    assert fixed.request_beginnings(begun, 0) is None
    varied = WorldParameters({"a": Sampler(choice=(1, 2))}, SPEC, SEEDS)
    assert varied.request_beginnings(~begun, 0) is None


def test_lessons_end_at_either_threshold() -> None:
    first = Lesson(until_return=0.5, until_steps=100)
    lessons = Lessons((first, replace_steps(first, 50), Lesson()), {"a": 1})
    assert not lessons.advance(99, [0.9, None])
    assert not lessons.advance(99, [0.9, 0.4])
    assert lessons.advance(99, [0.9, 0.5])
    assert not lessons.advance(148, [None])
    assert lessons.advance(149, [None])
    assert lessons.is_last
    assert not lessons.advance(10**9, [1.0])


def replace_steps(lesson: Lesson, steps: int) -> Lesson:
    return Lesson(until_return=lesson.until_return, until_steps=steps)


def test_parameters_of_a_lesson_win() -> None:
    lessons = Lessons((Lesson(parameters={"a": 2}, until_steps=1), Lesson()), {"a": 1, "b": 3})
    assert lessons.parameters == {"a": 2, "b": 3}
    lessons.advance(1, [])
    assert lessons.parameters == {"a": 1, "b": 3}
    resumed = Lessons((Lesson(until_steps=1), Lesson()), {})
    resumed.load_state(lessons.state())
    assert resumed.is_last


def test_a_run_without_them_has_one_lesson() -> None:
    config = TrainConfig()
    lessons = Lessons(config.curriculum, config.randomise)
    assert lessons.is_last
    assert not lessons.has_parameters
