"""What goes wrong in a run, drawn from the seed.

Swarm testing: each seed has some kinds of trouble, often, and never sees the others, for a bit of everything is always the
same. Trouble comes at random times, lasts for a while, and is over by itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from math import log

from smv_planner.emulation.draw import Draw
from smv_planner.lazy import dataclass
from smv_planner.simulate.network import Weather


class Trouble(StrEnum):
    HUB_CRASHES = "hub crashes"
    HUB_FORGETS = "hub crashes and forgets"
    HUB_FREEZES = "hub freezes"
    HUB_STUCK = "hub is stuck"
    HUB_SILENT = "hub is silent"
    HUB_LIES = "hub lies"
    DEAF = "hub hears nothing"
    UNHEARD = "hub is not heard"
    CUT_OFF = "hub is cut off"
    EFFECT_FAILS = "effect fails"
    EFFECT_LATE = "effect is late"
    EFFECT_UNEXPECTED = "unexpected effect"
    PLANNER_STOPS = "planner stands still"
    PLANNER_KILLED = "planner is killed"
    PLANNER_TWICE = "second planner"
    ENGINE_FAILS = "engine fails"
    ENGINE_LATE = "engine is late"
    ENGINE_LIES = "engine lies"
    ENGINE_REPEATS = "answers come twice"
    ASSIGNED = "decision variable is set"
    PAUSED = "intention is paused"
    CANCELLED = "intention is cancelled"
    OPERATION_CANCELLED = "operation is cancelled"
    CONFIRMED_FALSELY = "confirmed without doing"
    CONFIRMED_AGAIN = "confirmed again"
    OPERATOR_SLOW = "operator is slow"


RARE = {Trouble.PLANNER_TWICE, Trouble.CANCELLED, Trouble.HUB_LIES, Trouble.ASSIGNED}
"""After these the station needs a while: too often, and nothing else ever happens."""


@dataclass(frozen=True, slots=True)
class Swarm:
    """`rates` are per second. `pace` is how fast devices are, as a part of the time that their effects have."""

    weather: Weather
    rates: Mapping[Trouble, float]
    pace: float

    @property
    def kinds(self) -> tuple[str, ...]:
        return tuple(trouble.value for trouble in self.rates)


def swarm(draw: Draw) -> Swarm:
    """Which trouble a seed has, and how often. Some messages always get lost: no network is perfect."""
    weather = Weather(
        loss=0.01 + 0.24 * draw.unit("loss") ** 3,
        twice=_sometimes(draw.of("twice"), 0.3),
        late=_sometimes(draw.of("late"), 0.2),
        damage=_sometimes(draw.of("damage"), 0.1),
        longest=0.1 + 1.4 * draw.unit("longest") ** 2,
    )
    rates = {}
    for trouble in Trouble:
        if draw.unit(trouble.value) < 0.4:
            most = 0.02 if trouble in RARE else 0.08
            rates[trouble] = most * (0.2 + 0.8 * draw.unit(trouble.value, "rate"))
    return Swarm(weather, rates, 0.05 + 0.25 * draw.unit("pace"))


def _sometimes(draw: Draw, most: float) -> float:
    return most * draw.unit("how much") if draw.unit("whether") < 0.5 else 0.0


def next_time(rate: float, draw: Draw) -> float:
    """Seconds until it happens again, as if it did not remember when it happened last."""
    return -log(1.0 - draw.unit("when")) / rate
