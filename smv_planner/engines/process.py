"""Running one model checker as a child process: bounded in time, memory and output, and gone afterwards.

The child gets a session of its own, no input, a small environment and resource limits, and it dies with us. Whatever
happens, an exception here included, its whole process group is killed and reaped before `run` returns.
"""

from __future__ import annotations

import ctypes
import math
import os
import resource
import selectors
import signal
import subprocess
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import IO, Literal

from smv_planner.lazy import dataclass

FLOOD = 64 << 20
"""Bytes a child may write to standard output, to standard error, or to a file."""

_LAST = 12  # lines that are kept for messages
_STACK = 64 << 20  # NuSMV recurses over what it reads; the usual 8 MiB are not much
_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG, _PR_SET_NO_NEW_PRIVS = 1, 38
_ADDR_NO_RANDOMIZE = 0x0040000  # NuSMV orders things by address: with fixed ones the same question has the same answer

Killed = Literal["deadline", "flood"]


@dataclass(frozen=True, slots=True)
class Ended:
    """How a child ended: its exit status, or minus the signal that ended it; `killed` if that was us, and why."""

    status: int
    killed: Killed | None
    output: bytes
    last_words: str

    @property
    def trouble(self) -> str | None:
        """What went wrong and what the child last said; None if it ended well."""
        if self.killed == "flood":
            trouble = f"wrote more than {FLOOD >> 20} MiB"
        elif self.killed:
            trouble = "ran out of time"
        elif self.status < 0:
            trouble = f"was ended by {_signal(-self.status)}"
        elif self.status:
            trouble = f"ended with exit status {self.status}"
        else:
            return None
        return f"{trouble}, and last said:\n{self.last_words}" if self.last_words else trouble


def run(command: Sequence[str], *, folder: str, seconds: float, memory: int, on_line: Callable[[str], None]) -> Ended:
    """Run a command in `folder`. `on_line` hears its standard error while it runs, line by line.

    Raises OSError if the command cannot be started.
    """
    ends = time.monotonic() + seconds
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # until the child is in a `try` of ours
    try:
        child = subprocess.Popen(
            command,
            cwd=folder,
            env=_environment(folder),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
            preexec_fn=_confinement(memory, seconds, mask),
        )
        with child:  # closes the pipes and reaps
            assert child.stdout
            assert child.stderr
            heard = _Heard(child.stdout, child.stderr, on_line)
            try:
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)
                killed = heard.listen(child.pid, ends)
            finally:
                with suppress(ProcessLookupError):
                    os.killpg(child.pid, signal.SIGKILL)
            status = child.wait()
            killed = heard.rest() or killed
        return Ended(status, killed, bytes(heard.output), heard.last_words())
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


class _Heard:
    """What a child has said so far."""

    def __init__(self, out: IO[bytes], err: IO[bytes], on_line: Callable[[str], None]) -> None:
        self.output = bytearray()
        self._lines: deque[str] = deque(maxlen=_LAST)
        self._line = b""
        self._errors = 0
        self._on_line = on_line
        self._hears: dict[int, Callable[[bytes], None]] = {out.fileno(): self.output.extend, err.fileno(): self._hear_error}
        for descriptor in self._hears:
            os.set_blocking(descriptor, False)

    def listen(self, pid: int, ends: float) -> Killed | None:
        """Until the child ends by itself, or has to be killed."""
        with selectors.DefaultSelector() as selector, open(os.pidfd_open(pid), "rb", buffering=0) as ended:
            selector.register(ended, selectors.EVENT_READ)
            for descriptor in self._hears:
                selector.register(descriptor, selectors.EVENT_READ)
            while (left := ends - time.monotonic()) > 0:
                ready = [key.fd for key, _ in selector.select(left)]
                if ended.fileno() in ready:
                    return None
                for descriptor in ready:
                    if not self._read(descriptor):
                        selector.unregister(descriptor)
                if self._flooded():
                    return "flood"
            return "deadline"

    def rest(self) -> Killed | None:
        """What is still in the pipes after the end."""
        for descriptor in self._hears:
            while not self._flooded() and self._read(descriptor):
                pass
        if self._line:
            self._hear_error(b"\n")
        return "flood" if self._flooded() else None

    def last_words(self) -> str:
        lines = list(self._lines) or self.output[-2000:].decode("ascii", "replace").splitlines()[-_LAST:]
        return "\n".join(lines)

    def _read(self, descriptor: int) -> bool:
        try:
            data = os.read(descriptor, 1 << 16)
        except BlockingIOError:
            return False
        self._hears[descriptor](data)
        return bool(data)

    def _flooded(self) -> bool:
        return max(len(self.output), self._errors) > FLOOD

    def _hear_error(self, data: bytes) -> None:
        self._errors += len(data)
        *lines, self._line = (self._line + data).split(b"\n")
        self._line = self._line[-4000:]
        for line in lines[-1000:]:  # a flood is not worth hearing line by line
            text = line[-400:].decode("ascii", "replace").strip()
            if text:
                self._lines.append(text)
                self._on_line(text)


def _confinement(memory: int, seconds: float, mask: set[signal.Signals | int]) -> Callable[[], None]:
    """What the child does between fork and exec. The limit on CPU time is for the case that we are stuck ourselves."""
    parent = os.getpid()
    cpu = math.ceil(seconds) + 1
    limits = {resource.RLIMIT_AS: memory, resource.RLIMIT_CPU: cpu, resource.RLIMIT_FSIZE: FLOOD, resource.RLIMIT_CORE: 0}

    def confine() -> None:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        _LIBC.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
        _LIBC.personality(_ADDR_NO_RANDOMIZE)
        if os.getppid() != parent:
            os._exit(127)
        for limit, value in limits.items():
            allowed = _within(value, resource.getrlimit(limit)[1])
            resource.setrlimit(limit, (allowed, allowed))
        ceiling = resource.getrlimit(resource.RLIMIT_STACK)[1]
        resource.setrlimit(resource.RLIMIT_STACK, (_within(_STACK, ceiling), ceiling))
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)

    return confine


def _within(value: int, ceiling: int) -> int:
    return value if ceiling == resource.RLIM_INFINITY else min(value, ceiling)


def _environment(folder: str) -> Mapping[str, str]:
    """What a model checker needs to start, and no start-up files of the user's."""
    kept = ("PATH", "LD_LIBRARY_PATH", "NUSMV_LIBRARY_PATH", "NUXMV_LIBRARY_PATH")
    return {name: os.environ[name] for name in kept if name in os.environ} | {"HOME": folder, "TMPDIR": folder, "LC_ALL": "C"}


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
