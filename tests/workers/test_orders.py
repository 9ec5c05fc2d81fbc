"""What machines are told, and what is told about them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ludus.errors import MachineLost
from ludus.training.live import machines_text
from ludus.training.loop import train
from ludus.workers import opening
from ludus.workers.interface import MachineState, Order
from tests.workers.machines import InProcess
from tests.workers.test_equal_bits import config

pytestmark = pytest.mark.slow


class Dying(InProcess):
    """Notes the orders of machine 0; machine 1 dies once, at its fifth order."""

    orders: list[Order] = []  # noqa: RUF012
    num_left = 5

    def send(self, method: str, *arguments: Any) -> None:
        self._is_second = self.name == "machine 1"
        if method == "play":
            if self._is_second:
                Dying.num_left -= 1
            else:
                self.orders.append(arguments[0])
        super().send(method, *arguments)

    def receive(self) -> Any:
        if getattr(self, "_is_second", False) and Dying.num_left == 0:
            Dying.num_left = -1
            raise MachineLost(f"{self.name} is gone")
        return super().receive()


def test_the_others_get_new_weights_after_one_was_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opening, "ProcessMachine", Dying)
    result = train(config("ppo", tmp_path, "local:2", exact_resume=False))
    assert "machine 1 is gone" in (result.path / "train.log").read_text()
    orders = [order for order in Dying.orders if order.num_steps]
    numbers = [order.policies["agent"].number for order in orders]
    assert numbers == list(range(len(numbers)))
    assert all(order.policies["agent"].weights is not None for order in orders[1:])


@pytest.mark.parametrize(
    ("plays", "said"),
    [
        ([0.1, 0.1, 0.11], "3 of 3 machines play, 6 engines"),
        (
            [0.1, 0.4, 0.1],
            "3 of 3 machines play, 6 engines; slow: machine 1 (b, process 2), 4.0 × the others",
        ),
        ([0.1, None, 0.1], "2 of 3 machines play, 4 engines; lost: machine 1 (b, process 2)"),
    ],
)
def test_who_is_slow_and_who_is_lost(plays: list[float | None], said: str) -> None:
    names = ("machine 0 (a, process 1)", "machine 1 (b, process 2)", "machine 2 (c, process 3)")
    states = [
        MachineState(name, 2, play_s or 0.1, play_s is None)
        for name, play_s in zip(names, plays, strict=True)
    ]
    assert machines_text(states) == said
