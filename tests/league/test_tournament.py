"""Tournaments in real Godot between players whose strength is known."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import torch

from ludus.errors import CheckpointError, ConfigError, RunError
from ludus.league import tournament
from ludus.league.players import load_players, subsample
from ludus.league.tournament import TournamentConfig, play_tournament
from ludus.networks.policy import Player
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.session.engine_session import EngineSession
from ludus.settings.train_config import PPOConfig
from ludus.spec.batch import Batch
from ludus.training.loop import train
from tests.export.trained_runs import SIMPLE, make_policy
from tests.league.duel import chooser, make_project

GAMES = TournamentConfig(episodes=6)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_project(tmp_path_factory.mktemp("games") / "duel")


@pytest.fixture
def pool(request: pytest.FixtureRequest, project: Path) -> Iterator[EnginePool]:
    config = PoolConfig(num_worlds=5, num_engines=2, max_restarts=1)
    with open_pool(project / f"{request.param}.tscn", config) as opened:
        yield opened


def players(pool: EnginePool, policy: str, *choices: int) -> Any:
    """Return players that always make these choices; the last is the newest."""
    spec = pool.policies[policy]
    past = [chooser(spec, choice) for choice in choices[:-1]]
    return (*past, chooser(spec, choices[-1], is_newest=True))


@pytest.mark.engine
@pytest.mark.parametrize("pool", ["duel"], indirect=True)
@pytest.mark.parametrize("is_stochastic", [False, True])
def test_every_two_players_meet_as_often(pool: EnginePool, is_stochastic: bool) -> None:
    league_players = {"hero": players(pool, "hero", 0, 1, 3), "foe": players(pool, "foe", 2, 1)}
    seen: list[tuple[int, int]] = []
    config = TournamentConfig(episodes=6, is_stochastic=is_stochastic)
    (table,) = play_tournament(league_players, pool, config, lambda *of: seen.append(of))  # pyright: ignore
    assert [player.updates for player in table.rows] == [0, 1, 3]
    assert [player.is_newest for player in table.columns] == [False, True]
    assert table.wins.tolist() == [[0, 0], [0, 0], [6, 6]]
    assert table.draws.tolist() == [[0, 0], [0, 6], [0, 0]]
    assert table.losses.tolist() == [[6, 6], [6, 0], [0, 0]]
    assert table.shares.tolist() == [[0.0, 0.0], [0.0, 0.5], [1.0, 1.0]]
    assert seen[-1] == (36, 36)


@pytest.mark.engine
@pytest.mark.parametrize("pool", ["mirror"], indirect=True)
def test_players_of_one_policy_meet_in_both_teams(pool: EnginePool) -> None:
    (table,) = play_tournament({"twin": players(pool, "twin", 2, 1, 3)}, pool, GAMES)
    assert table.rows == table.columns
    assert table.wins.tolist() == [[0, 6, 0], [0, 0, 0], [6, 6, 0]]
    assert (table.losses == table.wins.T).all()
    assert np.isnan(np.diag(table.shares)).all()


@pytest.mark.engine
@pytest.mark.parametrize("pool", ["mirror"], indirect=True)
def test_one_player_alone_has_nobody_to_meet(pool: EnginePool) -> None:
    assert play_tournament({"twin": players(pool, "twin", 2)}, pool, GAMES) == []


@pytest.mark.engine
@pytest.mark.parametrize("pool", ["trio"], indirect=True)
def test_three_policies_make_three_tables(pool: EnginePool) -> None:
    league_players = {
        "hero": players(pool, "hero", 0, 2),
        "foe": players(pool, "foe", 3, 1),
        "third": players(pool, "third", 1),
    }
    tables = play_tournament(league_players, pool, GAMES)
    found = {
        (table.rows[0].policy, table.columns[0].policy): table.shares.tolist() for table in tables
    }
    assert found == {
        ("hero", "foe"): [[0.0, 0.0], [0.0, 1.0]],
        ("hero", "third"): [[0.0], [1.0]],
        ("foe", "third"): [[1.0], [0.5]],
    }


@pytest.mark.engine
@pytest.mark.parametrize("pool", ["squads"], indirect=True)
def test_a_game_goes_on_when_one_of_a_team_has_died(pool: EnginePool) -> None:
    league_players = {"hero": players(pool, "hero", 3), "foe": players(pool, "foe", 2)}
    (table,) = play_tournament(league_players, pool, GAMES)
    # 3 + 4 * 3 against 2 * 4 * 2; when the first hero dies, it is 6 against 4.
    assert table.losses.tolist() == [[6]]


@pytest.mark.engine
@pytest.mark.parametrize("pool", ["duel"], indirect=True)
def test_games_of_an_engine_that_died_are_played_again(pool: EnginePool) -> None:
    league_players = {"hero": players(pool, "hero", 3), "foe": players(pool, "foe", 2)}
    (first, _) = cast(list[EngineSession], pool.sessions)
    assert first.pid is not None
    alive = [first.pid]

    def kill_one(played: int, _: int) -> None:
        if played >= 10 and alive:  # the first game of each of ten worlds
            os.kill(alive.pop(), signal.SIGKILL)

    config = TournamentConfig(episodes=40)
    (table,) = play_tournament(league_players, pool, config, kill_one)
    assert pool.num_restarts == 1
    assert table.wins.tolist() == [[40]]


@pytest.mark.engine
@pytest.mark.parametrize("pool", ["duel"], indirect=True)
def test_games_that_do_not_end_are_given_up(
    pool: EnginePool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tournament, "MAX_STEPS", 2)
    league_players = {"hero": players(pool, "hero", 3), "foe": players(pool, "foe", 2)}
    with pytest.raises(RunError, match="no game ended within 2 steps"):
        play_tournament(league_players, pool, GAMES)


def test_a_player_forgets_single_slots() -> None:
    """One that paused while its agent died would otherwise take a memory into the next game."""
    policy = make_policy(SIMPLE, PPOConfig(hidden_sizes=(8,), memory_size=6))
    player = Player(policy, 2)
    batch = Batch.allocate(SIMPLE, 2)
    batch.active[:] = True
    batch.observation["position"][:] = 1.0

    def memory() -> torch.Tensor:
        player.act(batch)
        state = player._state  # pyright: ignore[reportPrivateUsage]
        assert state is not None
        return state.clone()

    first, second = memory(), memory()
    player.forget(np.asarray([1]))
    third = memory()
    assert torch.equal(third[1], first[1])
    assert not torch.equal(third[0], first[0])
    assert not torch.equal(third[0], second[0])


def test_a_game_of_one_agent_is_refused(small: Any) -> None:
    from ludus.pool import open_pool

    run = train(small()).path
    _, _, league_players = load_players(run)
    with pytest.raises(ConfigError, match="agent is the only agent of a world"):
        play_tournament(league_players, open_pool("gym:Identity-discrete-v0"), GAMES)


def test_without_a_league_older_checkpoints_are_the_past(small: Any) -> None:
    run = train(small(checkpoint_every_updates=2, keep_checkpoints=4)).path
    path, newest, league_players = load_players(run)
    assert path.name == f"step-{newest.agent_steps:012d}" == "step-000000000640"
    agents = league_players["agent"]
    assert [agent.updates for agent in agents] == [4, 6, 8, 10]
    assert [agent.is_newest for agent in agents] == [False, False, False, True]
    earlier = run / "checkpoints" / "step-000000000384"
    assert [agent.updates for agent in load_players(earlier)[2]["agent"]] == [4, 6]


def test_a_damaged_checkpoint_is_left_out(small: Any) -> None:
    run = train(small(checkpoint_every_updates=2, keep_checkpoints=4)).path
    (run / "checkpoints" / "step-000000000384" / "tensors.safetensors").write_bytes(b"no")
    assert [agent.updates for agent in load_players(run)[2]["agent"]] == [4, 8, 10]


def test_a_league_of_another_shape_is_corrupt(small: Any) -> None:
    run = train(small()).path
    state = run / "checkpoints" / "step-000000000640" / "state.json"
    values = json.loads(state.read_bytes())
    del values["state_sha256"]  # as versions before it wrote them
    values["run"]["league"] = {"past": 3, "ratings": {}}
    state.write_text(json.dumps(values))
    with pytest.raises(CheckpointError, match=r"step-000000000640 is corrupt"):
        load_players(run)


def test_subsampling_keeps_the_first_and_the_last(small: Any) -> None:
    run = train(small(checkpoint_every_updates=1, keep_checkpoints=99)).path
    agents = load_players(run)[2]["agent"]
    assert [agent.updates for agent in agents] == list(range(11))
    assert [agent.updates for agent in subsample(agents, 3)] == [0, 5, 10]
    assert [agent.updates for agent in subsample(agents, 2)] == [0, 10]
    assert subsample(agents, 11) == subsample(agents, 99) == agents
