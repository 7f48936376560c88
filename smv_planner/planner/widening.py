"""Invariants widened over what nobody can hold back (Machines 2021, section 3).

The states that break an invariant are extended by all states from which automatic and effect transitions can lead
into them; the widened invariant is what remains. The pre-image of a transition is its guard together with the bad
states in which its assignments stand in for the variables: plain substitution, so that the result stays readable.
The result is exact, which tests/planner holds to a search of all states.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from smv_planner.errors import EngineError
from smv_planner.model.expressions import FALSE, And, Expr, conjunction, negation, substitute, variables_of
from smv_planner.model.semantics import may_fire
from smv_planner.model.system import Any, Invariant, System, Transition

Satisfiable = Callable[[Expr], bool]
"""Whether some state satisfies a predicate."""

LIMIT = 5_000
"""How many pieces the bad states of one invariant may fall into."""


@dataclass(frozen=True, slots=True)
class Growth:
    """Some states from which `transition` leads towards breaking an invariant."""

    transition: str
    states: Expr


@dataclass(frozen=True, slots=True)
class Widened:
    """An invariant as declared, and what its widening adds to the states it forbids."""

    declared: Invariant
    growth: tuple[Growth, ...]

    @property
    def invariant(self) -> Invariant:
        """What every state of a plan must satisfy."""
        kept = [self.declared.predicate, *(negation(growth.states) for growth in self.growth)]
        return Invariant(self.declared.name, conjunction(kept))


def widen(system: System, satisfiable: Satisfiable) -> tuple[Widened, ...]:
    """Every invariant of the system, widened. Effects that are not expected count too: they may happen."""
    return tuple(_widen(system, invariant, satisfiable) for invariant in system.invariants)


def _widen(system: System, invariant: Invariant, satisfiable: Satisfiable) -> Widened:
    moves = [_Move.of(system, t) for t in system.transitions if t.kind.uncontrollable]
    good = [invariant.predicate]  # what is not known to be bad, as a conjunction
    growth: list[Growth] = []
    waiting = deque([negation(invariant.predicate)])
    while waiting:
        bad = waiting.popleft()
        read = variables_of(bad)
        for move in moves:
            if read.isdisjoint(move.values):
                continue
            before = conjunction([move.fires, substitute(bad, move.values)])
            if before == FALSE or not satisfiable(conjunction([before, *good])):
                continue
            before = _generalised(before, good, satisfiable)
            good.append(negation(before))
            growth.append(Growth(move.name, before))
            waiting.append(before)
            if len(growth) > LIMIT:
                raise EngineError(f"the invariant '{invariant.name}' grows into more than {LIMIT} pieces; state it more simply")
    return Widened(invariant, tuple(growth))


def _generalised(before: Expr, good: list[Expr], satisfiable: Satisfiable) -> Expr:
    """The predicate without the conditions whose absence adds only states that are bad anyway."""
    parts = list(before.parts) if isinstance(before, And) else [before]
    for part in list(parts):
        others = [other for other in parts if other is not part]
        if not satisfiable(conjunction([*others, negation(part), *good])):
            parts = others
    return conjunction(parts)


@dataclass(frozen=True, slots=True)
class _Move:
    name: str
    fires: Expr
    values: dict[str, Expr]

    @classmethod
    def of(cls, system: System, transition: Transition) -> _Move:
        values = {action.variable: action.value for action in transition.actions if not isinstance(action.value, Any)}
        assert len(values) == len(transition.actions), "nobody chooses the values of an uncontrollable transition"
        return cls(transition.name, may_fire(system, transition), values)
