"""The daemon's loop: one thread that owns the situation, one turn after the other.

In a turn everything that has come in becomes events, the runner takes its steps, the journal is written, and only then is
anything published. A turn that cannot be written has not happened: what was commanded last is said again, and the hubs
hold.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from typing import Any

from bridge import keys
from bridge.errors import LinkError
from bridge.link import MAX_DOCUMENT, Link, most
from smv_planner.daemon import documents, orders
from smv_planner.daemon.chronicle import Chronicle
from smv_planner.daemon.planners import Opinion, Planners
from smv_planner.lazy import dataclass, field, replace
from smv_planner.protocol.messages import Rejected, StateMessage, decode_state, encode
from smv_planner.runner.events import (
    Answered,
    Ask,
    Began,
    Consent,
    Event,
    Heard,
    Instruct,
    Note,
    Order,
    Ordered,
    Output,
    Send,
    Tick,
    Withdraw,
)
from smv_planner.runner.situation import Phase, Situation, Station
from smv_planner.runner.step import step
from smv_planner.runner.taking_over import LEAP

log = logging.getLogger("smv_planner.daemon")

QUEUE = 64
"""So many orders wait; more are refused."""

SECOND = 1.0
"""So often is everything said again, for those who have just come."""

RECENT = 1000
"""So many events are told to those who have missed some."""

BREATH = 0.002
"""Seconds between turns, so that a flood of messages is taken in lots."""

IDLE = 0.5
"""Seconds after which the loop looks around at the latest, however long the period is."""

FAILURES = 3
"""So many decisions in a row that did not come about are more than a bad moment."""

ANSWER = 5.0
"""Seconds that who orders something waits until it is in the journal."""


Document = Callable[[Station, Situation], dict[str, Any]]


@dataclass
class Waiting:
    """An order on its way into the journal."""

    order: Order
    done: threading.Event = field(default_factory=threading.Event)
    refusal: str | None = None


@dataclass
class Pulse:
    """How the loop is doing; `late` are seconds by which ticks came too late, newest last."""

    ticks: int = 0
    ticked_at: float = 0.0
    missed: int = 0
    late: deque[float] = field(default_factory=lambda: deque(maxlen=1000))
    counts: Counter[str] = field(default_factory=Counter)


class Daemon:
    """`alarm` is set by whoever has something for the loop.

    `turned` is called after each turn that `run` takes, `ticked` after each tick.
    """

    def __init__(
        self,
        station: Station,
        situation: Situation,
        link: Link,
        chronicle: Chronicle,
        planners: Planners,
        alarm: threading.Event,
        clock: Callable[[], float] = time.monotonic,
        ticked: Callable[[], None] = lambda: None,
        turned: Callable[[], None] = lambda: None,
    ) -> None:
        self.station, self.link = station, link
        self.situation = replace(situation, phase=Phase.STOPPED)  # whatever it was, this process has not begun
        self.chronicle, self.planners, self.alarm = chronicle, planners, alarm
        self.clock, self.ticked, self.turned = clock, ticked, turned
        self.pulse = Pulse()
        self.stopping = False
        self._zero = clock() - situation.at  # time goes on from where the journal ends
        self._due = clock()
        self._published: dict[str, bytes] = {}
        self._said_at = -SECOND
        self._said: dict[str, Mapping[str, Any]] = {}
        self._waiting: deque[Waiting] = deque()
        self._unwritten: list[Began | Answered] = []
        self._undecided = 0
        self._events = 0
        self._recent: deque[tuple[int, bytes]] = deque(maxlen=RECENT)
        cell = station.cell
        self._mailbox = link.latest(keys.state(cell), wake=alarm.set)
        for key, document in self._told().items():
            link.answer(key, lambda _, document=document: self.document(document))  # type: ignore[misc]
        link.answer(keys.event(cell), self.recent)
        link.answer(keys.health(cell), lambda _: self.document(lambda *_: self.health()))
        link.answer(keys.order(cell), self.take_order)
        link.alive(keys.planner(cell))

    # --- from other threads ---------------------------------------------------------------------------------

    def stop(self) -> None:
        self.stopping = True
        self.alarm.set()

    def take_order(self, payload: bytes) -> bytes:
        """An order, until it is in the journal. Raises UsageError or ValueError with the reason against it."""
        order = orders.meant(payload, self.station, self.situation)
        if len(self._waiting) >= QUEUE:
            raise ValueError("too many orders are waiting")
        waiting = Waiting(order)
        self._waiting.append(waiting)
        self.alarm.set()
        if not waiting.done.wait(ANSWER):
            raise ValueError("the planner has not taken it yet; it may still do")
        if waiting.refusal:
            raise ValueError(waiting.refusal)
        return documents.encoded({"format": documents.FORMAT, "kind": "accepted", **orders.said(order)})

    def document(self, made: Document) -> bytes:
        """As of now. Raises UsageError from one that rules no more."""
        self.leave_it_to_the_other()
        document = documents.encoded(made(self.station, self.situation))
        if len(document) > MAX_DOCUMENT:
            raise ValueError(f"the answer has {len(document)} bytes, and at most {MAX_DOCUMENT} get through")
        return document

    def leave_it_to_the_other(self) -> None:
        if self.situation.phase is Phase.FENCED_OUT:
            raise orders.refused("another planner has taken over; ask that one")

    def recent(self, payload: bytes) -> bytes:
        """The events after a number, oldest first, as many as fit: what is published may be lost on its way.

        Raises UsageError from one that rules no more.
        """
        self.leave_it_to_the_other()
        after = orders.after(payload, self.situation.planner)
        size, fitting = 0, list[bytes]()
        for number, each in list(self._recent):
            if number > after:
                size += len(each) + 1
                if size > MAX_DOCUMENT // 2:
                    break
                fitting.append(each)
        return b"[" + b",".join(fitting) + b"]"

    @property
    def patience(self) -> float:
        """Seconds without a tick that are too many."""
        return max(1.0, 5 * self.station.model.period)

    def health(self) -> dict[str, Any]:
        """Whether the planner does its work, and why not; and what the station waits for, which no restart would change."""
        now, age = self.situation, self.clock() - self.pulse.ticked_at
        wrong = []
        if age > self.patience:
            wrong.append(f"the last tick was {age:.1f} s ago")
        if self.chronicle.trouble:
            wrong.append(self.chronicle.trouble)
        connected = self.link.connected
        if not connected:
            wrong.append("there is no router, or a reader of the network has died")
        if now.phase is Phase.FENCED_OUT:
            wrong.append("another planner has taken over")
        if now.hubs and all(name in now.lost for name in now.hubs):
            wrong.append("all resources are lost")
        if self._undecided >= FAILURES:
            wrong.append(f"{self._undecided} decisions in a row did not come about")
        return {
            **documents.head("health", self.station, now),
            "healthy": not wrong,
            "wrong": wrong,
            "waiting": documents.waiting(now),
            "phase": now.phase.value,
            "connected": connected,
            "halted": now.halted,
            "worker_starts": self.planners.starts,
            "ticks": self.pulse.ticks,
            "tick_age": round(age, 3),
            "missed": self.pulse.missed,
            "counts": dict(sorted(self.pulse.counts.items())),
            "rejected": dict(now.rejected),
        }

    # --- the loop -------------------------------------------------------------------------------------------

    def run(self, planner: str) -> None:
        """Until told to stop."""
        self._due = self.clock()
        self.turn([Began(self.at(self._due), planner)])
        while not self.stopping:
            self.alarm.wait(min(IDLE, max(0.0, self._due - self.clock())))
            self.alarm.clear()
            self.once(self.clock())
            self.turned()
            time.sleep(BREATH)

    def at(self, clock: float) -> float:
        """The planner's time, which never goes back."""
        return max(clock - self._zero, self.situation.at)

    def once(self, clock: float) -> None:
        """Whatever there is to do now."""
        period, tick = self.station.model.period, clock >= self._due
        late = clock - self._due
        if tick:
            behind = int(late / period)
            if late > max(SECOND, 5 * period):
                # We were stopped. What waited in sockets is older than it looks: let hubs speak before anything is judged.
                log.warning("the planner stood still for %.1f s", late)
                self.pulse.missed += behind
                self._mailbox.drain()
                self._due = clock + 2 * period
                return
            at = self.at(self._due)  # when it should have been: else ticks that jitter would miss each other's period
            self._due += (behind + 1) * period
            self.pulse.missed += behind
            self.pulse.late.append(late)
        else:
            at = self.at(clock)
        taken = [self._waiting.popleft() for _ in range(len(self._waiting))]
        events = [*self.heard(at), *self.answered(at), *(Ordered(at, waiting.order) for waiting in taken)]
        if tick:
            events.append(Tick(at))
        refusal = None if not events or self.turn(events) else f"the planner holds: {self.chronicle.trouble}"
        for waiting in taken:
            waiting.refusal = refusal
            waiting.done.set()
        if tick:
            self.pulse.ticks += 1
            self.pulse.ticked_at = clock
            self.tell(clock)
            self.ticked()

    def heard(self, at: float) -> list[Event]:
        found: list[Event] = []
        for key, payload in self._mailbox.drain():
            interface = self.station.interfaces.get(keys.resource_of(key) or "")
            if interface is None:
                self.pulse.counts["rejected foreign"] += 1
                continue
            message = decode_state(payload, interface)
            match message:
                case StateMessage():
                    self.pulse.counts["heard"] += 1
                    found.append(Heard(at, message))
                case Rejected(reason, detail):
                    if not self.pulse.counts[f"rejected {reason.value}"]:
                        log.warning("a message on '%s' is refused (%s): %s", key, reason.value, detail)
                    self.pulse.counts[f"rejected {reason.value}"] += 1
        return found

    def answered(self, at: float) -> list[Event]:
        found: list[Event] = [replace(each, at=at) for each in self._unwritten]
        self._unwritten = []
        for reply in self.planners.replies():
            if isinstance(reply, Opinion):
                self.opinion(reply)
            else:
                self._undecided = self._undecided + 1 if reply[1].undecided else 0
                found.append(Answered(at, *reply))
        return found

    def opinion(self, opinion: Opinion) -> None:
        self.pulse.counts["second opinion differs" if opinion.differs else "second opinion agrees"] += 1
        if opinion.differs:
            text = f"engines differ: {opinion.differs}; '{opinion.folder}' holds the question and both answers"
            self.note(Note("alarm", text, {"folder": opinion.folder}))

    def turn(self, events: list[Event]) -> bool:
        """Take steps, write, perform. False if it could not be written; then nothing has happened."""
        now, outputs = self.situation, list[Output]()
        for event in events:
            now, wanted = step(self.station, now, event)
            outputs += wanted
        if now.phase is Phase.FENCED_OUT or self.superseded(events):
            self._published.clear()  # whether it can be written or not: who rules no more has nothing to say again
        trouble = self.chronicle.trouble
        if not self.chronicle.write(self.situation, now, events, outputs):
            self._unwritten = [event for event in events if isinstance(event, Began | Answered)]
            if self.chronicle.trouble != trouble:
                self.note(Note("alarm", f"the planner holds: {self.chronicle.trouble}"))
            if any(isinstance(event, Tick) for event in events):
                self.hold()
            return False
        if trouble:
            log.warning("the journal can be written again")
        self.situation = now
        for output in outputs:
            self.perform(output)
        return True

    def superseded(self, events: list[Event]) -> bool:
        """Whether a hub obeys a planner that comes after this one."""
        said = [event.message for event in events if isinstance(event, Heard)]
        mine, name = self.situation.epoch, self.situation.planner
        return any(mine < each.epoch <= mine + LEAP or (each.epoch == mine > 0 and each.planner != name) for each in said)

    def hold(self) -> None:
        """Say again what was commanded last; nothing new may be."""
        for key, payload in self._published.items():
            self.publish(key, payload)

    def perform(self, output: Output) -> None:
        match output:
            case Send(message):
                key, payload = keys.goal(message.cell, message.resource), encode(message)
                self._published[key] = payload
                self.publish(key, payload)
            case Ask(revision, request):
                self.planners.ask(revision, request)
            case Instruct(request, transition, text):
                self.note(Note("instruct", text, {"request": request, "transition": transition}))
            case Consent(request, text):
                self.note(Note("consent", text, {"request": request}))
            case Withdraw(request):
                self.note(Note("withdraw", f"request {request} is no longer wanted", {"request": request}))
            case Note():
                self.note(output)

    def note(self, note: Note) -> None:
        self._events += 1
        self.pulse.counts[f"event {note.kind}"] += 1
        level = logging.WARNING if note.kind in ("alarm", "lost", "timeout", "gate") else logging.INFO
        log.log(level, "%s", note.text, extra={"event": note.kind, "at": round(self.situation.at, 3)})
        document = documents.encoded(documents.event(self.station, self.situation, note, self._events))
        self._recent.append((self._events, document))
        self.publish(keys.event(self.station.cell), document)

    def tell(self, clock: float) -> None:
        """Publish what has changed, and all of it from time to time."""
        cell, now = self.station.cell, self.situation
        everything = clock - self._said_at >= SECOND
        for key, document in self._told().items():
            told = document(self.station, now)
            timeless = {**told, "at": None}
            if everything or timeless != self._said.get(key):
                self._said[key] = timeless
                self.publish(key, documents.encoded(told))
        if everything:
            self._said_at = clock
            self.publish(keys.health(cell), documents.encoded(self.health()))

    def _told(self) -> dict[str, Document]:
        cell = self.station.cell
        return {
            keys.situation(cell): documents.situation,
            keys.plan(cell): documents.plan,
            keys.operator(cell): documents.operator,
        }

    def publish(self, key: str, payload: bytes) -> None:
        if len(payload) > most(key):  # the router would drop it without a word
            if not self.pulse.counts["oversize"]:
                log.error("%d bytes for '%s' are too many, at most %d get through: not published", len(payload), key, most(key))
            self.pulse.counts["oversize"] += 1
            return
        try:
            self.link.publish(key, payload)
        except LinkError as error:  # the next period says it again
            self.pulse.counts["not published"] += 1
            log.debug("%s", error)
