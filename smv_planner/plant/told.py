"""What an emulated device is told while it runs, as words: `fail=door.opens:1`, `silent`, `lying=door.pos:opened`, `well`."""

from __future__ import annotations

from collections.abc import Callable

from smv_planner.emulation import emulator as emulators
from smv_planner.emulation.behaviour import Behaviour, Instead, Times
from smv_planner.emulation.emulator import Emulator
from smv_planner.errors import Mistake, UsageError, did_you_mean
from smv_planner.lazy import replace
from smv_planner.model.domains import Value, show_value

WORDS = {
    "fail": "fail=EFFECT[:TIMES]        the effect does not happen",
    "instead": "instead=EFFECT:OTHER[:TIMES] another effect happens in its place",
    "silent": "silent[=off]               the hub reports nothing",
    "stuck": "stuck[=off]                the hub obeys and mirrors no new goals",
    "lying": "lying=VARIABLE:VALUE       the hub reports this whatever is the case",
    "forgetful": "forgetful[=off]            a restart loses the device's state",
    "dead": "dead                       silent, stuck, and nothing moves",
    "restart": "restart                    the hub's process starts anew",
    "set": "set=VARIABLE:VALUE         the measured value is this from now on",
    "well": "well                       as it was at first",
}


def tell(emulator: Emulator, words: str, boot: str, at: float, first: Behaviour) -> Emulator:
    """The emulator after one instruction. `boot` is for a restart, `first` what `well` goes back to. Raises UsageError."""
    word, _, argument = words.strip().partition("=")
    if word not in WORDS:
        raise _wrong(f"'{words[:80]}' tells a device nothing", did_you_mean(word, WORDS) or "there are " + ", ".join(WORDS))
    behaviour = emulator.device.behaviour
    match word, argument:
        case "fail", _ if argument:
            name, times = _times(argument)
            effect = _effect(emulator, name)
            return _anew(_behaving(emulator, replace(behaviour, failing={**behaviour.failing, effect: times})))
        case "instead", _ if ":" in argument:
            word, other = argument.split(":", 1)
            other, times = _times(other)
            told = Instead(_effect(emulator, other), times=times)
            return _anew(_behaving(emulator, replace(behaviour, instead={**behaviour.instead, _effect(emulator, word): told})))
        case "lying", _ if ":" in argument:
            name, value = _measured(emulator, argument)
            return _behaving(emulator, replace(behaviour, lying={**behaviour.lying, name: value}))
        case "set", _ if ":" in argument:
            name, value = _measured(emulator, argument)
            device = emulator.device
            return _anew(replace(emulator, device=replace(device, measured={**device.measured, name: value})))
        case (("silent" | "stuck" | "forgetful"), ("on" | "off" | "")):
            return _behaving(emulator, _switch(word)(behaviour, argument != "off"))
        case "dead", "":
            failing: dict[str, Times] = {effect.name: None for effect in emulator.device.effects}
            return _anew(_behaving(emulator, replace(behaviour, silent=True, stuck=True, failing=failing)))
        case "restart", "":
            return emulators.restart(emulator, boot, at)
        case "well", "":
            return _anew(_behaving(emulator, first))
    raise _wrong(f"'{words[:80]}' is not how to say it", " ".join(WORDS[word].split("   ")[0].split()))


def _switch(word: str) -> Callable[[Behaviour, bool], Behaviour]:
    return {
        "silent": lambda behaviour, on: replace(behaviour, silent=on),
        "stuck": lambda behaviour, on: replace(behaviour, stuck=on),
        "forgetful": lambda behaviour, on: replace(behaviour, forgetful=on),
    }[word]


def _behaving(emulator: Emulator, behaviour: Behaviour) -> Emulator:
    return emulators.behaving(emulator, behaviour)


def _anew(emulator: Emulator) -> Emulator:
    """What goes on in the device is decided anew."""
    return replace(emulator, device=replace(emulator.device, begun=(), seen=None))


def _times(argument: str) -> tuple[str, Times]:
    name, colon, times = argument.partition(":")
    if not colon:
        return name, None
    if not times.isdecimal() or not 0 < int(times[:6]) < 10**5:
        raise _wrong(f"'{times[:40]}' is not how often", "as in fail=EFFECT:1")
    return name, int(times)


def _effect(emulator: Emulator, name: str) -> str:
    known = [effect.name for effect in emulator.device.effects]
    found = _full(emulator, name, known)
    if found is None:
        raise _wrong(f"'{name[:80]}' is not an effect of '{emulator.device.resource}'", _close(name, known))
    return found


def _measured(emulator: Emulator, argument: str) -> tuple[str, Value]:
    name, _, text = argument.partition(":")
    found = _full(emulator, name, list(emulator.device.measured))
    if found is None:
        raise _wrong(f"'{emulator.device.resource}' does not measure '{name[:80]}'", _close(name, list(emulator.device.measured)))
    domain = emulator.device.system.domains[found]
    for value in domain.values:
        if show_value(value) == text:
            return found, value
    raise _wrong(f"'{text[:80]}' is not a value of '{found}'", f"its domain is {domain}")


def _full(emulator: Emulator, name: str, known: list[str]) -> str | None:
    """The full name, which may be said without the resource."""
    return next((each for each in (name, f"{emulator.device.resource}.{name}") if each in known), None)


def _close(name: str, known: list[str]) -> str:
    return did_you_mean(name, known) or ("there are " + ", ".join(known[:8]) if known else "there is none")


def _wrong(message: str, hint: str) -> UsageError:
    return UsageError([Mistake(message, hint)])
