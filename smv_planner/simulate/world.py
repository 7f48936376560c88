"""The clock of the simulation and everything that happens on it.

What the planner is told and what it sends goes through the real codecs and over a network that may lose, repeat, delay,
reorder and corrupt. What is true is only known here and to the observer.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from smv_planner.emulation import emulator as emulators
from smv_planner.emulation.draw import Draw
from smv_planner.emulation.emulator import Emulator
from smv_planner.model.domains import Value
from smv_planner.protocol.messages import GoalMessage, Rejected, decode_goal, decode_state, encode
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
from smv_planner.runner.recovery import Planners, recover
from smv_planner.runner.situation import Situation, Station, at_rest
from smv_planner.runner.step import step
from smv_planner.simulate.operator import Operator

Happening = Callable[[], None]


@dataclass
class World:
    """One run. `seed` decides everything that is left open."""

    station: Station
    planners: Planners
    seed: int = 0
    set: Mapping[str, Value] = field(default_factory=dict)
    operator: Operator = Operator()
    on_note: Callable[[float, Note], None] = lambda at, note: None

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
        self.situation: Situation = Situation(at=0.0, state=state, intentions=initial.intentions)
        self._place(system.named(state))
        self.notes: list[tuple[float, Note]] = []
        self.sent: list[tuple[float, GoalMessage]] = []
        period = self.station.model.period
        for number, name in enumerate(self.hubs):
            self.later(period * number / len(self.hubs), lambda name=name: self.hub_period(name))  # type: ignore[misc]
        self.later(0.0, lambda: self.happen(Began(self.at, "planner")))
        self.later(period, self.planner_period)

    def _place(self, named: Mapping[str, Value]) -> None:
        """Put devices and hubs into the state that was given."""
        from dataclasses import replace

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

    # --- the planner

    def planner_period(self) -> None:
        self.happen(Tick(self.at))
        self.later(self.station.model.period, self.planner_period)

    def happen(self, event: Event) -> None:
        self.situation, outputs = step(self.station, self.situation, event)
        for output in outputs:
            self.perform(output)

    def order(self, order: Order) -> None:
        self.happen(Ordered(self.at, order))

    def perform(self, output: Output) -> None:
        match output:
            case Send(message):
                self.sent.append((self.at, message))
                payload = encode(message)
                self.later(0.002, lambda: self.goal_arrives(message.resource, payload))
            case Ask(revision, request):
                decision = recover(self.station.model, request, self.planners)
                self.later(0.05, lambda: self.happen(Answered(self.at, revision, decision)))
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

    def note(self, note: Note) -> None:
        self.notes.append((self.at, note))
        self.on_note(self.at, note)

    def operator_does(self, request: str, transition: str) -> None:
        if request not in self.situation.wishes:
            return
        self.operator, done, confirmed = self.operator.asked(transition)
        if done:
            world = self.truth()
            maintenance = self.station.system.transition[transition]
            for name, emulator in self.hubs.items():
                self.hubs[name] = emulators.perform(emulator, maintenance, world)
        if confirmed:
            self.later(0.5, lambda: self.order(Confirm(request)))

    # --- the hubs

    def truth(self) -> dict[str, Value]:
        world: dict[str, Value] = {}
        for emulator in self.hubs.values():
            world.update(emulator.world)
        return world

    def goal_arrives(self, name: str, payload: bytes) -> None:
        match decode_goal(payload, self.station.interfaces[name]):
            case Rejected():
                return
            case message:
                result = emulators.receive(self.hubs[name], message, self.at)
                if not isinstance(result, Rejected):
                    self.hubs[name] = result
                    self.advance(name)

    def hub_period(self, name: str) -> None:
        self.advance(name)
        self.hubs[name], message = emulators.report(self.hubs[name], self.at)
        if message is not None:
            payload = encode(message)
            self.later(0.002, lambda: self.state_arrives(name, payload))
        self.later(self.station.model.period, lambda: self.hub_period(name))

    def advance(self, name: str) -> None:
        self.hubs[name] = emulators.advance(self.hubs[name], self.truth(), self.at, self.draw)

    def state_arrives(self, name: str, payload: bytes) -> None:
        match decode_state(payload, self.station.interfaces[name]):
            case Rejected():
                return
            case message:
                self.happen(Heard(self.at, message))
