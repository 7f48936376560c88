"""Several emulated devices that see each other, and what the hubs of others say of theirs."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

from smv_planner.emulation import emulator as emulators
from smv_planner.emulation.behaviour import Behaviour
from smv_planner.emulation.draw import Draw
from smv_planner.emulation.emulator import Emulator
from smv_planner.errors import Mistake, UsageError, did_you_mean
from smv_planner.lazy import dataclass, replace
from smv_planner.model.domains import Value
from smv_planner.model.model import Model
from smv_planner.model.system import Kind
from smv_planner.plant.told import tell
from smv_planner.protocol.hub import deadman_of
from smv_planner.protocol.interface import interfaces
from smv_planner.protocol.messages import GoalMessage, Rejected, StateMessage

ROUNDS = 16
"""So often devices may react to each other at one moment; what is left comes with the next."""


@dataclass(frozen=True, slots=True)
class Plant:
    """`emulators` by resource. `others` has what is known of resources whose hubs are elsewhere."""

    emulators: Mapping[str, Emulator]
    first: Behaviour
    draw: Draw
    others: Mapping[str, Value]

    @property
    def world(self) -> dict[str, Value]:
        """What is true everywhere, as far as it is known here."""
        known = dict(self.others)
        for emulator in self.emulators.values():
            known.update(emulator.world)
        return known

    @property
    def due(self) -> float:
        """When a device has something to do next."""
        return min((each.device.due for each in self.emulators.values()), default=inf)


def planted(
    model: Model,
    cell: str,
    names: tuple[str, ...],
    boots: Mapping[str, str],
    at: float,
    behaviour: Behaviour,
    seed: int = 0,
    placed: Mapping[str, Value] | None = None,
) -> Plant:
    """The devices of these resources, of all if none is named, at rest with initial values or as `placed` says instead.

    Raises UsageError.
    """
    resources = {resource.name: resource for resource in model.resources}
    known = interfaces(model, cell)
    chosen = names or tuple(known)
    mistakes = [Mistake(f"there is no resource '{name}'", did_you_mean(name, known)) for name in chosen if name not in known]
    if mistakes:
        raise UsageError(mistakes)
    started = {
        name: emulators.start(model.system, known[name], boots[name], at, behaviour, deadman_of(resources[name]))
        for name in chosen
    }
    return Plant({name: _placed(each, placed or {}) for name, each in started.items()}, behaviour, Draw(seed), {})


def _placed(emulator: Emulator, values: Mapping[str, Value]) -> Emulator:
    hub, device = emulator.hub, emulator.device
    resting = {name: values.get(name, value) for name, value in hub.resting.items()}
    measured = {name: values.get(name, value) for name, value in device.measured.items()}
    return Emulator(replace(hub, resting=resting), replace(device, measured=measured))


def obey(plant: Plant, message: GoalMessage, at: float) -> Plant | Rejected:
    match emulators.receive(plant.emulators[message.resource], message, at):
        case Rejected() as rejected:
            return rejected
        case emulator:
            return _with(plant, message.resource, emulator)


def overhear(plant: Plant, message: StateMessage) -> Plant:
    """What the hub of another process says of its device is believed."""
    if message.resource in plant.emulators:
        return plant
    return replace(plant, others={**plant.others, **message.mirror, **message.measured})


def advance(plant: Plant, at: float) -> Plant:
    """Every device at `at`; what one does may be what another waits for."""
    for _ in range(ROUNDS):
        before = plant
        world = plant.world
        for name, emulator in plant.emulators.items():
            after = emulators.advance(emulator, world, at, plant.draw)
            if after != emulator:
                plant = _with(plant, name, after)
                world.update(after.world)
        if plant is before:
            return plant
    return plant


def report(plant: Plant, name: str, at: float) -> tuple[Plant, StateMessage | None]:
    emulator, message = emulators.report(plant.emulators[name], at)
    return _with(plant, name, emulator), message


def told(plant: Plant, name: str, words: str, boot: str, at: float) -> Plant:
    """The plant after one device was told something. Raises UsageError."""
    return _with(plant, name, tell(plant.emulators[name], words, boot, at, plant.first))


def perform(plant: Plant, name: str, transition: str, chosen: Mapping[str, Value]) -> Plant:
    """The plant after a person has done to one device what a maintenance transition says. Raises UsageError for another name."""
    emulator = plant.emulators[name]
    system = emulator.device.system
    found = system.transition.get(transition)
    if found is None or found.kind is not Kind.MAINTENANCE:
        known = [each.name for each in system.transitions if each.kind is Kind.MAINTENANCE]
        raise UsageError([Mistake(f"'{transition[:80]}' is nothing that a person does", did_you_mean(transition, known))])
    return _with(plant, name, emulators.perform(emulator, found, plant.world, chosen))


def _with(plant: Plant, name: str, emulator: Emulator) -> Plant:
    return replace(plant, emulators={**plant.emulators, name: emulator})
