"""The notebook runs: the whole journey of a GymGodot project, with a short training.

`.venv/bin/jupyter execute --inplace docs/gymgodot.ipynb` makes the one that is committed.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, cast

import pytest

from tests.legacy.gymgodot.conftest import left_processes

NOTEBOOK = Path(__file__).parents[2] / "docs" / "gymgodot.ipynb"
MAX_BYTES = 1_000_000
SHORT_STEPS = "1024"


def outputs_of(notebook: Any) -> list[dict[str, Any]]:
    return [output for cell in notebook["cells"] for output in cell.get("outputs", [])]


def shown(outputs: list[dict[str, Any]], kind: str) -> list[str]:
    """Return everything of one MIME type that cells have put out."""
    found = [output["data"][kind] for output in outputs if kind in output.get("data", {})]
    return ["".join(text) for text in found]


def printed(outputs: list[dict[str, Any]]) -> str:
    return "".join("".join(output.get("text", "")) for output in outputs)


def check_journey(outputs: list[dict[str, Any]]) -> None:
    """Check what every run of the notebook shows, however long it trained."""
    text = printed(outputs)
    assert "[-1.057811 -0.440057  0.131532  0.054847] 1.0 False" in text
    assert "(360, 640, 3) uint8" in text
    assert re.search(r"mean return of 5 episodes: \d+\.\d ± 0\.0", text)
    assert len(shown(outputs, "image/png")) == 2, "a frame and a curve"
    assert "data:video/mp4;base64," in shown(outputs, "text/html")[-1]


def test_the_committed_notebook_has_been_executed() -> None:
    notebook = json.loads(NOTEBOOK.read_text())
    assert NOTEBOOK.stat().st_size < MAX_BYTES
    outputs = outputs_of(notebook)
    check_journey(outputs)
    assert "mean return of 5 episodes: 250.0 ± 0.0" in printed(outputs), "it balances"
    assert "251 frames" in printed(outputs)
    assert not [output for output in outputs if output.get("name") == "stderr"]
    counts = [cell["execution_count"] for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert counts == list(range(1, len(counts) + 1))


@pytest.mark.games
@pytest.mark.engine
@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_notebook_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    import nbformat
    from nbclient import NotebookClient

    monkeypatch.setenv("NOTEBOOK_STEPS", SHORT_STEPS)
    monkeypatch.delenv("DISPLAY", raising=False)
    notebook: Any = cast(Any, nbformat).read(NOTEBOOK, as_version=4)
    resources = {"metadata": {"path": str(NOTEBOOK.parent)}}
    NotebookClient(notebook, timeout=400, resources=resources).execute()
    check_journey(outputs_of(notebook))
    assert left_processes() == []
