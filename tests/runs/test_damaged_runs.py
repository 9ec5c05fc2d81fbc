"""Whatever lies in a run folder: one error that names the file, and nothing is lost."""

from __future__ import annotations

import json
import logging
import os
import shutil
import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ludus.cli.main import main
from ludus.errors import ConfigError, LudusError, RunError
from ludus.runs.checkpoint import checkpoint_errors, read_checkpoint
from ludus.runs.control import StopRequest, send_request, take_requests
from ludus.runs.metrics import read_metrics
from ludus.runs.run_folder import RunFolder
from ludus.runs.run_list import list_runs
from ludus.settings.plain import read_file
from ludus.training.hooks import Hooks, Training
from ludus.training.loop import train
from ludus.training.progress import Progress, SilentReporter

BOMBS = {
    "list": b"[" * 100_000,
    "object": b'{"a":' * 500 + b"1" + b"}" * 500,
    "digits": b'{"agent_steps": ' + b"9" * 5000 + b"}",
    "not UTF-8": b'{"kind": "\xff"}',
    "a number": b"7",
    "nothing": b"",
}


def reseal(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change a checkpoint as a version of Ludus without the hash would have written it."""
    state = json.loads((path / "state.json").read_bytes())
    del state["state_sha256"]
    change(state)
    (path / "state.json").write_text(json.dumps(state))


def replace_by_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def replace_by_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


DAMAGES: dict[str, Callable[[Path], object]] = {
    **{
        f"state: {name}": lambda path, bomb=bomb: (path / "state.json").write_bytes(bomb)
        for name, bomb in BOMBS.items()
    },
    "state is a pipe": lambda path: replace_by_pipe(path / "state.json"),
    "state is a folder": lambda path: replace_by_folder(path / "state.json"),
    "tensors are a pipe": lambda path: replace_by_pipe(path / "tensors.safetensors"),
    "it is a file": lambda path: (shutil.rmtree(path), path.write_bytes(b"")),
    "it is a pipe": lambda path: (shutil.rmtree(path), os.mkfifo(path)),
    "steps are a text": lambda path: reseal(path, lambda of: of.update(agent_steps="many")),
    "no learner": lambda path: reseal(path, lambda of: of.update(learners={})),
    "a learner is a list": lambda path: reseal(path, lambda of: of["learners"].update(agent=[])),
    "no episodes": lambda path: reseal(path, lambda of: of["run"].update(episodes={})),
    "no random state": lambda path: reseal(path, lambda of: of["run"].update(random=[1])),
    "updates are a list": lambda path: reseal(path, lambda of: of["run"].update(updates=[1])),
    "settings are a text": lambda path: reseal(path, lambda of: of.update(config="x")),
    "no policies": lambda path: reseal(path, lambda of: of["config"].update(policies=7)),
}


@pytest.fixture
def run(trained: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(trained, tmp_path / "run"))


def checkpoints(run: Path) -> list[Path]:
    return RunFolder(run).checkpoints().paths()


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES.keys())
def test_a_damaged_checkpoint_is_set_aside_and_training_goes_on(
    damage: Callable[[Path], object], run: Path, caplog: pytest.LogCaptureFixture
) -> None:
    *_, older, newest = checkpoints(run)
    steps = read_checkpoint(newest).agent_steps
    damage(newest)
    config = replace(RunFolder(run).read_config(), total_steps=steps + 64)
    result = train(config, resume=run)
    assert result.agent_steps == steps + 64
    assert str(newest) in caplog.text
    assert "trying an older one" in caplog.text
    assert os.path.lexists(newest.with_name(f"unloadable-{newest.name}"))
    assert older in checkpoints(run)
    assert read_checkpoint(checkpoints(run)[-1]).agent_steps == steps + 64


def test_a_run_whose_newest_checkpoints_are_all_corrupt_writes_them_again(run: Path) -> None:
    oldest, *corrupt = checkpoints(run)
    assert len(corrupt) == 2
    for path in corrupt:
        (path / "tensors.safetensors").write_bytes(b"")
    assert main(["train", "--resume", str(run), "--total-steps", "256"]) == 0
    names = {path.name for path in oldest.parent.iterdir()}
    assert {f"unloadable-{path.name}" for path in corrupt} <= names
    newest = checkpoints(run)[-1]
    assert read_checkpoint(newest).agent_steps == 256


def test_checkpoints_to_keep_for_ever_are_resumed_from_when_no_other_can_be(run: Path) -> None:
    checkpoints(run)[1].rename(run / "checkpoints" / "update-000000000002")
    for path in checkpoints(run):
        (path / "state.json").write_bytes(b"")
    config = replace(RunFolder(run).read_config(), total_steps=256)
    assert train(config, resume=run).agent_steps == 256
    assert (run / "checkpoints" / "update-000000000002" / "state.json").is_file()


def test_other_things_among_the_checkpoints_are_none(run: Path) -> None:
    folder = run / "checkpoints"
    for name in ("step-backup", "step-", "step-999999999999999999999999", "step-9\n"):
        (folder / name).mkdir()
    config = replace(RunFolder(run).read_config(), total_steps=256)
    assert train(config, resume=run).agent_steps == 256
    assert (folder / "step-backup").is_dir()


@pytest.mark.parametrize("bomb", BOMBS.values(), ids=BOMBS.keys())
@pytest.mark.parametrize("command", ["resume", "evaluate", "export", "league", "control"])
def test_a_damaged_config_is_one_error_with_its_name(
    bomb: bytes, command: str, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (run / "config.json").write_bytes(bomb)
    given = ["train", "--resume"] if command == "resume" else [command]
    code = main([*given, str(run), *(["--stop"] if command == "control" else [])])
    shown = capsys.readouterr().err
    assert code in {2, 5}
    assert "defect" not in shown
    assert "Traceback" not in shown
    if command in {"resume", "evaluate"}:
        assert str(run / "config.json") in shown
    assert list_runs(run.parent) == []


WRONG_VALUES: list[dict[str, Any]] = [
    {"seed": [[[[]]]]}, {"total_steps": 10**400}, {"policies": [1]}, {"policies": {"agent": 3}},
    {"ppo": "x"}, {"schedule": [{"updates": {}}]}, {"num_worlds": 1e999}, {"target": 5},
    {"ppo": {"learning_rate": 10**400}}, {"runs": {}}, {"league": 1},
]  # fmt: skip


@pytest.mark.parametrize("values", WRONG_VALUES)
def test_settings_of_the_wrong_type_name_the_file(
    values: dict[str, Any], run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = run / "config.json"
    path.write_text(json.dumps({**json.loads(path.read_bytes()), **values}))
    assert main(["train", "--resume", str(run)]) == 2
    assert str(run) in capsys.readouterr().err


@pytest.mark.parametrize("suffix", [".json", ".toml"])
def test_a_settings_file_may_be_a_bomb(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"settings{suffix}"
    for text in ("[" * 100_000, "a = " + "[" * 50_000, "\udcff", '{"a": ' + "1" * 5000 + "}"):
        path.write_bytes(text.encode("utf-8", "surrogateescape"))
        with pytest.raises(ConfigError, match="is not valid"):
            read_file(path)


# --- what else lies there -----------------------------------------------------------------------


def test_bad_requests_neither_kill_nor_hang(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "control"
    folder.mkdir()
    os.mkfifo(folder / "0.json")
    (folder / "1.json").mkdir()
    (folder / "2.json").mkdir()
    (folder / "2.json" / "kept").write_bytes(b"")
    for number, bomb in enumerate(BOMBS.values(), 3):
        (folder / f"{number}.json").write_bytes(bomb)
    (folder / "9.json").symlink_to(folder / "nowhere")
    send_request(folder, StopRequest())
    assert take_requests(folder) == [{"kind": "stop"}]
    num_warnings = len(caplog.records)
    assert take_requests(folder) == []
    assert len(caplog.records) == num_warnings  # not after every update
    assert (folder / "2.json" / "kept").exists()
    assert {path.name for path in folder.iterdir()} == {"1.json", "2.json"}


class Dropping(SilentReporter):
    """Puts things into a run's folder ``control`` after the second update, then asks to stop."""

    def __init__(self, run: Path) -> None:
        self._run, self._updates = run, 0

    def updated(self, progress: Progress) -> None:
        self._updates += 1
        control = self._run / "control"
        if self._updates == 2:
            control.mkdir()
            (control / "a.json").mkdir()
            os.mkfifo(control / "b.json")
            (control / "c.json").write_bytes(BOMBS["list"][:4000])
        elif self._updates == 4:
            send_request(control, StopRequest())


def test_training_goes_on_whatever_lies_among_the_requests(small: Any) -> None:
    config = small(total_steps=6_400)
    result = train(config, reporter=Dropping(config.runs / "run"))
    assert (result.stop_reason, result.updates) == ("stopped", 4)


def test_a_lack_of_memory_is_not_blamed_on_a_checkpoint(tmp_path: Path) -> None:
    with pytest.raises(MemoryError), checkpoint_errors(tmp_path):
        raise MemoryError


@pytest.mark.parametrize("error", [RecursionError(), RunError("x"), MemoryError(), OSError(5, "x")])
def test_any_exception_saves_a_checkpoint_first(error: Exception, small: Any) -> None:
    def fail(training: Training) -> None:
        if training.progress is not None and training.progress.agent_steps >= 256:
            raise error

    config = small(checkpoint_every_updates=None)
    with pytest.raises(type(error)):
        train(config, hooks=Hooks(on_update=fail))
    run = config.runs / "run"
    assert read_checkpoint(checkpoints(run)[-1]).agent_steps == 256
    assert json.loads((run / "result.json").read_bytes())["stop_reason"] == "failed"
    assert train(config, resume=run).agent_steps == config.total_steps


def test_an_error_is_shown_though_nothing_can_be_saved(
    small: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(training: Training) -> None:
        monkeypatch.setattr(os, "fsync", full)
        raise ZeroDivisionError

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(ZeroDivisionError):
        train(small(), hooks=Hooks(on_update=fail))
    assert "no checkpoint of step" in caplog.text


@pytest.mark.curve
def test_damaged_metrics_are_left_out_and_the_others_kept(
    run: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = run / "metrics.jsonl"
    lines = path.read_bytes().splitlines()
    odd = [b"\xff\xfe", b"[" * 100_000, b"7", b'{"agent_steps": "a", "policies": {}}',
           b'{"agent_steps": 1, "policies": {"agent": 3}}']  # fmt: skip
    few = b'{"agent_steps": 96, "policies": {"agent": {"mean_return": "x"}}}'
    path.write_bytes(b"\n".join([lines[0], *odd, few, *lines[1:], lines[0][:20]]))
    assert len(read_metrics(path)) == len(lines) + 1
    assert f"{path}: 6 lines are damaged" in caplog.text
    config = replace(RunFolder(run).read_config(), total_steps=256)
    train(config, resume=run)
    steps = [line["agent_steps"] for line in read_metrics(path)]
    assert steps[0] == json.loads(lines[0])["agent_steps"]
    assert steps[-1] == 256
    assert (run / "learning_curve.png").is_file()
    assert list_runs(run)[0].agent_steps == 256


@pytest.mark.curve
@pytest.mark.parametrize("name", ["metrics.jsonl", "result.json", "learning_curve.png", ".lock"])
@pytest.mark.parametrize("kind", ["folder", "pipe"])
def test_something_else_in_the_place_of_a_file_is_one_error_or_none(
    name: str, kind: str, run: Path
) -> None:
    (run / name).unlink(missing_ok=True)
    if kind == "folder":
        (run / name).mkdir()
        (run / name / "kept").write_bytes(b"")
    else:
        os.mkfifo(run / name)
    config = replace(RunFolder(run).read_config(), total_steps=256)
    try:
        train(config, resume=run)
    except LudusError as error:
        assert str(run) in error.message
    assert list_runs(run)
    assert kind == "pipe" or (run / name / "kept").exists()


@pytest.mark.parametrize("kind", ["folder", "pipe"])
def test_a_log_that_cannot_be_written_is_said_once(
    kind: str, run: Path, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    caplog.set_level(logging.INFO, "ludus")
    (run / "train.log").unlink(missing_ok=True)
    (run / "train.log").mkdir() if kind == "folder" else os.mkfifo(run / "train.log")
    train(replace(RunFolder(run).read_config(), total_steps=256), resume=run)
    assert caplog.text.count("train.log is not written") == 1
    assert "Logging error" not in capsys.readouterr().err


@contextmanager
def without_rights() -> Generator[None, None, None]:
    """Be a user who may not write everywhere, as root may."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


def test_a_read_only_run_is_one_error(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", str(run), "--episodes", "1"]) == 0  # all is imported now
    with tempfile.TemporaryDirectory() as parent:  # pytest's own folders are closed to others
        Path(parent).chmod(0o755)
        closed = Path(shutil.copytree(run, f"{parent}/run"))
        for path in (closed, *closed.rglob("*")):
            path.chmod(0o555 if path.is_dir() else 0o444)
        with without_rights():
            assert main(["evaluate", str(closed), "--episodes", "1"]) == 0
            capsys.readouterr()
            assert main(["train", "--resume", str(closed)]) == 5
            shown = capsys.readouterr().err
            assert f"cannot write the run folder {closed}: " in shown
            assert "Permission denied" in shown
            assert main(["control", str(closed), "--stop"]) == 5
            shown = capsys.readouterr().err
            assert "defect" not in shown
            assert str(closed) in shown
        for path in (closed, *closed.rglob("*")):
            path.chmod(0o755)


def test_a_run_that_is_resumed_is_never_removed(run: Path) -> None:
    shutil.rmtree(run / "checkpoints")
    for path in run.iterdir():
        if path.name not in {"config.json", ".lock"}:
            path.unlink()
    with pytest.raises(RunError, match="no checkpoint in"):
        train(RunFolder(run).read_config(), resume=run)
    assert (run / "config.json").is_file()
