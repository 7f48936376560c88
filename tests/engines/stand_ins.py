"""Programs that stand where a model checker should, and misbehave; and a way to see that nothing of them is left."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path

import pytest

FAULTS = {
    "segmentation fault": "kill -SEGV $$",
    "abort": "kill -ABRT $$",
    "killed": "kill -KILL $$",
    "says nothing": "exit 0",
    "exit status 1": "echo something is wrong >&2; exit 1",
    "out of memory": "exec tail /dev/zero",
    "floods standard output": "exec yes",
    "floods standard error": "exec yes >&2",
    "floods the disk": "while :; do cat /dev/zero >> trace.xml || exit 1; done",
    "one endless line": "exec cat /dev/zero >&2",
    "hangs": "exec sleep 600",
    "hangs and ignores": "trap '' TERM INT HUP; while :; do sleep 600; done",
    "hangs with closed pipes": "exec sleep 600 >&- 2>&-",
    "forks and hangs": "sleep 600 & sleep 600",
    "forks and leaves": "sleep 600 & exit 0",
    "forks, leaves and floods": "yes >&2 & exit 0",
}

HANGS = {name for name in FAULTS if "hangs" in name}


class StandIn:
    """An executable shell script in a folder with a space in its name."""

    def __init__(self, folder: Path, body: str) -> None:
        home = folder / "somebody's own tools"
        home.mkdir()
        self.path = home / "nuXmv"
        self._group = home / "group"
        self.path.write_text(f'#!/bin/sh\necho $$ > "$(dirname "$0")/group"\n{body}\n')
        self.path.chmod(0o755)

    def started(self) -> bool:
        return self._group.exists() and self._group.read_text().endswith("\n")

    def gone(self) -> bool:
        """Whether nobody of its process group is left, shortly after."""
        group = self._group.read_text().strip()
        return any(not alive(group) or time.sleep(0.01) for _ in range(100))


def alive(group: str) -> list[str]:
    """The processes of a group, without those that only wait for somebody to take note of their end."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, its_group, *_ = stat.read_text().rpartition(")")[2].split()
            if its_group == group and state != "Z":
                found.append(stat.parent.name)
    return found


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where temporary folders are made during a test."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder
