"""How an emulated device behaves: how fast, what fails, what happens instead, and what it tells of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from smv_planner.lazy import dataclass, field
from smv_planner.model.domains import Value

Times = int | None
"""So many times from now; None: for ever."""


@dataclass(frozen=True, slots=True)
class Instead:
    """When an effect is due, `effect` happens in its place, with this chance, so many times."""

    effect: str
    chance: float = 1.0
    times: Times = None


@dataclass(frozen=True, slots=True)
class Behaviour:
    """Without arguments: everything expected happens, in about half the time it has, and nothing else does.

    An effect takes `delay` times its `within` (`delays` has other factors for single effects; above 1 it is late),
    give or take the part `jitter` of that; one without `within` has `leisure` seconds.

    Effects that become possible at once and change the same variable are alternatives: one happens, by `weights`. An
    expected effect weighs 1 and an unexpected one 0 unless told; what is missing to 1 is the chance that none happens.

    `failing` effects do not happen. A `stuck` hub accepts no goals and says nothing about it, a `silent` one reports
    nothing, a `lying` one reports these values whatever is the case; a `forgetful` device starts with initial values.
    """

    delay: float = 0.5
    jitter: float = 0.2
    leisure: float = 1.0
    delays: Mapping[str, float] = field(default_factory=dict)
    weights: Mapping[str, float] = field(default_factory=dict)
    failing: Mapping[str, Times] = field(default_factory=dict)
    instead: Mapping[str, Instead] = field(default_factory=dict)
    stuck: bool = False
    silent: bool = False
    lying: Mapping[str, Value] = field(default_factory=dict)
    forgetful: bool = False

    @property
    def effects(self) -> Iterator[str]:
        """Every effect it speaks of."""
        for table in (self.delays, self.weights, self.failing, self.instead):
            yield from table
        yield from (instead.effect for instead in self.instead.values())


WELL = Behaviour()


def fewer(table: Mapping[str, Times], name: str) -> dict[str, Times]:
    """The table once `name` has happened: one time less, and gone with the last."""
    times = table[name]
    left = None if times is None else times - 1
    return {key: left if key == name else value for key, value in table.items() if key != name or left != 0}
