"""`smv-planner simulate`: a whole station in virtual time, live for people and as a transcript for everything else."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from smv_planner import garbage, language
from smv_planner.cli import outcome
from smv_planner.cli.question import settings
from smv_planner.errors import Mistake, UsageError
from smv_planner.journal import Folder, Refused, Unwritten
from smv_planner.lazy import dataclass, field
from smv_planner.model.model import Model
from smv_planner.runner.events import Note
from smv_planner.runner.situation import Status
from smv_planner.simulate.answers import Memory
from smv_planner.simulate.campaign import TROUBLE, Campaign
from smv_planner.simulate.planning import planners, station
from smv_planner.simulate.play import Play, Record
from smv_planner.simulate.script import WITHIN, Case, Then, cases, chosen
from smv_planner.simulate.view import Timelines, transcript
from smv_planner.simulate.world import World

if TYPE_CHECKING:
    from smv_planner.cli.scene import Scene

FRAME = 0.1
"""Real seconds between two pictures."""

AT_ONCE = 5.0
"""Virtual seconds between two pictures when time passes as fast as it can."""

SCENARIO = "scenario"
"""The file beside a journal that says which scenario it is of."""

EXAMPLES = """\
examples:
  smv-planner simulate scenarios/door --case played_jam
  smv-planner simulate scenarios/door --set door.locked=false --speed 10
  smv-planner simulate scenarios/door --faults --seed 7

exit codes:
  0  the case came out as it declares; without one, everything intended was reached
  1  it did not"""


def add_simulate(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", help="a scenario file, or a folder that holds model.yaml and cases")
    parser.add_argument("--case", metavar="NAME", help="play an execution case of the folder, as e5 for cases/e5.yaml")
    parser.add_argument("--set", metavar="VAR=VALUE", action="append", default=[], help="what is true at the start; repeatable")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="what decides all that is left open (default: 0)")
    parser.add_argument("--until", metavar="S", type=float, help="virtual seconds at most")
    parser.add_argument("--speed", metavar="X", type=float, default=0.0, help="times real time (default: as fast as possible)")
    parser.add_argument(
        "--faults", metavar="S", type=float, nargs="?", const=TROUBLE, help="so many seconds of trouble first (%(const)g)"
    )
    parser.add_argument("--engine", metavar="NAME", default="auto", help="who plans (default: %(default)s)")
    parser.add_argument("--journal", metavar="DIR", help="write the planner's journal to a new folder, for 'replay'")
    parser.add_argument("--json", action="store_true", help="print one JSON object at the end")


class _Unhurried(Folder):
    """A folder that leaves it to the system when bytes reach the disk: what is lost can be simulated again."""

    def sync(self, name: str) -> None:
        pass


class Run(Protocol):
    """What can be played on in pieces and judged at the end."""

    world: World

    def over(self) -> bool: ...

    def differences(self) -> list[str]: ...


@dataclass
class Troubled:
    """A campaign with trouble of its own, after which what is intended has to be reached."""

    campaign: Campaign

    def __post_init__(self) -> None:
        self.world = self.campaign.world

    def over(self) -> bool:
        if self.campaign.troubled and self.world.at >= self.campaign.trouble:
            self.campaign.calm()
        return self.campaign.finished()

    def differences(self) -> list[str]:
        found = [str(violation) for violation in self.campaign.observer.violations]
        return found if self.campaign.finished() else [*found, self.campaign.unfinished()]


@dataclass
class Free:
    """A station left to itself: over when all that began is done."""

    play: Play

    def __post_init__(self) -> None:
        self.world = self.play.world

    def over(self) -> bool:
        self.play.over()
        now = self.world.situation
        rest = (Status.INITIAL, Status.FINISHED, Status.CANCELLED)
        return bool(self.play.record.intentions) and all(p.status in rest for p in now.intentions.values())

    def differences(self) -> list[str]:
        now = self.world.situation
        return [f"'{n}' is {p.status.value}: {p.reason}" for n, p in now.intentions.items() if p.status is Status.ERROR] + [
            f"'{n}' is {p.status.value}" for n, p in now.intentions.items() if p.status in (Status.EXECUTING, Status.PAUSED)
        ]


@dataclass
class Watched:
    """A run together with everything that is told of it."""

    record: Record = field(default_factory=Record)
    tell: Callable[[float, Note], None] = lambda at, note: None

    def __call__(self, at: float, note: Note) -> None:
        self.record.take(note)
        self.tell(at, note)


def run(asked: argparse.Namespace) -> int:
    _check(asked)
    garbage.look_seldom()
    model, case = _case(asked)
    watched = Watched()
    playing, limit = _begun(asked, model, case, watched, _journal(asked))
    scene = None
    if not asked.json and sys.stdout.isatty():
        from smv_planner.cli.scene import Scene

        scene = Scene(playing.world, case, asked.speed)
        watched.tell = scene.tell
    elif not asked.json:
        print(f"{model.name}, {case.name}, seed {asked.seed}: {case.description}")
        watched.tell = lambda at, note: print(transcript(at, note))
    lines = scene.lines if scene else Timelines(playing.world.station)
    try:
        _pass(playing, limit, asked.speed, lines, scene)
    finally:
        for process in playing.world.processes:
            if process.journal is not None and asked.journal:
                process.journal.close()
    found = playing.differences()
    if asked.json:
        print(json.dumps(_told(asked, case, playing.world, watched.record, found), indent=2))
    else:
        _show_end(playing.world, lines, watched.record, found)
    return outcome.NO_PLAN if found else outcome.REACHED


def _begun(asked: argparse.Namespace, model: Model, case: Case, watched: Watched, disk: Folder | None) -> tuple[Run, float]:
    """What is to be played, and how long at most."""
    if asked.faults is not None:
        campaign = Campaign(station(model), Memory(model, planners(asked.engine)), asked.seed, case.given, asked.faults)
        campaign.world.on_note = watched
        return Troubled(campaign), asked.until or campaign.trouble + campaign.peace
    play = Play(station(model), case, planners(asked.engine), asked.seed, watched, disk)
    return (play if case.then.intentions else Free(play)), asked.until or case.then.within


def _pass(playing: Run, limit: float, speed: float, lines: Timelines, scene: Scene | None) -> None:
    """Let time pass to the end of the run, and show it if somebody looks on."""
    over = False

    def stop() -> bool:
        nonlocal over
        lines.see(playing.world.situation)
        over = over or playing.over()
        return over

    with scene.shown() if scene else nullcontext():
        at, began = 0.0, time.monotonic()
        while at < limit and not over:
            at = min(limit, (time.monotonic() - began) * speed if speed else at + AT_ONCE)
            playing.world.run(at, stop)
            if scene is not None:
                scene.draw()
            if speed and not over:
                time.sleep(FRAME)


def _check(asked: argparse.Namespace) -> None:
    mistakes = []
    if asked.case and asked.set:
        mistakes.append(Mistake("--case and --set do not go together", "a case has its own start"))
    if asked.case and asked.faults is not None:
        mistakes.append(Mistake("--case and --faults do not go together", "a case tells what goes wrong"))
    if asked.journal and asked.faults is not None:
        mistakes.append(Mistake("--journal and --faults do not go together", "there, planners die and begin anew"))
    for name in ("until", "faults"):
        value = getattr(asked, name)
        if value is not None and not 0 < value <= 1e6:
            mistakes.append(Mistake(f"--{name} is {value:g}", "it is in seconds, greater than 0, at most 1000000"))
    if not 0 <= asked.speed <= 1e6:
        mistakes.append(Mistake(f"--speed is {asked.speed:g}", "it is a factor; 0 is as fast as possible"))
    if mistakes:
        raise UsageError(mistakes)


def _case(asked: argparse.Namespace) -> tuple[Model, Case]:
    if asked.case:
        return chosen(cases(Path(asked.scenario), cache(language.load)), asked.case)
    model = language.load(asked.scenario)
    return model, Case("no case", "the station runs", settings(model, asked.set), (), Then(within=asked.until or WITHIN))


def _journal(asked: argparse.Namespace) -> Folder | None:
    if asked.journal is None:
        return None
    folder = Path(asked.journal)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError([Mistake(f"'{folder}' is there already", "a journal of a simulation begins in a new folder")])
    try:
        disk = _Unhurried(folder)
    except (Refused, Unwritten) as error:
        raise UsageError([Mistake(str(error), "--journal names another folder")]) from error
    (folder / SCENARIO).write_text(f"{Path(asked.scenario).absolute()}\n", encoding="utf-8")
    return disk


def _told(asked: argparse.Namespace, case: Case, world: World, record: Record, found: list[str]) -> dict[str, object]:
    return {
        "case": case.name,
        "seed": asked.seed,
        "engine": asked.engine,
        "virtual_seconds": round(world.at, 3),
        "intentions": record.intentions,
        "actions": [action.name for action in record.recovery],
        "operator": record.operator,
        "operations": record.operations,
        "failed": list(record.failed),
        "alarms": record.alarms,
        "differences": found,
        "fingerprint": world.fingerprint,
        "notes": [{"at": round(at, 4), "kind": note.kind, "text": note.text} for at, note in world.notes],
    }


def _show_end(world: World, lines: Timelines, record: Record, found: list[str]) -> None:
    width = 100
    scale = max(world.at, 1.0) / width
    longest = max((len(name) for name, _ in lines.drawn(world.at, width, scale)), default=0)
    print()
    for name, line in lines.drawn(world.at, width, scale):
        print(f"{name:<{longest}} │{line.rstrip()}")
    print(f"{'seconds':<{longest}} │{lines.axis(world.at, width, scale)}")
    print("━ at it   ? waits for the operator   ! in error   x lost\n")
    if record.recovery:
        print("planning actions: " + ", ".join(action.name for action in record.recovery))
    if record.operator:
        print("the operator was asked for: " + ", ".join(record.operator))
    for name, status in record.intentions.items():
        print(f"{name}: {status}")
    for difference in found:
        print(f"not as it should be: {difference}")
    print(f"{world.at:.2f} virtual seconds; {'as expected' if not found else 'otherwise than expected'}")
