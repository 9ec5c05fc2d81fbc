"""What a sweep varies, as it is typed."""

from __future__ import annotations

import pytest

from ludus.errors import ConfigError
from ludus.tuning.space import Choice, Domain, Range, nest, read_space


@pytest.mark.parametrize(
    ("name", "text", "domain"),
    [
        ("ppo.learning_rate", "log:1e-5:1e-2", Range(1e-5, 1e-2, True, False)),
        ("ppo.discount", "0:1", Range(0.0, 1.0, False, False)),
        ("ppo.epochs", "1:8", Range(1.0, 8.0, False, True)),
        ("num_worlds", "log:1:64", Range(1.0, 64.0, True, True)),
        ("policies.hero.tau", "", None),
        ("policies.hero.target_rate", "log:1e-3:1e-1", Range(1e-3, 1e-1, True, False)),
        ("ppo.activation", "tanh,relu", Choice(('"tanh"', '"relu"'))),
        ("ppo.hidden_sizes", "[64,64],[128,128]", Choice(("[64, 64]", "[128, 128]"))),
        ("ppo.target_kl", "null,0.02", Choice(("null", "0.02"))),
        ("ppo.overlap", "true,false", Choice(("true", "false"))),
    ],
)
def test_ranges_and_choices_are_read(name: str, text: str, domain: Domain | None) -> None:
    if domain is None:
        with pytest.raises(ConfigError, match="there is no such setting"):
            read_space({name: text})
    else:
        assert read_space({name: text}) == {name: domain}


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("ppo.learnin_rate", "0:1", "there is no such setting\nhint: did you mean ppo.learning_r"),
        ("ppo", "1,2", "--set ppo: there is no such setting"),
        ("sac.x.y", "1,2", "there is no such setting"),
        ("ppo.epochs", "8:1", "the bounds must be LOW, then HIGH"),
        ("ppo.learning_rate", "log:0:1", "the bounds must be LOW above 0, then HIGH"),
        ("ppo.learning_rate", "log:1", "cannot be read\nhint: write NAME=LOW:HIGH"),
        ("ppo.learning_rate", "a:b", "cannot be read"),
        ("ppo.activation", "1:2", "ppo.activation is not a number"),
    ],
)
def test_what_cannot_be_varied_is_an_error(name: str, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_space({name: text})


def test_dotted_names_become_nested_settings() -> None:
    assert nest({"ppo.epochs": 2, "ppo.overlap": True, "seed": 1}) == {
        "ppo": {"epochs": 2, "overlap": True},
        "seed": 1,
    }
