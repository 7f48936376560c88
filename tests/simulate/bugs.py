"""Bugs that were never there: each is an edit of the code, with what finds it: a seed, or where none does a case or a story.

`python bugs.py NAME SCENARIO SEEDS` looks for seeds that do. A planted bug nobody finds says that the simulation looks away.
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
class Seed:
    """A run under drawn trouble, which breaks `rule`."""

    scenario: str
    number: int
    rule: str

    @property
    def command(self) -> list[str]:
        return [str(Path(__file__).with_name("seeds.py")), self.scenario, str(self.number)]

    @property
    def shown(self) -> str:
        """What is said when it breaks: the rule of the observer, or the name of an exception."""
        return self.rule if self.rule[0].isupper() and self.rule[1:2].islower() else f" {self.rule}: "


@dataclass(frozen=True)
class Case:
    """An execution case, whose expectations do not hold."""

    scenario: str
    name: str

    @property
    def command(self) -> list[str]:
        return ["-m", "smv_planner", "simulate", str(ROOT / "scenarios" / self.scenario), "--case", self.name]

    shown = ""


@dataclass(frozen=True)
class Story:
    """A test of the runner with obedient hubs on a bench, which fails."""

    file: str
    test: str

    @property
    def command(self) -> list[str]:
        return ["-m", "pytest", "-q", "-p", "no:cacheprovider", f"{ROOT / 'tests' / 'runner' / self.file}::{self.test}"]

    shown = "1 failed"


Finder = Seed | Case | Story


@dataclass(frozen=True)
class Bug:
    """With these edits the finder finds something, and nothing without."""

    name: str
    finder: Finder
    edits: tuple[Edit, ...]


def _one(name: str, finder: Finder, file: str, old: str, new: str) -> Bug:
    return Bug(name, finder, (Edit(file, old, new),))


HUB, VIEW = "protocol/hub.py", "protocol/view.py"
STATION = "assembly_station"

BUGS = (
    _one(
        "plans are followed unchecked",
        Seed("nutrunner", 2, "I7"),
        "planner/decide.py",
        "            checked = check_plan(problem, verdict, orders(problem, verdict))\n",
        "            each = tuple((at - 1,) if at else () for at in range(len(verdict.path)))\n"
        "            checked = CheckedPlan(problem, verdict, each, False)\n",
    ),
    _one(
        "an overtaken state is believed",
        Seed("nutrunner", 3, "I2"),
        VIEW,
        "if message.seq <= now.seq:",
        "if message.seq == now.seq:",
    ),
    Bug(
        "the clock of an effect is never reset",
        Seed("nutrunner", 0, "I2"),
        (
            Edit(
                "runner/monitor.py",
                "    return {\n        name: timers.get(name, at)",
                "    return dict(timers) | {\n        name: timers.get(name, at)",
            ),
            Edit(
                "runner/turn.py",
                "timers = {name: since for name, since in self.now.timers.items() if self.station.enabled[name](state)}",
                "timers = self.now.timers",
            ),
        ),
    ),
    _one(
        "an answer to an old question is taken",
        Seed("nutrunner", 46, "I8"),
        "runner/asking.py",
        "if asked is None or asked.revision != revision:",
        "if asked is None:",
    ),
    Bug(
        "published before it is in the journal",
        Seed("nutrunner", 0, "I5"),
        (
            Edit("simulate/process.py", "        self._write(event)\n        self._moment(Moment.WRITTEN)\n", ""),
            Edit(
                "simulate/process.py",
                "            self._moment(Moment.PERFORMED)\n",
                "            self._moment(Moment.PERFORMED)\n        self._write(event)\n        self._moment(Moment.WRITTEN)\n",
            ),
        ),
    ),
    _one("a hub obeys an old epoch", Seed("nutrunner", 1, "fence"), HUB, "if message.epoch < now.epoch:", "if False:"),
    _one("a hub obeys an overtaken goal", Seed("nutrunner", 1, "fence"), HUB, "if message.seq < now.seq:", "if False:"),
    _one(
        "at a start goals come from the initial state, not from the mirror",
        Seed("nutrunner", 3, "I3"),
        "runner/resources.py",
        "turn.believe({**state.measured, **state.mirror})",
        "turn.believe({**state.measured})",
    ),
    _one(
        "commands do not wait for those that they depend on",
        Seed(STATION, 0, "true"),
        "runner/plan_steps.py",
        "return all(name in turn.now.lost or goals.mirrors(turn, name) for",
        "return all(True for",
    ),
    _one(
        "timed-out effects are planned on",
        Seed("nutrunner", 0, "I7"),
        "runner/asking.py",
        "disabled=frozenset(now.disabled),",
        "disabled=frozenset(),",
    ),
    _one(
        "the order of a plan is ignored",
        Seed("nutrunner", 11, "I7"),
        "runner/decision.py",
        "waiting = (at for at in range(len(self.plan.trace.path)) if at not in self.done)\n"
        "        return tuple(at for at in waiting if self.done.issuperset(self.plan.after[at]))",
        "waiting = (at for at in range(len(self.plan.trace.path)) if at not in self.done)\n        return tuple(waiting)",
    ),
    _one(
        "a torn record is read as a whole one",
        Seed("nutrunner", 0, "Unreadable"),
        "journal/framing.py",
        "        if written < body + length:\n            break\n        payload = data[body : body + length]\n"
        "        if crc32(payload, of_length) != of_payload:\n",
        "        payload = data[body : body + length]\n        if False:\n",
    ),
    _one(
        "goals are sent under the old number",
        Seed("nutrunner", 0, "I5"),
        "runner/goals.py",
        "number = turn.now.sequence[name] + 1",
        "number = turn.now.sequence[name] or 1",
    ),
    _one(
        "nobody notices that a hub is silent",
        Seed("nutrunner", 1, "I6"),
        "runner/resources.py",
        "if limit is not None and hubs.silent(view, turn.now.at, limit):",
        "if False:",
    ),
    Bug(
        "the gate lets everything pass, and goals are not taken from the mirror",
        Seed("nutrunner", 9, "I3"),
        (
            Edit(
                "runner/gate.py",
                "    interface = station.interfaces[resource]\n",
                "    return None\n    interface = station.interfaces[resource]\n",
            ),
            Edit("runner/resources.py", "turn.believe({**state.measured, **state.mirror})", "turn.believe({**state.measured})"),
        ),
    ),
    _one(
        "failures are not counted",
        Case(STATION, "e8_for_ever"),
        "runner/failures.py",
        "failures[operation.name] = failures.get(operation.name, 0) + 1",
        "failures[operation.name] = 1",
    ),
    _one(
        "what an intention still owes is forgotten",
        Story("test_intentions.py", "test_activating_what_is_pursued_already_forgets_nothing_that_is_owed"),
        "runner/turn.py",
        "owed=progressed(formula, old, index))",
        "owed=formula)",
    ),
    _one(
        "post-conditions are worked out again when an operation goes on",
        Story("test_intentions.py", "test_an_operation_that_goes_on_in_a_new_plan_keeps_the_post_condition_it_started_with"),
        "runner/recovery.py",
        "going_on.append(replace(execution, task=course.plan.tasks[at]))",
        "going_on.extend(start(self.model, self.request.state, [course.plan.tasks[at]])[1])",
    ),
    _one(
        "a confirmation counts for whatever is asked now",
        Story("test_operator.py", "test_a_confirmation_said_again_confirms_nothing_that_was_asked_for_since"),
        "runner/orders.py",
        '"""Done, says the operator. Confirming twice, or what is no longer wanted, changes nothing."""\n'
        "    wish = turn.now.wishes.get(request)",
        "request, wish = next(reversed(turn.now.wishes.items()), (request, None))",
    ),
    _one(
        "maintenance counts as confirmed when it is asked for",
        Story("test_step.py", "test_nothing_goes_on_under_the_hands_of_the_operator"),
        "runner/plan_steps.py",
        "operator.ask(turn, Wish(WishKind.MAINTENANCE, text, at, transition.name))",
        "operator.ask(turn, Wish(WishKind.MAINTENANCE, text, at, transition.name, confirmed_at=now.at))",
    ),
    _one(
        "a planner that begins anew takes the epoch that it finds",
        Seed("door", 0, "I5"),
        "runner/taking_over.py",
        "epoch = max([now.epoch, *(one for one in claimed if one <= now.epoch + LEAP)]) + 1",
        "epoch = max([1, now.epoch, *(one for one in claimed if one <= now.epoch + LEAP)])",
    ),
    _one(
        "a superseded planner goes on",
        Seed("nutrunner", 0, "fence"),
        "runner/taking_over.py",
        "or not hubs.superseded(view, now.epoch, now.planner):",
        "or True:",
    ),
    _one(
        "nobody is asked before a step out of a forbidden state",
        Story("test_forbidden.py", "test_the_way_out_goes_on_when_the_intention_is_reached_on_it"),
        "runner/plan_steps.py",
        "if following.purpose is Purpose.EXIT and at not in following.approved:",
        "if False:",
    ),
    _one(
        "nobody notices that a hub is stuck",
        Story("test_step.py", "test_a_hub_that_speaks_but_does_not_mirror_is_lost"),
        "runner/resources.py",
        "elif stuck := hubs.stuck(view, resource.mirror_within):",
        "elif stuck := ():",
    ),
    Bug(
        "resources that are lost are planned with and commanded",
        Seed("nutrunner", 1, "I6"),
        (
            Edit("runner/asking.py", "lost=frozenset(now.lost),", "lost=frozenset(),"),
            Edit("runner/plan_steps.py", "(name in turn.now.lost or not resources.obeys(turn, view))", "False"),
        ),
    ),
    _one(
        "what has waited while a planner slept is believed",
        Seed(STATION, 1288, "true"),
        "runner/step.py",
        "deaf=station.model.period",
        "deaf=0.0",
    ),
    _one(
        "what a silent hub was told is taken back, wherever its device may be",
        Seed(STATION, 1496, "true"),
        "runner/resources.py",
        "if is_silent(turn, name) and not _may_go_back(turn, name, mirrored):",
        "if False:",
    ),
    _one(
        "automatic transitions wait while a plan is followed",
        Seed("nutrunner", 0, "I8"),
        "runner/advancing.py",
        "if due is None or turn.now.halted == UNSETTLED:",
        "if due is None or turn.now.following or turn.now.halted == UNSETTLED:",
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


def run(folder: Path, finder: Finder) -> subprocess.CompletedProcess[str]:
    """What finds a bug, on the package in a folder, in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-P", *finder.command]  # not the package in the current folder
    return subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)


def finds(done: subprocess.CompletedProcess[str], finder: Finder) -> bool:
    return done.returncode == 1 and finder.shown in done.stdout + done.stderr


def main(name: str, *search: str) -> None:
    """Whether each bug is found by what is said to find it; or, with a scenario and a number, by which of so many seeds."""
    for bug in BUGS:
        if name not in ("all", bug.name):
            continue
        with tempfile.TemporaryDirectory() as folder:
            planted(bug, Path(folder))
            finders: list[Finder] = [Seed(search[0], at, "?") for at in range(int(search[1]))] if search else [bug.finder]
            for finder in finders:
                done = run(Path(folder), finder)
                lines = [line.strip() for line in done.stdout.splitlines() if ": " in line and "only" not in line]
                words = [*lines[:1], *done.stderr.splitlines()[-1:]]
                found = done.returncode == 1 and bool(words) if search else finds(done, finder)
                if found:
                    break
        print(f"{bug.name}: {finder} {'; '.join(words)[:200] if found else 'NOT FOUND'}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
