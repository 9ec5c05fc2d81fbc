"""What agents see of a state, and of a picture, that bevy_rl programs publish."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from PIL import Image

from ludus.errors import GameError
from ludus.legacy.bevy_rl.observing import Observing
from ludus.legacy.bevy_rl.pictures import split_picture


def _box(size: int) -> spaces.Box:
    return spaces.Box(-np.inf, np.inf, (size,), np.float32)


def _observe(space: Any, state: Any, num_agents: int = 1) -> list[Any]:
    return Observing(space, None, with_pixels=False).observe(state, b"", num_agents)


def _picture(width: int, height: int) -> tuple[np.ndarray[Any, Any], bytes]:
    pixels = np.random.default_rng(7).integers(0, 256, (height, width, 4), np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return pixels, file.getvalue()


@pytest.mark.parametrize(
    ("state", "num_agents", "expected"),
    [
        ([1, 2.5], 1, [[1, 2.5]]),
        (3, 1, [[3]]),
        ({"position": [1, 2], "speed": {"x": 3, "y": True}}, 1, [[1, 2, 3, 1]]),
        ({"agents": [[1, 2]]}, 1, [[1, 2]]),
        ({"position": [1, 2, 3]}, 1, [[1, 2, 3]]),
        ([[1], [2]], 2, [[1], [2]]),
        ({"agents": [{"x": 1}, {"x": 2}], "wind": [1, 2, 3]}, 2, [[1], [2]]),
    ],
)
def test_numbers_come_as_they_stand(state: Any, num_agents: int, expected: Any) -> None:
    found = _observe(_box(len(expected[0])), state, num_agents)
    np.testing.assert_array_equal(np.stack(found), expected)


def test_entries_of_a_dictionary_come_by_name() -> None:
    space = spaces.Dict({"x": _box(2), "on": spaces.Box(0, 1, (1,), np.uint8)})
    state = {"agents": [{"x": [1, 2], "on": True, "z": 9}, {"x": [3, 4], "on": False}]}
    found = _observe(space, state, 2)
    np.testing.assert_array_equal(found[1]["x"], [3, 4])
    assert found[0]["on"].dtype == np.uint8
    assert found[0]["on"][0] == 1


@pytest.mark.parametrize(
    ("state", "num_agents", "text"),
    [
        (None, 1, "has not published a state yet"),
        ([1], 1, "the state has 1 numbers, the space 2"),
        (["a", 1], 1, "the state is not a number: 'a'"),
        ({"x": {"y": "a"}}, 1, r"the state\.x\.y is not a number"),
        ([1, 2, 3], 2, "0 lists of 2 elements"),
        ({"a": [1, 2], "b": [3, 4]}, 2, "2 lists of 2 elements"),
    ],
)
def test_what_does_not_fit_is_told(state: Any, num_agents: int, text: str) -> None:
    with pytest.raises(GameError, match=text):
        _observe(_box(2), state, num_agents)


def test_missing_entries_are_told() -> None:
    space = spaces.Dict({"x": _box(1)})
    with pytest.raises(GameError, match="the state has no 'x', it has y"):
        _observe(space, {"y": 1, "z": 2})
    with pytest.raises(GameError, match="is not a JSON object"):
        _observe(space, [1])


@pytest.mark.parametrize("channels", [3, 4])
def test_each_agent_gets_its_part_of_the_picture(channels: int) -> None:
    pixels, png = _picture(3 * 20, 7)
    parts = split_picture(png, spaces.Box(0, 255, (7, 20, channels), np.uint8), 3)
    for agent, part in enumerate(parts):
        own = pixels[:, agent * 20 : (agent + 1) * 20, :channels]
        np.testing.assert_array_equal(part, own)


def test_pixels_come_alone_or_beside_numbers() -> None:
    _, png = _picture(2 * 5, 4)
    image = spaces.Box(0, 255, (4, 5, 1), np.uint8)
    alone = Observing(image, None, with_pixels=True).observe(None, png, 2)
    both = Observing(spaces.Dict({"pixels": image, "x": _box(1)}), None, with_pixels=True)
    found = both.observe([{"x": 1}, {"x": 2}], png, 2)
    np.testing.assert_array_equal(found[1]["pixels"], alone[1])
    assert found[1]["x"][0] == 2


def test_other_pictures_are_refused() -> None:
    box = spaces.Box(0, 255, (7, 20, 3), np.uint8)
    with pytest.raises(GameError, match="the picture has 60 x 7 pixels, expected 40 x 7"):
        split_picture(_picture(60, 7)[1], box, 2)
    for bytes_ in (b"", b"no picture", _picture(20, 7)[1][:100]):
        with pytest.raises(GameError, match="not answered with a PNG"):
            split_picture(bytes_, box, 1)
