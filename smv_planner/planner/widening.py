"""Invariants widened over what nobody can hold back (Machines 2021, section 3).

The states that break an invariant are extended by all states from which automatic and effect transitions can lead
into them; the widened invariant is what remains. The pre-image of a transition is its guard together with the bad
states in which its assignments stand in for the variables: plain substitution, so that the result stays readable.
The result is exact, which tests/planner holds to a search of all states.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import cached_property

from smv_planner.errors import EngineError
from smv_planner.lazy import dataclass
from smv_planner.model.expressions import FALSE, And, Expr, conjunction, negation, substitute, variables_of
from smv_planner.model.semantics import may_fire
from smv_planner.model.system import Any, Invariant, System, Transition

Satisfiable = Callable[..., bool]
"""Whether some state satisfies all of some predicates."""

LIMIT = 5_000
"""How many pieces the bad states of one invariant may fall into."""


@dataclass(frozen=True)
class Growth:
    """Some states from which `transition` leads towards breaking an invariant."""

    transition: str
    states: Expr

    @cached_property
    def others(self) -> Expr:
        """All states but these."""
        return negation(self.states)


@dataclass(frozen=True)
class Widened:
    """An invariant as declared, and what its widening adds to the states it forbids."""

    declared: Invariant
    growth: tuple[Growth, ...]

    @cached_property
    def invariant(self) -> Invariant:
        """What every state of a plan must satisfy."""
        kept = [self.declared.predicate, *(growth.others for growth in self.growth)]
        return Invariant(self.declared.name, conjunction(kept))


def widen(system: System, satisfiable: Satisfiable) -> tuple[Widened, ...]:
    """Every invariant of the system, widened. Effects that are not expected count too: they may happen."""
    moves = _moves(system, ())
    return tuple(_widen(Widened(invariant, ()), [], moves, satisfiable) for invariant in system.invariants)


class Widening:
    """Widens systems made from one base. What the base's transitions alone add to an invariant is worked out once."""

    def __init__(self, base: System, satisfiable: Satisfiable) -> None:
        self._base = base
        self._satisfiable = satisfiable
        self._moves = _moves(base, ())
        self._known: dict[int, Widened] = {}  # by identity: to compare large expressions takes time

    def __call__(self, system: System) -> tuple[Widened, ...]:
        """`widen`, for the base itself or a system made from it; what its own transitions do not touch stays the same."""
        if system is not self._base:
            assert system.base is self._base
            assert all(system.transition.get(move.transition.name) is move.transition for move in self._moves)
        own = _moves(system, self._moves)
        widened = (self._by_base(invariant) for invariant in system.invariants)
        return tuple(_widen(one, self._moves, own, self._satisfiable) if own else one for one in widened)

    def _by_base(self, invariant: Invariant) -> Widened:
        if id(invariant) not in self._known:
            if len(self._known) >= LIMIT:
                self._known.clear()
            self._known[id(invariant)] = _widen(Widened(invariant, ()), [], self._moves, self._satisfiable)
        return self._known[id(invariant)]


def _widen(known: Widened, done: Sequence[_Move], new: Sequence[_Move], satisfiable: Satisfiable) -> Widened:
    """Widen further what is widened over the moves `done` already."""
    invariant, growth = known.declared, list(known.growth)
    good = [invariant.predicate, *(one.others for one in growth)]  # what is not known to be bad, as a conjunction
    waiting = deque((bad, new) for bad in (negation(invariant.predicate), *(one.states for one in growth)))
    while waiting:
        bad, moves = waiting.popleft()
        read = variables_of(bad)
        for move in moves:
            if read.isdisjoint(move.values):
                continue
            before = conjunction([move.fires, substitute(bad, move.values)])
            if before == FALSE or not satisfiable(before, *good):
                continue
            before = _generalised(before, good, satisfiable)
            growth.append(Growth(move.transition.name, before))
            good.append(growth[-1].others)
            waiting.append((before, [*done, *new]))
            if len(growth) > LIMIT:
                raise EngineError(f"the invariant '{invariant.name}' grows into more than {LIMIT} pieces; state it more simply")
    return Widened(invariant, tuple(growth)) if len(growth) > len(known.growth) else known


def _generalised(before: Expr, good: list[Expr], satisfiable: Satisfiable) -> Expr:
    """The predicate without the conditions whose absence adds only states that are bad anyway."""
    parts = list(before.parts) if isinstance(before, And) else [before]
    for part in list(parts):
        others = [other for other in parts if other is not part]
        if not satisfiable(*others, negation(part), *good):
            parts = others
    return conjunction(parts)


@dataclass(frozen=True, slots=True)
class _Move:
    transition: Transition
    fires: Expr
    values: dict[str, Expr]


def _moves(system: System, besides: Sequence[_Move]) -> list[_Move]:
    """What nobody can hold back and can come about at all, but for the moves that are known."""
    known = {id(move.transition) for move in besides}
    uncontrollable = (t for t in system.transitions if t.kind.uncontrollable and t.guard != FALSE and id(t) not in known)
    return [_move(system, transition) for transition in uncontrollable]


def _move(system: System, transition: Transition) -> _Move:
    values = {action.variable: action.value for action in transition.actions if not isinstance(action.value, Any)}
    assert len(values) == len(transition.actions), "nobody chooses the values of an uncontrollable transition"
    return _Move(transition, may_fire(system, transition), values)
