"""The clock of the simulation and everything that happens on it.

What the planner is told and what it sends goes through the real codecs and over a network that may lose, repeat, delay,
reorder and corrupt. What is true is only known here and to the observer.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Mapping
from hashlib import blake2b

from smv_planner.emulation import emulator as emulators
from smv_planner.emulation.draw import Draw
from smv_planner.emulation.emulator import Emulator
from smv_planner.errors import EngineError
from smv_planner.journal import Disk
from smv_planner.lazy import dataclass, field, replace
from smv_planner.model.domains import Value
from smv_planner.protocol.messages import GoalMessage, Rejected, StateMessage, decode_goal, decode_state, encode
from smv_planner.runner.decision import Decision, Request
from smv_planner.runner.events import (
    Answered,
    Approve,
    Ask,
    Began,
    Confirm,
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
from smv_planner.runner.records import Known
from smv_planner.runner.recovery import Planners, recover
from smv_planner.runner.situation import Situation, Station, at_rest
from smv_planner.simulate.network import CALM, Arrival, Weather, arrivals
from smv_planner.simulate.operator import Operator
from smv_planner.simulate.process import SEGMENT, Moment, Process

Happening = Callable[[], None]

THINKING = 0.05
"""Seconds of virtual time that the planners take."""

BACKLOG = 1000
"""So many messages wait for a process that is stopped; later ones are lost."""


class Watch:
    """Who looks on, and here sees nothing; `observer` is one who does."""

    def reported(self, message: StateMessage) -> None:
        """A hub has sent this."""

    def turned(self, process: Process, event: Event, before: Situation, outputs: tuple[Output, ...]) -> None:
        """The runner has taken a step, and nothing of what it wants is done yet."""

    def published(self, process: Process, message: GoalMessage, payload: bytes) -> None:
        """Bytes of a goal message enter the network."""

    def finished(self, process: Process) -> None:
        """Everything that followed from an event is done."""

    def moved(self, name: str) -> None:
        """What is true of a resource may have changed."""

    def handled(self) -> None:
        """A person is about to lay hands on the station."""


@dataclass
class World:
    """One run. `seed` decides everything that is left open."""

    station: Station
    planners: Planners
    seed: int = 0
    set: Mapping[str, Value] = field(default_factory=dict)
    operator: Operator = field(default_factory=Operator)
    on_note: Callable[[float, Note], None] = lambda at, note: None
    disk: Disk | None = None
    segment: int = SEGMENT
    weather: Weather = CALM
    watch: Watch = field(default_factory=Watch)
    kill: Callable[[Process, Moment], bool] = lambda process, moment: False
    think: Callable[[Request], tuple[Decision, tuple[float, ...]]] | None = None
    """In place of the planners: their decision, and after how long it comes, once or more often."""

    def __post_init__(self) -> None:
        self.at = 0.0
        self.draw = Draw(self.seed)
        self._heap: list[tuple[float, int, Happening]] = []
        self._order = 0
        system = self.station.system
        self.hubs: dict[str, Emulator] = {
            name: emulators.start(system, interface, f"{name}-1", 0.0) for name, interface in self.station.interfaces.items()
        }
        initial = at_rest(self.station)
        state = tuple(self.set.get(v.name, v.initial) for v in system.variables)
        self._first = Situation(at=0.0, state=state, intentions=initial.intentions)
        self._place(system.named(state))
        self.notes: list[tuple[float, Note]] = []
        self.sent: list[tuple[float, GoalMessage]] = []
        self.counts: Counter[str] = Counter()
        self.cut: dict[tuple[str, str], int] = {}
        self.down: dict[str, str] = {}
        self._boots = dict.fromkeys(self.hubs, 1)
        self._frozen: dict[str, list[bytes]] = {}
        self._carried = 0
        self._goals: dict[str, tuple[bytes, GoalMessage]] = {}
        self._states: dict[str, tuple[bytes, StateMessage | Rejected]] = {}
        self._encoded: dict[tuple[str, str], tuple[GoalMessage, bytes]] = {}
        self._truth = self.truth()
        self._digest = blake2b(digest_size=16)
        self.processes: list[Process] = []
        period = self.station.model.period
        for number, name in enumerate(self.hubs):
            self.later(period * number / len(self.hubs), lambda name=name: self.hub_period(name))  # type: ignore[misc]
        self.later(0.0, self.start_first)

    def _place(self, named: Mapping[str, Value]) -> None:
        """Put devices and hubs into the state that was given."""
        for name, emulator in self.hubs.items():
            measured = {v: named[v] for v in emulator.device.measured}
            resting = {v: named[v] for v in emulator.hub.resting}
            self.hubs[name] = Emulator(replace(emulator.hub, resting=resting), replace(emulator.device, measured=measured))

    # --- the clock

    def later(self, delay: float, happening: Happening) -> None:
        self._order += 1
        heapq.heappush(self._heap, (self.at + delay, self._order, happening))

    def run(self, until: float, stop: Callable[[], bool] = lambda: False) -> None:
        while self._heap and self._heap[0][0] <= until and not stop():
            self.at, _, happening = heapq.heappop(self._heap)
            happening()

    @property
    def fingerprint(self) -> str:
        """Of all that was sent, heard and noted: the same seed has the same."""
        return self._digest.hexdigest()

    def record(self, what: str, payload: bytes) -> None:
        self._digest.update(f"{self.at!r} {what} ".encode())
        self._digest.update(payload)

    # --- the planner's processes

    @property
    def process(self) -> Process:
        """The one that was started last; orders go to it."""
        return self.processes[-1]

    @property
    def situation(self) -> Situation:
        return self.process.situation if self.processes else self._first

    def start_first(self) -> None:
        self.start_planner("planner", self.disk)

    def start_planner(self, name: str, disk: Disk | None = None) -> Situation:
        """A new process of the planner, which goes on from the journal on its disk if there is one: what that tells."""
        known = Known(self.station.model, self.planners.widen)
        process = Process(name, self.station, known, self._first, self.perform, self.turned, self.kill, disk, self.segment)
        process.begin()
        told = process.situation
        self.processes.append(process)
        self.happen(Began(self.at, name), process)
        self.later(self.station.model.period, lambda: self.planner_period(process))
        return told

    def planner_period(self, process: Process) -> None:
        if not process.alive:
            return
        if process.stopped is None:  # a process that is stopped makes no ticks
            self.happen(Tick(self.at), process)
        self.later(self.station.model.period, lambda: self.planner_period(process))

    def happen(self, event: Event, process: Process | None = None) -> None:
        process = process or self.process
        if process.stopped is None or len(process.stopped) < BACKLOG:
            process.happen(event)
            self.watch.finished(process)

    def wake(self, process: Process) -> None:
        if process.stopped is not None:
            process.go_on(self.at)
            self.watch.finished(process)

    def order(self, order: Order) -> None:
        self.happen(Ordered(self.at, order))

    def turned(self, process: Process, event: Event, before: Situation, outputs: tuple[Output, ...]) -> None:
        self.watch.turned(process, event, before, outputs)

    def perform(self, process: Process, output: Output) -> None:
        match output:
            case Send(message):
                self.publish(process, message)
            case Ask(revision, request):
                decision, times = self.decide(request)
                for seconds in times:
                    self.later(seconds, lambda: self.happen(Answered(self.at, revision, decision), process))
            case Instruct(request_id, transition, _):
                self.note(Note("instruct", output.text, {"transition": transition, "request": request_id}))
                self.later(self.operator.delay, lambda: self.operator_does(request_id, transition))
            case Consent(request_id, text):
                self.note(Note("consent", text, {"request": request_id}))
                if self.operator.agrees:
                    self.later(2.0, lambda: self.order(Approve(request_id)))
            case Withdraw(request):
                self.note(Note("withdraw", request))
            case Note():
                self.note(output)

    def decide(self, request: Request) -> tuple[Decision, tuple[float, ...]]:
        """What the planners come to, and after how long. What the checker refuses is no decision."""
        try:
            if self.think is not None:
                return self.think(request)
            return recover(self.station.model, request, self.planners), (THINKING,)
        except EngineError as error:
            return Decision(undecided=str(error)), (THINKING,)

    def note(self, note: Note) -> None:
        self.notes.append((self.at, note))
        self.record(note.kind, note.text.encode())
        self.on_note(self.at, note)

    def operator_does(self, request: str, transition: str) -> None:
        if request not in self.situation.wishes:
            return
        self.operator, done, confirmed = self.operator.asked(transition)
        if done:
            self.watch.handled()
            world = self.truth()
            maintenance = self.station.system.transition[transition]
            for name, emulator in self.hubs.items():
                self.become(name, emulators.perform(emulator, maintenance, world))
        if confirmed:
            self.later(0.5, lambda: self.order(Confirm(request)))

    # --- the network

    def carry(self, sender: str, receiver: str, payload: bytes, arrive: Callable[[Arrival], None]) -> None:
        """Whatever arrives of a message, when it arrives."""
        if (sender, receiver) in self.cut:
            self.counts["cut off"] += 1
            return
        self._carried += 1
        copies = arrivals(self.weather, payload, self.draw.of("network", self._carried))
        if self.weather is not CALM:
            self.counts["lost"] += not copies
            self.counts["twice"] += len(copies) > 1
            self.counts["late"] += sum(copy.after > 0.05 for copy in copies)
            self.counts["damaged"] += sum(not copy.sound for copy in copies)
        for copy in copies:
            self.later(copy.after, lambda copy=copy: arrive(copy))  # type: ignore[misc]

    def publish(self, process: Process, message: GoalMessage) -> None:
        self.sent.append((self.at, message))
        payload = self.encoded(process, message)
        self.record("goal", payload)
        self.watch.published(process, message, payload)
        name = message.resource
        self.carry(process.name, name, payload, lambda arrival: self.goal_arrives(name, arrival))

    def encoded(self, process: Process, message: GoalMessage) -> bytes:
        last = self._encoded.get((process.name, message.resource))
        if last is None or last[0] != message:  # mostly it is the same again
            last = self._encoded[process.name, message.resource] = message, encode(message)
        return last[1]

    # --- the hubs

    def truth(self) -> dict[str, Value]:
        world: dict[str, Value] = {}
        for emulator in self.hubs.values():
            world.update(emulator.world)
        return world

    def become(self, name: str, emulator: Emulator) -> None:
        """What is true of a resource from now on."""
        if emulator is not self.hubs[name]:
            self.hubs[name] = emulator
        self._truth.update(emulator.world)
        self.watch.moved(name)

    def goal_arrives(self, name: str, arrival: Arrival) -> None:
        if name in self.down:
            return
        if name in self._frozen:
            if arrival.sound and len(self._frozen[name]) < BACKLOG:
                self._frozen[name].append(arrival.payload)
            return
        if not arrival.sound:
            self.thrown_away(decode_goal(arrival.payload, self.station.interfaces[name]))
            return
        self.obey(name, arrival.payload)

    def obey(self, name: str, payload: bytes) -> None:
        last = self._goals.get(name)
        if last and last[0] == payload:  # the usual case: the same again
            message: GoalMessage | Rejected = last[1]
        else:
            message = decode_goal(payload, self.station.interfaces[name])
        if isinstance(message, Rejected):
            self.counts[f"goal {message.reason}"] += 1
            return
        self._goals[name] = payload, message
        result = emulators.receive(self.hubs[name], message, self.at)
        if isinstance(result, Rejected):
            self.counts[f"goal {result.reason}"] += 1
        else:
            self.become(name, result)
            self.advance(name)

    def thrown_away(self, decoded: GoalMessage | StateMessage | Rejected) -> None:
        self.counts["damaged and refused" if isinstance(decoded, Rejected) else "damaged and plausible"] += 1

    def hub_period(self, name: str) -> None:
        self.later(self.station.model.period, lambda: self.hub_period(name))
        self.advance(name)
        if name in self.down or name in self._frozen:
            return
        self.hubs[name], message = emulators.report(self.hubs[name], self.at)
        if message is None:
            return
        payload = encode(message)
        self.watch.reported(message)
        self.record("state", payload)
        for process in self.processes:
            if process.alive:
                self.carry(name, process.name, payload, lambda a, p=process: self.state_arrives(name, p, a))  # type: ignore[misc]

    def advance(self, name: str) -> None:
        before = self.hubs[name]
        after = emulators.advance(before, self._truth, self.at, self.draw)
        self.hubs[name] = after
        if after.device.measured is not before.device.measured or after.hub is not before.hub:
            self.become(name, after)

    def state_arrives(self, name: str, process: Process, arrival: Arrival) -> None:
        decoded = self.decoded(name, arrival.payload)
        if not arrival.sound:
            self.thrown_away(decoded)
        elif isinstance(decoded, StateMessage):
            self.happen(Heard(self.at, decoded), process)

    def decoded(self, name: str, payload: bytes) -> StateMessage | Rejected:
        last = self._states.get(name)
        if last is None or last[0] != payload:  # several processes hear the same, or one hears it twice
            last = self._states[name] = payload, decode_state(payload, self.station.interfaces[name])
        return last[1]

    # --- what may befall them

    def crash_hub(self, name: str) -> None:
        self.down.setdefault(name, "crashed")

    def restart_hub(self, name: str) -> None:
        """A new process of the hub; what was under way at the device is not."""
        self.down.pop(name, None)
        self._boots[name] += 1
        self.become(name, emulators.restart(self.hubs[name], f"{name}-{self._boots[name]}", self.at))

    def freeze_hub(self, name: str) -> None:
        """The hub stands still (SIGSTOP); its device does not."""
        self._frozen.setdefault(name, [])

    def thaw_hub(self, name: str) -> None:
        for payload in self._frozen.pop(name, []):
            self.obey(name, payload)

    def cut_off(self, sender: str, receiver: str) -> None:
        """One way only: who is not heard may still hear. As often as it is cut off, a way has to be mended."""
        self.cut[sender, receiver] = self.cut.get((sender, receiver), 0) + 1

    def mend(self, sender: str, receiver: str) -> None:
        left = self.cut.pop((sender, receiver), 1) - 1
        if left > 0:
            self.cut[sender, receiver] = left
