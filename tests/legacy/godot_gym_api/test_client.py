"""The client and the environments against a program that speaks the wire."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env

from ludus.errors import ActionError, ConfigError, GameError, SequenceError, UsageError
from ludus.legacy.env import LegacyEnv
from ludus.legacy.godot_gym_api import Data, GodotClient, GodotEnvironment
from ludus.legacy.godot_gym_api.messages import State
from tests.legacy.godot_gym_api.compiled import APPLE_SEEKER, WALK
from tests.legacy.godot_gym_api.conftest import ALL, WALK_SPACES, Opener
from tests.legacy.godot_gym_api.fake_game import CONVERSATION, Walk, answering, playing, replay

HALF = np.float32(0.5)


def test_recorded_conversation_is_replayed(opener: Opener) -> None:
    """godot_gym_api's own apple seeker under Godot 3.6.2 said this."""
    lines = [json.loads(line) for line in CONVERSATION.read_text().splitlines()]
    with playing(replay) as address:
        client = opener.client(APPLE_SEEKER, address)
        seen = [client.request(json.loads(request)) for request, _ in lines]
        client.close()
    assert len(seen) == len(lines) == 17
    first, last = seen[2], seen[-1]
    assert list(first["agent"].distances_to_obstacle) == [5.0] * 16
    assert not first["world"].apple_caught
    np.testing.assert_allclose(
        last["agent"].distances_to_obstacle[:2], [1.088460, 1.667984], atol=1e-5
    )
    for (request, _), state in zip(lines, seen, strict=True):
        asked = json.loads(request)["observation"]
        assert len(state["agent"].distances_to_target) == (16 if "agent" in asked else 0)


def apple_reward(state: State) -> float:
    return 100.0 if state["world"].apple_caught else 0.0


def never(_state: State) -> bool:
    return False


def endless(_state: State) -> float:
    return np.inf


def test_recorded_game_as_an_environment(opener: Opener) -> None:
    distances = spaces.Box(0.0, 5.0, (16,))
    with playing(replay) as address:
        env = opener.env(
            action_space=spaces.Discrete(4),
            observation_space=spaces.Dict({"distances_to_obstacle": distances}),
            get_reward=apple_reward,
            is_terminated=never,
            protobuf_message_module=APPLE_SEEKER,
            engine_address=address,
            configuration={"environment": {"repeat_action": 4}},
        )
        assert isinstance(env.unwrapped, LegacyEnv)
        env.unwrapped.game.methods["configure"]({"environment": {"time_speed": 4.0}})
        env.reset()
        for action in (0, 0, 0, 3, 3, 1, 2):
            observation, reward, terminated, truncated, _ = env.step(np.int64(action))
            assert observation["distances_to_obstacle"].dtype == np.float32
            assert (reward, terminated, truncated) == (100.0, False, False)
        assert observation["distances_to_obstacle"][0] == pytest.approx(1.2512246)
        env.close()


class Original(GodotEnvironment):
    """Written as godot_gym_api's documentation shows it."""

    def __init__(self, engine_address: tuple[str, int], engine_chunk_size: int = 65536) -> None:
        super().__init__(WALK, engine_address, engine_chunk_size)
        self.observation_space = spaces.Box(-np.inf, np.inf, (1,))
        self.action_space = spaces.Discrete(4)
        self._requested_observation = {self.AGENT_KEY: ["place"]}
        self._godot_set_time_speed(2.0)
        self._godot_set_repeat_action(3)
        self._godot_configure({self.WORLD_KEY: {"start": 0.0}})

    def step(self, action: np.ndarray) -> Any:
        state = self._godot_step(action.item())
        return np.asarray([state[self.AGENT_KEY].place]), 0.0, False, False, {}

    def reset(self, *_args: Any, **_kwargs: Any) -> Any:
        return np.asarray([self._godot_reset()[self.AGENT_KEY].place]), {}


@pytest.mark.parametrize("is_documented", [True, False])
def test_class_written_for_the_original_works(*, is_documented: bool) -> None:
    walk = Walk(is_documented=is_documented)
    with playing(answering(walk)) as address:
        env = Original(address)
        assert env.reset()[0].tolist() == [0.0]
        assert env.step(np.asarray(3))[0].tolist() == [3.0]
        env.close()
    environment = {"repeat_action": 3}
    assert [request.get("config") for request in walk.requests] == [
        {"environment": {"time_speed": 2.0}},
        {"environment": environment},
        {"world": {"start": 0.0}},
        None,
        None,
    ]
    assert walk.requests[-1] == {"action": 3, "observation": {"agent": ["place"]}}
    assert all("observation" in request for request in walk.requests)


@pytest.mark.parametrize("is_documented", [True, False])
def test_configurations_are_answered_or_not(opener: Opener, *, is_documented: bool) -> None:
    walk = Walk(is_documented=is_documented)
    with (
        playing(answering(walk)) as address,
        opener.client(engine_address=address, step_timeout_s=5.0) as client,
    ):
        client.configure(agent={"a": 1}, environment={"repeat_action": 2})
        client.configure({"world": {"b": 2}}, agent={"a": 3})
        client.set_time_speed(0.5)
        assert client.step(0.5, ALL)["agent"].place == 0.5
        assert client.request({"action": 1.0})["agent"] == {}
        assert client.reset({"agent": []})["agent"]["place"] == 0.0
    configs = [request["config"] for request in walk.requests if "config" in request]
    assert configs[1] == {"world": {"b": 2}, "agent": {"a": 3}}
    assert configs[2] == {"environment": {"time_speed": 0.5}}


def test_json_answers_have_fields(opener: Opener) -> None:
    with playing(answering(Walk())) as address:
        client = opener.client(engine_address=address)
        state = client.reset(ALL)
        assert state["agent"].picture == b"\x00\xff\x0a"
        assert state["world"].names == ["a", {"b": 1}]
        assert state["world"]["names"][1].b == 1
        with pytest.raises(AttributeError, match="the game sent no 'far'; it sent is_far, names"):
            _ = state["world"].far
        partial = client.step(0.5, {"world": []})
        assert partial["agent"] == {} and not partial["world"].is_far
        client.close()


def test_data_reads_like_a_mapping() -> None:
    data = Data({"items": 1, "x": Data({"y": 2})})
    assert dict(data) == {"items": 1, "x": {"y": 2}}
    assert data["items"] == 1 and data.x.y == 2 and len(data) == 2
    assert repr(data) == "Data({'items': 1, 'x': Data({'y': 2})})"
    with pytest.raises(KeyError):
        _ = data["z"]


def test_protobuf_and_json_are_told_apart(opener: Opener) -> None:
    """A module for messages does not hurt where a game answers in JSON."""
    with playing(answering(Walk())) as address:
        client = opener.client(WALK, address)
        assert client.step(0.5, ALL)["agent"].place == 0.5
        client.close()
    message = WALK.Message()
    message.agent_data.place = 2.5
    with playing(answering(lambda _: message.SerializeToString())) as address:
        client = opener.client(WALK, address)
        assert client.step(0.5, ALL)["agent"].place == 2.5
        client.close()


def test_gymnasium_checker_passes(opener: Opener) -> None:
    space = spaces.Dict(
        {"place": spaces.Box(-100.0, 100.0, ()), "picture": spaces.Box(0, 255, (1, 3), np.uint8)}
    )
    with playing(answering(Walk())) as address:
        env = opener.env(engine_address=address, observation_space=space)
        check_env(env.unwrapped, skip_close_check=True)
        env.close()


def test_reset_options_configure_the_game(opener: Opener) -> None:
    walk = Walk()
    with playing(answering(walk)) as address:
        env = opener.env(engine_address=address, requested_observation={"agent": ["place"]})
        bare = env.unwrapped
        with pytest.raises(SequenceError, match="outside an episode"):
            bare.step(HALF)
        env.reset(options={"agent": {"speed": 2}})
        ends = [env.step(HALF)[2] for _ in range(7)]
        assert ends == [False] * 6 + [True]
        with pytest.raises(SequenceError, match="outside an episode"):
            bare.step(HALF)
        with pytest.raises(UsageError, match="unknown reset option 'level'"):
            env.reset(options={"level": 2})
        env.reset()
        env.close()
        env.close()
    assert walk.requests[0] == {"config": {"agent": {"speed": 2}}, "observation": {}}
    assert walk.requests[-1] == {"reset": 1, "observation": {"agent": ["place"]}}


@pytest.mark.parametrize(
    ("space", "action", "sent"),
    [
        (spaces.Discrete(4), np.int64(3), 3),
        (spaces.Box(-1.0, 1.0, (2,)), np.array([0.5, 2.0], np.float32), [0.5, 2.0]),
        (spaces.MultiDiscrete([2, 3]), np.array([1, 2]), [1, 2]),
    ],
)
def test_actions_are_sent_as_plain_json(opener: Opener, space: Any, action: Any, sent: Any) -> None:
    requests: list[Any] = []

    def answer(request: dict[str, Any]) -> bytes:
        requests.append(request)
        return b'{"agent_data": {"place": 1}}'

    with playing(answering(answer)) as address:
        env = opener.env(engine_address=address, action_space=space)
        env.reset()
        env.step(action)
        env.close()
    assert requests[-1]["action"] == sent


@pytest.mark.parametrize(
    "action", [np.zeros(2), [np.nan], "left", None, {}, [[1], [2, 3]]], ids=str
)
def test_misfitting_action_leaves_the_game_running(opener: Opener, action: Any) -> None:
    with playing(answering(Walk())) as address:
        env = opener.env(engine_address=address).unwrapped
        env.reset()
        with pytest.raises(ActionError):
            env.step(action)
        assert env.step(HALF)[1] == 0.25
        env.close()


@pytest.mark.parametrize("action", [float("nan"), {1, 2}, np.float32(1.0), b"left"], ids=str)
def test_requests_must_be_json(opener: Opener, action: Any) -> None:
    with playing(answering(Walk())) as address:
        client = opener.client(engine_address=address)
        with pytest.raises(ActionError, match="not JSON"):
            client.step(action, ALL)
        assert client.step(0.5, ALL)["agent"].place == 0.5
        client.close()


@pytest.mark.parametrize(
    ("settings", "what"),
    [
        ({"action_space": None}, "action_space must be one of Discrete, Box"),
        ({"action_space": spaces.Dict({})}, "action_space must be one of"),
        ({"observation_space": spaces.Dict({"a": spaces.Text(3)})}, r"observation_space\['a'\]"),
        ({"observation_space": spaces.Box(0, 1, (2,))}, "get_observation is missing"),
        ({"get_reward": None}, "get_reward is missing"),
        ({"is_terminated": "now"}, "is_terminated is missing"),
        ({"engine_address": ("127.0.0.1", 0)}, "has port 0, which only a game that we start"),
        ({"command": "true", "target": "."}, "both target and command"),
        ({"command": "true", "engine_address": ("127.0.0.1", 65536)}, "has the port 65536"),
        ({"protobuf_message_module": SimpleNamespace()}, "no protobuf Message with agent_data"),
        ({"speed": 3}, "unknown argument speed"),
    ],
)
def test_unusable_arguments_are_refused(
    opener: Opener, settings: dict[str, Any], what: str
) -> None:
    with pytest.raises(ConfigError, match=what):
        opener.env(**settings)


def test_unknown_configuration_is_refused(opener: Opener) -> None:
    with playing(answering(Walk())) as address:
        client = opener.client(engine_address=address)
        with pytest.raises(ConfigError, match="unknown part 'agnet' of a configuration"):
            client.configure({"agnet": {}})
        assert client.step(0.5, ALL)["agent"].place == 0.5
        client.close()
    with (
        playing(answering(Walk())) as address,
        pytest.raises(ConfigError, match="unknown part 'level'"),
    ):
        opener.env(engine_address=address, configuration={"level": 1})


@pytest.mark.parametrize(
    ("space", "fields", "what"),
    [
        (spaces.Box(0, 1, ()), {"far": 1}, "neither agent nor world sent a field called 'place'"),
        (spaces.Box(0, 1, (2,)), {"place": [1]}, r"shape \[1\] instead of \[2\]"),
        (spaces.Box(0, 1, (2,)), {"place": [1, None]}, "something that is not a number: None"),
        (spaces.Box(0, 1, (2,)), {"place": "ab"}, "something that is not a number: 'ab'"),
        (spaces.Box(0, 1, (2,)), {"place": {"$bytes": "AAAA"}}, r"shape \[3\] instead of \[2\]"),
        (spaces.Box(0, 1, (2,)), {"place": [1, float("nan")]}, r"nan at \[1\]"),
    ],
)
def test_misfitting_observation_names_the_field(
    opener: Opener, space: Any, fields: Any, what: str
) -> None:
    answer = json.dumps({"agent_data": fields}).encode()
    with playing(answering(lambda _: answer)) as address:
        env = opener.env(engine_address=address, observation_space=spaces.Dict({"place": space}))
        with pytest.raises(GameError, match=what):
            env.reset()


def test_infinite_reward_is_an_error(opener: Opener) -> None:
    with playing(answering(Walk())) as address:
        env = opener.env(engine_address=address, get_reward=endless)
        env.reset()
        with pytest.raises(GameError, match="the reward is inf"):
            env.step(HALF)


def test_names_of_the_original_are_there() -> None:
    assert (GodotClient.CONFIG_KEY, GodotClient.RESET_KEY) == ("config", "reset")
    assert (GodotClient.ACTION_KEY, GodotClient.OBSERVATION_KEY) == ("action", "observation")
    assert (GodotClient.DEFAULT_TIME_SPEED, GodotClient.DEFAULT_REPEAT_ACTION) == (1.0, 4)
    assert (GodotEnvironment.WORLD_KEY, GodotEnvironment.AGENT_KEY) == ("world", "agent")
    assert GodotEnvironment.ENVIRONMENT_KEY == "environment"
    assert issubclass(GodotEnvironment, gymnasium.Env)
    assert WALK_SPACES
