"""One run again and again, each time with the planner killed at another moment, and gone on with from its journal.

Seeds kill it somewhere; a sweep kills it everywhere: before a record is written, while it is, before the runner sees the
event, before anything is performed, and after each output.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from smv_planner.lazy import dataclass
from smv_planner.runner.events import Event, Output, Send
from smv_planner.runner.situation import Situation
from smv_planner.simulate.observer import Observer
from smv_planner.simulate.process import MemoryDisk, Moment, Process
from smv_planner.simulate.world import Watch, World

DEAD = 1.0
"""Seconds until there is a new process."""

Make = Callable[[], World]
"""The world of a run, always the same one."""

Done = Callable[[Situation], bool]


class _Marks(Watch):
    """The moments of events from which more follows than goals said again."""

    def __init__(self) -> None:
        self.moments: list[Moment] = []
        self.points: list[int] = []
        self._began = 0
        self._something = False

    def moment(self, process: Process, moment: Moment) -> bool:
        if moment is Moment.RECEIVED:
            self.close()
        self.moments.append(moment)
        return False

    def turned(self, process: Process, event: Event, before: Situation, outputs: tuple[Output, ...]) -> None:
        new = process.situation.sequence != before.sequence
        self._something = new or any(not isinstance(output, Send) for output in outputs)

    def close(self) -> None:
        if self._something:
            self.points.extend(range(self._began, len(self.moments)))
        self._began, self._something = len(self.moments), False


@dataclass(frozen=True, slots=True)
class Point:
    """The `number`-th moment of a run."""

    number: int
    moment: Moment


def points(make: Make, done: Done, until: float) -> list[Point]:
    """Every moment of a run from which something follows."""
    marks, world = _Marks(), make()
    world.watch, world.kill = marks, marks.moment
    world.run(until, stop=lambda: done(world.situation))
    assert done(world.situation), "undisturbed, the run comes to its end"
    marks.close()
    return [Point(number, marks.moments[number]) for number in marks.points]


def killed(point: Point, make: Make, done: Done, until: float) -> Iterator[str]:
    """What is wrong with the run in which the planner dies at this moment."""
    world, count = make(), iter(range(point.number + 1))
    assert isinstance(world.disk, MemoryDisk)
    observer = Observer(world.station)
    observer.watching(world)

    def kill(process: Process, moment: Moment) -> bool:
        if next(count, None) != point.number:
            return False
        assert moment is point.moment, "until then nothing is different"
        world.later(DEAD, go_on)
        return True

    def go_on() -> None:
        world.start_planner("planner-2", world.disk)

    world.kill = kill
    world.run(until, stop=lambda: done(world.situation) and world.process.alive)  # what a dead process knew does not count
    where = f"killed at moment {point.number} ({point.moment})"
    yield from (f"{where}: {violation}" for violation in observer.violations)
    if len(world.processes) != 2:
        yield f"{where}: nobody was killed"
    elif not done(world.situation):
        yield f"{where}: not done after {until:g} s"
