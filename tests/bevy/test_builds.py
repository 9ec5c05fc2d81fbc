"""The builds of ``make test-bevy`` compile Bevy twice: with its renderer, and without."""

from __future__ import annotations

import re
import shlex
import subprocess
from collections import defaultdict

import pytest

from tests.legacy.gymgodot.conftest import ROOT

pytestmark = [pytest.mark.bevy, pytest.mark.timeout(120)]

NUM_BUILDS = 10
CHOOSES = {"--workspace": 0, "--package": 1, "--features": 1, "--no-default-features": 0}
"""Flags that choose what is compiled, and how many words follow each."""


def builds() -> list[list[str]]:
    """Return the flags of each build: those of ``bevy-test``, then one for each example."""
    makefile = (ROOT / "Makefile").read_text()
    features = re.search(r"^BEVY_FEATURES := (.*)$", makefile, re.MULTILINE)
    tests = re.findall(r"cargo test (.*)$", makefile, re.MULTILINE)
    examples = re.search(r"for example in (.*?);", makefile, re.DOTALL)
    assert features and tests and examples
    found = [chosen(line.replace("$(BEVY_FEATURES)", features[1])) for line in tests]
    names = shlex.split(examples[1].replace("\\\n", " "))
    return found + [chosen(f"--package {name}") for name in names]


def chosen(command: str) -> list[str]:
    words = iter(shlex.split(command))
    kept: list[str] = []
    for word in words:
        if word in CHOOSES:
            kept += [word, *(next(words) for _ in range(CHOOSES[word]))]
    return kept


def features_of_bevy(build: list[str]) -> dict[str, str]:
    """Return the features of each crate of Bevy in a build."""
    done = subprocess.run(
        ["cargo", "tree", "--locked", "--prefix", "none", "--format", "{p}|{f}", *build],
        cwd=ROOT / "engines/bevy",
        check=True,
        capture_output=True,
        text=True,
    )
    return dict(re.findall(r"^(bevy_\w+) v0\.19\S*[^|\n]*\|(\S*)", done.stdout, re.MULTILINE))


@pytest.mark.slow
def test_bevy_is_compiled_with_its_renderer_and_without() -> None:
    features: defaultdict[str, set[str]] = defaultdict(set)
    for build in (found := builds()):
        for crate, enabled in features_of_bevy(build).items():
            features[crate].add(enabled)
    assert len(found) == NUM_BUILDS
    assert len(features["bevy_ecs"]) == 2
    assert {crate: sets for crate, sets in features.items() if len(sets) > 2} == {}
    assert len(features["bevy_render"]) == 1
