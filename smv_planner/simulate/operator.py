"""The operator of a simulated station: what it takes, and whether what was asked for is done before it is confirmed."""

from __future__ import annotations

from collections.abc import Mapping

from smv_planner.emulation.behaviour import Times, fewer
from smv_planner.lazy import dataclass, field, replace


@dataclass(frozen=True, slots=True)
class Operator:
    """Does what is asked `delay` seconds later, confirms half a second after that, and agrees to everything.

    `ignores` are maintenance transitions that do not get done, `pretends` those that are confirmed without being done, and
    `forgets` those that are done and not confirmed; so many times. One who does not `agree` leaves every question open.
    """

    delay: float = 3.0
    ignores: Mapping[str, Times] = field(default_factory=dict)
    pretends: Mapping[str, Times] = field(default_factory=dict)
    forgets: Mapping[str, Times] = field(default_factory=dict)
    agrees: bool = True

    def asked(self, transition: str) -> tuple[Operator, bool, bool]:
        """The operator from now on, whether the work gets done, and whether it is confirmed."""
        if transition in self.ignores:
            return replace(self, ignores=fewer(self.ignores, transition)), False, False
        if transition in self.pretends:
            return replace(self, pretends=fewer(self.pretends, transition)), False, True
        if transition in self.forgets:
            return replace(self, forgets=fewer(self.forgets, transition)), True, False
        return self, True, True
