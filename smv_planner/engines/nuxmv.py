"""The user's own nuXmv: its executable is given a script and a model, and writes the counterexample as XML.

nuXmv may not be redistributed and was not at hand when this was written: it was never run by us. What is used of it is
what NuSMV 2.5.4 and the manuals of NuSMV 2.6 and nuXmv have in common, and was tried with the executable of NuSMV.
"""

from __future__ import annotations

import os
import re
import shutil
import stat
import time
from pathlib import Path
from xml.etree import ElementTree

from smv_planner.engines import Limits, bmc
from smv_planner.engines.process import FLOOD
from smv_planner.errors import EngineError
from smv_planner.export.smv import TRACE_FILE, RawTrace, encode
from smv_planner.lazy import replace
from smv_planner.problem import NotWithin, Problem, Undecided, Verdict

SETTING = "SMV_PLANNER_NUXMV"
"""The environment variable that says where the executable is."""

NAMES = ("nuXmv", "nuxmv")

_NONE = re.compile(rb"^-- no counterexample found with bound (\d{1,9})\b", re.MULTILINE)


def executable() -> str | None:
    """Where nuXmv is, if it is anywhere."""
    chosen = os.environ.get(SETTING)
    candidates = (chosen,) if chosen else NAMES
    return next((os.path.abspath(found) for name in candidates if (found := shutil.which(name))), None)


def available() -> str | None:
    if executable():
        return None
    if chosen := os.environ.get(SETTING):
        return f"{SETTING} is set to {chosen!r}, which is not an executable file"
    return f"nuXmv is not on the PATH: install it from https://nuxmv.fbk.eu, or set {SETTING} to its executable"


def ask(problem: Problem, limits: Limits) -> Verdict:
    command = executable()
    if command is None:
        raise EngineError(available())
    started = time.monotonic()
    encoding = encode(problem)
    with bmc.folder(encoding) as where:
        ended = bmc.answer("nuXmv", (command, "-source", bmc.SCRIPT, bmc.MODEL), where, encoding, limits, started)
        if isinstance(ended, Undecided):
            return ended
        trace = _written(where / TRACE_FILE)
    if trace is not None:
        return replace(encoding.decode(read(trace)), argument=bmc.FIRST)
    bounds = _NONE.findall(ended.output)
    if bounds and int(bounds[-1]) == encoding.bound:
        return NotWithin(problem.bound, bmc.NONE)
    return Undecided(f"nuXmv ended without an answer, and last said:\n{ended.last_words}", deadline=False)


def _written(path: Path) -> bytes | None:
    """The file, if there is one."""
    try:
        status = path.lstat()
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(status.st_mode) or status.st_size > FLOOD:
        raise EngineError(f"the trace is not a file of at most {FLOOD >> 20} MiB")
    return path.read_bytes()


def read(data: bytes) -> RawTrace:
    """An XML trace (trace plug-in 4). Raises EngineError if it is not one, or not of the right kind.

    Plug-ins differ in whether they repeat what did not change, so values stand until they are replaced.
    """
    if not data.isascii() or b"<!" in data:  # declarations could define entities that grow without bound
        raise EngineError("the trace is not plain XML")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as problem:
        raise EngineError(f"the trace is not XML: {problem}") from problem
    if root.tag != "counter-example" or root.get("desc") != bmc.DESCRIPTION:
        raise EngineError(f"the trace is not a counterexample but {root.tag[:60]!r}, {root.get('desc', '')[:60]!r}")
    states: list[dict[str, str]] = []
    inputs: list[dict[str, str]] = []
    for node in root:
        parts = {part.tag: part for part in node}
        if node.tag == "loops":
            continue
        expected = {"state"} <= parts.keys() <= {"state", "combinatorial", "input"}
        if node.tag != "node" or not expected or len(parts) < len(node):
            raise EngineError(f"the trace has an unknown part {node.tag[:60]!r}: {sorted(parts)[:3]}")
        states.append({**(states[-1] if states else {}), **_values(parts["state"])})
        if "input" in parts:
            inputs.append({**(inputs[-1] if inputs else {}), **_values(parts["input"])})
    return RawTrace(tuple(states), tuple(inputs))


def _values(part: ElementTree.Element) -> dict[str, str]:
    values: dict[str, str] = {}
    for value in part:
        name, text = value.get("variable"), value.text
        if value.tag != "value" or len(value) or name is None or text is None or name in values:
            raise EngineError(f"the trace has an unknown value {ascii(name)[:60]} in {part.tag!r}")
        values[name] = text.strip()
    return values
