"""Gymnasium's own checker on a world with one agent."""

from __future__ import annotations

import re
import warnings

from gymnasium.utils.env_checker import check_env

from ludus.check.causes import name_causes
from ludus.check.context import CheckContext
from ludus.check.finding import Finding, fail, info, ok, warn
from ludus.libraries import LudusEnv
from ludus.spec import Spec

__all__ = ["check_gymnasium", "why_not_gymnasium"]

TITLE = "gymnasium.utils.env_checker.check_env"
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_REPORTED_ELSEWHERE = ("infinity", "alternative render modes")
"""Bounds are in the observation report; a game renders itself, and needs a screen for that."""
_HINT = (
    "follow the advice of the lines on seeds and observations; if they are ok, please report it "
    "with the scene"
)


def check_gymnasium(context: CheckContext) -> list[Finding]:
    """Run ``check_env``; its warnings become findings."""
    reason = why_not_gymnasium(context.spec)
    if reason:
        return [info(TITLE, f"does not apply: {reason}")]
    try:
        with (
            context.lone_pool() as pool,
            warnings.catch_warnings(record=True) as caught,
        ):
            warnings.simplefilter("always")
            check_env(LudusEnv(pool), skip_close_check=True)
    except AssertionError as error:
        return [fail(TITLE, _plain(str(error)), name_causes(context.scripts, _HINT))]
    texts = [_plain(str(warning.message)) for warning in caught]
    texts = [text for text in texts if not any(part in text for part in _REPORTED_ELSEWHERE)]
    return [ok(TITLE), *(warn("Gymnasium warns", text) for text in dict.fromkeys(texts))]


def why_not_gymnasium(spec: Spec) -> str:
    """Return why ``check_env`` does not apply to a game; empty if it does."""
    policy, *others = spec.policies
    if others:
        names = ", ".join(policy.name for policy in spec.policies)
        return f"there are several policies ({names}); use ludus.open_pool"
    if policy.agents_per_world > 1:
        return f"a world has {policy.agents_per_world} agents; use ludus.make_vec"
    if policy.has_action_mask:
        return "it does not know action masks, and would choose forbidden actions"
    return ""


def _plain(text: str) -> str:
    return " ".join(_COLOUR.sub("", text).removeprefix("WARN: ").split())
