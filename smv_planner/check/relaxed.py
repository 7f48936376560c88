"""Do these sets of values hold everything that can happen, and no way to meet the goals?

Expressions are judged over a set of values for every variable: a conjunction by its conjuncts, first those that read a
single variable, which narrow its set, then the others, each of their parts on its own. What is found possible may not
be; what is found impossible is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import product

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
from smv_planner.problem import Problem, Relaxed

Sets = Mapping[str, frozenset[Value]]


def broken(problem: Problem, proof: Relaxed) -> str | None:
    """Why the sets prove nothing; None if they do."""
    system = problem.system
    if len(proof.values) != len(system.variables):
        return "the proof's sets are not one for every variable"
    sets = {v.name: frozenset(values) for v, values in zip(system.variables, proof.values, strict=True)}
    if not all(value in sets[name] for name, value in system.named(problem.initial).items()):
        return "the proof leaves out the initial state"
    allowed = [part for i in problem.allowed for part in once(system, "parts", i.predicate, parts)]
    for transition in problem.usable:
        enabled = once(system, "enabled", transition, lambda system, transition: list(conjuncts(ready(system, transition))))
        for number, chosen in enumerate(choices(system, transition)):
            if _stays(system, enabled, chosen, sets):
                continue
            if not _stays(system, [*enabled, *kept(system, transition, number, chosen, allowed)], chosen, sets):
                return f"the proof leaves out what follows on '{transition.name}'"
    if may_hold(problem.formula, sets, [part for part, _ in allowed]):
        return "the proof's sets do not rule out that the goals are met"
    return None


def parts(system: System, predicate: Expr) -> list[tuple[Expr, frozenset[str]]]:
    """What all has to hold for a predicate to hold, each part with the variables that it reads."""
    return [(part, variables_of(part)) for part in conjuncts(predicate)]


def kept(
    system: System, transition: Transition, number: int, chosen: Mapping[str, Expr], allowed: list[tuple[Expr, frozenset[str]]]
) -> list[Expr]:
    """What has to hold before a transition with a choice, for what is allowed to hold after it."""
    before = once(system, "before", transition, _nothing_yet)
    touched = [part for part, names in allowed if not names.isdisjoint(chosen)]
    for old in touched:
        if (number, id(old)) not in before:
            before[number, id(old)] = old, tuple(conjuncts(substitute(old, chosen)))
    return [part for old in touched for part in before[number, id(old)][1]]


def _nothing_yet(system: System, transition: Transition) -> dict[tuple[int, int], tuple[Expr, tuple[Expr, ...]]]:
    """By a transition's choice and a part of an invariant: the part, and what has to hold before for it to hold after."""
    return {}


def _stays(system: System, enabled: list[Expr], chosen: Mapping[str, Expr], sets: Sets) -> bool:
    """Whether what is assigned when `enabled` holds lies in the sets already."""
    narrowed = narrow(enabled, sets)
    return narrowed is None or all(
        possible(value, narrowed) & frozenset(system.domains[name].values) <= sets[name] for name, value in chosen.items()
    )


def out_of_reach(problem: Problem, proof: Relaxed) -> list[Expr]:
    """The goals, or parts of them, that the sets rule out by themselves: to be named in an explanation."""
    sets = {v.name: frozenset(values) for v, values in zip(problem.system.variables, proof.values, strict=True)}
    asked = (part for goal in problem.goals for part in (*_written(goal.predicate), goal.predicate))
    return [part for part in dict.fromkeys(asked) if narrow(conjuncts(part), sets) is None]


def _written(predicate: Expr) -> Iterator[Expr]:
    match predicate:
        case And(parts):
            yield from parts
        case _:
            yield predicate


def choices(system: System, transition: Transition) -> Iterator[dict[str, Expr]]:
    """What the transition assigns, for every choice it leaves to the planner."""
    alternatives = [
        [Const(value) for value in system.domains[action.variable].values] if isinstance(action.value, Any) else [action.value]
        for action in transition.actions
    ]
    for values in product(*alternatives):
        yield {action.variable: value for action, value in zip(transition.actions, values, strict=True)}


def may_hold(formula: Formula, sets: Sets, always: list[Expr]) -> bool:
    """Whether the formula might hold at some time in a run that stays inside the sets, where `always` holds."""
    match formula:
        case Atom(predicate):
            return narrow([*conjuncts(predicate), *always], sets) is not None
        case Next(part):
            return may_hold(part, sets, always)
        case Both(left, right):
            return may_hold(left, sets, always) and may_hold(right, sets, always)
        case Either(left, right):
            return may_hold(left, sets, always) or may_hold(right, sets, always)
        case Until(_, right) | Release(_, right):
            return may_hold(right, sets, always)


def narrow(parts: Iterable[Expr], sets: Sets) -> Sets | None:
    """The sets as far as all of `parts` may hold in them; None if they cannot."""
    narrowed = dict(sets)
    others = []
    for part in parts:
        names = variables_of(part)
        if len(names) == 1:
            (name,) = names
            holds = meaning(part, {name: 0})
            narrowed[name] = frozenset(value for value in narrowed[name] if holds((value,)))
            if not narrowed[name]:
                return None
        else:
            others.append(part)
    return narrowed if all(True in possible(part, narrowed) for part in others) else None


def possible(expr: Expr, sets: Sets) -> frozenset[Value]:
    """Every value the expression can have, and perhaps more where a variable occurs in several of its parts."""
    names = variables_of(expr)
    if len(names) < 2:
        index = dict.fromkeys(names, 0)
        worth = meaning(expr, index)
        return frozenset(worth((value,)) for name in names for value in sets[name]) if names else frozenset([worth(())])
    match expr:
        case Named(_, part):
            return possible(part, sets)
        case Not(part):
            return frozenset(not value for value in possible(part, sets))
        case And(parts):
            found = [possible(part, sets) for part in parts]
            return _truths(all(True in values for values in found), any(False in values for values in found))
        case Or(parts):
            found = [possible(part, sets) for part in parts]
            return _truths(any(True in values for values in found), all(False in values for values in found))
        case If(condition, then, otherwise):
            branches = [(True, then), (False, otherwise)]
            chosen = possible(condition, sets)
            return frozenset(value for case, branch in branches if case in chosen for value in possible(branch, sets))
        case Equal(left, right):
            pairs = _pairs(left, right, sets)
            return frozenset(a == b for a, b in pairs)
        case Less(left, right):
            return frozenset(a < b for a, b in _pairs(left, right, sets))  # type: ignore[operator]
        case Plus(left, right):
            return frozenset(int(a) + int(b) for a, b in _pairs(left, right, sets))
        case Minus(left, right):
            return frozenset(int(a) - int(b) for a, b in _pairs(left, right, sets))
        case Const() | Var():
            raise AssertionError(expr)


def _pairs(left: Expr, right: Expr, sets: Sets) -> Iterable[tuple[Value, Value]]:
    return product(possible(left, sets), possible(right, sets))


def _truths(true: bool, false: bool) -> frozenset[Value]:
    return frozenset(value for value, can_be in ((True, true), (False, false)) if can_be)
