"""Bugs that were never there: each is an edit of the code, with the seed that finds it.

`python bugs.py NAME SEEDS` looks for seeds that do. A planted bug nobody finds says that the simulation looks away.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Edit:
    file: str
    old: str
    new: str


@dataclass(frozen=True)
class Bug:
    """`seed` of `scenario` breaks `rule` with these edits, and none without."""

    name: str
    scenario: str
    seed: int
    rule: str
    edits: tuple[Edit, ...]


def _one(name: str, scenario: str, seed: int, rule: str, file: str, old: str, new: str) -> Bug:
    return Bug(name, scenario, seed, rule, (Edit(file, old, new),))


STEP, HUB, VIEW = "runner/step.py", "protocol/hub.py", "protocol/view.py"
STATION = "assembly_station"

BUGS = (
    _one(
        "plans are followed unchecked",
        "nutrunner",
        2,
        "I7",
        "planner/decide.py",
        "            checked = check_plan(problem, verdict, orders(problem, verdict))\n",
        "            each = tuple((at - 1,) if at else () for at in range(len(verdict.path)))\n"
        "            checked = CheckedPlan(problem, verdict, each, False)\n",
    ),
    _one(
        "an overtaken state is believed", "nutrunner", 1, "I2", VIEW, "if message.seq <= now.seq:", "if message.seq == now.seq:"
    ),
    Bug(
        "the clock of an effect is never reset",
        "nutrunner",
        0,
        "I2",
        (
            Edit(
                "runner/monitor.py",
                "    return {\n        name: timers.get(name, at)",
                "    return dict(timers) | {\n        name: timers.get(name, at)",
            ),
            Edit(
                STEP,
                "timers = {name: since for name, since in self.now.timers.items() if self.station.enabled[name](state)}",
                "timers = self.now.timers",
            ),
        ),
    ),
    _one(
        "an answer to an old question is taken",
        STATION,
        3,
        "I8",
        STEP,
        "if asked is None or asked.revision != revision:",
        "if asked is None:",
    ),
    Bug(
        "published before it is in the journal",
        "nutrunner",
        0,
        "I5",
        (
            Edit("simulate/process.py", "        self._write(event)\n        self._moment(Moment.WRITTEN)\n", ""),
            Edit(
                "simulate/process.py",
                "            self._moment(Moment.PERFORMED)\n",
                "            self._moment(Moment.PERFORMED)\n        self._write(event)\n        self._moment(Moment.WRITTEN)\n",
            ),
        ),
    ),
    _one("a hub obeys an old epoch", "nutrunner", 1, "fence", HUB, "if message.epoch < now.epoch:", "if False:"),
    _one("a hub obeys an overtaken goal", "nutrunner", 1, "fence", HUB, "if message.seq < now.seq:", "if False:"),
    _one(
        "at a start goals come from the initial state, not from the mirror",
        "nutrunner",
        0,
        "I3",
        STEP,
        "self.believe({**state.measured, **state.mirror})",
        "self.believe({**state.measured})",
    ),
    _one(
        "commands do not wait for those that they depend on",
        STATION,
        0,
        "true",
        STEP,
        "return all(name in self.now.lost or self.mirrors(name) for",
        "return all(True for",
    ),
    _one(
        "timed-out effects are planned on",
        "nutrunner",
        0,
        "I7",
        STEP,
        "disabled=frozenset(now.disabled),",
        "disabled=frozenset(),",
    ),
    _one(
        "the order of a plan is ignored",
        "nutrunner",
        11,
        "I7",
        "runner/decision.py",
        "waiting = (at for at in range(len(self.plan.trace.path)) if at not in self.done)\n"
        "        return tuple(at for at in waiting if self.done.issuperset(self.plan.after[at]))",
        "waiting = (at for at in range(len(self.plan.trace.path)) if at not in self.done)\n        return tuple(waiting)",
    ),
    _one(
        "a torn record is read as a whole one",
        "nutrunner",
        0,
        "Unreadable",
        "journal/framing.py",
        "        if written < body + length:\n            break\n        payload = data[body : body + length]\n"
        "        if crc32(payload, of_length) != of_payload:\n",
        "        payload = data[body : body + length]\n        if False:\n",
    ),
    _one(
        "goals are sent under the old number",
        "nutrunner",
        0,
        "I5",
        STEP,
        "number = self.now.sequence[name] + 1",
        "number = self.now.sequence[name] or 1",
    ),
    _one(
        "nobody notices that a hub is silent",
        "nutrunner",
        1,
        "I6",
        STEP,
        "if limit is not None and hubs.silent(view, self.now.at, limit):",
        "if False:",
    ),
    Bug(
        "the gate lets everything pass, and goals are not taken from the mirror",
        "nutrunner",
        0,
        "I3",
        (
            Edit(
                "runner/gate.py",
                "    interface = station.interfaces[resource]\n",
                "    return None\n    interface = station.interfaces[resource]\n",
            ),
            Edit(STEP, "self.believe({**state.measured, **state.mirror})", "self.believe({**state.measured})"),
        ),
    ),
)


def planted(bug: Bug | None, folder: Path) -> Path:
    """A copy of the package with a bug in it."""
    copy = folder / "smv_planner"
    shutil.copytree(ROOT / "smv_planner", copy, ignore=shutil.ignore_patterns("__pycache__"))
    for edit in bug.edits if bug else ():
        text = (copy / edit.file).read_text(encoding="utf-8")
        assert text.count(edit.old) == 1, f"{edit.file} has changed: '{edit.old}' is there {text.count(edit.old)} times"
        (copy / edit.file).write_text(text.replace(edit.old, edit.new), encoding="utf-8")
    return folder


def run(folder: Path, scenario: str, seeds: list[int]) -> subprocess.CompletedProcess[str]:
    """These seeds on the package in a folder, in a process of its own."""
    seeds_py = Path(__file__).with_name("seeds.py")
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, str(seeds_py), scenario, *map(str, seeds)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def main(name: str, scenario: str, last: str) -> None:
    for bug in BUGS:
        if name not in ("all", bug.name):
            continue
        with tempfile.TemporaryDirectory() as folder:
            done = run(planted(bug, Path(folder)), scenario, list(range(int(last))))
        lines = [line.strip() for line in done.stdout.splitlines() if line.startswith("  seed") and "only" not in line]
        words = [*lines[:1], *done.stderr.splitlines()[-1:]] if done.returncode else []
        print(f"{bug.name}: {'; '.join(words)[:300] or 'NOT FOUND'}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
