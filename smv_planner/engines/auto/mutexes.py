"""Pairwise mutexes: which values of two variables could ever hold together (the h2 heuristic of classical planning).

A fact is a variable with a value; for every fact a bit set says beside which others it may hold. An action may be taken
where facts can be found that its conditions ask for and that all may hold together, and what it assigns may then hold
beside whatever may hold there. The sets only grow; they hold whatever can happen and more, for automatic transitions are
not given priority, and of three facts only each two are looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import product
from math import prod

from smv_planner.clock import look
from smv_planner.engines.auto.grounding import Action, Ground, alternatives
from smv_planner.lazy import dataclass
from smv_planner.model.domains import Value
from smv_planner.model.expressions import And, Const, Expr, If, Or, conjuncts, meaning, negation
from smv_planner.model.ltl import Atom, Both, Either, Formula, Next, Release, Until
from smv_planner.problem import Pairs, Problem

TABLE = 600
"""How many combinations of values a condition may have to be taken by its values; what is not, and has no parts, is let pass."""

CASES = 300
"""How many combinations of values an action may read to assign what it computes; with more it may assign anything."""

FACTS = 1500
"""How many facts a system may have for their pairs to be looked at."""

Facts = int
"""A set of facts, one bit each: in the order of the variables, of each in the order of its domain."""

Together = Sequence[Facts]
"""For every fact those beside which it may hold, itself among them; none if it never does."""

Narrow = Callable[[Facts, Together], Facts]
"""Of facts that may hold in one state those that still may if a condition holds there; none if it cannot hold."""

OnTime = Callable[[], bool]


@dataclass(frozen=True, slots=True)
class Case:
    """If all of `when` hold before a step, `then` do after it; of a variable with several, one of them."""

    when: tuple[int, ...]
    then: Facts


@dataclass(frozen=True, slots=True)
class Move:
    conditions: tuple[Narrow, ...]
    wide: tuple[Narrow, ...]
    written: Facts
    cases: tuple[Case, ...]


class Mutexes:
    """Conditions and actions of a grounded system, compiled to judge sets of facts. The same for every question."""

    def __init__(self, of: Ground) -> None:
        self._of = of
        self._variables = [(v.name, v.domain.values) for v in of.system.variables]
        self._number = {(name, value): 0 for name, values in self._variables for value in values}
        self._number.update({fact: at for at, fact in enumerate(self._number)})
        self.facts = tuple(self._number)
        self._values = {name: self._mask((name, value) for value in values) for name, values in self._variables}
        self._own = tuple(self._values[name] for name, _ in self.facts)
        self._compiled: dict[int, tuple[Expr, Narrow]] = {}
        self._moves: dict[int, Move] = {}
        self._readers = self._woken()

    def grown(self, start: Iterable[Value], usable: int, on_time: OnTime) -> Together | None:
        """What can follow on `start` by the usable actions, and more; None if the time is up."""
        table = self.only(start)
        known: dict[tuple[int, int], Facts] = {}
        waiting = usable
        while waiting:
            for at in range(len(self._of.actions)):  # in turn, for what has grown a little will often grow more
                if waiting >> at & 1:
                    if not on_time():
                        return None
                    waiting &= ~(1 << at)
                    for fact in _places(self._taken(at, table, known)):
                        waiting |= self._readers[fact] & usable
        return table

    def only(self, state: Iterable[Value]) -> list[Facts]:
        """What may hold together in one state alone."""
        held = self._mask((name, value) for (name, _), value in zip(self._variables, state, strict=True))
        return [held if held >> at & 1 else 0 for at in range(len(self.facts))]

    def may_hold(self, predicates: Iterable[Expr], table: Together) -> bool:
        """Whether all predicates may hold together."""
        found = _held(table)
        narrows = [self._narrow(part) for predicate in predicates for part in conjuncts(predicate)]
        before = 0
        while found != before:
            before = found
            for narrow in narrows:
                found = narrow(found, table)
                if not found:
                    return False
        return self._whole(found)

    def proof(self, table: Together) -> Pairs:
        apart = (
            (self.facts[one], self.facts[other])
            for one, beside in enumerate(table)
            for other in _places(((1 << one + 1) - 1) & ~beside & (~self._own[one] | 1 << one))
            if one == other or (beside and table[other])
        )
        return Pairs(tuple(apart))

    def _taken(self, at: int, table: list[Facts], known: dict[tuple[int, int], Facts]) -> Facts:
        """Add to `table` what may hold after an action is taken in it; the facts about which that is new."""
        if at not in self._moves:
            self._moves[at] = self._move(at)
        move, found = self._moves[at], _held(table)
        for narrow in move.conditions:
            found = narrow(found, table)
            if not found:
                return 0
        news = 0
        for number, case in enumerate(move.cases):
            before = found
            for fact in case.when:
                before &= table[fact] if before >> fact & 1 else 0
            for narrow in move.wide if case.when and before else ():
                before = narrow(before, table)
                if not before:
                    break
            if not before or before == known.get((at, number)) or not self._whole(before):
                continue
            known[at, number] = before
            after = before & ~move.written | case.then
            for fact in _places(case.then):
                new = (after & ~self._own[fact] | 1 << fact) & ~table[fact]
                if new:
                    news |= new | 1 << fact
                    table[fact] |= new
                    for other in _places(new):
                        table[other] |= 1 << fact
        return news

    def _whole(self, found: Facts) -> bool:
        """Whether every variable has a value left."""
        return all(map(found.__and__, self._values.values()))

    def _move(self, at: int) -> Move:
        look()
        action = self._of.actions[at]
        parts = (*action.conditions, *self._of.keeps[at])
        narrow = sorted(parts, key=lambda part: len(self._of.reads(part)))
        return Move(
            conditions=tuple(map(self._narrow, narrow)),
            wide=tuple(self._narrow(part) for part in narrow if len(self._of.reads(part)) > 1),
            written=sum(self._values[name] for name in action.assigned),
            cases=tuple(self._cases(action)),
        )

    def _woken(self) -> tuple[int, ...]:
        """For every fact the actions that may do more when it may hold beside more; one bit each."""
        readers = dict.fromkeys(self._values, 0)
        for at, (action, keeps) in enumerate(zip(self._of.actions, self._of.keeps, strict=True)):
            for name in frozenset().union(*map(self._of.reads, (*action.conditions, *keeps, *action.assigned.values()))):
                readers[name] |= 1 << at
        return tuple(readers[name] for name, _ in self.facts)

    def _cases(self, action: Action) -> Iterator[Case]:
        computed = {name: value for name, value in action.assigned.items() if not isinstance(value, Const)}
        then = self._mask((name, value.value) for name, value in action.assigned.items() if isinstance(value, Const))
        names = sorted({name for value in computed.values() for name in self._of.reads(value)}, key=self._of.system.index.get)  # type: ignore[arg-type]
        if prod(len(self._of.system.domains[name].values) for name in names) > CASES:
            yield Case((), then | sum(self._values[name] for name in computed))
            return
        index = {name: at for at, name in enumerate(names)}
        worth = {name: meaning(value, index) for name, value in computed.items()}
        for row in product(*(self._of.system.domains[name].values for name in names)):
            assigned = [(name, value(row)) for name, value in worth.items()]
            if all(fact in self._number for fact in assigned):
                yield Case(tuple(self._number[fact] for fact in zip(names, row, strict=True)), then | self._mask(assigned))

    def _narrow(self, expr: Expr) -> Narrow:
        """By identity: to compare large expressions takes time."""
        if id(expr) not in self._compiled:
            self._compiled[id(expr)] = expr, self._compile(expr)
        return self._compiled[id(expr)][1]

    def _compile(self, expr: Expr) -> Narrow:
        names = sorted(self._of.reads(expr), key=self._of.system.index.get)  # type: ignore[arg-type]
        if len(names) == 1:
            return self._single(expr, names[0])
        if not names:
            return _anything if meaning(expr, {})(()) else _nothing
        every = tuple(conjuncts(expr))
        if len(every) > 1:
            return _all([self._narrow(part) for part in every])
        some = alternatives(expr)
        if len(some) > 1:
            return _some([self._narrow(part) for part in some])
        if isinstance(every[0], And | Or):
            return self._narrow(every[0])
        match every[0]:
            case If(condition, then, otherwise):
                branches = And((condition, then)), And((negation(condition), otherwise))
                return _some([self._narrow(branch) for branch in branches])
        if prod(len(self._of.system.domains[name].values) for name in names) > TABLE:
            return _anything
        return self._tabled(every[0], names)

    def _single(self, expr: Expr, name: str) -> Narrow:
        holds = meaning(expr, {name: 0})
        values, everything = self._values[name], self._of.system.domains[name].values
        refused = values & ~self._mask((name, value) for value in everything if holds((value,)))

        def narrow(found: Facts, table: Together) -> Facts:
            if not found & refused:
                return found
            left = found & values & ~refused
            return found & _beside(left, table) if left else 0

        return narrow

    def _tabled(self, expr: Expr, names: Sequence[str]) -> Narrow:
        """By what the last variable may be worth for all values of the others."""
        holds = meaning(expr, {name: at for at, name in enumerate(names)})
        *others, last = names
        rows = []
        for row in product(*(self._of.system.domains[name].values for name in others)):
            left = self._mask((last, value) for value in self._of.system.domains[last].values if holds((*row, value)))
            if left:
                rows.append((tuple(self._number[fact] for fact in zip(others, row, strict=True)), left))

        def narrow(found: Facts, table: Together) -> Facts:
            result = 0
            for facts, values in rows:
                before = found
                for fact in facts:
                    before &= table[fact] if before >> fact & 1 else 0
                left = before & values
                if left:
                    result |= before & _beside(left, table)
                    if result == found:
                        break
            return result

        return narrow

    def _mask(self, facts: Iterable[tuple[str, Value]]) -> Facts:
        """The facts that there are."""
        mask = 0
        for fact in facts:
            if fact in self._number:
                mask |= 1 << self._number[fact]
        return mask


def _held(table: Together) -> Facts:
    return sum(1 << at for at, beside in enumerate(table) if beside)


def _beside(facts: Facts, table: Together) -> Facts:
    """What may hold beside one of some facts."""
    result = 0
    for fact in _places(facts):
        result |= table[fact]
    return result


def _places(facts: Facts) -> Iterator[int]:
    while facts:
        yield (facts & -facts).bit_length() - 1
        facts &= facts - 1


def _anything(found: Facts, table: Together) -> Facts:
    return found


def _nothing(found: Facts, table: Together) -> Facts:
    return 0


def _all(parts: list[Narrow]) -> Narrow:
    def narrow(found: Facts, table: Together) -> Facts:
        for part in parts:
            found = part(found, table)
            if not found:
                break
        return found

    return narrow


def _some(parts: list[Narrow]) -> Narrow:
    def narrow(found: Facts, table: Together) -> Facts:
        result = 0
        for part in parts:
            result |= part(found, table)
            if result == found:
                break
        return result

    return narrow


def may_be_met(formula: Formula, mutexes: Mutexes, table: Together, allowed: tuple[Expr, ...]) -> bool:
    """Whether a run inside `table` might satisfy the formula at some time, each of its parts judged on its own."""
    match formula:
        case Atom(predicate):
            return mutexes.may_hold([predicate, *allowed], table)
        case Next(part):
            return may_be_met(part, mutexes, table, allowed)
        case Both(left, right):
            return all(may_be_met(part, mutexes, table, allowed) for part in (left, right))
        case Either(left, right):
            return any(may_be_met(part, mutexes, table, allowed) for part in (left, right))
        case Until(_, right) | Release(_, right):
            return may_be_met(right, mutexes, table, allowed)


def kept_apart(mutexes: Mutexes, of: Ground, problem: Problem, on_time: OnTime) -> Pairs | None:
    """Why no goal can be met, of every two facts only those that may hold together; None if that does not show it."""
    table = mutexes.grown(problem.initial, of.usable(problem.unusable), on_time)
    if table is None or all(may_be_met(Atom(goal.predicate), mutexes, table, of.clauses) for goal in problem.goals):
        return None
    return mutexes.proof(table)
