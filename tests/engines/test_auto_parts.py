"""Questions that fall apart: parts are planned by themselves, merged into a shortest plan, and proved impossible by one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from random import Random

import pytest
from engines.test_auto import LIMITS, same, stands, token_ring
from generated import question

from smv_planner.check import Refused, check_proof
from smv_planner.engines import auto, explicit
from smv_planner.engines.auto.session import session_of
from smv_planner.model import ltl
from smv_planner.model.expressions import FALSE, Expr, Var, conjunction, substitute
from smv_planner.model.system import Any, Assignment, Invariant, State, System, Transition
from smv_planner.problem import Exhausted, Goal, NotWithin, Problem, Projected, Reached, Relaxed, Unreachable

FEW = 40
"""States of a question that may be put beside another."""


def beside(one: Problem, prefix: str) -> Problem:
    """The same question with every name behind a prefix."""
    names: dict[str, Expr] = {v.name: Var(prefix + v.name) for v in one.system.variables}

    def renamed(expr: Expr) -> Expr:
        return substitute(expr, names)

    def action(action: Assignment) -> Assignment:
        return Assignment(prefix + action.variable, action.value if isinstance(action.value, Any) else renamed(action.value))

    def transition(t: Transition) -> Transition:
        return replace(t, name=prefix + t.name, guard=renamed(t.guard), actions=tuple(map(action, t.actions)))

    def invariants(some: tuple[Invariant, ...]) -> tuple[Invariant, ...]:
        return tuple(Invariant(prefix + i.name, renamed(i.predicate)) for i in some)

    return Problem(
        system=System(
            tuple(replace(v, name=prefix + v.name) for v in one.system.variables),
            tuple(map(transition, one.system.transitions)),
            invariants(one.system.invariants),
        ),
        initial=one.initial,
        goals=tuple(Goal(renamed(goal.predicate), ltl.over_atoms(goal.until, renamed)) for goal in one.goals),
        allowed=invariants(one.allowed),
        unusable=frozenset(prefix + name for name in one.unusable),
        bound=one.bound,
    )


def together(random: Random, one: Problem, other: Problem) -> Problem:
    """Two questions as one: transitions of both in turns, and of both goals sometimes a single one."""
    a, b = beside(one, "a."), beside(other, "b.")
    transitions = list(a.system.transitions)
    for transition in b.system.transitions:
        transitions.insert(random.randrange(len(transitions) + 1), transition)
    goals = (*a.goals, *b.goals)
    if len(goals) == 2 and all(goal.until == ltl.ALWAYS_TRUE for goal in goals):
        goals = (Goal(conjunction(goal.predicate for goal in goals)),)
    elif random.random() < 0.2:
        goals = a.goals
    return Problem(
        system=System(
            (*a.system.variables, *b.system.variables), tuple(transitions), (*a.system.invariants, *b.system.invariants)
        ),
        initial=(*a.initial, *b.initial),
        goals=goals,
        allowed=(*a.allowed, *b.allowed),
        unusable=a.unusable | b.unusable,
        bound=random.choice((50, 50, 6)),
    )


def small(seeds: range) -> Iterator[Problem]:
    """Questions with few states, from anywhere: also from states that have yet to settle."""
    for seed in seeds:
        problem = question(seed)
        random = Random(seed)
        states = reachable(problem)
        if len(states) <= FEW:
            wild = tuple(random.choice(v.domain.values) for v in problem.system.variables)
            start = random.choice((problem.initial, random.choice(states), wild))
            yield replace(problem, initial=start)


def reachable(problem: Problem) -> list[State]:
    verdict = explicit.ask(replace(problem, goals=(Goal(FALSE),)), LIMITS)
    if not isinstance(verdict, Unreachable) or not isinstance(verdict.proof, Exhausted):
        return [problem.initial] * (FEW + 1)
    return sorted({state for state, _ in verdict.proof.reached}, key=repr)


def pairs(seeds: range) -> Iterator[Problem]:
    problems = list(small(seeds))
    random = Random(seeds.start)
    for one in problems:
        yield together(random, one, random.choice(problems))


@pytest.mark.parametrize("seeds", [range(3000, 3060), range(3060, 3120)], ids=str)
def test_two_questions_side_by_side_are_answered_as_the_explicit_engine_answers_them(seeds: range) -> None:
    found: Counter[str] = Counter()
    for number, problem in enumerate(pairs(seeds)):
        session = session_of(problem.system)
        apart = session.parts(session.variant(problem.allowed)[0]).apart(problem)
        answered = auto.ask(problem, LIMITS)
        assert same(answered, explicit.ask(problem, LIMITS)), f"pair {number}"
        assert stands(problem, answered), f"pair {number}"
        found[type(answered).__name__ if apart else "whole"] += 1
    assert min(found["Reached"], found["Unreachable"], found["whole"]) > 2, found


@pytest.mark.parametrize("seeds", [range(3200, 3300)], ids=str)
def test_what_does_not_matter_is_left_out(seeds: range) -> None:
    """Whatever is needed alone gives the answer of the whole."""
    left_out = 0
    for seed in seeds:
        problem = question(seed)
        session = session_of(problem.system)
        needed = session.parts(session.variant(problem.allowed)[0]).needed(problem)
        if needed:
            left_out += 1
            _, share = needed
            assert same(explicit.ask(share, LIMITS), explicit.ask(problem, LIMITS)), f"question {seed}"
            answered = auto.ask(problem, LIMITS, 0)
            assert same(answered, explicit.ask(problem, LIMITS)), f"question {seed}"
            assert stands(problem, answered), f"question {seed}"
    assert left_out > 5


def test_switches_that_concern_nobody_do_not_multiply_the_states() -> None:
    problem = token_ring(switches=24)
    verdict = auto.ask(problem, LIMITS)
    assert isinstance(verdict, Unreachable)
    assert isinstance(verdict.proof, Projected)
    assert verdict.proof.variables == {"p0", "p1", "p2", "token"}
    assert check_proof(problem, verdict.proof) is None


def test_a_proof_about_a_part_that_depends_on_the_rest_is_refused() -> None:
    problem = token_ring(switches=2)
    alone = Projected(frozenset(["p0", "p1"]), Relaxed((("idle",), ("idle",))))
    assert isinstance(check_proof(problem, alone), Refused)
    assert isinstance(check_proof(problem, Projected(frozenset(["no such"]), Relaxed(()))), Refused)


def test_a_proof_about_a_part_says_nothing_about_a_goal_elsewhere() -> None:
    problem = token_ring(switches=2)
    verdict = auto.ask(problem, LIMITS)
    assert isinstance(verdict, Unreachable)
    elsewhere = replace(problem, goals=(Goal(Var("s0")),))
    assert isinstance(auto.ask(elsewhere, LIMITS), Reached)
    assert isinstance(check_proof(elsewhere, verdict.proof), Refused)


def test_plans_of_parts_that_are_too_long_together_are_not_within_the_bound() -> None:
    problem = token_ring(switches=3)
    every = replace(problem, goals=(Goal(conjunction(Var(f"s{at}") for at in range(3))),))
    assert auto.ask(replace(every, bound=2), LIMITS) == NotWithin(2)
    assert isinstance(auto.ask(replace(every, bound=3), LIMITS), Reached)
