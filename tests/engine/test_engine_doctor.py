"""The doctor tells what is there and what is missing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from engine_fakes import fake_godot

from ludus.engine.doctor import FindingStatus, doctor
from ludus.extras import install_hint

NAMES = [
    "python",
    "godot4",
    "godot3",
    "template",
    "cache",
    "cores",
    "sockets",
    "screen",
    "torch",
    "cuda",
]


def findings() -> dict[str, tuple[FindingStatus, str, str]]:
    return {item.name: (item.status, item.detail, item.hint) for item in doctor()}


def test_doctor_fails_without_godot4_and_warns_without_the_rest(
    bare_machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    found = findings()
    assert list(found) == NAMES
    assert found["godot4"][0] is FindingStatus.FAIL
    assert found["godot4"][2] == "ludus engine install godot4"
    assert found["godot3"][0] is FindingStatus.WARN
    assert found["screen"][0] is FindingStatus.WARN
    assert "xvfb" in found["screen"][2]


def test_doctor_reports_what_it_found(bare_machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = fake_godot(bare_machine / "godot4", "4.6.3.stable")
    monkeypatch.setenv("DISPLAY", ":7")
    found = findings()
    assert found["godot4"] == (FindingStatus.OK, f"4.6.3 {program} [PATH]", "")
    assert found["screen"] == (FindingStatus.OK, "display :7", "")
    assert found["cores"][0] is FindingStatus.OK


def test_doctor_names_missing_packages(bare_machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "platformdirs", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)  # pyright: ignore
    found = findings()
    assert found["cache"][0] is FindingStatus.WARN
    assert found["torch"][0] is FindingStatus.WARN
    assert install_hint("train") in found["torch"][2]


def test_doctor_does_not_import_torch() -> None:
    code = (
        "import sys; from ludus.engine import doctor; doctor(); assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
