"""PettingZoo's own tests on one world, for what Gymnasium's checker does not know."""

# PettingZoo's types are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownParameterType=false

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable
from typing import Any

from ludus.check.causes import name_causes
from ludus.check.context import CheckContext
from ludus.check.finding import Finding, fail, info, ok
from ludus.check.gymnasium_env import why_not_gymnasium
from ludus.check.seeds import RNG_HINT
from ludus.errors import LudusError, MissingExtra
from ludus.extras import install_hint

__all__ = ["check_pettingzoo"]

TITLE = "pettingzoo.test"
_NUM_CYCLES = 100


def check_pettingzoo(context: CheckContext) -> list[Finding]:
    """Run tests of PettingZoo; their warnings are advice that games may ignore."""
    if not why_not_gymnasium(context.spec):
        return [info(TITLE, "does not apply: a world has one agent, without masks")]
    if context.is_legacy:
        return [
            info(TITLE, "does not apply: its tests pass options to reset; this game takes none")
        ]
    try:
        from ludus.pettingzoo import LudusParallelEnv

        with warnings.catch_warnings():  # it imports its own games, in a deprecated way
            warnings.simplefilter("ignore")
            from pettingzoo.test import api_test, parallel_api_test, seed_test
            from pettingzoo.test.state_test import state_test
        from pettingzoo.utils.conversions import parallel_to_aec
    except (MissingExtra, ImportError):
        return [info(TITLE, "not checked: it is not installed", install_hint("pettingzoo"))]

    with contextlib.ExitStack() as pools:

        def make() -> LudusParallelEnv:
            return LudusParallelEnv(pools.enter_context(context.other_pool(num_worlds=1)))

        env = LudusParallelEnv(pools.enter_context(context.lone_pool()))
        tests: dict[str, Callable[[], Any]] = {
            "parallel_api_test": lambda: parallel_api_test(env, num_cycles=_NUM_CYCLES),
            "api_test": lambda: api_test(parallel_to_aec(env), num_cycles=_NUM_CYCLES),
            "seed_test": lambda: seed_test(lambda: parallel_to_aec(make()), num_cycles=20),
        }
        # It chooses actions that masks forbid, as parallel_seed_test does.
        if not any(policy.has_action_mask for policy in context.spec.policies):
            tests["state_test"] = lambda: state_test(parallel_to_aec(env), env, num_cycles=20)
        hints = {"seed_test": name_causes(context.scripts, RNG_HINT)}
        return [_run(name, test, hints.get(name, "")) for name, test in tests.items()]


def _run(name: str, test: Callable[[], Any], hint: str) -> Finding:
    with (
        contextlib.redirect_stdout(io.StringIO()),  # the tests print that they passed
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        try:
            test()
        except AssertionError as error:
            text = " ".join(str(error).split()) or "an assertion failed"
            return fail(f"{TITLE}.{name}", text, hint)
        except LudusError:
            raise
        except Exception as error:  # whatever their tests do with an environment that they reject
            return fail(f"{TITLE}.{name}", f"{type(error).__name__}: {error}")
    return ok(f"{TITLE}.{name}")
