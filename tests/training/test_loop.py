"""Whole runs: what they leave, how they resume, and how they fail."""

from __future__ import annotations

import errno
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest
import torch

from ludus.algorithms.learner import LearnerState
from ludus.algorithms.ppo import PPO
from ludus.errors import CheckpointError, DivergenceError, EngineCrashed, RunError
from ludus.play.evaluation import Evaluation
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.runs.checkpoint import Checkpoint, read_checkpoint
from ludus.runs.metrics import METRICS, POLICY_METRICS, read_metrics
from ludus.runs.run_folder import RunFolder
from ludus.session.gymnasium_session import GymnasiumSession
from ludus.settings.policy_config import Mode
from ludus.settings.train_config import Phase
from ludus.training import final_evaluation
from ludus.training.loop import train
from ludus.training.progress import Progress, SilentReporter
from ludus.training.trainer import Trainer
from tests.runs.test_damaged_runs import reseal

ROOT = Path(__file__).parents[2]
SAC_METRICS = {
    "q_loss", "mean_q", "temperature", "temperature_loss", "gradient_steps", "replay_size",
}  # fmt: skip
# Metrics that a run of PPO without self-play, demonstrations and curiosity does not have.
ELSEWHERE = {"elo", "imitation_weight", "imitation_loss", "novelty"} | SAC_METRICS


def newest(run: Path) -> Checkpoint:
    return RunFolder(run).checkpoints().newest()[1]


def is_equal(first: Checkpoint, second: Checkpoint) -> bool:
    one, two = first.learners["agent"].tensors, second.learners["agent"].tensors
    return one.keys() == two.keys() and all(torch.equal(one[name], two[name]) for name in one)


@pytest.mark.curve
def test_leaves_a_complete_folder(small: Any) -> None:
    result = train(small(evaluation_episodes=20))
    names = {path.name for path in result.path.iterdir()}
    expected = {"config.json", "checkpoints", "metrics.jsonl", "learning_curve.png"}
    assert expected | {"evaluation.json"} <= names
    assert any(name.startswith("events.out.tfevents") for name in names)
    assert (result.path / "learning_curve.png").read_bytes().startswith(b"\x89PNG")
    assert (result.stop_reason, result.agent_steps, result.updates) == ("total_steps", 640, 10)
    evaluation = json.loads((result.path / "evaluation.json").read_bytes())
    assert len(evaluation["agent"]["returns"]) == 20


def test_a_run_whose_episodes_never_end_is_whole(
    small: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(final_evaluation, "ENDLESS_STEPS", 50)
    result = train(small("gym:Endless-v0", evaluation_episodes=2))
    assert (result.stop_reason, result.agent_steps, result.evaluation) == ("total_steps", 640, {})
    assert (
        "no evaluation: policy agent: 0 of 2 episodes ended within 50 steps; set max_ep"
        in caplog.text
    )
    written = json.loads((result.path / "result.json").read_bytes())
    assert (written["stop_reason"], written["evaluation"]) == ("total_steps", {})


def test_every_metric_is_documented_and_steps_grow(small: Any) -> None:
    result = train(small("gym:Identity-continuous-v0"))
    lines = read_metrics(result.path / "metrics.jsonl")
    assert [line["agent_steps"] for line in lines] == list(range(64, 641, 64))
    for line in lines:
        assert line.keys() - {"policies"} == METRICS.keys()
        assert line["policies"]["agent"].keys() <= POLICY_METRICS.keys()
    assert POLICY_METRICS.keys() - lines[-1]["policies"]["agent"].keys() <= ELSEWHERE


def test_events_can_be_read_by_tensorboard(small: Any) -> None:
    from tensorboard.backend.event_processing.event_file_loader import EventFileLoader

    result = train(small())
    (path,) = result.path.glob("events.out.tfevents*")
    events: list[Any] = list(cast(Any, EventFileLoader(str(path))).Load())
    values = {(value.tag, event.step) for event in events for value in event.summary.value}
    assert ("agent/entropy", 640) in values
    assert ("run/steps_per_s", 64) in values


@pytest.mark.slow
def test_equal_seeds_give_equal_weights(small: Any) -> None:
    first, second = train(small(name="a")), train(small(name="b"))
    other = train(small(name="c", seed=8))
    assert is_equal(newest(first.path), newest(second.path))
    assert not is_equal(newest(first.path), newest(other.path))


@pytest.mark.slow
def test_resume_continues_the_run(small: Any) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    config = small()
    first = train(config)
    second = train(replace(config, total_steps=1280), resume=first.path)
    assert second.path == first.path
    steps = [line["agent_steps"] for line in read_metrics(first.path / "metrics.jsonl")]
    assert steps == list(range(64, 1281, 64))
    assert len(list(first.path.glob("events.out.tfevents*"))) == 2
    events: Any = EventAccumulator(str(first.path))
    events.Reload()
    assert [event.step for event in events.Scalars("agent/entropy")] == steps
    assert newest(first.path).run["episodes"]["agent"]["num_episodes"] > 0


def test_resume_replaces_a_corrupt_newest_checkpoint(
    small: Any, caplog: pytest.LogCaptureFixture
) -> None:
    config = small()
    first = train(config)
    path = RunFolder(first.path).checkpoints().paths()[-1]
    (path / "tensors.safetensors").write_bytes(b"half")
    second = train(config, resume=first.path)
    assert (second.stop_reason, second.agent_steps) == ("total_steps", 640)
    assert f"{path} was renamed to unloadable-{path.name}" in caplog.text
    assert read_checkpoint(path).agent_steps == 640
    assert newest(first.path).agent_steps == 640


@pytest.mark.slow
@pytest.mark.parametrize("ppo", [{}, {"curiosity": 0.5}, {"frame_stack": 3}], ids=str)
def test_exact_resume_equals_an_uninterrupted_run(ppo: dict[str, Any], small: Any) -> None:
    ppo = {"learning_rate_schedule": "constant", **ppo}
    config = small(exact_resume=True, checkpoint_every_updates=2, ppo=ppo, total_steps=768)
    whole = train(replace(config, name="whole"))
    half = train(replace(config, name="half", total_steps=384))
    assert half.agent_steps == 384
    train(replace(config, name="half"), resume=half.path)
    assert is_equal(newest(whole.path), newest(half.path))


def test_resume_of_another_spec_names_the_policy(small: Any) -> None:
    first = train(small())
    with pytest.raises(CheckpointError, match="other observations or actions of policy agent"):
        train(small("gym:Identity-continuous-v0"), resume=first.path)


def test_resume_with_another_network_is_refused(small: Any) -> None:
    first = train(small())
    changed = replace(small(), ppo=replace(small().ppo, hidden_sizes=(17,)))
    wrong = r"policies\.agent\.hidden_sizes is \[17\] instead of \[16\]"
    with pytest.raises(CheckpointError, match=wrong):
        train(changed, resume=first.path)
    with pytest.raises(CheckpointError, match='algorithm is "sac" instead of "ppo"'):
        train(replace(small(), algorithm="sac"), resume=first.path)


def test_resume_names_settings_that_differ(small: Any, caplog: pytest.LogCaptureFixture) -> None:
    first = train(small())
    changed = replace(small(total_steps=704), ppo=replace(small().ppo, learning_rate=1e-5))
    train(changed, resume=first.path)
    assert "goes on with other settings: " in caplog.text
    assert "total_steps is 704 instead of 640" in caplog.text
    assert "policies.agent.learning_rate is 1e-05 instead of 0.001" in caplog.text


def test_resume_at_a_limit_names_it_and_keeps_the_evaluation(
    small: Any, caplog: pytest.LogCaptureFixture
) -> None:
    first = train(small(evaluation_episodes=2))
    written = (first.path / "result.json").read_bytes()
    second = train(small(evaluation_episodes=2), resume=first.path)
    assert (second.stop_reason, second.evaluation) == ("total_steps", first.evaluation)
    assert f"{first.path} is finished: it has reached its total_steps of 640; " in caplog.text
    assert f"ludus train --resume {first.path} --total-steps" in caplog.text
    assert (first.path / "result.json").read_bytes() == written
    train(small(evaluation_episodes=2, target_return=-1e9, return_window=1, total_steps=1280),
          resume=first.path)  # fmt: skip
    assert "reached its target_return of -1e+09; to train it further, raise that" in caplog.text
    train(small(evaluation_episodes=2, total_steps=1280, max_time_s=1000.0), resume=first.path)
    assert re.search(r"max_time_s is 1000 s: \d+ s of it are left", caplog.text)


def test_an_evaluation_of_before_is_no_result_of_a_run_that_went_on(small: Any) -> None:
    first = train(small(evaluation_episodes=2))
    further = small(evaluation_episodes=2, total_steps=1280)
    second = train(further, resume=first.path, reporter=Killer(signal.SIGINT, after=5))
    assert second.stop_reason == "interrupted"
    assert not (first.path / "evaluation.json").exists()
    assert train(further, resume=first.path).evaluation


def test_a_corrupt_checkpoint_is_left_out_though_settings_differ(
    small: Any, caplog: pytest.LogCaptureFixture
) -> None:
    first = train(small())
    *_, path = RunFolder(first.path).checkpoints().paths()
    reseal(path, lambda state: state["run"].pop("wall_s"))
    changed = replace(small(), ppo=replace(small().ppo, learning_rate=1e-5))
    assert train(changed, resume=first.path).agent_steps == 640
    assert f"{path} was renamed to unloadable-{path.name}" in caplog.text


def test_an_evaluation_that_never_ends_is_played_once(
    small: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never_ends(*_: Any, **__: Any) -> Any:
        played.append(True)
        raise RunError("no episode ended")

    played: list[bool] = []
    monkeypatch.setattr(final_evaluation, "evaluate", never_ends)
    result = train(small(target_return=-1e9, return_window=1, evaluation_episodes=2))
    assert (result.stop_reason, result.evaluation, len(played)) == ("target_return", {}, 1)


def test_divergence_saves_the_state_and_keeps_good_checkpoints(small: Any) -> None:
    config = small("gym:Poisoned-v0", ppo={"scale_reward": False}, checkpoint_every_updates=1)
    with pytest.raises(DivergenceError, match=r"policy agent: .*value_loss is inf") as info:
        train(config)
    run = config.runs / "run"
    assert str(run / "diverged") in info.value.hint
    assert read_checkpoint(run / "diverged").agent_steps > newest(run).agent_steps > 0
    weights = newest(run).learners["agent"].tensors.values()
    assert all(torch.isfinite(tensor.double()).all() for tensor in weights)


def test_divergence_in_the_last_gradient_steps_saves_the_state(
    small: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def diverge(ppo: PPO) -> LearnerState:
        if trainers[0].updates == 2 and len(trainers) == 1:
            trainers.append(trainers[0])
            raise DivergenceError("policy agent: value_loss is nan", "lower it")
        return state(ppo)

    def run(trainer: Trainer, *arguments: Any) -> Any:
        trainers.append(trainer)
        return run_trainer(trainer, *arguments)

    trainers: list[Trainer] = []
    state, run_trainer = PPO.state, Trainer.run
    monkeypatch.setattr(PPO, "state", diverge)
    monkeypatch.setattr(Trainer, "run", run)
    config = small(total_steps=128, checkpoint_every_updates=None)
    with pytest.raises(DivergenceError, match="value_loss is nan"):
        train(config)
    assert read_checkpoint(config.runs / "run" / "diverged").agent_steps == 128


def test_divergence_while_engines_simulate_leaves_none_in_a_step(
    small: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def diverge(_: PPO) -> None:
        raise DivergenceError("policy agent: value_loss is nan", "lower it")

    def send(pool: EnginePool, engine: int, actions: Any) -> None:
        in_flight.add(engine)
        send_to(pool, engine, actions)

    def receive(pool: EnginePool, engine: int) -> Any:
        in_flight.discard(engine)
        return receive_from(pool, engine)

    in_flight: set[int] = set()
    send_to, receive_from = EnginePool.send, EnginePool.receive
    monkeypatch.setattr(PPO, "learn_while_stepping", diverge)
    monkeypatch.setattr(EnginePool, "send", send)
    monkeypatch.setattr(EnginePool, "receive", receive)
    with open_pool("gym:Identity-discrete-v0", PoolConfig(num_worlds=4, num_engines=2)) as pool:
        with pytest.raises(DivergenceError):
            train(small(ppo={"overlap": True}), pool=pool)
        assert not in_flight
        pool.reset(0)


def test_what_is_frozen_has_learnt_all_that_was_left(
    small: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With overlap, gradient steps are left when a phase ends; a save would take them later."""
    is_equal_after: list[bool] = []

    def set_mode(trainer: Trainer, policy: str, mode: Mode) -> None:
        set_mode_of(trainer, policy, mode)
        if trainer.updates:
            ppo: Any = trainer._learners[policy]  # pyright: ignore[reportPrivateUsage]
            before = [parameter.clone() for parameter in ppo.policy.parameters()]
            ppo.state()
            after = ppo.policy.parameters()
            is_equal_after.append(all(map(torch.equal, before, after)))

    set_mode_of = Trainer.set_mode
    monkeypatch.setattr(Trainer, "set_mode", set_mode)
    schedule = (Phase(3, {}), Phase(1, {"agent": "frozen"}))
    train(small(ppo={"overlap": True}, schedule=schedule))
    assert is_equal_after[:2] == [True, True]


def test_a_full_disk_ends_the_run_with_one_error(
    small: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, fsync, calls = small(), os.fsync, 0

    def full(descriptor: int) -> None:
        nonlocal calls
        calls += 1
        if calls > 12:
            raise OSError(errno.ENOSPC, "No space left on device")
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RunError, match=r"cannot write the checkpoint .*: the disk is full"):
        train(config)
    monkeypatch.undo()
    assert newest(config.runs / "run").agent_steps > 0


def test_a_failed_engine_leaves_a_checkpoint(small: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    config, receive, calls = small(checkpoint_every_updates=None), GymnasiumSession.receive, 0

    def fail(session: GymnasiumSession) -> Any:
        nonlocal calls
        calls += 1
        if calls == 50:
            raise EngineCrashed("the engine died")
        return receive(session)

    monkeypatch.setattr(GymnasiumSession, "receive", fail)
    with pytest.raises(EngineCrashed):
        train(config)
    assert newest(config.runs / "run").agent_steps >= 192


class Killer(SilentReporter):
    """Sends a signal after some updates."""

    def __init__(self, signum: int, after: int) -> None:
        self.signum, self.left = signum, after

    def updated(self, progress: Progress) -> None:
        self.left -= 1
        if self.left == 0:
            os.kill(os.getpid(), self.signum)


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_saves_and_stops(small: Any, signum: int) -> None:
    before = signal.getsignal(signum)
    result = train(small(evaluation_episodes=20), reporter=Killer(signum, after=4))
    assert (result.stop_reason, result.signum) == ("interrupted", signum)
    assert newest(result.path).agent_steps == result.agent_steps == 256
    assert not result.evaluation
    assert signal.getsignal(signum) is before


def test_limits_stop_the_run(small: Any) -> None:
    assert train(small(name="t", max_time_s=1e-6)).stop_reason == "max_time"
    result = train(small(name="r", target_return=-1.0, return_window=5))
    assert result.stop_reason == "target_return"
    assert result.agent_steps < 640


def test_a_target_that_only_drawn_actions_reach_does_not_end_training(
    small: Any, caplog: pytest.LogCaptureFixture
) -> None:
    config = small("gym:Changing-v0", target_return=2.0, return_window=8, evaluation_episodes=8)
    result = train(config)
    assert (result.stop_reason, result.agent_steps) == ("total_steps", 640)
    assert result.evaluation["agent"].mean_return == 0.0
    said = "target_return 2 is reached in training, and 0 ± 0 in an evaluation: training goes on"
    assert said in caplog.text
    unchecked = train(replace(config, evaluation_episodes=0, name="unchecked"))
    assert unchecked.stop_reason == "target_return"


def test_training_goes_on_until_an_evaluation_reaches_the_target(
    small: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    played: list[float] = []

    def evaluate(*arguments: Any, **named: Any) -> dict[str, Evaluation]:
        found = play(*arguments, **named)
        played.append(found["agent"].mean_return)
        return found if len(played) > 2 else {"agent": Evaluation.of([-50.0, -51.0], [8, 8])}

    play = final_evaluation.evaluate
    monkeypatch.setattr(final_evaluation, "evaluate", evaluate)
    config = small(target_return=0.0, return_window=8, evaluation_episodes=8)
    result = train(config)
    assert (result.stop_reason, len(played)) == ("target_return", 3)
    assert result.agent_steps == 3 * 64  # each time as many more as it takes to end 8 episodes
    assert result.evaluation["agent"].mean_return == played[-1]
    saved = json.loads((result.path / "evaluation.json").read_bytes())
    assert saved["agent"]["mean_return"] == played[-1]


def test_a_run_that_is_killed_after_an_evaluation_that_fell_short_is_trained_further(
    small: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fall_short(*_: Any, **__: Any) -> dict[str, Evaluation]:
        return {"agent": Evaluation.of([-50.0, -51.0], [8, 8])}

    def die(*_: Any, **__: Any) -> Any:
        raise KeyboardInterrupt

    config = small(target_return=0.0, return_window=8, evaluation_episodes=8)
    with monkeypatch.context() as patch:
        patch.setattr(final_evaluation, "evaluate", fall_short)
        patch.setattr(Trainer, "_forget_returns", die)
        with pytest.raises(KeyboardInterrupt):
            train(config)
    result = train(config, resume=config.runs / config.name)
    assert result.stop_reason == "target_return"
    assert result.evaluation["agent"].mean_return >= 0.0


@pytest.mark.slow
def test_kill_at_any_moment_leaves_a_loadable_run(small: Any) -> None:
    """A child saves all the time and is killed at random moments; each time it can resume."""
    config = small(total_steps=10_000_000, checkpoint_every_updates=1)
    program = (
        "import sys; from tests.training.environments import register; register()\n"
        "from pathlib import Path\n"
        "from dataclasses import replace\n"
        "from ludus.runs.run_folder import RunFolder; from ludus.training.loop import train\n"
        "run = Path(sys.argv[1]); config = RunFolder(run).read_config()\n"
        "print('ready', flush=True); train(config, resume=run)\n"
    )
    run = train(replace(config, total_steps=64)).path
    RunFolder(run).write_config(config)
    steps, chance = 64, random.Random(0)
    for _ in range(2):
        child = subprocess.Popen(
            [sys.executable, "-c", program, str(run)], cwd=ROOT, stdout=subprocess.PIPE
        )
        assert child.stdout is not None
        child.stdout.readline()
        deadline = time.monotonic() + 60
        while newest(run).agent_steps == steps and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(chance.uniform(0.0, 0.2))
        child.kill()
        child.wait()
        child.stdout.close()
        saved = newest(run).agent_steps
        assert saved > steps
        steps = saved
    result = train(replace(config, total_steps=steps + 64), resume=run)
    assert result.agent_steps == steps + 64
    assert not list((run / "checkpoints").glob(".*"))
    lines = [line["agent_steps"] for line in read_metrics(run / "metrics.jsonl")]
    assert lines == sorted(set(lines))


def test_run_folders_get_the_name_asked_for_or_one_of_target_and_time(
    small: Any, tmp_path: Path
) -> None:
    first, second = RunFolder.create(small(name="")), RunFolder.create(small(name=""))
    assert first.path != second.path
    assert first.path.name.startswith("Identity-discrete-v0-2")
    RunFolder.create(small(name="mine"))
    with pytest.raises(RunError, match=r"mine exists already\nhint: .*--resume .*--name NAME"):
        RunFolder.create(small(name="mine"))
    with pytest.raises(CheckpointError, match="is not a run"):
        RunFolder.find(tmp_path)


def test_a_run_that_never_starts_leaves_no_folder(small: Any) -> None:
    config = small("gym:Nowhere-v0")
    with pytest.raises(Exception, match="cannot make"):
        train(config)
    assert list(config.runs.iterdir()) == []
