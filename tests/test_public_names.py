"""What ``ludus`` exports, and the import paths of earlier versions."""

from __future__ import annotations

import importlib
import pkgutil

import pytest

import ludus


def test_every_public_name_is_importable() -> None:
    for name in ludus.__all__:
        assert getattr(ludus, name) is not None


def test_no_package_has_the_name_of_a_public_function() -> None:
    functions = {*ludus.__all__, "train", "evaluate", "sweep", "load_policy"}
    modules = {module.name for module in pkgutil.iter_modules(ludus.__path__)}
    assert not functions & modules


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("ludus.dialects.gymgodot", "ludus.legacy.gymgodot"),
        ("ludus.dialects.godot_gym_api", "ludus.legacy.godot_gym_api"),
        ("ludus.envs", "ludus.libraries"),
    ],
)
def test_renamed_packages_are_found_under_their_old_names(old: str, new: str) -> None:
    module = importlib.import_module(old)
    assert module is importlib.import_module(new)
    assert module.__spec__ is not None
    assert module.__spec__.name == new


@pytest.mark.parametrize("old", ["ludus.train", "ludus.train.config", "ludus.train.loop"])
def test_a_package_that_is_gone_names_the_line_to_write(old: str) -> None:
    with pytest.raises(ImportError, match="from ludus import train, TrainConfig"):
        importlib.import_module(old)


def test_an_unknown_submodule_is_reported_as_usual() -> None:
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("ludus.no_such_module")
