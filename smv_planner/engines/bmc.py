"""What the two ways of running NuSMV share: a private folder, the files in it, the limits, and the progress."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from smv_planner.engines import Limits
from smv_planner.engines.process import Ended, run
from smv_planner.errors import EngineError
from smv_planner.export.smv import Encoding
from smv_planner.problem import Undecided

MODEL, SCRIPT = "problem.smv", "problem.cmd"

DESCRIPTION = "BMC Counterexample"
"""How NuSMV describes a trace that starts in an initial state; it also reports traces that do not."""

FIRST = "bounded model checking, bound after bound: the first counterexample"
NONE = "bounded model checking found no counterexample up to the bound"
"""By which argument a model checker answers."""

_BOUND = re.compile(r"Generating problem with bound (\d{1,9}),")


@contextmanager
def folder(encoding: Encoding) -> Iterator[Path]:
    """A private folder with the model and the command script in it, gone afterwards."""
    with TemporaryDirectory(prefix="smv_planner-") as name:
        path = Path(name)
        path.joinpath(MODEL).write_text(encoding.text, encoding="ascii", newline="\n")
        path.joinpath(SCRIPT).write_text(f"set verbose_level 1\n{encoding.script}", encoding="ascii", newline="\n")
        yield path


def answer(
    name: str, command: Sequence[str], where: Path, encoding: Encoding, limits: Limits, started: float
) -> Ended | Undecided:
    """Let a model checker work on the files. `started` is when the question was put, on the monotonic clock."""
    length = 0

    def hear(line: str) -> None:
        nonlocal length
        if bound := _BOUND.match(line):
            length = max(0, int(bound[1]) - (encoding.bound - encoding.problem.bound))
            limits.progress(f"bound {length}")

    left = limits.deadline - (time.monotonic() - started)
    try:
        ended = run(command, folder=str(where), seconds=left, memory=limits.memory, on_line=hear)
    except OSError as problem:
        raise EngineError(f"{name} cannot be started: {problem}") from problem
    if ended.killed == "deadline":
        return Undecided(f"the deadline passed at bound {length}", deadline=True)
    if ended.trouble:
        return Undecided(f"{name} {ended.trouble}", deadline=False)
    return ended
