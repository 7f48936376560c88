"""A second engine's opinion on what the first has said, in the background and at the lowest priority.

It is about lengths and verdicts, which no checker of plans can judge (`planner/second_opinion`). Nobody waits for it: when
there are more questions than it can answer, the oldest are left out.
"""

from __future__ import annotations

import json
import os
import threading
from collections import deque
from collections.abc import Callable

from smv_planner import api
from smv_planner.engines import ENGINES, Limits
from smv_planner.errors import EngineError
from smv_planner.model.model import Model
from smv_planner.planner.second_opinion import Agrees, Differs, Says, compare
from smv_planner.problem import Problem, Undecided, Verdict

WAITING = 16
DEADLINE = 60.0


class Second:
    """`tell` hears as JSON of each question that both answered: nothing, or what differs and the folder that reproduces it."""

    def __init__(self, model: Model, first: str, second: str, folder: str, tell: Callable[[bytes], None]) -> None:
        self._model, self._first, self._second, self._folder, self._tell = model, first, second, folder, tell
        self._waiting: deque[tuple[Problem, Verdict]] = deque(maxlen=WAITING)
        self._some = threading.Event()
        threading.Thread(target=self._listen, name="second opinion", daemon=True).start()

    def hear(self, problem: Problem, verdict: Verdict) -> None:
        if not isinstance(verdict, Undecided):
            self._waiting.append((problem, verdict))
            self._some.set()

    def _listen(self) -> None:
        os.nice(19)  # on Linux: of this thread, and of the engine's process that it starts
        while True:
            self._some.wait()
            self._some.clear()
            while self._waiting:
                self._judge(*self._waiting.popleft())

    def _judge(self, problem: Problem, verdict: Verdict) -> None:
        try:
            other = ENGINES[self._second].ask(problem, Limits(DEADLINE, api.MEMORY, lambda text: None))
        except EngineError:
            return  # a broken second engine says nothing about the first
        one, two = Says(self._first, verdict), Says(self._second, other)
        match compare(one, two):
            case Agrees():
                self._tell(b"{}")
            case Differs(reason):
                kept = api.keep_difference(self._model, problem, one, two, reason, within=self._folder)
                self._tell(json.dumps({"reason": reason, "folder": str(kept)}).encode("ascii"))
