"""The process that plans: it reads questions of the runner, and writes decisions, one line each.

Nothing that an engine does can hold up the ticks, and it may be killed at any moment. What it learns about a model stays
with it, so that the next question is answered sooner. It dies with the process that started it.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import struct
import sys
import time
from typing import BinaryIO

from smv_planner import api, garbage
from smv_planner.daemon.second import Second
from smv_planner.engines import ENGINES, Limits, auto
from smv_planner.errors import EngineError
from smv_planner.lazy import dataclass
from smv_planner.model.model import Model
from smv_planner.problem import Problem, Verdict
from smv_planner.runner.decision import Decision
from smv_planner.runner.events import Answered
from smv_planner.runner.records import Known, asked, record
from smv_planner.runner.recovery import Planners, recover

LENGTH = struct.Struct("<Q")
ANSWER, OPINION = b"answer ", b"opinion "

_PR_SET_PDEATHSIG = 1


@dataclass(frozen=True, slots=True)
class Job:
    """What a worker is told before anything else. `deadline` is for one question of the runner, in seconds.

    With `second` another engine is asked the same in the background; where they differ goes into the folder `differences`.
    """

    model: Model
    parent: int
    engine: str
    deadline: float
    second: str | None = None
    differences: str = "."


def main() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started us
    # What anything prints goes where errors go; only we write answers.
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    questions = sys.stdin.buffer
    (size,) = LENGTH.unpack(_exactly(questions, LENGTH.size))
    job: Job = pickle.loads(_exactly(questions, size))
    if os.getppid() != job.parent:
        return
    garbage.look_seldom()
    serve(job, questions, answers)


def serve(job: Job, questions: BinaryIO, answers: BinaryIO) -> None:
    """Answer questions until there are no more."""
    auto.prepare()
    model = job.model
    known = Known(model, api.widened_system)
    api.widened(model)
    second = None
    if job.second is not None:
        second = Second(model, job.engine, job.second, job.differences, lambda told: _write(answers, OPINION, told))
    ends = 0.0

    def solve(problem: Problem) -> Verdict:
        left = max(ends - time.monotonic(), 0.0)
        verdict = ENGINES[job.engine].ask(problem, Limits(left, api.MEMORY, lambda text: None))
        if second is not None:
            second.hear(problem, verdict)
        return verdict

    planners = Planners(solve, api.widened_system, api.DEFAULT_BOUND, time.monotonic)
    for line in questions:
        revision, question = line.split(b" ", 1)
        ends = time.monotonic() + job.deadline
        try:
            decision = recover(model, asked(question, known), planners)
        except EngineError as error:
            decision = Decision(undecided=str(error))
        _write(answers, ANSWER, record(Answered(0.0, int(revision), decision)))


def _write(answers: BinaryIO, kind: bytes, told: bytes) -> None:
    line = memoryview(kind + told + b"\n")
    while line:
        line = line[answers.write(line) :]


def _exactly(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size)
    if len(data) != size:
        raise SystemExit(0)  # who started us is gone
    return data


if __name__ == "__main__":
    main()
