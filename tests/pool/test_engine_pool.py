"""Many engines as one, some of which die."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from ludus.engine import CorePlan, ReservedCores
from ludus.errors import (
    EngineCrashed,
    EngineError,
    EngineStartError,
    EngineTimeout,
    GameError,
    SequenceError,
    UsageError,
)
from ludus.pool.engine_pool import EnginePool
from ludus.session.engine_session import EngineSession
from ludus.session.supervision import Supervision
from ludus.settings.world_parameters import Sampler
from ludus.spec.batch import ActionBatch, Batches
from ludus.wire.handshake import EngineConfig
from ludus.wire.reset import ResetRequest
from tests.actions import zeros
from tests.fake_engine import POLICIES, FakeEngine, Talk, end_all
from tests.wire.reference import decode_reset, decode_step, encode_batch, frame, quiet_batch

TARGET = "Ziel ✓"


class Fleet:
    """Starts fake engines; engine *k* shows ``100·k + starts·10 + step`` in every entry.

    Attributes:
        deaths: ``(engine, start)`` → number of the request at which it goes.
        frozen: Those of ``deaths`` that freeze rather than end.
        torn: Those of ``deaths`` that go in the middle of an answer.
        broken: ``(engine, start)`` that cannot be started.
    """

    def __init__(self) -> None:
        self.deaths: dict[tuple[int, int], int] = {}
        self.frozen: set[tuple[int, int]] = set()
        self.torn: set[tuple[int, int]] = set()
        self.broken: set[tuple[int, int]] = set()
        self.num_starts: dict[int, int] = {}
        self.engines: dict[tuple[int, int], FakeEngine] = {}
        self.sessions: list[EngineSession] = []
        self._lock = threading.Lock()

    def open(self, engine: int) -> EngineSession:
        with self._lock:
            start = self.num_starts.get(engine, 0)
            self.num_starts[engine] = start + 1
        if (engine, start) in self.broken:
            raise EngineStartError(f"engine {engine} is broken")
        fake = FakeEngine(lambda talk: self._play(talk, engine, start), POLICIES)
        self.engines[engine, start] = fake
        timeout_s = 1.0 if (engine, start) in self.frozen else 5.0
        session = EngineSession(
            fake.link(), EngineConfig(), Supervision(None), fake.greeting(), timeout_s
        )
        self.sessions.append(session)
        return session

    def _play(self, talk: Talk, engine: int, start: int) -> None:
        talk.greet()
        number = 0
        while (name := talk.read()[0]) in {"RESET", "STEP"}:
            if self.deaths.get((engine, start)) == number:
                if (engine, start) in self.torn:
                    torn = quiet_batch(talk.spec, value=77.0)
                    talk.raw(frame("BATCH", encode_batch(talk.spec, torn))[:-8])
                if (engine, start) in self.frozen:
                    talk.wait_for_the_end()
                return
            value = 100.0 * engine + 10.0 * start + number
            content = quiet_batch(talk.spec, is_reset=name == "RESET", value=value)
            content["policies"][TARGET] |= {"active": [1, 1, 0, 1, 1, 0], **self._end(value)}
            talk.raw(frame("BATCH", encode_batch(talk.spec, content)))
            number += 1

    def _end(self, value: float) -> dict[str, Any]:
        """In step 2 of every engine its target in slot 4 ends."""
        if value % 10 != 2:
            return {}
        final = {"slots": [4], "observation": {"place": [[[-value], [-value]]]}}
        return {"terminated": [0, 0, 0, 0, 1, 0], "reward": [0, 0, 0, 0, value, 0], "final": final}

    def received(self, engine: int, start: int = 0) -> list[tuple[str, bytes]]:
        return self.engines[engine, start].talk.received

    def end(self) -> None:
        end_all(self.sessions, self.engines.values())


@pytest.fixture
def fleet() -> Iterator[Fleet]:
    made = Fleet()
    yield made
    made.end()


def first_elements(batches: Batches) -> list[float]:
    """One number per hero, which tells where it came from."""
    return batches["hero"].observation["aim"][:, 0].tolist()


# Order


def test_rows_of_engines_follow_each_other(fleet: Fleet) -> None:
    pool = EnginePool(fleet.open, 3)
    assert (pool.num_engines, pool.num_agents("hero"), pool.num_agents(TARGET)) == (3, 6, 18)
    assert [pool.rows(TARGET, engine) for engine in range(3)] == [
        slice(0, 6),
        slice(6, 12),
        slice(12, 18),
    ]
    assert first_elements(pool.reset(1)) == [0, 0, 100, 100, 200, 200]
    batches = pool.step(zeros(pool))
    assert first_elements(batches) == [1, 1, 101, 101, 201, 201]
    for engine in range(3):
        rows = pool.rows(TARGET, engine)
        assert set(batches[TARGET].observation["place"][rows].flat) == {100.0 * engine + 1}
    assert batches[TARGET].active.tolist() == [True, True, False] * 6


def test_final_observations_are_joined_in_the_order_of_slots(fleet: Fleet) -> None:
    pool = EnginePool(fleet.open, 2)
    pool.reset(1)
    pool.step(zeros(pool))
    batch = pool.step(zeros(pool))[TARGET]
    assert batch.final_index.tolist() == [4, 10]
    assert batch.final_observation["place"][:, 0, 0].tolist() == [-2.0, -102.0]
    assert np.flatnonzero(batch.terminated).tolist() == [4, 10]
    assert batch.reward[[4, 10]].tolist() == [2.0, 102.0]


def test_joined_batches_stay_valid(fleet: Fleet) -> None:
    pool = EnginePool(fleet.open, 2)
    first = pool.reset(1)
    pool.step(zeros(pool))
    assert first_elements(first) == [0, 0, 100, 100]


def test_each_engine_gets_its_own_actions(fleet: Fleet) -> None:
    pool = EnginePool(fleet.open, 2)
    pool.reset(1)
    actions = zeros(pool)
    actions["hero"].discrete[:, 0] = [0, 1, 2, 3]
    pool.step(actions)
    for engine, expected in enumerate([[[0], [1]], [[2], [3]]]):
        payload = fleet.received(engine)[-1][1]
        assert decode_step(POLICIES, payload)["policies"]["hero"]["discrete"] == expected


def test_worlds_are_counted_over_all_engines(fleet: Fleet) -> None:
    pool = EnginePool(fleet.open, 2)
    pool.reset(5, [{"i": 0}, None, {"i": 2}, None])
    pool.reset(None, {"all": True})
    expected = [
        (["5", "6"], [{"i": 0}, None]),
        (["7", "8"], [{"i": 2}, None]),
    ]
    for engine, (seeds, parameters) in enumerate(expected):
        (_, first), (_, second) = fleet.received(engine)[2:]
        assert decode_reset(first)["seeds"] == [seed.zfill(16) for seed in seeds]
        assert decode_reset(first)["actions"] == [2, 2]
        assert decode_reset(first)["parameters"] == parameters
        assert decode_reset(second)["actions"] == [1, 1]
        assert decode_reset(second)["parameters"] == {"all": True}


def drawn(fleet: Fleet, engine: int = 0) -> list[float | None]:
    """Return what the worlds of an engine were last given as ``wind``."""
    given = decode_reset(fleet.received(engine)[-1][1])["parameters"]
    return [world["wind"] if world else None for world in given]


WIND = {"wind": Sampler(uniform=(0.0, 1.0))}


def test_draws_follow_from_seeds_that_came_before(fleet: Fleet) -> None:
    pool = EnginePool(fleet.open, 2)
    pool.reset(0)
    pool.randomise(WIND)
    pool.reset()
    draws = drawn(fleet, 0) + drawn(fleet, 1)
    assert len(set(draws)) == 4
    pool.reset(0)
    assert drawn(fleet, 0) + drawn(fleet, 1) == draws
    pool.reset_worlds(ResetRequest(np.asarray([3, 2, 1, 0], "u8"), np.full(4, 2, "u1")))
    pool.randomise(WIND)
    pool.reset()
    assert (drawn(fleet, 0) + drawn(fleet, 1))[::-1] == draws


def test_the_first_request_begins_every_world_with_a_seed(fleet: Fleet) -> None:
    """Worlds without one would all play the same episodes."""
    pool = EnginePool(fleet.open, 2)
    pool.reset_worlds(ResetRequest(np.asarray([0, 7, 0, 0], "u8"), np.asarray([1, 2, 1, 0], "u1")))
    first, second = (decode_reset(fleet.received(engine)[-1][1]) for engine in (0, 1))
    seeds = first["seeds"] + second["seeds"]
    assert first["actions"] + second["actions"] == [2, 2, 2, 2]
    assert seeds[1] == f"{7:016x}"
    assert len({*seeds, f"{0:016x}"}) == 5


def test_worlds_draw_before_they_get_a_seed(fleet: Fleet) -> None:
    pool = EnginePool(fleet.open, 1)
    pool.randomise(WIND)
    pool.reset_worlds(ResetRequest(np.zeros(2, "u8"), np.asarray([2, 1], "u1")))
    assert None not in drawn(fleet)


def test_engines_one_by_one(fleet: Fleet) -> None:
    pool = EnginePool(fleet.open, 2)
    pool.reset(1)
    own = {name: ActionBatch.zeros(p, p.num_agents) for name, p in pool.policies.items()}
    pool.send(1, own)
    assert first_elements(pool.receive(1)) == [101, 101]
    pool.send(0, own)
    pool.send(1, own)
    assert first_elements(pool.receive(1)) == [102, 102]
    assert first_elements(pool.receive(0)) == [1, 1]


def test_a_reset_of_too_few_worlds(fleet: Fleet) -> None:
    pool = EnginePool(fleet.open, 2)
    with pytest.raises(UsageError, match="reset of 3 worlds, the pool has 4"):
        pool.reset_worlds(ResetRequest.all_worlds(3, 1))
    with pytest.raises(UsageError, match="parameters for 2 worlds, the pool has 4"):
        pool.reset(1, [{}, {}])


def test_the_sequence_is_kept(fleet: Fleet) -> None:
    pool = EnginePool(fleet.open, 1)
    with pytest.raises(SequenceError):
        pool.send(0, {})
    with pytest.raises(SequenceError):
        pool.receive(0)
    pool.reset(1)
    with pytest.raises(SequenceError):
        pool.receive(0)


# Engines that die


@pytest.mark.slow
@pytest.mark.parametrize("is_frozen", [False, True])
def test_a_lost_engine_is_started_again(
    fleet: Fleet, is_frozen: bool, caplog: pytest.LogCaptureFixture
) -> None:
    fleet.deaths = {(1, 0): 3}
    fleet.frozen = {(1, 0)} if is_frozen else set()
    pool = EnginePool(fleet.open, 2, max_restarts=1)
    pool.reset(1)
    pool.step(zeros(pool))
    pool.step(zeros(pool))
    with caplog.at_level(logging.WARNING):
        batches = pool.step(zeros(pool))
    assert "engine 1 is started again (1 of 1)" in caplog.text
    assert pool.num_restarts == 1
    # Engine 0 goes on; engine 1 shows the first observation of its second life.
    assert first_elements(batches) == [3, 3, 110, 110]
    hero, target = batches["hero"], batches[TARGET]
    assert hero.truncated.tolist() == [False, False, True, True]
    assert target.truncated[6:].tolist() == [True, True, False, True, True, False]
    assert not hero.terminated.any()
    assert hero.reward.tolist() == [0, 0, 0, 0]
    # What was seen last: step 2 of its first life.
    assert hero.final_index.tolist() == [2, 3]
    assert hero.final_observation["aim"][:, 0].tolist() == [102, 102]
    assert target.final_index.tolist() == [6, 7, 9, 10]
    assert target.final_observation["place"][:, 0, 0].tolist() == [102] * 4
    assert first_elements(pool.step(zeros(pool))) == [4, 4, 111, 111]
    assert not pool.step(zeros(pool))["hero"].truncated.any()


def test_a_torn_answer_does_not_spoil_what_was_seen_last(fleet: Fleet) -> None:
    fleet.deaths = {(0, 0): 2}
    fleet.torn = {(0, 0)}
    pool = EnginePool(fleet.open, 1, max_restarts=1)
    pool.reset(1)
    pool.step(zeros(pool))
    hero = pool.step(zeros(pool))["hero"]
    assert hero.final_observation["aim"][:, 0].tolist() == [1, 1]


def test_the_second_life_has_other_seeds(fleet: Fleet) -> None:
    fleet.deaths = {(1, 0): 1}
    pool = EnginePool(fleet.open, 2, max_restarts=1)
    pool.reset(40)
    pool.step(zeros(pool))
    first = decode_reset(fleet.received(1, 0)[2][1])["seeds"]
    second = decode_reset(fleet.received(1, 1)[2][1])
    assert not set(first) & set(second["seeds"])
    assert second["actions"] == [2, 2]


def test_restarts_are_bounded(fleet: Fleet) -> None:
    fleet.deaths = {(0, 0): 1, (0, 1): 1, (0, 2): 1}
    pool = EnginePool(fleet.open, 2, max_restarts=2)
    pool.reset(1)
    pool.step(zeros(pool))
    pool.step(zeros(pool))
    with pytest.raises(EngineCrashed):
        pool.step(zeros(pool))
    assert pool.num_restarts == 2
    assert fleet.num_starts == {0: 3, 1: 1}
    assert_all_ended(fleet)


def assert_all_ended(fleet: Fleet) -> None:
    for engine in fleet.engines.values():
        engine.join()


def test_without_restarts_an_error_ends_all(fleet: Fleet) -> None:
    fleet.deaths = {(0, 0): 1}
    pool = EnginePool(fleet.open, 2)
    pool.reset(1)
    with pytest.raises(EngineCrashed):
        pool.step(zeros(pool))
    assert_all_ended(fleet)
    pool.close()


def test_an_engine_that_dies_at_its_first_reset_too(fleet: Fleet) -> None:
    fleet.deaths = {(0, 0): 1, (0, 1): 0}
    pool = EnginePool(fleet.open, 1, max_restarts=5)
    pool.reset(1)
    batches = pool.step(zeros(pool))
    assert pool.num_restarts == 2
    assert first_elements(batches) == [20, 20]
    assert batches["hero"].final_observation["aim"][:, 0].tolist() == [0, 0]


def test_an_engine_that_cannot_be_started_again_ends_all(fleet: Fleet) -> None:
    fleet.deaths = {(0, 0): 1}
    fleet.broken = {(0, 1)}
    pool = EnginePool(fleet.open, 2, max_restarts=5)
    pool.reset(1)
    with pytest.raises(EngineStartError):
        pool.step(zeros(pool))
    assert_all_ended(fleet)


def test_an_engine_that_is_gone_at_a_reset_is_started_again(fleet: Fleet) -> None:
    fleet.deaths = {(1, 0): 2}
    pool = EnginePool(fleet.open, 2, max_restarts=1)
    pool.reset(1)
    pool.step(zeros(pool))
    batches = pool.reset(9)
    assert first_elements(batches) == [2, 2, 110, 110]
    assert not batches["hero"].truncated.any()
    assert batches["hero"].final_index.tolist() == []
    seeds = decode_reset(fleet.received(1, 1)[2][1])["seeds"]
    assert seeds == [f"{seed:016x}" for seed in (11, 12)]
    assert first_elements(pool.step(zeros(pool))) == [3, 3, 111, 111]


def test_an_engine_that_dies_in_a_call_is_started_again(fleet: Fleet) -> None:
    """The engines here know no calls, and go."""
    pool = EnginePool(fleet.open, 2, max_restarts=1)
    pool.reset(1)
    for _ in range(2):
        with pytest.raises(EngineCrashed):
            pool.call({"world": 0}, "ludus_open_door")
    batches = pool.step(zeros(pool))
    assert pool.num_restarts == 1
    assert first_elements(batches) == [10, 10, 101, 101]
    assert batches["hero"].truncated[:2].all()


def test_a_second_life_has_the_parameters_of_the_first(fleet: Fleet) -> None:
    fleet.deaths = {(1, 0): 2}
    pool = EnginePool(fleet.open, 2, max_restarts=1)
    pool.reset(1, [{"i": i} for i in range(4)])
    pool.reset(None, [None, None, {"i": 9}, None])
    pool.step(zeros(pool))
    assert decode_reset(fleet.received(1, 1)[2][1])["parameters"] == [{"i": 9}, {"i": 3}]


def test_a_mistake_of_the_game_is_not_forgiven(fleet: Fleet) -> None:
    def behave(talk: Talk) -> None:
        talk.greet()
        talk.read()
        talk.batch(is_reset=True)
        talk.read()
        talk.json("ERROR", {"code": "game", "message": "no"})
        talk.wait_for_the_end()

    fake = FakeEngine(behave, POLICIES)
    config = EngineConfig()
    pool = EnginePool(
        lambda _: EngineSession(fake.link(), config, Supervision(None), fake.greeting()), 1, 9
    )
    pool.reset(1)
    with pytest.raises(GameError):
        pool.step(zeros(pool))
    assert pool.num_restarts == 0
    fake.join()


def test_a_start_that_fails_ends_the_others(fleet: Fleet) -> None:
    fleet.broken = {(1, 0)}
    with pytest.raises(EngineStartError, match="engine 1 is broken"):
        EnginePool(fleet.open, 3)
    assert fleet.num_starts == {0: 1, 1: 1, 2: 1}
    assert_all_ended(fleet)


def test_engines_with_other_specs_are_refused(fleet: Fleet) -> None:
    other = {**POLICIES, "policies": POLICIES["policies"][:1]}

    def behave(talk: Talk) -> None:
        talk.greet()
        talk.serve()

    fakes = [FakeEngine(behave, spec) for spec in (POLICIES, other)]

    def open_engine(engine: int) -> EngineSession:
        fake = fakes[engine]
        return EngineSession(fake.link(), EngineConfig(), Supervision(None), fake.greeting())

    with pytest.raises(EngineError, match=r"engine 1 .* engine 0"):
        EnginePool(open_engine, 2)
    for fake in fakes:
        fake.join()


def test_leaving_the_block_ends_all(fleet: Fleet) -> None:
    with EnginePool(fleet.open, 2) as pool:
        pool.reset(1)
    assert_all_ended(fleet)
    pool.close()


@pytest.mark.parametrize("engine", range(3))
def test_an_engine_that_cannot_be_ended_leaves_none_of_the_others(
    fleet: Fleet, engine: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> None:
        raise RuntimeError("it does not end")

    freed: list[str] = []

    class Reserved(ReservedCores):
        def close(self) -> None:
            freed.append("freed")

    pool = EnginePool(fleet.open, 3, cores=Reserved(CorePlan((None,) * 3, None)))
    with monkeypatch.context() as patch, pytest.raises(RuntimeError, match="it does not end"):
        patch.setattr(pool.sessions[engine], "close", fail)
        pool.close()
    for other in {0, 1, 2} - {engine}:
        fleet.engines[other, 0].join()
    assert freed == ["freed"]


@pytest.mark.slow
def test_timeouts_are_errors_of_the_engine(fleet: Fleet) -> None:
    fleet.deaths = {(0, 0): 1}
    fleet.frozen = {(0, 0)}
    pool = EnginePool(fleet.open, 1)
    pool.reset(1)
    with pytest.raises(EngineTimeout):
        pool.step(zeros(pool))


# Cores


@pytest.mark.parametrize("is_broken", [False, True])
def test_cores_are_held_until_the_pool_is_closed(fleet: Fleet, is_broken: bool) -> None:
    freed: list[str] = []

    class Reserved(ReservedCores):
        def close(self) -> None:
            freed.append("freed")

    cores = Reserved(CorePlan(((0,),), (1,)))
    if is_broken:
        fleet.broken = {(0, 0)}
        with pytest.raises(EngineStartError):
            EnginePool(fleet.open, 1, cores=cores)
    else:
        fleet.deaths = {(0, 0): 1}
        with EnginePool(fleet.open, 1, max_restarts=1, cores=cores) as pool:
            pool.reset(1)
            pool.step(zeros(pool))
            assert (pool.num_restarts, pool.learner_cores, freed) == (1, (1,), [])
    assert freed == ["freed"]
