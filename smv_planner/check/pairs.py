"""Are these pairs of facts kept apart whatever happens, and do they keep the goals from being met?

A fact is a variable with a value. From the facts that may hold in one state, a condition strikes out those that hold in
no way to meet it: its ways are enumerated where it reads few combinations of values, else a conjunction is judged part by
part and a disjunction leaves what any part leaves. Each transition is enumerated by its choices and by what it reads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import product
from math import prod

from smv_planner.check.relaxed import choices, kept, parts
from smv_planner.clock import look
from smv_planner.model.domains import Value
from smv_planner.model.expressions import And, Expr, If, Or, conjuncts, meaning, negation, variables_of
from smv_planner.model.ltl import Atom, Both, Either, Formula, Next, Release, Until
from smv_planner.model.semantics import once, ready
from smv_planner.model.system import System, Transition, Variable
from smv_planner.problem import Pairs, Problem

COMBINATIONS = 1000
"""How many combinations of values are enumerated for a condition, or for what a transition reads to compute values."""

Fact = tuple[str, Value]

Left = int
"""Facts that may still hold in a state, one bit each; none if there is no such state."""

Judge = Callable[[Left, list[int]], Left]


def broken(problem: Problem, proof: Pairs) -> str | None:
    """Why the pairs prove nothing; None if they do."""
    try:
        check = _Check(problem, proof)
    except KeyError:
        return "the proof speaks of variables or values that do not exist"
    return check.broken()


class _Facts:
    """All facts of a system, numbered, and how conditions on them are judged: nothing of any proof, for it is remembered."""

    def __init__(self, system: System, variables: Iterable[Variable]) -> None:
        self.number: dict[Fact, int] = {}
        self.values: dict[str, Left] = {}
        self._domains = {variable.name: variable.domain.values for variable in variables}
        for name, domain in self._domains.items():
            facts = [(name, value) for value in domain]
            for fact in facts:
                self.number[fact] = len(self.number)
            self.values[name] = self.bits(facts)

    def judge(self, condition: Expr) -> Judge:
        names = sorted(variables_of(condition))
        domains = [self._domains[name] for name in names]
        if len(names) <= 1 or prod(map(len, domains)) <= COMBINATIONS:
            holds = meaning(condition, {name: at for at, name in enumerate(names)})
            return enumerated([self._numbers(names, row) for row in product(*domains) if holds(row)])
        every = tuple(conjuncts(condition))
        if len(every) > 1:
            return in_turn(list(map(self.judge, every)))
        some = tuple(negation(part) for part in conjuncts(condition, False))
        if len(some) > 1:
            return either(list(map(self.judge, some)))
        match every[0]:
            case And() | Or():
                return self.judge(every[0])
            case If(case, then, otherwise):
                return either([self.judge(And((case, then))), self.judge(And((negation(case), otherwise)))])
        return lambda left, beside: left

    def bits(self, facts: Iterable[Fact]) -> Left:
        return sum(1 << self.number[fact] for fact in facts)

    def _numbers(self, names: list[str], row: tuple[Value, ...]) -> tuple[int, ...]:
        return tuple(self.number[fact] for fact in zip(names, row, strict=True))


def _judge(system: System, condition: Expr) -> Judge:
    return once(system, _Facts, system.variables).judge(condition)


def _enabled(system: System, transition: Transition) -> list[Expr]:
    return list(conjuncts(ready(system, transition)))


class _Check:
    def __init__(self, problem: Problem, proof: Pairs) -> None:
        self.problem, self.system = problem, problem.system
        facts = once(self.system, _Facts, self.system.variables)
        self.number, self.values, self.bits = facts.number, facts.values, facts.bits
        self.own = [self.values[name] for name, _ in self.number]
        everything = (1 << len(self.number)) - 1
        self.beside = [everything & ~values | 1 << at for at, values in enumerate(self.own)]
        for one, other in proof.apart:
            self.beside[self.number[one]] &= ~(1 << self.number[other])
            self.beside[self.number[other]] &= ~(1 << self.number[one])
        never = sum(1 << at for at, beside in enumerate(self.beside) if not beside >> at & 1)
        self.beside = [0 if never >> at & 1 else beside & ~never for at, beside in enumerate(self.beside)]
        self.most = everything & ~never

    def broken(self) -> str | None:
        start = self.bits(self.system.named(self.problem.initial).items())
        if any(start & ~self.beside[at] for at in places(start)):
            return "the proof keeps apart what holds at the start"
        allowed = [part for i in self.problem.allowed for part in once(self.system, parts, i.predicate)]
        for transition in self.problem.usable:
            enabled = once(self.system, _enabled, transition)
            for number, chosen in enumerate(choices(self.system, transition)):
                look()
                if self.leaves([*enabled, *kept(self.system, transition, number, chosen, allowed)], chosen):
                    return f"the proof leaves out what follows on '{transition.name}'"
        if self.may_hold(self.problem.formula, [part for part, _ in allowed]):
            return "the pairs do not rule out that the goals are met"
        return None

    def leaves(self, conditions: list[Expr], chosen: Mapping[str, Expr]) -> bool:
        """Whether what is assigned where the conditions hold may stand beside what it is to be kept apart from."""
        judges = list(map(self.judge, conditions))
        before = self.struck(self.most, judges)
        written = sum(self.values[name] for name in chosen)
        for read, then in self.outcomes(chosen) if before else ():
            left = self.given(before, read)
            if left and any(self.escaping(fact, left & ~written | then) for fact in places(then)):
                left = self.struck(left, judges)
                for fact in places(then) if left else ():
                    for other in places(self.escaping(fact, left & ~written | then)):
                        if then >> other & 1 or self.struck(self.given(left, [other]), judges):
                            return True
        return False

    def escaping(self, fact: int, after: Left) -> Left:
        """Facts that a fact is to be kept apart from and that may now stand beside it; itself if it is never to hold."""
        return (after & ~self.own[fact] | 1 << fact) & ~self.beside[fact]

    def outcomes(self, chosen: Mapping[str, Expr]) -> Iterator[tuple[list[int], Left]]:
        """What is read, and what is then assigned; if too much is read, that anything may be."""
        names = sorted(frozenset().union(*map(variables_of, chosen.values())))
        domains = [self.system.domains[name].values for name in names]
        if len(names) > 1 and prod(map(len, domains)) > COMBINATIONS:
            yield [], sum(self.values[name] for name in chosen)
            return
        index = {name: at for at, name in enumerate(names)}
        worth = {name: meaning(value, index) for name, value in chosen.items()}
        for row in product(*domains):
            assigned = [(name, value(row)) for name, value in worth.items()]
            if all(fact in self.number for fact in assigned):
                yield [self.number[fact] for fact in zip(names, row, strict=True)], self.bits(assigned)

    def may_hold(self, formula: Formula, always: list[Expr]) -> bool:
        """Whether the formula might hold at some time in a run that keeps the pairs apart, where `always` holds."""
        match formula:
            case Atom(predicate):
                return bool(self.struck(self.most, [self.judge(part) for part in (*conjuncts(predicate), *always)]))
            case Next(part):
                return self.may_hold(part, always)
            case Both(left, right):
                return self.may_hold(left, always) and self.may_hold(right, always)
            case Either(left, right):
                return self.may_hold(left, always) or self.may_hold(right, always)
            case Until(_, right) | Release(_, right):
                return self.may_hold(right, always)

    def struck(self, left: Left, judges: list[Judge]) -> Left:
        """What all conditions together leave, judged in turn until nothing changes."""
        before = 0
        while left and left != before:
            before = left
            for judge in judges:
                left = judge(left, self.beside)
                if not left:
                    return 0
        return left if all(left & values for values in self.values.values()) else 0

    def given(self, left: Left, facts: Iterable[int]) -> Left:
        """What is left if these facts hold."""
        for fact in facts:
            left &= self.beside[fact] if left >> fact & 1 else 0
        return left

    def judge(self, condition: Expr) -> Judge:
        return once(self.system, _judge, condition)


def enumerated(ways: list[tuple[int, ...]]) -> Judge:
    def judge(left: Left, beside: list[int]) -> Left:
        found = 0
        for way in ways:
            possible = left
            for fact in way:
                possible &= beside[fact] if possible >> fact & 1 else 0
            found |= possible
            if found == left:
                break
        return found

    return judge


def in_turn(judges: list[Judge]) -> Judge:
    def judge(left: Left, beside: list[int]) -> Left:
        for part in judges:
            left = part(left, beside)
        return left

    return judge


def either(judges: list[Judge]) -> Judge:
    def judge(left: Left, beside: list[int]) -> Left:
        found = 0
        for part in judges:
            found |= part(left, beside)
        return found

    return judge


def places(facts: int) -> Iterator[int]:
    while facts:
        yield (facts & -facts).bit_length() - 1
        facts &= facts - 1
