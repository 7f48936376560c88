"""NuSMV as a library: bounded model checking by pynusmv, in a child process.

It answers with a shortest plan, or that there is none within the bound; it proves nothing beyond.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from smv_planner.engines import Limits, bmc
from smv_planner.errors import EngineError
from smv_planner.export.smv import RawTrace, encode
from smv_planner.lazy import replace
from smv_planner.problem import NotWithin, Problem, Undecided, Verdict

CHILD = (sys.executable, "-I", str(Path(__file__).with_name("nusmv_child.py")))


def available() -> str | None:
    if find_spec("pynusmv") is None:
        return "pynusmv is not installed: `make nusmv` builds and installs it, for which it needs compilers"
    return None


def ask(problem: Problem, limits: Limits, child: Sequence[str] = CHILD) -> Verdict:
    """`child` is the command that runs `nusmv_child.py`, or what a test puts in its place."""
    if reason := available():
        raise EngineError(reason)
    started = time.monotonic()
    encoding = encode(problem)
    with bmc.folder(encoding) as where:
        command = (*child, bmc.MODEL, str(encoding.bound), encoding.loop)
        ended = bmc.answer("NuSMV", command, where, encoding, limits, started)
    if isinstance(ended, Undecided):
        return ended
    if not ended.output:
        return Undecided("NuSMV ended without an answer", deadline=False)
    match _parsed(ended.output):
        case {"none_within": int(bound), **rest} if bound == encoding.bound and not rest:
            return NotWithin(problem.bound, bmc.NONE)
        case {"description": bmc.DESCRIPTION, "states": list(states), "inputs": list(inputs), **rest} if not rest:
            if all(map(_readings, (*states, *inputs))):
                return replace(encoding.decode(RawTrace(tuple(states), tuple(inputs))), argument=bmc.FIRST)
    raise EngineError(f"NuSMV's answer makes no sense: {ended.output[:200]!r}")


def _parsed(output: bytes) -> object:
    try:
        return json.loads(output)
    except (ValueError, RecursionError):
        return None


def _readings(value: object) -> bool:
    """Whether a value is a mapping from texts to texts."""
    return isinstance(value, dict) and all(isinstance(name, str) and isinstance(text, str) for name, text in value.items())
