"""In which states of a run predicates hold, each part of them judged once for all states that it cannot tell apart.

Of many independent stations one moves at a time, so what is asked of the others has been judged before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from operator import itemgetter

from smv_planner.check.relaxed import parts
from smv_planner.clock import look
from smv_planner.model.expressions import And, Expr
from smv_planner.model.semantics import judge, once
from smv_planner.model.system import State, System

Seen = Callable[[State], object]
"""What can be seen of a state, if only some variables are looked at."""


def seen(system: System, names: Iterable[str]) -> Seen:
    places = sorted(system.index[name] for name in names)
    return itemgetter(*places) if places else lambda state: ()


class Where:
    def __init__(self, system: System, states: Sequence[State]) -> None:
        self._system, self._states = system, states
        self._everywhere = (1 << len(states)) - 1
        self._known: dict[int, tuple[Expr, int]] = {}

    def everywhere(self, predicate: Expr) -> bool:
        """Whether a predicate holds in each of the states."""
        return self._all(predicate) == self._everywhere

    def __call__(self, predicate: Expr) -> list[bool]:
        """Whether a predicate holds, state by state."""
        found = self._all(predicate)
        return [bool(found >> at & 1) for at in range(len(self._states))]

    def _all(self, predicate: Expr) -> int:
        """The states where all parts of a predicate hold, one bit each; what several predicates share is judged once."""
        if id(predicate) not in self._known:
            found = self._everywhere
            if isinstance(predicate, And):
                for part in predicate.parts:
                    found &= self._all(part)
            else:
                for part, see in once(self._system, _parts, predicate):
                    found &= self._one(part, see)
            self._known[id(predicate)] = predicate, found
        return self._known[id(predicate)][1]

    def _one(self, part: Expr, see: Seen) -> int:
        look()
        holds = judge(self._system, part)
        truth = {what: bool(holds(state)) for what, state in {see(state): state for state in self._states}.items()}
        if all(truth.values()):
            return self._everywhere
        return sum(1 << at for at, state in enumerate(self._states) if truth[see(state)])


def _parts(system: System, predicate: Expr) -> list[tuple[Expr, Seen]]:
    return [(part, seen(system, names)) for part, names in once(system, parts, predicate)]
