"""Lines of the game's scripts that may explain why it does not reset or repeat itself.

What is named here is a likely cause: the text of a script does not show what it does. So lines
are named only where a check has failed, never as a finding of their own.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from ludus.check.scripts import Script, functions_of_reset

__all__ = ["name_causes", "scene_changes"]

MAX_PLACES = 4
RNG = "LudusWorld.of(self).rng"
_SCENE_CHANGE = re.compile(
    r"tree\s*(?:\(\s*\))?\s*\.\s*(reload_current_scene|change_scene(?:_to(?:_\w+)?)?)\b"
)
_WAIT = re.compile(r"\b(await\b|yield\s*\()")
_DRAW = re.compile(
    r"(?<![\w.])(?:rand[fi]|randfn|rand[fi]_range|rand_range)\s*\("
    r"|\.\s*(?:pick_random|shuffle)\s*\(|\brandomize\s*\("
)
_GENERATOR = re.compile(r"(?:(\w+)\s*(?::[^=\n]*)?=\s*)?\bRandomNumberGenerator\s*\.\s*new\s*\(")
_FROM_WORLD = re.compile(r"world|rng|\.\s*rand", re.IGNORECASE)
_CAST = re.compile(
    r"\b(force_(ray|shape)cast_update|intersect_(ray|shape|point)|cast_motion|collide_shape"
    r"|is_colliding|get_overlapping_\w+)\s*\("
)
_UNSEEDED = "which no seed of the world reaches"
_RANDOM = {
    "rand_range": f"draws rand_range(), {_UNSEEDED}: use {RNG}.randf_range()",
    "pick_random": f"draws pick_random(), {_UNSEEDED}: take element {RNG}.randi() % size()",
    "shuffle": f"draws shuffle(), {_UNSEEDED}: swap each element i with the one at "
    f"{RNG}.randi_range(0, i)",
    "randomize": f"calls randomize(), which seeds from the clock: draw from {RNG} instead",
}
"""What the world's generator has no method for; the others have the same name there."""

Cause = tuple[str, str]
"""Where a cause is, and what happens there."""


def name_causes(scripts: tuple[Script, ...], otherwise: str, *, has_casts: bool = False) -> str:
    """Return a hint: likely causes with script and line, then what else it may be.

    Args:
        scripts: The scripts of the scene.
        otherwise: The whole hint, if no line looks like a cause.
        has_casts: Whether a look into the physics space may be the cause, as it is where a first
            observation is wrong.
    """
    places: dict[str, list[str]] = {}
    causes = [*scene_changes(scripts), *_waits(scripts)]
    if has_casts:
        causes += _casts(scripts)
    for place, text in [*causes, *_draws(scripts), *_generators(scripts)]:
        places.setdefault(text, []).append(place)
    named = [f"{_list_places(where)} {text}. " for text, where in places.items()]
    return f"{''.join(named)}Otherwise: {otherwise}" if named else otherwise


def scene_changes(scripts: tuple[Script, ...]) -> Iterator[Cause]:
    """Yield the calls that need the scene to be the tree's current one."""
    for script in scripts:
        for found in _SCENE_CHANGE.finditer(script.code):
            yield (
                script.place(found.start(1)),
                f"calls {found[1]}(), which cannot work in training, where the scene is one of "
                "many copies: let is_done() return true, and put everything back in reset()",
            )


def _waits(scripts: tuple[Script, ...]) -> Iterator[Cause]:
    for script, function in functions_of_reset(scripts):
        for found in _WAIT.finditer(function.code):
            verb = "awaits" if found[1] == "await" else "yields"
            caller = "" if function.name == "reset" else ", which reset() calls"
            yield (
                script.place(function.start + found.start()),
                f"{verb} in {function.name}(){caller}; reset() must be done when it returns (if "
                "bodies have to settle, set settle_ticks of the LudusWorld)",
            )


def _casts(scripts: tuple[Script, ...]) -> Iterator[Cause]:
    for script in scripts:
        for found in _CAST.finditer(script.code):
            yield (
                script.place(found.start()),
                "looks into the physics space, where bodies that reset() has moved are at their "
                "old places until the next tick: use a sensor such as LudusRays2D, which sees them "
                "at once (docs/sensors.md), or set settle_ticks of the LudusWorld to 1",
            )


def _draws(scripts: tuple[Script, ...]) -> Iterator[Cause]:
    own = {function.name for script in scripts for function in script.functions}
    for script in scripts:
        for found in _DRAW.finditer(script.code):
            name = found[0].strip(". \t\n(")
            if name not in own:
                usual = f"draws {name}(), {_UNSEEDED}: use {RNG}.{name}()"
                yield script.place(found.start()), _RANDOM.get(name, usual)


def _generators(scripts: tuple[Script, ...]) -> Iterator[Cause]:
    """Find generators that ``reset()`` does not seed and nothing seeds from the world."""
    of_reset = [function.code for _, function in functions_of_reset(scripts)]
    for script in scripts:
        for found in _GENERATOR.finditer(script.code):
            seeding = re.compile(
                rf"\b{found[1]}\s*\.\s*(?:(?:seed|state)\s*=(?!=)|set_(?:seed|state)\b)(.*)"
            )
            seeds = [text for other in scripts for text in seeding.findall(other.code)]
            is_seeded = any(map(_FROM_WORLD.search, seeds)) or any(map(seeding.search, of_reset))
            if not is_seeded:
                yield (
                    script.place(found.start()),
                    f"makes a RandomNumberGenerator, {_UNSEEDED}: use {RNG}, or set its seed to "
                    f"{RNG}.randi() in reset()",
                )


def _list_places(places: list[str]) -> str:
    others = places[1:MAX_PLACES] + ["…"] * (len(places) > MAX_PLACES)
    return f"{places[0]} (also {', '.join(others)})" if others else places[0]
