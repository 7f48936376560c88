"""Our end of the process that plans: it is asked, looked after, and started again when it is late or dead."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Protocol

from smv_planner.daemon.worker import ANSWER, LENGTH, OPINION, Job
from smv_planner.lazy import dataclass, field
from smv_planner.runner.decision import Decision, Request
from smv_planner.runner.events import Answered
from smv_planner.runner.records import Known, Unreadable, entry, question

GRACE = 5.0
"""Seconds that a worker has beyond its own deadline before it is killed: it may have to be started first."""


@dataclass(frozen=True, slots=True)
class Opinion:
    """A second engine agrees; or it differs, for this reason, and `folder` reproduces it."""

    differs: str | None = None
    folder: str | None = None


Reply = tuple[int, Decision] | Opinion


class Planners(Protocol):
    """Who decides. Nothing here blocks. `starts` counts the processes that were begun for it."""

    starts: int

    def ask(self, revision: int, request: Request) -> None:
        """A question; an older one that is open is void."""

    def replies(self) -> list[Reply]:
        """What has come in since, also the news that there will be no answer."""

    def close(self) -> None: ...


@dataclass
class Process:
    """One child, and the thread that talks with it."""

    child: subprocess.Popen[bytes]
    asking: deque[bytes] = field(default_factory=deque)
    some: threading.Event = field(default_factory=threading.Event)
    over: bool = False


class Worker:
    """Planners in a child process. `wake` is called in another thread when there is a reply.

    What the child says is read with the kernel's check of its plans, in a thread of ours: that takes some milliseconds.
    """

    def __init__(self, job: Job, known: Known, wake: Callable[[], None]) -> None:
        self._deadline, self._told = job.deadline, pickle.dumps(job)
        self._known, self._wake = known, wake
        self._replies: deque[Reply] = deque()
        self._open: int | None = None
        self._since = 0.0
        self.starts = 0
        self._process = self._start()

    def ask(self, revision: int, request: Request) -> None:
        if self._open is not None or self._process.over:
            self._stop()
            self._process = self._start()
        self._open, self._since = revision, time.monotonic()
        self._process.asking.append(b"%d " % revision + question(request) + b"\n")
        self._process.some.set()

    def replies(self) -> list[Reply]:
        over = self._process.over  # before what it has said is looked at: its last word counts
        found: list[Reply] = []
        while self._replies:
            reply = self._replies.popleft()
            if isinstance(reply, Opinion):
                found.append(reply)
            elif reply[0] == self._open:
                self._open = None
                found.append(reply)
        if self._open is not None:
            late = time.monotonic() - self._since > self._deadline + GRACE
            if late or over:
                why = "took too long" if late else f"ended with status {self._process.child.wait()}"
                found.append((self._open, Decision(undecided=f"the process that plans {why}")))
                self._open = None
                self._stop()
                self._process = self._start()
        return found

    @property
    def pid(self) -> int:
        return self._process.child.pid

    def close(self) -> None:
        self._stop()

    def _start(self) -> Process:
        self.starts += 1
        # -P: else a file of the folder in which the daemon was started could take the place of any module.
        command = [sys.executable, "-P", "-m", "smv_planner.daemon.worker"]
        child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        process = Process(child)
        threading.Thread(target=self._talk, args=(process,), name="planners", daemon=True).start()
        return process

    def _stop(self) -> None:
        process = self._process
        process.over = True
        process.child.kill()
        process.child.wait()
        process.some.set()

    def _talk(self, process: Process) -> None:
        to, back = process.child.stdin, process.child.stdout
        assert to is not None
        assert back is not None
        with suppress(OSError, ValueError), to, back:
            to.write(LENGTH.pack(len(self._told)) + self._told)
            to.flush()
            threading.Thread(target=self._listen, args=(process, back), name="answers", daemon=True).start()
            while not process.over:
                process.some.wait()
                process.some.clear()
                while process.asking:
                    to.write(process.asking.popleft())
                to.flush()
            process.child.wait()
        process.over = True
        self._wake()

    def _listen(self, process: Process, back: IO[bytes]) -> None:
        with suppress(OSError, ValueError):
            for line in back:
                if line.startswith(ANSWER):
                    self._replies.append(self._read(line.removeprefix(ANSWER)))
                elif line.startswith(OPINION):
                    told = json.loads(line.removeprefix(OPINION))
                    self._replies.append(Opinion(told.get("reason"), told.get("folder")))
                self._wake()
        process.over = True
        process.some.set()
        self._wake()

    def _read(self, said: bytes) -> tuple[int, Decision]:
        revision = int(json.loads(said)["revision"])
        try:
            answered = entry(said, self._known)
        except Unreadable as error:
            return revision, Decision(undecided=f"what the process that plans has said does not hold: {error}")
        assert isinstance(answered, Answered)
        return revision, answered.decision


def job(known: Known, engine: str, deadline: float, second: str | None = None, differences: str = ".") -> Job:
    return Job(known.model, os.getpid(), engine, deadline, second, differences)
