"""What a game says is shown without control characters."""

from __future__ import annotations

import io
import logging
from pathlib import Path
from typing import Any

import pytest

from ludus.errors import GameError
from ludus.printing import PrintableFormatter, printable
from ludus.runs.curve import draw_learning_curve
from ludus.training.live import TerminalReporter, evaluation_table, policy_text
from ludus.training.loop import train

EVIL = "\x1b]0;owned\x07\x1b[2Jok\r\x9b31m\u202e\ud800"
SHOWN = r"\x1b]0;owned\x07\x1b[2Jok\r\x9b31m\u202e\ud800"


def test_errors_and_logs_are_escaped() -> None:
    assert printable(f"a\tb\n{EVIL}") == f"a\tb\n{SHOWN}"
    assert printable("Größe 敵 “x”") == "Größe 敵 “x”"
    error = GameError(f"node Hero: {EVIL}", EVIL)
    assert (error.message, error.hint) == (f"node Hero: {SHOWN}", SHOWN)
    assert str(error).splitlines()[0] == error.message
    record = logging.LogRecord("ludus", logging.INFO, "", 0, "%s connected", (EVIL,), None)
    assert PrintableFormatter("%(message)s").format(record) == f"{SHOWN} connected"


NAMES = [r"$\frac$", "$x^$", "a$b", "[/]", "[red]", ":smile:", "a b"]


@pytest.mark.slow
def test_names_are_drawn_as_they_are(tmp_path: Path) -> None:
    policies = ", ".join(
        f'"{name}": {{"mean_return": 1.0, "return_p10": 0.0, "return_p90": 2.0}}'
        for name in (name.replace("\\", "\\\\") for name in NAMES)
    )
    metrics = tmp_path / "metrics.jsonl"
    metrics.write_text(f'{{"agent_steps": 8, "wall_s": 1.0, "policies": {{{policies}}}}}\n')
    assert draw_learning_curve(metrics, tmp_path / "curve.png", r"runs/$\oops_{$")
    assert (tmp_path / "curve.png").stat().st_size > 1000


@pytest.mark.parametrize("name", NAMES)
def test_names_are_printed_as_they_are(name: str) -> None:
    from rich.console import Console

    from ludus.play.evaluation import Evaluation

    text = io.StringIO()
    of = Evaluation.of([1.0], [1])
    Console(file=text, width=200).print(evaluation_table({name: of}, f"run {name}"))
    assert text.getvalue().count(name) == 2
    assert policy_text(name, {}, "train").startswith(name)


def test_the_figures_of_a_policy_are_named() -> None:
    metrics = {"mean_return": 2.5, "min_return": 1.0, "max_return": 9.0}
    assert policy_text("hero", metrics, "train") == "hero: mean return 2.5 (lowest 1, highest 9)"


@pytest.mark.curve
def test_a_run_may_be_called_what_its_user_likes(small: Any) -> None:
    from rich.console import Console

    text = io.StringIO()
    reporter = TerminalReporter(Console(file=text, width=200))
    config = small(name=r"[red]$x^$")
    result = train(config, reporter=reporter)
    reporter.finished(result)
    assert str(result.path) in text.getvalue()
    assert (result.path / "learning_curve.png").is_file()


def test_nothing_is_shown_of_a_run_that_had_ended_before(small: Any) -> None:
    from rich.console import Console

    config = small(evaluation_episodes=2)
    text = io.StringIO()
    reporter = TerminalReporter(Console(file=text, width=200))
    result = train(config, resume=train(config).path, reporter=reporter)
    reporter.finished(result)
    assert text.getvalue() == ""
