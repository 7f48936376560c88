"""The device of one resource, made from the effects of the model that change what it measures.

An effect whose guard holds is begun and happens after a while, unless its guard becomes false before. Guards are
judged by `model/semantics.py`, over what is true everywhere: the goals that hubs obey and the values that devices
measure, not over what the planner believes. What the planner only estimates stays at its initial value, unless the world
says otherwise. Of an effect that changes several resources, each device makes its own part happen.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

from smv_planner.emulation.behaviour import WELL, Behaviour, fewer
from smv_planner.emulation.draw import Draw
from smv_planner.errors import Mistake, UsageError, did_you_mean
from smv_planner.lazy import dataclass, replace
from smv_planner.model.domains import Value, show_value
from smv_planner.model.expressions import meaning
from smv_planner.model.semantics import fire
from smv_planner.model.system import Any, Kind, State, System, Transition, VariableKind

SHORTEST = 0.001
"""Seconds that every effect takes at least, so that effects which undo each other do not stop the clock."""


@dataclass(frozen=True, slots=True)
class Begun:
    """What has been decided since `effects`, alternatives of each other, became possible together.

    `happens` at `due`, as long as `chosen` stays possible; None: nothing happens. Without a choice it stands as long as
    any of them stays possible.
    """

    effects: tuple[str, ...]
    chosen: str | None
    happens: str | None
    due: float


@dataclass(frozen=True, slots=True)
class Device:
    """`measured` is the truth about its measured variables, `effects` are those that change them, expected or not.

    `watched` are the variables that the effects use, with their initial values, and `seen` what the last reaction left of
    them. `began` counts decisions, to draw anew for each.
    """

    system: System
    resource: str
    effects: tuple[Transition, ...]
    watched: Mapping[str, Value]
    behaviour: Behaviour
    measured: Mapping[str, Value]
    begun: tuple[Begun, ...] = ()
    began: int = 0
    seen: tuple[Value, ...] | None = None

    @property
    def due(self) -> float:
        """When to `react` next even if nothing else changes; infinite if there is no need."""
        return min((each.due for each in self.begun), default=inf)


def emulated(system: System, resource: str, behaviour: Behaviour = WELL) -> Device:
    """The device of a resource, with initial values. Raises UsageError if the behaviour speaks of what it has not."""
    ours = (v for v in system.variables if v.resource == resource and v.kind is VariableKind.MEASURED)
    measured = {v.name: v.initial for v in ours}
    effects = tuple(t for t in system.transitions if t.kind is Kind.EFFECT and not t.assigned.isdisjoint(measured))
    used = frozenset().union(*(effect.used for effect in effects))
    watched = {v.name: v.initial for v in system.variables if v.name in used}
    return behaving(Device(system, resource, effects, watched, behaviour, measured), behaviour)


def behaving(device: Device, behaviour: Behaviour) -> Device:
    """The device with another behaviour from now on; what has begun goes on. Raises UsageError like `emulated`."""
    known = [effect.name for effect in device.effects]
    mistakes = [
        Mistake(f"'{name}' is not an effect of '{device.resource}'", did_you_mean(name, known))
        for name in dict.fromkeys(behaviour.effects)
        if name not in known
    ]
    for name, value in behaviour.lying.items():
        if name not in device.measured:
            mistakes.append(Mistake(f"'{device.resource}' does not measure '{name}'", did_you_mean(name, device.measured)))
        elif value not in device.system.domains[name]:
            mistakes.append(Mistake(f"'{show_value(value)}' is not a value of '{name}'"))
    if mistakes:
        raise UsageError(mistakes)
    return replace(device, behaviour=behaviour)


def react(device: Device, world: Mapping[str, Value], at: float, draw: Draw) -> Device:
    """The device at `at`: what was due has happened, what has become possible is begun.

    `world` has the values of all variables as far as they are known; its own measured values a device knows better.
    """
    if _seen(device, world) == device.seen and at < device.due:
        return device
    for each in sorted((each for each in device.begun if each.due <= at), key=lambda each: each.due):
        possible = _possible(device, _state(device, world))
        if _stands(each, possible):
            rest = tuple(other for other in device.begun if other is not each)
            if each.happens in possible:
                device = replace(device, measured={**device.measured, **possible[each.happens]}, begun=rest)
            else:  # what was to happen instead cannot
                device = replace(device, begun=(*rest, replace(each, happens=None, due=inf)))
    possible = _possible(device, _state(device, world))
    standing = tuple(each for each in device.begun if _stands(each, possible))
    begun = {effect for each in standing for effect in each.effects}
    device = replace(device, begun=standing, seen=_seen(device, world))
    waiting = [effect for effect in device.effects if effect.name in possible and effect.name not in begun]
    while waiting:
        alternatives = [effect for effect in waiting if effect.assigned & waiting[0].assigned & device.measured.keys()]
        waiting = [effect for effect in waiting if effect not in alternatives]
        device = _begin(device, alternatives, at, draw.of(device.resource, device.began))
    return device


def perform(
    device: Device, transition: Transition, world: Mapping[str, Value], chosen: Mapping[str, Value] | None = None
) -> Device:
    """The device after a person has done what a maintenance transition says, as far as it concerns this device.

    The person does not ask for guards. `chosen` has the values that the planner chose where the transition leaves it free.
    """
    state = _state(device, world)
    values = dict(chosen or {})
    for action in transition.actions:
        if not isinstance(action.value, Any):
            values[action.variable] = meaning(action.value, device.system.index)(state)
    domains = device.system.domains
    done = {name: value for name, value in values.items() if name in device.measured and value in domains[name]}
    return replace(device, measured={**device.measured, **done}, begun=(), seen=None)


def restarted(device: Device) -> Device:
    """The device after its power was cut: what was under way is not, and a forgetful one is as it was at first."""
    if device.behaviour.forgetful:
        initial = {name: device.system.initial[device.system.index[name]] for name in device.measured}
        return replace(device, measured=initial, begun=(), seen=None)
    return replace(device, begun=(), seen=None)


def _begin(device: Device, alternatives: list[Transition], at: float, draw: Draw) -> Device:
    """Decides which of them happens, if any, what happens instead of it, and when."""
    behaviour = device.behaviour
    names = tuple(effect.name for effect in alternatives)
    effect = _chosen(behaviour, alternatives, draw.unit("effect"))
    if effect is None:
        return _decided(device, Begun(names, None, None, inf), behaviour)
    if effect.name in behaviour.failing:
        failing = fewer(behaviour.failing, effect.name)
        return _decided(device, Begun(names, effect.name, None, inf), replace(behaviour, failing=failing))
    due = at + _delay(behaviour, effect, draw.unit("delay"))
    told = behaviour.instead.get(effect.name)
    if told and draw.unit("instead") < told.chance:
        left = fewer({effect.name: told.times}, effect.name)
        others = {name: other for name, other in behaviour.instead.items() if name != effect.name}
        instead = {**others, **{name: replace(told, times=times) for name, times in left.items()}}
        return _decided(device, Begun(names, effect.name, told.effect, due), replace(behaviour, instead=instead))
    return _decided(device, Begun(names, effect.name, effect.name, due), behaviour)


def _decided(device: Device, begun: Begun, behaviour: Behaviour) -> Device:
    return replace(device, begun=(*device.begun, begun), began=device.began + 1, behaviour=behaviour)


def _chosen(behaviour: Behaviour, alternatives: list[Transition], drawn: float) -> Transition | None:
    weights = [behaviour.weights.get(effect.name, 1.0 if effect.expected else 0.0) for effect in alternatives]
    left = drawn * max(1.0, sum(weights))
    for effect, weight in zip(alternatives, weights, strict=True):
        if left < weight:
            return effect
        left -= weight
    return None


def _delay(behaviour: Behaviour, effect: Transition, drawn: float) -> float:
    full = behaviour.leisure if effect.within is None else effect.within
    factor = behaviour.delays.get(effect.name, behaviour.delay)
    return max(SHORTEST, full * factor * (1 + behaviour.jitter * (2 * drawn - 1)))


def _stands(each: Begun, possible: Mapping[str, object]) -> bool:
    return each.chosen in possible if each.chosen else any(effect in possible for effect in each.effects)


def _possible(device: Device, state: State) -> dict[str, dict[str, Value]]:
    """The effects that can happen now, each with what it would change of this device."""
    found = {}
    for effect in device.effects:
        for after in fire(device.system, effect, state):
            changes = device.system.changes(state, after)
            ours = {name: value for name, value in changes.items() if name in device.measured}
            if ours:
                found[effect.name] = ours
    return found


def _state(device: Device, world: Mapping[str, Value]) -> State:
    known = {**world, **device.measured}
    return tuple(map(known.get, device.system.index, device.system.initial))


def _seen(device: Device, world: Mapping[str, Value]) -> tuple[Value, ...]:
    own = device.measured
    return tuple([own[name] if name in own else world.get(name, initial) for name, initial in device.watched.items()])
