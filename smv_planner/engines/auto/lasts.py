"""By which actions a goal comes to hold, and what has to hold before them.

The last step before a goal is met is taken by one of a few actions, of which each needs something else. So what comes
before a goal is looked at one last action at a time.
"""

from __future__ import annotations

from collections.abc import Iterator

from smv_planner.engines.auto.conditions import Condition
from smv_planner.engines.auto.grounding import Ground, Truth, alternatives, dealt_out
from smv_planner.engines.auto.relaxed import Abstraction
from smv_planner.engines.auto.support import Support
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import FALSE, And, Expr, conjuncts

ACTIONS = 12
"""How many actions may come last, of goals that are looked at together."""

ALTERNATIVES = 4
"""How many alternatives of what a last action needs are looked at apart."""

GOALS = 1000
"""For how many goals is kept by which actions they come to hold."""


@dataclass(frozen=True, slots=True, eq=False)
class Last:
    """An action by which a goal may come to hold, and what has to hold before it."""

    action: int
    target: tuple[Expr, ...]
    condition: Condition


@dataclass(frozen=True, slots=True)
class Towards:
    """A goal with all the ways in which it may come to hold. For as long as some of `until` is owed, it has to.

    A part of a goal comes `before` that, whose number it has among those that are looked at together.
    """

    predicate: Expr
    until: int
    part: int
    holds: Truth
    lasts: tuple[Last, ...]
    before: int | None = None


class Lasts:
    """What is known about the last actions of goals in a grounded system, so that it serves many questions."""

    def __init__(self, of: Ground, abstraction: Abstraction) -> None:
        self.clauses = tuple(dict.fromkeys(part for clause in of.clauses for part in dealt_out(clause)))
        """What is allowed, in parts of which each reads as little as can be."""
        self._of = of
        self._abstraction = abstraction
        self._allowed = abstraction.condition(self.clauses)
        self._known: dict[object, tuple[Last, ...]] = {}
        self._implied: dict[int, tuple[Expr, ...]] = {}

    def towards(self, predicate: Expr, until: int, support: Support, before: int | None = None) -> Towards | None:
        """None if nothing makes a predicate true, or too much."""
        of = self._of
        lasts = tuple(last for last in self._of_all(predicate, support.taken) if support.may_hold(last.condition))
        if not 0 < len(lasts) <= ACTIONS:
            return None
        names = of.reads(predicate)
        truth = of.shared.truth(predicate, sorted(names, key=of.packing.order.__getitem__))
        return Towards(predicate, until, of.packing.mask(names), truth, lasts, before)

    def implied(self, at: int) -> tuple[Expr, ...]:
        """What single variables have to be worth for an action to lead from an allowed state to another."""
        if at not in self._implied:
            condition = self._abstraction.forced(self._abstraction.closely(at), self._allowed)
            self._implied[at] = (FALSE,) if condition is None else tuple(self._abstraction.written(condition))
        return self._implied[at]

    def _of_all(self, predicate: Expr, taken: tuple[int, ...]) -> tuple[Last, ...]:
        key = predicate, taken
        if key not in self._known:
            if len(self._known) == GOALS:
                self._known.clear()
            self._known[key] = tuple(self._ways(predicate, taken))
        return self._known[key]

    def _ways(self, predicate: Expr, taken: tuple[int, ...]) -> Iterator[Last]:
        """Each way to make a predicate true: which action does, and what has to hold before."""
        names, wanted = self._of.reads(predicate), tuple(conjuncts(predicate))
        for at in taken:
            action = self._of.actions[at]
            if not names.isdisjoint(action.assigned):
                needed = (*action.conditions, *(part for each in wanted for part in self._of.shared.keeps(action, each)))
                for target in _one_alternative_each(needed):
                    if FALSE not in target:
                        condition = self._abstraction.forced(self._abstraction.condition(target), self._allowed)
                        if condition is not None:
                            yield Last(at, (*target, *self._abstraction.written(condition)), condition)


def _one_alternative_each(parts: tuple[Expr, ...]) -> Iterator[tuple[Expr, ...]]:
    """A conjunction of which one part has a few alternatives, once for each of them: each may take other variables."""
    for at, part in enumerate(parts):
        ways = alternatives(part)
        if 1 < len(ways) <= ALTERNATIVES and any(isinstance(way, And) for way in ways):
            for way in ways:
                yield (*parts[:at], *conjuncts(way), *parts[at + 1 :])
            return
    yield parts
