"""The example "key_door": what memory is worth, shown by players with and without it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

import ludus
from ludus.libraries.vector import LudusVectorEnv

pytestmark = pytest.mark.engine

NUM_WORLDS = 12
NUM_DOORS = 3
OPEN = 4
KEY_REWARD, DOOR_REWARD = 0.1, 0.9
BEST_WITH_MEMORY = 1.0
BEST_WITHOUT_MEMORY = KEY_REWARD + DOOR_REWARD / NUM_DOORS
LONGEST_WAY = 13
NUM_COLOURED = 3
PLAN = ["...   0 ", ".......1", "...   2 "]
MOVES = [(-1, 0), (1, 0), (0, -1), (0, 1)]
DOORS = [(6, 0), (7, 1), (6, 2)]
HAS_KEY, COLOUR = 2, slice(5, 8)

Cell = tuple[int, int]
Row = NDArray[np.float32]


def is_floor(cell: Cell) -> bool:
    x, y = cell
    return 0 <= x < 8 and 0 <= y < 3 and PLAN[y][x] != " "


def neighbour(cell: Cell, action: int) -> Cell:
    return cell[0] + MOVES[action][0], cell[1] + MOVES[action][1]


def opposite(action: int) -> int:
    return action ^ 1


def first_move(start: Cell, goal: Cell) -> int:
    """Return the first move of a shortest way; the goal is another cell."""
    came: dict[Cell, int] = {goal: -1}
    queue = deque([goal])
    while queue:
        cell = queue.popleft()
        for action in range(4):
            before = neighbour(cell, opposite(action))
            if is_floor(before) and before not in came:
                came[before] = action
                queue.append(before)
    return came[start]


def place(row: Row) -> Cell:
    return round(row[0] * 7), round(row[1]) + 1


def key_place(row: Row) -> Cell:
    x, y = place(row)
    return x + round(row[3] * 7), y + round(row[4] * 2)


def mask_of(row: Row) -> list[bool]:
    cell = place(row)
    moves = [is_floor(neighbour(cell, action)) for action in range(4)]
    return [*moves, cell in DOORS and row[HAS_KEY] == 1]


def walk(row: Row, door: int) -> int:
    """Choose the next action of one who fetches the key and opens that door."""
    cell = place(row)
    goal = DOORS[door] if row[HAS_KEY] else key_place(row)
    return OPEN if cell == goal else first_move(cell, goal)


class WithMemory:
    """Remembers the colour of each world's key."""

    def __init__(self) -> None:
        self.doors = [0] * NUM_WORLDS

    def act(self, world: int, row: Row) -> int:
        if row[COLOUR].any():
            self.doors[world] = int(row[COLOUR].argmax())
        return walk(row, self.doors[world])


class WithoutMemory:
    """Follows the colour as long as it shows, and then goes to the same door always."""

    def act(self, world: int, row: Row) -> int:
        door = int(row[COLOUR].argmax()) if row[COLOUR].any() else world % NUM_DOORS
        return walk(row, door)


@pytest.fixture(scope="module")
def envs() -> Iterator[LudusVectorEnv]:
    envs = ludus.make_vec("key_door", num_worlds=NUM_WORLDS)
    yield envs
    envs.close()


def play(
    envs: LudusVectorEnv, act: Callable[[int, Row], int], num_steps: int
) -> tuple[list[float], list[int]]:
    """Return the returns and lengths of all episodes that end; checks every mask on the way."""
    rows, infos = envs.reset(seed=1, options={"parameters": {}})
    returns, lengths = np.zeros(NUM_WORLDS), np.zeros(NUM_WORLDS, int)
    ended: tuple[list[float], list[int]] = ([], [])
    for _ in range(num_steps):
        assert infos["action_mask"].tolist() == [mask_of(row) for row in rows]
        actions = np.array([act(world, row) for world, row in enumerate(rows)])
        assert infos["action_mask"][np.arange(NUM_WORLDS), actions].all()
        rows, rewards, terminated, truncated, infos = envs.step(actions)
        returns += rewards
        lengths += 1
        for world in np.flatnonzero(terminated | truncated):
            ended[0].append(float(returns[world]))
            ended[1].append(int(lengths[world]))
            returns[world], lengths[world] = 0, 0
    return ended


def test_memory_always_earns_the_best_return(envs: LudusVectorEnv) -> None:
    returns, lengths = play(envs, WithMemory().act, 150)
    assert len(returns) > 100
    np.testing.assert_allclose(returns, BEST_WITH_MEMORY, rtol=1e-6)
    assert max(lengths) <= LONGEST_WAY


def test_without_memory_the_door_is_a_guess(envs: LudusVectorEnv) -> None:
    returns, _ = play(envs, WithoutMemory().act, 600)
    deviation = DOOR_REWARD * np.sqrt(2 / 9 / len(returns))
    assert abs(np.mean(returns) - BEST_WITHOUT_MEMORY) < 4 * deviation
    assert set(np.round(returns, 6)) == {KEY_REWARD, BEST_WITH_MEMORY}


def test_nothing_tells_the_doors_apart_once_the_colour_is_gone() -> None:
    envs = ludus.make_vec("key_door", num_worlds=1)
    doors = [seen_with_door(envs, door) for door in range(NUM_DOORS)]
    envs.close()
    for door, rows in enumerate(doors):
        assert rows[:NUM_COLOURED, COLOUR].tolist() == [np.eye(NUM_DOORS)[door].tolist()] * 3
        assert not rows[NUM_COLOURED:, COLOUR].any()
        np.testing.assert_array_equal(rows[NUM_COLOURED:], doors[0][NUM_COLOURED:])


def seen_with_door(envs: LudusVectorEnv, door: int) -> Row:
    """Return what a player sees who goes to a door but opens none, then back."""
    rows, infos = envs.reset(seed=5, options={"parameters": {"door": door}})
    seen = [rows[0].copy()]
    while not infos["action_mask"][0, OPEN]:
        rows, _, terminated, truncated, infos = envs.step(np.array([walk(rows[0], 1)]))
        assert not terminated.any() and not truncated.any()
        seen.append(rows[0].copy())
    return np.array(seen)


def test_the_colour_is_gone_before_the_crossing(envs: LudusVectorEnv) -> None:
    """Whoever comes to the crossing sees no colour, so the bound without memory holds."""
    hunter = WithMemory()
    crossing = (6, 1)
    seen: list[bool] = []

    def act(world: int, row: Row) -> int:
        if place(row) == crossing:
            seen.append(bool(row[COLOUR].any()))
        return hunter.act(world, row)

    play(envs, act, 100)
    assert len(seen) > 50 and not any(seen)


def test_idle_episodes_are_cut_off(envs: LudusVectorEnv) -> None:
    envs.reset(seed=2, options={"parameters": {}})
    for step in range(1, 26):
        # Opening a door in the room is forbidden, does nothing, and takes its step all the same.
        _, rewards, terminated, truncated, _ = envs.step(np.full(NUM_WORLDS, OPEN))
        assert not rewards.any() and not terminated.any()
        assert truncated.tolist() == [step == 25] * NUM_WORLDS


def test_equal_seeds_are_equal_episodes(envs: LudusVectorEnv) -> None:
    first = envs.reset(seed=9)[0].copy()
    np.testing.assert_array_equal(envs.reset(seed=9)[0], first)
    later = envs.reset(seed=10)[0]
    np.testing.assert_array_equal(later[:-1], first[1:])
    assert not np.array_equal(later, first)
