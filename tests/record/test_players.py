"""Who plays in a film; here in an environment that needs no engine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ludus.cli.main import main
from ludus.errors import ConfigError, SetupError, TargetError
from ludus.model import PolicyModel, write_model
from ludus.model.policy_model import Distribution, Linear
from ludus.record import RecordConfig, record
from ludus.session.gymnasium_session import GymnasiumSession
from ludus.settings.train_config import PPOConfig, TrainConfig
from ludus.training.loop import train
from tests.record.games import STEPS, Ticks, read_ticks

TARGET = "gym:tests.record.games:Ticks-v0"


def policy_file(path: Path, bias: list[float], name: str = "agent") -> Path:
    """Write a policy that has these logits whatever it sees."""
    (spec,) = GymnasiumSession([Ticks()]).spec.policies
    layer = Linear(np.zeros((3, 1), np.float32), np.array(bias, np.float32), "none")
    write_model(
        path,
        PolicyModel(
            policy=name,
            fingerprint=spec.fingerprint(),
            observation=spec.observation,
            action=spec.action,
            has_action_mask=False,
            normalisation=None,
            images=(),
            memory=None,
            layers=(layer,),
            distribution=Distribution(None),
        ),
    )
    return path


@pytest.mark.screen
def test_a_policy_file_takes_its_most_probable_action(films: Path) -> None:
    out, policy = films / "film.mp4", policy_file(films / "agent.ludus.json", [0.0, 0.0, 1.0])
    recorded = record(RecordConfig(target=TARGET, out=out, policy=(policy,), num_episodes=2))
    episode = list(range(0, STEPS + 1, 2))
    assert read_ticks(out) == [*episode, *episode]
    assert recorded.num_episodes == {"agent": 2}


@pytest.mark.screen
def test_a_policy_file_draws_its_actions(films: Path) -> None:
    policy = policy_file(films / "agent.ludus.json", [-99.0, 0.0, 0.0])
    seen: list[list[int]] = []
    for seed in (1, 1, 2):
        config = RecordConfig(
            target=TARGET, out=films / "film.mp4", policy=(policy,), is_stochastic=True, seed=seed
        )
        record(config)
        seen.append(read_ticks(films / "film.mp4"))
    assert seen[0] == seen[1] != seen[2]
    assert set(np.diff(seen[0][:11])) <= {1, 2}


@pytest.mark.screen
def test_a_run_plays_what_it_was_trained_in(films: Path) -> None:
    config = TrainConfig(
        target=TARGET, num_worlds=2, num_engines=1, total_steps=64, seed=7, runs=films,
        name="run", evaluation_episodes=0, max_episode_steps=12,
        ppo=PPOConfig(rollout_steps=8, hidden_sizes=(8,)),
    )  # fmt: skip
    run = train(config).path
    out = films / "film.webm"
    for arguments in ([str(run)], [TARGET, "--policy", str(run)]):
        assert main(["record", *arguments, "--episodes", "1", "--out", str(out)]) == 0
        assert 2 <= len(read_ticks(out)) <= 13
    assert main(["record", str(run), "--random", "--episodes", "1", "--out", str(out)]) == 0
    assert 2 <= len(read_ticks(out)) <= 13


@pytest.mark.screen
def test_chance_plays_where_nobody_else_does(films: Path) -> None:
    recorded = record(RecordConfig(target=TARGET, out=films / "film.mp4", seconds=2.0, start=1.0))
    assert len(read_ticks(films / "film.mp4")) == recorded.num_frames == 60


@pytest.mark.screen
def test_policies_that_do_not_fit(films: Path) -> None:
    other = policy_file(films / "hero.ludus.json", [0.0, 0.0, 1.0], "hero")
    with pytest.raises(ConfigError, match="the game has the policies agent; the files hold hero"):
        record(RecordConfig(target=TARGET, out=films / "film.mp4", policy=(other,)))


@pytest.mark.screen
def test_what_cannot_be_filmed(films: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = films / "film.mp4"
    with pytest.raises(TargetError, match="render\\(\\) returned str"):
        record(RecordConfig(target="gym:tests.record.games:Blind-v0", out=out))
    with pytest.raises(SetupError, match="cannot draw: paint is not installed"):
        record(RecordConfig(target="gym:tests.record.games:Unpainted-v0", out=out))
    assert main(["record", "gym:Nowhere-v0", "--out", str(out)]) == 2
    assert "Gymnasium cannot make 'Nowhere-v0'" in capsys.readouterr().err
    assert list(films.iterdir()) == []
