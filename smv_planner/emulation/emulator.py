"""An emulated device behind the hub automaton of real drivers: goal messages in, state messages out."""

from __future__ import annotations

from collections.abc import Mapping

from smv_planner.emulation import device as devices
from smv_planner.emulation.behaviour import WELL, Behaviour
from smv_planner.emulation.device import Device
from smv_planner.emulation.draw import Draw
from smv_planner.lazy import dataclass, replace
from smv_planner.model.domains import Value
from smv_planner.model.system import System, Transition
from smv_planner.protocol import hub as hubs
from smv_planner.protocol.hub import HOLD, Deadman, Hub
from smv_planner.protocol.interface import Interface
from smv_planner.protocol.messages import GoalMessage, Rejected, StateMessage


@dataclass(frozen=True, slots=True)
class Emulator:
    """`hub` has what is mirrored and obeyed, `device` what is true."""

    hub: Hub
    device: Device

    @property
    def world(self) -> dict[str, Value]:
        """What is true of this resource, for the guards of others: the goals it obeys and its measured values."""
        return {**self.hub.goal, **self.device.measured}


def start(
    system: System, interface: Interface, boot: str, at: float, behaviour: Behaviour = WELL, deadman: Deadman = HOLD
) -> Emulator:
    """A device at rest with initial values. Raises UsageError if the behaviour speaks of what it has not."""
    goal = {name: system.initial[system.index[name]] for name in interface.goals}
    device = devices.emulated(system, interface.resource, behaviour)
    return Emulator(hubs.start(interface, boot, at, goal, deadman), device)


def receive(emulator: Emulator, message: GoalMessage, at: float) -> Emulator | Rejected:
    """The emulator after a decoded goal message. A stuck one believes to be well, and neither obeys nor refuses."""
    if emulator.device.behaviour.stuck:
        return replace(emulator, hub=replace(emulator.hub, heard_at=at))
    match hubs.receive(emulator.hub, message, at):
        case Rejected() as rejected:
            return rejected
        case hub:
            return replace(emulator, hub=hub)


def advance(emulator: Emulator, world: Mapping[str, Value], at: float, draw: Draw) -> Emulator:
    """The emulator as time goes by: deadman reaction, then effects. `world` is what is true of the other resources."""
    hub = hubs.tick(emulator.hub, at)
    return Emulator(hub, devices.react(emulator.device, {**world, **hub.goal}, at, draw))


def report(emulator: Emulator, at: float) -> tuple[Emulator, StateMessage | None]:
    """The next state message; None from a silent one."""
    device = emulator.device
    if device.behaviour.silent:
        return emulator, None
    hub, message = hubs.report(emulator.hub, {**device.measured, **device.behaviour.lying}, at)
    return replace(emulator, hub=hub), message


def perform(
    emulator: Emulator, transition: Transition, world: Mapping[str, Value], chosen: Mapping[str, Value] | None = None
) -> Emulator:
    """The emulator after a person has done what a maintenance transition says."""
    known = {**world, **emulator.hub.goal}
    return replace(emulator, device=devices.perform(emulator.device, transition, known, chosen))


def behaving(emulator: Emulator, behaviour: Behaviour) -> Emulator:
    """The emulator with another behaviour from now on. Raises UsageError like `start`."""
    return replace(emulator, device=devices.behaving(emulator.device, behaviour))


def restart(emulator: Emulator, boot: str, at: float) -> Emulator:
    """The emulator after a crash. It has forgotten whom it obeyed; a forgetful one also what it was asked and where it was."""
    hub, system = emulator.hub, emulator.device.system
    goal = hub.goal
    if emulator.device.behaviour.forgetful:
        goal = {name: system.initial[system.index[name]] for name in hub.interface.goals}
    return Emulator(hubs.start(hub.interface, boot, at, goal, hub.deadman), devices.restarted(emulator.device))
