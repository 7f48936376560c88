"""Do these sets of values hold everything that can happen, and no way to meet the goals?

Expressions are judged over a set of values for every variable: a conjunction by its conjuncts, first those that read a
single variable, which narrow its set, then the others, each of their parts on its own. What is found possible may not
be; what is found impossible is. So a transition is looked at only as closely as it takes to see that it stays in the sets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import product

from smv_planner.clock import look
from smv_planner.lazy import dataclass
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
    Var,
    conjuncts,
    meaning,
    substitute,
    variables_of,
)
from smv_planner.model.ltl import Atom, Both, Either, Formula, Next, Release, Until
from smv_planner.model.semantics import once, ready
from smv_planner.model.system import Any, System, Transition
from smv_planner.problem import Goal, Problem, Relaxed

Sets = Mapping[str, frozenset[Value]]

Possible = Callable[[Sets], frozenset[Value]]
"""Every value that an expression can have, and perhaps more where a variable occurs in several of its parts."""

Maybe = Callable[[Sets], bool]
"""Whether a predicate can be what is asked."""


def broken(problem: Problem, proof: Relaxed) -> str | None:
    """Why the sets prove nothing; None if they do."""
    system = problem.system
    if len(proof.values) != len(system.variables):
        return "the proof's sets are not one for every variable"
    sets = {v.name: frozenset(v.domain.values).intersection(it) for v, it in zip(system.variables, proof.values, strict=True)}
    if not all(value in sets[name] for name, value in system.named(problem.initial).items()):
        return "the proof leaves out the initial state"
    allowed = [part for i in problem.allowed for part in once(system, parts, i.predicate)]
    for transition in problem.usable:
        look()
        for number, way in enumerate(once(system, _ways, transition)):
            if way.stays(sets, sets):
                continue
            enabled = once(system, _enabling, transition)
            narrowed = narrow(enabled, sets)
            if narrowed is None or way.stays(narrowed, sets):
                continue
            before = kept(system, transition, number, way.chosen, allowed)
            narrowed = narrow([*enabled, *(once(system, condition, part) for part in before)], sets)
            if narrowed is not None and not way.stays(narrowed, sets):
                return f"the proof leaves out what follows on '{transition.name}'"
    always = [once(system, condition, part) for part, _ in allowed]
    if may_hold(system, problem.formula, sets, always):
        return "the proof's sets do not rule out that the goals are met"
    return None


def parts(system: System, predicate: Expr) -> list[tuple[Expr, frozenset[str]]]:
    """What all has to hold for a predicate to hold, each part with the variables that it reads."""
    return [(part, variables_of(part)) for part in conjuncts(predicate)]


def kept(
    system: System, transition: Transition, number: int, chosen: Mapping[str, Expr], allowed: list[tuple[Expr, frozenset[str]]]
) -> list[Expr]:
    """What has to hold before a transition with a choice, for what is allowed to hold after it."""
    before = once(system, _nothing_yet, transition)
    touched = [part for part, names in allowed if not names.isdisjoint(chosen)]
    for old in touched:
        if (number, id(old)) not in before:
            before[number, id(old)] = old, tuple(conjuncts(substitute(old, chosen)))
    return [part for old in touched for part in before[number, id(old)][1]]


def _nothing_yet(system: System, transition: Transition) -> dict[tuple[int, int], tuple[Expr, tuple[Expr, ...]]]:
    """By a transition's choice and a part of an invariant: the part, and what has to hold before for it to hold after."""
    return {}


def choices(system: System, transition: Transition) -> Iterator[dict[str, Expr]]:
    """What the transition assigns, for every choice it leaves to the planner."""
    alternatives = [
        [Const(value) for value in system.domains[action.variable].values] if isinstance(action.value, Any) else [action.value]
        for action in transition.actions
    ]
    for values in product(*alternatives):
        yield {action.variable: value for action, value in zip(transition.actions, values, strict=True)}


@dataclass(frozen=True, slots=True)
class _Way:
    """A transition with a choice: what is assigned, and every value in the variable's domain that this can be."""

    chosen: Mapping[str, Expr]
    assigned: tuple[tuple[str, frozenset[Value], Possible], ...]

    def stays(self, before: Sets, sets: Sets) -> bool:
        """Whether what is assigned where `before` holds lies in the sets already."""
        return all(worth(before) & domain <= sets[name] for name, domain, worth in self.assigned)


def _ways(system: System, transition: Transition) -> tuple[_Way, ...]:
    def assigned(name: str, value: Expr) -> tuple[str, frozenset[Value], Possible]:
        return name, frozenset(system.domains[name].values), possible(system, value)

    return tuple(_Way(chosen, tuple(assigned(*each) for each in chosen.items())) for chosen in choices(system, transition))


def _enabling(system: System, transition: Transition) -> tuple[Condition, ...]:
    return tuple(condition(system, part) for part in conjuncts(ready(system, transition)))


@dataclass(frozen=True, slots=True)
class Condition:
    """What a part asks: of the variable that it reads alone some values, of several that it may hold."""

    alone: tuple[str, frozenset[Value]] | None
    holds: Maybe


def condition(system: System, part: Expr) -> Condition:
    names = variables_of(part)
    if len(names) != 1:
        return Condition(None, maybe(system, part, True))
    (name,) = names
    worth = meaning(part, {name: 0})
    values = frozenset(value for value in system.domains[name].values if worth((value,)))
    return Condition((name, values), lambda sets: True)


def narrow(conditions: Iterable[Condition], sets: Sets) -> Sets | None:
    """The sets as far as all conditions may hold in them; None if they cannot."""
    narrowed = dict(sets)
    others = []
    for each in conditions:
        if each.alone is None:
            others.append(each.holds)
        else:
            name, values = each.alone
            narrowed[name] &= values
            if not narrowed[name]:
                return None
    return narrowed if all(holds(narrowed) for holds in others) else None


def may_hold(system: System, formula: Formula, sets: Sets, always: list[Condition]) -> bool:
    """Whether the formula might hold at some time in a run that stays inside the sets, where `always` holds."""
    match formula:
        case Atom(predicate):
            asked = [condition(system, part) for part in conjuncts(predicate)]
            return narrow(asked, sets) is not None and narrow([*asked, *always], sets) is not None
        case Next(part):
            return may_hold(system, part, sets, always)
        case Both(left, right):
            return may_hold(system, left, sets, always) and may_hold(system, right, sets, always)
        case Either(left, right):
            return may_hold(system, left, sets, always) or may_hold(system, right, sets, always)
        case Until(_, right) | Release(_, right):
            return may_hold(system, right, sets, always)


def out_of_reach(system: System, goals: Iterable[Goal], proof: Relaxed) -> list[Expr]:
    """The goals, or parts of them, that the sets rule out by themselves: to be named in an explanation."""
    sets = {v.name: frozenset(values) for v, values in zip(system.variables, proof.values, strict=True)}
    asked = (part for goal in goals for part in (*_written(goal.predicate), goal.predicate))
    return [part for part in dict.fromkeys(asked) if narrow((condition(system, each) for each in conjuncts(part)), sets) is None]


def _written(predicate: Expr) -> Iterator[Expr]:
    match predicate:
        case And(parts):
            yield from parts
        case _:
            yield predicate


def maybe(system: System, predicate: Expr, what: bool) -> Maybe:
    """Whether a predicate can be true, or false, judged part by part."""
    names = variables_of(predicate)
    match predicate:
        case Named(_, part):
            return maybe(system, part, what)
        case Not(part):
            return maybe(system, part, not what)
        case And(parts) | Or(parts) if len(names) > 1:
            each = [maybe(system, part, what) for part in parts]
            if isinstance(predicate, And) is what:
                return lambda sets: all(can(sets) for can in each)
            return lambda sets: any(can(sets) for can in each)
    worth = possible(system, predicate)
    return lambda sets: what in worth(sets)


def possible(system: System, expr: Expr) -> Possible:
    """Every value the expression can have, and perhaps more where a variable occurs in several of its parts."""
    names = variables_of(expr)
    if not names:
        always = frozenset([meaning(expr, {})(())])
        return lambda sets: always
    if len(names) == 1:
        (name,) = names
        worth = meaning(expr, {name: 0})
        known = {value: worth((value,)) for value in system.domains[name].values}
        return lambda sets: frozenset(map(known.__getitem__, sets[name]))
    match expr:
        case Named(_, part):
            return possible(system, part)
        case Not() | And() | Or():
            true, false = maybe(system, expr, True), maybe(system, expr, False)
            return lambda sets: frozenset(value for value, can in ((True, true), (False, false)) if can(sets))
        case If(condition, then, otherwise):
            holds, *branches = (possible(system, part) for part in (condition, otherwise, then))
            return lambda sets: frozenset[Value]().union(*(branches[case](sets) for case in holds(sets)))  # type: ignore[index]
        case Equal(left, right):
            return _compared(system, left, right, lambda a, b: a == b)
        case Less(left, right):
            return _compared(system, left, right, lambda a, b: a < b)  # type: ignore[operator]
        case Plus(left, right):
            return _compared(system, left, right, lambda a, b: int(a) + int(b))
        case Minus(left, right):
            return _compared(system, left, right, lambda a, b: int(a) - int(b))
        case Const() | Var():
            raise AssertionError(expr)


def _compared(system: System, left: Expr, right: Expr, worth: Callable[[Value, Value], Value]) -> Possible:
    """What two parts come to, whatever values they have."""
    first, second = possible(system, left), possible(system, right)
    return lambda sets: frozenset(worth(a, b) for a, b in product(first(sets), second(sets)))
