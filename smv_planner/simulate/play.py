"""A case being played: what it tells happens to the world when its time has come, and at the end it is judged.

What is asked of the true states is looked at after everything that happens, not only when somebody measures it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import chain
from typing import cast

from smv_planner.emulation import emulator as emulators
from smv_planner.emulation.behaviour import Behaviour, Instead, Times
from smv_planner.journal import Disk
from smv_planner.lazy import dataclass, field, replace
from smv_planner.model.domains import Value
from smv_planner.model.expressions import meaning
from smv_planner.model.system import State, VariableKind
from smv_planner.runner.decision import Action
from smv_planner.runner.events import Activate, Assign, Cancel, Note, Order, Pause, Proceed, Reenable
from smv_planner.runner.recovery import Planners
from smv_planner.runner.situation import Station
from smv_planner.simulate.operator import Operator
from smv_planner.simulate.process import MemoryDisk
from smv_planner.simulate.script import Case, Entry, Habits
from smv_planner.simulate.world import World

WHOLE = 1 << 32
"""Bytes that a journal may have before it begins anew: that of a case holds the whole story."""


@dataclass
class Record:
    """What people and cases want to know of a run, gathered from its notes in order."""

    decisions: list[tuple[Action, ...]] = field(default_factory=list)
    operator: list[str] = field(default_factory=list)
    intentions: dict[str, str] = field(default_factory=dict)
    failed: dict[str, None] = field(default_factory=dict)
    operations: list[str] = field(default_factory=list)
    alarms: list[str] = field(default_factory=list)
    seen: dict[str, None] = field(default_factory=dict)
    """Transitions that were taken and operations that have started."""

    def take(self, note: Note) -> None:
        data = note.data
        match note.kind:
            case "decision":
                self.decisions.append(cast(tuple[Action, ...], data["actions"]))
            case "instruct":
                self.operator.append(str(data["transition"]))
            case "intention" if data["state"] != "initial":  # finished counts, although it may start anew
                self.intentions[str(data["intention"])] = str(data["state"])
            case "operation" if data["state"] == "executing":
                self.operations.append(str(data["operation"]))
                self.seen.setdefault(str(data["operation"]))
            case "operation" if data["state"] == "error":
                self.failed.setdefault(str(data["operation"]))
            case "fired":
                self.seen.setdefault(str(data["transition"]))
            case "measured":
                self.seen.update(dict.fromkeys(data.get("effects", ())))  # type: ignore[call-overload]
            case "alarm":
                self.alarms.append(note.text)

    @property
    def recovery(self) -> tuple[Action, ...]:
        """The planning actions of recoveries in the notation of Table 1, each at its first time."""
        first: dict[str, Action] = {}
        for action in chain.from_iterable(self.decisions):
            if not action.ordinary:
                first.setdefault(action.name, action)
        return tuple(first.values())


class Play:
    """One run of a case from one seed."""

    def __init__(
        self,
        station: Station,
        case: Case,
        planners: Planners,
        seed: int = 0,
        on_note: Callable[[float, Note], None] = lambda at, note: None,
        disk: Disk | None = None,
    ) -> None:
        self.station, self.case = station, case
        self.record = Record()
        self._on_note = on_note
        restarts = any(each.planner_killed is not None for each in case.when)
        disk = disk or (MemoryDisk() if restarts else None)
        self.world = World(station, planners, seed, case.given, on_note=self._noted, disk=disk, segment=WHOLE)
        index = station.system.index
        self.coming = len(case.when)
        self.violated: dict[str, float] = {}
        self._judged = [(text, meaning(expr, index), True) for text, expr in case.then.never]
        self._judged += [(text, meaning(expr, index), False) for text, expr in case.then.always]
        self._once = [(each, meaning(each.once, index)) for each in case.when if each.once is not None]
        self._after = [each for each in case.when if each.after is not None]
        for each in case.when:
            if each.once is None and each.after is None:
                self._begin(each)

    def run(self, until: float | None = None) -> list[str]:
        """Play to the end, or at most to some time; what came otherwise than the case declares."""
        limit = self.case.then.within if until is None else until
        self.world.run(limit, self.over)
        return self.differences()

    def over(self) -> bool:
        """Asked between any two things that happen."""
        self._watch()
        wanted = self.case.then.intentions
        return bool(wanted) and not self.coming and all(self.record.intentions.get(n, "initial") == s for n, s in wanted.items())

    @property
    def state(self) -> State:
        """What is true: measured values and obeyed goals of the devices, and what the planner keeps of products."""
        truth, believed = self.world.truth(), self.world.situation.state
        return tuple(truth.get(name, believed[at]) for name, at in self.station.system.index.items())

    def differences(self) -> list[str]:
        then, record = self.case.then, self.record
        found = [f"'{text}' at {at:.2f} s" for text, at in self.violated.items()]
        if self.coming:
            found.append(f"{self.coming} entries of 'when' have not come to pass")
        state = self.station.system.named(self.state)
        told: dict[str, tuple[object, object]] = {
            "actions": (tuple(action.name for action in record.recovery), then.actions),
            "operator": (tuple(record.operator), then.operator),
            "failed": (tuple(record.failed), then.failed),
            "final": ({name: state[name] for name in then.final}, then.final),
            "intentions": ({name: record.intentions.get(name, "initial") for name in then.intentions}, then.intentions),
        }
        found += [f"{name} is {got}, not {want}" for name, (got, want) in told.items() if want is not None and got != want]
        started = iter(record.operations)
        if not all(name in started for name in then.operations):
            found.append(f"the operations are not in this order: {record.operations}")
        if then.alarms is not None and not (
            len(then.alarms) == len(record.alarms)
            and all(text in alarm for text, alarm in zip(then.alarms, record.alarms, strict=True))
        ):
            found.append(f"other alarms: {record.alarms}")
        return found

    # --- watching

    def _noted(self, at: float, note: Note) -> None:
        self.record.take(note)
        self._on_note(at, note)

    def _watch(self) -> None:
        if self._judged or self._once:
            state = self.state
            for text, judge, forbidden in self._judged:
                if bool(judge(state)) is forbidden:
                    self.violated.setdefault(text, self.world.at)
            for each, judge in [*self._once]:
                if judge(state):
                    self._once.remove((each, judge))
                    self._begin(each)
        for each in [*self._after]:
            if each.after in self.record.seen:
                self._after.remove(each)
                self._begin(each)

    # --- happening

    def _begin(self, each: Entry) -> None:
        self.world.later(each.delay, lambda: self._happen(each))

    def _happen(self, each: Entry) -> None:
        self.coming -= 1
        for effect in each.fail:
            self._at_devices_of(effect, partial(_failing, effect=effect, times=each.times))
        for effect, other in each.instead.items():
            self._at_devices_of(effect, partial(_exchanged, effect=effect, told=Instead(other, times=each.times)))
        for name in each.dead:
            self._kill(name)
        for name in each.silent:
            self._behave(name, partial(replace, silent=True))
        for name in each.stuck:
            self._behave(name, partial(replace, stuck=True))
        for variable, value in each.lying.items():
            self._behave(self._owner(variable), partial(_lying, variable=variable, value=value))
        for name in each.well:
            self._mend(name)
        for name in each.restart:
            self.world.restart_hub(name)
        self._set(each.set)
        if each.operator is not None:
            self.world.operator = _habits(self.world.operator, each.operator)
        for order in _orders(each):
            self.world.order(order)
        if each.planner_killed is not None:
            self.world.process.alive = False
            name = f"planner-{len(self.world.processes) + 1}"
            self.world.later(each.planner_killed, lambda: self._start_planner(name))

    def _start_planner(self, name: str) -> None:
        self.world.start_planner(name, self.world.disk)

    def _at_devices_of(self, effect: str, change: Callable[[Behaviour], Behaviour]) -> None:
        """Change the behaviour of every device in which an effect happens."""
        for name, emulator in self.world.hubs.items():
            if any(one.name == effect for one in emulator.device.effects):
                self._behave(name, change)

    def _behave(self, name: str, change: Callable[[Behaviour], Behaviour]) -> None:
        emulator = self.world.hubs[name]
        self.world.become(name, emulators.behaving(emulator, change(emulator.device.behaviour)))

    def _kill(self, name: str) -> None:
        """Its driver is gone: nothing is heard, nothing is said, and nothing moves by itself."""
        self.world.crash_hub(name)
        failing = {effect.name: None for effect in self.world.hubs[name].device.effects}
        self._behave(name, partial(replace, failing=failing))
        self._anew(name)

    def _mend(self, name: str) -> None:
        """As it was at first."""
        self._behave(name, lambda _: Behaviour())
        self._anew(name)
        if name in self.world.down:
            self.world.restart_hub(name)

    def _anew(self, name: str, values: Mapping[str, Value] | None = None) -> None:
        """What goes on in a device is decided anew, once `values` have become true."""
        emulator = self.world.hubs[name]
        measured = {**emulator.device.measured, **(values or {})}
        self.world.become(name, replace(emulator, device=replace(emulator.device, measured=measured, begun=(), seen=None)))

    def _set(self, values: Mapping[str, Value]) -> None:
        """Measured variables change in the world, the planner's own by somebody who tells it."""
        measured = {v.name for v in self.station.system.variables if v.kind is VariableKind.MEASURED}
        for variable, value in values.items():
            if variable in measured:
                self._anew(self._owner(variable), {variable: value})
        told = {variable: value for variable, value in values.items() if variable not in measured}
        if told:
            self.world.order(Assign(told))

    def _owner(self, variable: str) -> str:
        owner = self.station.system.resources[variable]
        assert owner is not None, variable
        return owner


def _failing(behaviour: Behaviour, effect: str, times: Times) -> Behaviour:
    return replace(behaviour, failing={**behaviour.failing, effect: times})


def _exchanged(behaviour: Behaviour, effect: str, told: Instead) -> Behaviour:
    return replace(behaviour, instead={**behaviour.instead, effect: told})


def _lying(behaviour: Behaviour, variable: str, value: Value) -> Behaviour:
    return replace(behaviour, lying={**behaviour.lying, variable: value})


def _habits(operator: Operator, told: Habits) -> Operator:
    return Operator(
        delay=operator.delay if told.delay is None else told.delay,
        ignores=dict.fromkeys(told.ignores, told.times),
        pretends=dict.fromkeys(told.pretends, told.times),
        forgets=dict.fromkeys(told.forgets, told.times),
        agrees=told.agrees,
    )


def _orders(each: Entry) -> Iterator[Order]:
    yield from map(Activate, each.activate)
    yield from map(Pause, each.pause)
    yield from map(Cancel, each.cancel)
    yield from map(Reenable, each.reenable)
    if each.proceed:
        yield Proceed()
