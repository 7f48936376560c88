"""The plant on the network: the clock, the links, and who tells devices to fail."""

from __future__ import annotations

import json
import threading
import time
import uuid
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from bridge import keys
from bridge.errors import LinkError
from bridge.link import Link
from bridge.wire import Wire
from smv_planner.emulation.behaviour import Behaviour
from smv_planner.errors import Mistake, UsageError, did_you_mean
from smv_planner.model.domains import Value
from smv_planner.model.model import Model
from smv_planner.plant import plant as plants
from smv_planner.protocol.interface import interfaces
from smv_planner.protocol.messages import Rejected, StateMessage, decode_state

GAP = 0.005
"""Seconds between two reports of a hub, however often something changes."""

FORMAT = 1
MAX_WORDS = 64


class Emulation:
    """Some hubs of a scenario, or all, with their devices, on one link. `period` is how often each reports."""

    def __init__(
        self,
        model: Model,
        cell: str,
        link: Link,
        names: tuple[str, ...] = (),
        behaviour: Behaviour | None = None,
        seed: int = 0,
        placed: Mapping[str, Value] | None = None,
    ) -> None:
        known = interfaces(model, keys.checked_cell(cell))
        boots = {name: _boot() for name in known}
        self.rejected: Counter[str] = Counter()
        self._clock = time.monotonic
        self._plant = plants.planted(model, cell, names, boots, self._clock(), behaviour or Behaviour(), seed, placed)
        self._period = model.period
        self._woken = threading.Event()
        self._lock = threading.Lock()
        self._closing = False
        self._wires = {name: Wire(link, known[name], self._woken.set) for name in self._plant.emulators}
        self._reported_at = dict.fromkeys(self._wires, 0.0)
        self._shown: dict[str, object] = dict.fromkeys(self._wires)
        elsewhere = {keys.state(cell, name): each for name, each in known.items() if name not in self._wires}
        self._elsewhere: Mapping[str, Any] = elsewhere
        self._overheard = link.latest(*elsewhere, wake=self._woken.set) if elsewhere else None
        for name in self._wires:
            link.answer(keys.behaviour(cell, name), self._told(name))
            link.answer(keys.perform(cell, name), self._performed(name))

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._wires)

    def fail(self, effect: str) -> None:
        """`EFFECT[:TIMES]` does not happen, on every device that has a part in it. Raises UsageError if none has."""
        emulators = self._plant.emulators
        name = effect.partition(":")[0]
        having = [each for each in emulators if any(one.name == name for one in emulators[each].device.effects)]
        for each in having:
            self.tell(each, f"fail={effect}")
        if not having:
            known = [one.name for each in emulators.values() for one in each.device.effects]
            raise UsageError([Mistake(f"there is no effect '{name}'", did_you_mean(name, known))])

    def tell(self, name: str, words: str) -> None:
        """Have a device behave otherwise from now on. Raises UsageError."""
        if name not in self._wires:
            raise UsageError([Mistake(f"there is no hub '{name}' here", did_you_mean(name, self._wires))])
        with self._lock:
            self._plant = plants.told(self._plant, name, words, _boot(), self._clock())
        self._woken.set()

    def run(self, over: Callable[[], bool] = lambda: False) -> None:
        """Until it is over, which is asked at least every period, or `stop` is called."""
        while not self._closing and not over():
            self._woken.clear()
            self._woken.wait(self.turn(self._clock()))

    def stop(self) -> None:
        self._closing = True
        self._woken.set()

    def turn(self, at: float) -> float:
        """Hear, react and report; how long there is nothing to do."""
        with self._lock:
            return self._turn(at)

    def _turn(self, at: float) -> float:
        for wire in self._wires.values():
            for message in wire.goals():
                match plants.obey(self._plant, message, at):
                    case Rejected() as rejected:
                        wire.refuse(rejected)
                    case plant:
                        self._plant = plant
        if self._overheard:
            for key, payload in self._overheard.drain():
                match decode_state(payload, self._elsewhere[key]):
                    case Rejected(reason):
                        self.rejected[f"state {reason}"] += 1
                    case said:
                        self._plant = plants.overhear(self._plant, said)
        self._plant = plants.advance(self._plant, at)
        return max(0.0, min(self._plant.due, *(self._report(name, at) for name in self._wires)) - at)

    def _report(self, name: str, at: float) -> float:
        """Report if it is time; when it is next."""
        emulator = self._plant.emulators[name]
        shown = emulator.hub.obeyed, emulator.hub.forsaken, emulator.device.measured, emulator.device.behaviour, emulator.hub.boot
        due = self._reported_at[name] + (self._period if shown == self._shown[name] else GAP)
        if at < due:
            return due
        self._plant, message = plants.report(self._plant, name, at)
        self._reported_at[name], self._shown[name] = at, shown
        if isinstance(message, StateMessage):
            self._wires[name].send(message)
        return at + self._period

    def _told(self, name: str) -> Callable[[bytes], bytes]:
        def answer(asked: bytes) -> bytes:
            words = _document(asked).get("tell", [])
            if type(words) is not list or len(words) > MAX_WORDS or not all(type(word) is str for word in words):
                raise ValueError("'tell' is a list of words")
            for word in words:
                self.tell(name, word)
            with self._lock:
                emulator = self._plant.emulators[name]
                told = {
                    "format": FORMAT,
                    "resource": name,
                    "boot": emulator.hub.boot,
                    "goal": dict(emulator.hub.goal),
                    "forsaken": emulator.hub.forsaken,
                    "measured": dict(emulator.device.measured),
                    "behaviour": _shown(emulator.device.behaviour),
                    "rejected": dict(self._wires[name].rejected),
                }
            return json.dumps(told).encode()

        return answer

    def _performed(self, name: str) -> Callable[[bytes], bytes]:
        def answer(asked: bytes) -> bytes:
            document = _document(asked)
            transition, chosen = document.get("transition"), document.get("chosen", {})
            if type(transition) is not str or type(chosen) is not dict:
                raise ValueError("expected a 'transition' and what was 'chosen'")
            with self._lock:
                self._plant = plants.perform(self._plant, name, transition, chosen)
            self._woken.set()
            return json.dumps({"format": FORMAT, "performed": transition}).encode()

        return answer


def tell(link: Link, cell: str, name: str, words: list[str]) -> dict[str, Any]:
    """Have a hub that runs elsewhere behave otherwise; what it says of itself then. Raises LinkError."""
    asked = json.dumps({"format": FORMAT, "tell": words}).encode()
    answered = link.ask(keys.behaviour(cell, name), asked)
    try:
        return _document(answered)
    except ValueError as error:
        raise LinkError(f"what '{name}' says of itself cannot be read: {error}") from error


def perform(link: Link, model: Model, cell: str, transition: str, chosen: Mapping[str, Value] | None = None) -> None:
    """Have done by a person, on all emulated devices that it concerns, what a maintenance transition says. Raises LinkError."""
    found = model.system.transition.get(transition)
    if found is None:
        raise UsageError([Mistake(f"there is no transition '{transition}'")])
    asked = json.dumps({"format": FORMAT, "transition": transition, "chosen": dict(chosen or {})}).encode()
    for name, interface in interfaces(model, cell).items():
        if not found.assigned.isdisjoint(interface.measured):
            link.ask(keys.perform(cell, name), asked)


def _document(text: bytes) -> dict[str, Any]:
    try:
        found = json.loads(text or b"{}")
    except RecursionError as error:
        raise ValueError("too deep") from error
    if type(found) is not dict or found.get("format", FORMAT) != FORMAT:
        raise ValueError(f"expected an object of format {FORMAT}")
    return found


def _shown(behaviour: Behaviour) -> dict[str, object]:
    told = {
        "silent": behaviour.silent,
        "stuck": behaviour.stuck,
        "forgetful": behaviour.forgetful,
        "fail": dict(behaviour.failing),
        "instead": {name: instead.effect for name, instead in behaviour.instead.items()},
        "lying": dict(behaviour.lying),
    }
    return {name: value for name, value in told.items() if value}


def _boot() -> str:
    return uuid.uuid4().hex
