"""What goes on in a run, for people: time lines of resources and operations (FAIM 2021, figure 2), and what is waited for.

Nothing here knows how time passes: lines are drawn from what was seen of situations.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from smv_planner.lazy import dataclass, field
from smv_planner.model.domains import show_value
from smv_planner.model.system import Kind
from smv_planner.runner.decision import Following, Purpose
from smv_planner.runner.events import Note
from smv_planner.runner.situation import Phase, Situation, Station, WishKind

BUSY, FAILED, LOST, ASKED, IDLE = "━", "!", "x", "?", " "
_GRAVITY = (IDLE, BUSY, ASKED, FAILED, LOST)

Lane = list[tuple[float, str]]
"""What a line shows from each time on."""


@dataclass
class Timelines:
    """One line for each intention, operation that has started, resource, and for the planners."""

    station: Station
    lanes: dict[str, Lane] = field(default_factory=dict)
    last: Situation | None = None

    def see(self, now: Situation) -> None:
        """Take in the present situation; the same again costs nothing."""
        if now is self.last:
            return
        self.last = now
        shown = dict(_shown(self.station, now))
        for name in [*self.lanes, *(name for name in shown if name not in self.lanes)]:
            lane = self.lanes.setdefault(name, [(0.0, IDLE)])
            sign = shown.get(name, IDLE)
            if lane[-1][1] != sign:
                lane.append((now.at, sign))

    def drawn(self, end: float, width: int, seconds: float) -> list[tuple[str, str]]:
        """The names and their lines up to `end`; a column stands for so many seconds, and for the gravest in them."""
        begin = max(0.0, end - width * seconds)
        columns = min(width, max(1, round((end - begin) / seconds)))
        edges = [begin + at * seconds for at in range(columns + 1)]
        return [(name, "".join(_columns(lane, edges))) for name, lane in self._ordered()]

    def axis(self, end: float, width: int, seconds: float) -> str:
        begin = max(0.0, end - width * seconds)
        marks = [f"{begin + at * seconds:<10.0f}" for at in range(0, width, 10)]
        return "".join(marks)[:width].rstrip()

    def _ordered(self) -> Iterator[tuple[str, Lane]]:
        """Intentions, the planners, operations in the order of their starts, resources in declared order."""
        kinds = ("intention ", "planners", "operation ", "resource ")
        for kind in kinds:
            for name, lane in self.lanes.items():
                if name.startswith(kind) and any(sign != IDLE for _, sign in lane):
                    yield name, lane


def _shown(station: Station, now: Situation) -> Iterator[tuple[str, str]]:
    for name, pursuit in now.intentions.items():
        sign = {"executing": BUSY, "error": FAILED, "paused": ASKED}.get(pursuit.status.value, IDLE)
        yield f"intention {name}", sign
    yield "planners", BUSY if now.asked else IDLE
    for execution in now.executing:
        yield f"operation {execution.task.operation.name}", BUSY
    for name in now.failed:
        yield f"operation {name}", FAILED
    asked = {resource for wish in now.wishes.values() if (resource := _of(station, wish.transition))}
    moving = {_of(station, name) for name in now.timers if station.system.transition[name].expected}
    for name in station.interfaces:
        sign = LOST if name in now.lost else ASKED if name in asked else BUSY if name in moving else IDLE
        yield f"resource {name}", sign


def _of(station: Station, transition: str | None) -> str | None:
    found = station.system.transition.get(transition) if transition else None
    return found.resource if found else None


def _columns(lane: Lane, edges: Sequence[float]) -> Iterator[str]:
    at, sign = 0, IDLE
    for edge in edges[1:]:
        seen = [sign]
        while at < len(lane) and lane[at][0] < edge:
            sign = lane[at][1]
            seen.append(sign)
            at += 1
        yield max(seen, key=_GRAVITY.index)


# --- the present ----------------------------------------------------------------------------------------


def plan_lines(following: Following | None, most: int = 12) -> list[str]:
    """The steps of the plan that is followed: done, possible now, and waiting."""
    if following is None:
        return []
    path, ready = following.plan.trace.path, set(following.ready())
    first = max(0, min(ready, default=len(path)) - 2)
    lines = []
    for at in range(first, min(len(path), first + most)):
        sign = "✓" if at in following.done else "▸" if at in ready else "·"
        kind = following.plan.problem.system.transition[path[at]].kind
        who = {Kind.EFFECT: " (waits)", Kind.MAINTENANCE: " (operator)"}.get(kind, "")
        lines.append(f"{sign} {path[at]}{who}")
    if first + most < len(path):
        lines.append(f"  and {len(path) - first - most} more")
    return lines


def waits(station: Station, now: Situation) -> list[str]:
    """What has to happen before anything goes on."""
    found = []
    if now.phase is not Phase.RUNNING:
        unheard = [name for name in now.hubs if name not in now.heard]
        more = f", and has never heard from {', '.join(unheard)}" if now.phase is Phase.JOINING and unheard else ""
        found.append(f"the planner is {now.phase.value}{more}")
    if now.halted:
        found.append(f"halted: {now.halted}")
    if now.asked:
        found.append(f"the planners, asked because of {now.asked.cause.value}")
    for request, wish in now.wishes.items():
        who = "to be done" if wish.kind is WishKind.MAINTENANCE else "to be agreed to"
        found.append(f"the operator ({request}, {who}): {wish.text}")
    if now.following and not now.asked:
        path = now.following.plan.trace.path
        for at in now.following.ready():
            within = station.system.transition[path[at]].within if path[at] in station.system.transition else None
            since = now.timers.get(path[at])
            if since is not None and within is not None:
                found.append(f"{path[at]}: {now.at - since:.1f} s of {within:g} s")
    if now.stuck:
        found.append(f"stuck: {now.stuck}")
    return found


def abilities(station: Station, now: Situation) -> dict[str, tuple[str, ...]]:
    """By resource, its predicates that hold; the scenario's own under its name."""
    found: dict[str, list[str]] = {}
    for name, expr in station.model.predicates.items():
        owner, _, word = name.rpartition(".")
        held = found.setdefault(owner or station.model.name, [])
        if station.holds(expr, now.state):
            held.append(word)
    return {owner: tuple(held) for owner, held in found.items()}


def purpose(following: Following | None) -> str:
    if following is None:
        return "no plan"
    return {
        Purpose.OPERATIONS: "plan",
        Purpose.MAINTENANCE: "plan with the operator's help",
        Purpose.EXIT: "way out of a forbidden state",
    }[following.purpose]


def transcript(at: float, note: Note) -> str:
    """One line for people."""
    changes = note.data.get("changes")
    more = ""
    if isinstance(changes, Mapping) and note.kind == "fired":
        more = "  " + ", ".join(f"{name} = {show_value(value)}" for name, value in changes.items())
    return f"{at:8.2f} s  {note.kind:<10} {note.text}{more}".rstrip()
