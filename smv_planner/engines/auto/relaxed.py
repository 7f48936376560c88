"""Relaxed reachability: which values each variable could ever take, if values once reached were never lost.

Every variable has a set of values, a bit mask; conditions are judged over sets, each part on its own. The sets only
grow, so the fixpoint takes a moment; they hold whatever can happen and more. A goal that is out of reach even so has
no plan (the h1 heuristic of classical planning).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from smv_planner.engines.auto.grounding import Ground
from smv_planner.model.domains import Value
from smv_planner.model.expressions import (
    And,
    Const,
    Equal,
    Expr,
    If,
    Less,
    Minus,
    Named,
    Not,
    Or,
    Plus,
    conjuncts,
    meaning,
)
from smv_planner.model.ltl import Atom, Both, Either, Formula, Next, Release, Until
from smv_planner.model.system import System
from smv_planner.problem import Problem, Relaxed

EXPRESSIONS = 100_000
"""How many expressions may be kept compiled."""

Sets = Sequence[int]
"""For every variable of the system a mask of the values it may have, one bit each in the order of the domain."""

Values = Callable[[Sets], frozenset[Value]]


@dataclass(frozen=True, slots=True)
class Condition:
    """A conjunction: which values of single variables it asks for, and the parts that read several variables."""

    singles: tuple[tuple[int, int], ...]
    others: tuple[Values, ...]

    def narrowed(self, sets: Sets) -> Sets | None:
        """The sets as far as the condition may hold; None if it cannot."""
        for at, mask in self.singles:
            if not sets[at] & mask:
                return None
        result = list(sets)
        for at, mask in self.singles:
            result[at] &= mask
        return result if all(True in values(result) for values in self.others) else None


@dataclass(frozen=True, slots=True)
class Outcome:
    """What an action adds to the sets of the variables it assigns, if its condition may hold."""

    condition: Condition
    constant: tuple[tuple[int, int], ...]
    computed: tuple[tuple[int, Values], ...]


class Abstraction:
    """Conditions and actions of a grounded system, compiled to judge sets of values. The same for every question."""

    def __init__(self, of: Ground) -> None:
        self.system: System = of.system
        self.index = of.system.index
        self._domains = tuple(variable.domain.values for variable in of.system.variables)
        self._bits = tuple({value: 1 << at for at, value in enumerate(values)} for values in self._domains)
        self._reads = of.reads
        self._compiled: dict[int, tuple[Expr, Values]] = of.shared.compiled
        self._singles: dict[int, tuple[Expr, tuple[int, int]]] = of.shared.singles
        self.actions = tuple(
            self._outcome(self.condition([*action.conditions, *keeps]), action.assigned)
            for action, keeps in zip(of.actions, of.keeps, strict=True)
        )
        self.readers: tuple[tuple[int, ...], ...] = self._readers(of)

    def condition(self, parts: Iterable[Expr]) -> Condition:
        singles: dict[int, int] = {}
        others = []
        for part in parts:
            names = self._reads(part)
            if len(names) == 1:
                at, mask = self._asked(part)
                singles[at] = singles.get(at, -1) & mask
            elif names or not meaning(part, {})(()):
                others.append(self._values(part))
        return Condition(tuple(singles.items()), tuple(others))

    def _asked(self, part: Expr) -> tuple[int, int]:
        """A variable, and the values that a predicate on it asks for."""
        if id(part) not in self._singles:
            (name,) = self._reads(part)
            at, holds = self.index[name], meaning(part, {name: 0})
            mask = sum(bit for value, bit in self._bits[at].items() if holds((value,)))
            self._singles[id(part)] = part, (at, mask)
        return self._singles[id(part)][1]

    def trim(self) -> None:
        """Forget what was compiled for earlier questions, if that has become much; what belongs to the actions stays."""
        if len(self._compiled) + len(self._singles) > EXPRESSIONS:
            self._compiled.clear()
            self._singles.clear()

    def fixpoint(self, start: Iterable[Value], usable: int) -> list[int]:
        """What can follow on `start` by the usable actions, and more."""
        sets = [bits[value] for bits, value in zip(self._bits, start, strict=True)]
        waiting = usable
        while waiting:
            at = (waiting & -waiting).bit_length() - 1
            waiting &= waiting - 1
            outcome = self.actions[at]
            if not outcome.computed and all(sets[variable] & bit for variable, bit in outcome.constant):
                continue
            narrowed = outcome.condition.narrowed(sets)
            if narrowed is None:
                continue
            found = [
                *outcome.constant,
                *((variable, self._mask(variable, values(narrowed))) for variable, values in outcome.computed),
            ]
            for variable, mask in found:
                if mask & ~sets[variable]:
                    sets[variable] |= mask
                    for reader in self.readers[variable]:
                        waiting |= 1 << reader
            waiting &= usable
        return sets

    def _outcome(self, condition: Condition, assigned: Mapping[str, Expr]) -> Outcome:
        constant, computed = [], []
        for name, value in assigned.items():
            at = self.index[name]
            if isinstance(value, Const):
                constant.append((at, self._mask(at, [value.value])))
            else:
                computed.append((at, self._values(value)))
        return Outcome(condition, tuple(constant), tuple(computed))

    def _mask(self, at: int, values: Iterable[Value]) -> int:
        """The values that lie in a variable's domain."""
        bits = self._bits[at]
        mask = 0
        for value in values:
            mask |= bits.get(value, 0)
        return mask

    def proof(self, sets: Sets) -> Relaxed:
        return Relaxed(tuple(self._decoded(at, mask) for at, mask in enumerate(sets)))

    def _decoded(self, at: int, mask: int) -> tuple[Value, ...]:
        return tuple(value for bit, value in enumerate(self._domains[at]) if mask >> bit & 1)

    def _readers(self, of: Ground) -> tuple[tuple[int, ...], ...]:
        readers: list[list[int]] = [[] for _ in self._domains]
        for at, (action, keeps) in enumerate(zip(of.actions, of.keeps, strict=True)):
            read = {name for part in (*action.conditions, *keeps, *action.assigned.values()) for name in self._reads(part)}
            for name in sorted(read):
                readers[self.index[name]].append(at)
        return tuple(map(tuple, readers))

    def _values(self, expr: Expr) -> Values:
        """What an expression may be worth."""
        if id(expr) not in self._compiled:
            self._compiled[id(expr)] = expr, self._compile(expr)
        return self._compiled[id(expr)][1]

    def _compile(self, expr: Expr) -> Values:
        names = self._reads(expr)
        if len(names) <= 1:
            return self._single(expr, next(iter(names), None))
        match expr:
            case Named(_, part):
                return self._values(part)
            case Not(part):
                inner = self._values(part)
                return lambda sets: _NEGATED[inner(sets)]
            case And(parts) | Or(parts):
                return _connective([self._values(part) for part in parts], neutral=isinstance(expr, And))
            case Equal(left, right):
                a, b = self._values(left), self._values(right)
                return lambda sets: _equal(a(sets), b(sets))
            case Less(left, right):
                a, b = self._values(left), self._values(right)
                return lambda sets: _less(a(sets), b(sets))
            case Plus(left, right) | Minus(left, right):
                a, b = self._values(left), self._values(right)
                sign = 1 if isinstance(expr, Plus) else -1
                return lambda sets: frozenset(int(x) + sign * int(y) for x in a(sets) for y in b(sets))
            case If(condition, then, otherwise):
                c, a, b = self._values(condition), self._values(then), self._values(otherwise)
                none: frozenset[Value] = frozenset()
                return lambda sets: (a(sets) if True in c(sets) else none) | (b(sets) if False in c(sets) else none)
        raise AssertionError(expr)

    def _single(self, expr: Expr, name: str | None) -> Values:
        if name is None:
            always = frozenset([meaning(expr, {})(())])
            return lambda sets: always
        at, worth = self.index[name], meaning(expr, {name: 0})
        known: dict[int, frozenset[Value]] = {}

        def values(sets: Sets) -> frozenset[Value]:
            mask = sets[at]
            if mask not in known:
                known[mask] = frozenset(worth((value,)) for value in self._decoded(at, mask))
            return known[mask]

        return values


_BOTH: frozenset[Value] = frozenset([False, True])
_NO: frozenset[Value] = frozenset([False])
_YES: frozenset[Value] = frozenset([True])
_NEGATED: dict[frozenset[Value], frozenset[Value]] = {_BOTH: _BOTH, _NO: _YES, _YES: _NO}


def _connective(parts: list[Values], neutral: bool) -> Values:
    """`and` (neutral: true) or `or` (neutral: false) of parts that are judged each on its own."""

    def values(sets: Sets) -> frozenset[Value]:
        result = _YES if neutral else _NO
        for part in parts:
            found = part(sets)
            if neutral not in found:
                return found
            if len(found) == 2:
                result = _BOTH
        return result

    return values


def _equal(left: frozenset[Value], right: frozenset[Value]) -> frozenset[Value]:
    if left.isdisjoint(right):
        return _NO
    return _YES if len(left) == len(right) == 1 else _BOTH


def _less(left: frozenset[Value], right: frozenset[Value]) -> frozenset[Value]:
    found: list[Value] = []
    if any(x < y for x in left for y in right):  # type: ignore[operator]
        found.append(True)
    if any(not x < y for x in left for y in right):  # type: ignore[operator]
        found.append(False)
    return frozenset(found)


def may_be_met(formula: Formula, abstraction: Abstraction, sets: Sets, allowed: tuple[Expr, ...]) -> bool:
    """Whether a run inside `sets` might satisfy the formula at some time, each of its parts judged on its own."""
    match formula:
        case Atom(predicate):
            return abstraction.condition([*conjuncts(predicate), *allowed]).narrowed(sets) is not None
        case Next(part):
            return may_be_met(part, abstraction, sets, allowed)
        case Both(left, right):
            return all(may_be_met(part, abstraction, sets, allowed) for part in (left, right))
        case Either(left, right):
            return any(may_be_met(part, abstraction, sets, allowed) for part in (left, right))
        case Until(_, right) | Release(_, right):
            return may_be_met(right, abstraction, sets, allowed)


def out_of_reach(abstraction: Abstraction, of: Ground, problem: Problem) -> Relaxed | None:
    """Why no goal can be met even when no value is ever lost; None if that does not show it."""
    sets = abstraction.fixpoint(problem.initial, of.usable(problem.unusable))
    goals_met = all(may_be_met(Until(goal.until, Atom(goal.predicate)), abstraction, sets, of.clauses) for goal in problem.goals)
    return None if goals_met else abstraction.proof(sets)
