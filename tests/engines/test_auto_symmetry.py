"""Things that may stand for each other: one order of them is as good as all, and nothing else is folded together."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import product
from random import Random

import pytest
from bench import instances
from engines.test_auto import LIMITS, same, stands, token_ring

from smv_planner.check import check_proof
from smv_planner.engines import auto, explicit
from smv_planner.engines.auto import symmetry
from smv_planner.engines.auto.search import Ended, Search
from smv_planner.engines.auto.session import session_of
from smv_planner.engines.auto.symmetry import Fold
from smv_planner.model.domains import Enum, Range
from smv_planner.model.expressions import TRUE, Const, Equal, Expr, Var, conjunction, negation, nodes
from smv_planner.model.system import Any, Assignment, Invariant, Kind, System, Transition, Variable, VariableKind
from smv_planner.problem import Goal, NotWithin, Problem, Reached, Unreachable, Verdict

THINGS = 3


def workshop(seed: int) -> Problem:
    """A robot goes from part to part and works on them; sometimes one part is unlike the others, sometimes by little."""
    random = Random(seed)
    parts = [f"p{at}" for at in range(THINGS)]
    states = Enum(("raw", "held", "done"))
    variables = [Variable(name, VariableKind.DECISION, states, "raw") for name in parts]
    variables += [Variable(name, VariableKind.GOAL, Range(0, THINGS), THINGS) for name in ("ref", "act")]
    transitions = []

    def add(name: str, kind: Kind, guard: Expr, **assigned: Expr | Any) -> None:
        transitions.append(Transition(name, kind, guard, tuple(Assignment(v, value) for v, value in assigned.items())))

    moved = Equal(Var("ref"), Var("act"))
    if random.random() < 0.5:
        add("move", Kind.CONTROLLED, moved, ref=Any())
    else:
        for at in range(THINGS + 1):
            add(f"move-{at}", Kind.CONTROLLED, moved, ref=Const(at))
    add("arrives", Kind.EFFECT, negation(moved), act=Var("ref"))
    for at, name in enumerate(parts):
        here = conjunction([Equal(Var("act"), Const(at)), moved] if random.random() < 0.9 else [Equal(Var("act"), Const(at))])
        kind = Kind.AUTOMATIC if seed % 2 else Kind.CONTROLLED
        add(f"take-{name}", kind, conjunction([here, Equal(Var(name), Const("raw"))]), **{name: Const("held")})
        ready = TRUE if random.random() < 0.05 else here
        add(f"work-{name}", Kind.CONTROLLED, conjunction([ready, Equal(Var(name), Const("held"))]), **{name: Const("done")})
        if seed % 3 == 0:
            add(
                f"drop-{name}",
                Kind.AUTOMATIC,
                conjunction([Equal(Var(name), Const("done")), Var_is_home]),
                **{name: Const("raw")},
            )
    held = conjunction([Equal(Var("p0"), Const("held")), Equal(Var("p1"), Const("held"))])
    allowed = (Invariant("hands", negation(held)),) if random.random() < 0.3 else ()
    system = System(tuple(variables), tuple(transitions), ())
    wanted = random.sample(parts, random.randint(1, THINGS))
    goal = conjunction(Equal(Var(name), Const(random.choice(("done", "done", "held")))) for name in wanted)
    start = tuple(random.choice(v.domain.values) if random.random() < 0.3 else v.initial for v in variables)
    if allowed and start[:2] == ("held", "held"):
        start = system.initial
    disabled = frozenset(t.name for t in transitions if random.random() < 0.04)
    return Problem(system, start, (Goal(goal),), allowed, disabled, bound=40)


Var_is_home = conjunction([Equal(Var("act"), Const(THINGS)), Equal(Var("ref"), Const(THINGS))])


def folded(problem: Problem) -> tuple[Fold | None, Verdict | Ended | None]:
    """What the search finds that looks at one state of all that are alike."""
    session = session_of(problem.system)
    ground, tables = session.variant(problem.allowed)
    fold = session.symmetries(ground).fold(problem)
    found = None
    for found in Search(tables, problem).explore(fold):
        if isinstance(found, Reached | Ended):
            return fold, found
    return fold, NotWithin(problem.bound)


@pytest.mark.parametrize("seeds", [range(60), range(60, 120)], ids=str)
def test_a_folded_search_finds_shortest_plans(seeds: range) -> None:
    found: Counter[str] = Counter()
    for seed in seeds:
        problem = workshop(seed)
        fold, answered = folded(problem)
        expected = explicit.ask(problem, LIMITS)
        if isinstance(answered, Ended):
            assert isinstance(expected, Unreachable), f"workshop {seed}"
        else:
            assert same(answered, expected), f"workshop {seed}"
            assert stands(problem, answered), f"workshop {seed}"
        if fold is not None:
            found[type(expected).__name__] += 1
        else:
            found["nothing alike"] += 1
    assert min(found["Reached"], found["nothing alike"]) > 5, found


def test_what_is_unlike_is_not_folded(monkeypatch: pytest.MonkeyPatch) -> None:
    """The questions above can tell: to believe every candidate makes plans too short, or loses them."""
    monkeypatch.setattr(symmetry.Symmetries, "_kept", lambda *_: {})
    monkeypatch.setattr(symmetry.Symmetries, "_same", lambda *_: True)
    wrong = 0
    for seed in range(60):
        problem = workshop(seed)
        try:
            _, answered = folded(problem)
        except AssertionError:
            wrong += 1
            continue
        expected = explicit.ask(problem, LIMITS)
        wrong += isinstance(answered, Ended) != isinstance(expected, Unreachable) or (
            not isinstance(answered, Ended) and not same(answered, expected)
        )
    assert wrong > 5


def test_a_swap_leaves_what_it_does_not_touch() -> None:
    left = 0
    for seed in range(60):
        problem = workshop(seed)
        session = session_of(problem.system)
        ground, _ = session.variant(problem.allowed)
        symmetries = session.symmetries(ground)
        written = [*(part for action in ground.actions for part in action.conditions), *ground.clauses]
        for first, *others in symmetries._candidates():
            swaps = [symmetry.Swap.of(first, other) for other in others]
            for swap, node in product(swaps, (node for expr in written for node in nodes(expr))):
                if swap.touched.isdisjoint(symmetries._mentions(node)):
                    assert symmetries._written(node, swap) == symmetries._written(node, symmetry.NO_SWAP), f"workshop {seed}"
                    left += 1
    assert left > 1000, left


def test_a_folded_search_that_ends_still_gives_a_proof() -> None:
    problem = token_ring(switches=9)
    some = conjunction([Var("s0"), negation(Var("s1"))])
    problem = replace(problem, allowed=(Invariant("linked", negation(conjunction([Var("s2"), Equal(Var("token"), Const(2))]))),))
    problem = replace(problem, goals=(Goal(conjunction([problem.goals[0].predicate, some])),))
    verdict = auto.ask(problem, LIMITS)
    assert isinstance(verdict, Unreachable)
    assert check_proof(problem, verdict.proof) is None


def test_eight_bolts_of_the_station_are_interchangeable_and_so_are_the_frozen_ones() -> None:
    problem = instances.frozen(8).problem
    session = session_of(problem.system)
    ground, _ = session.variant(problem.allowed)
    fold = session.symmetries(ground).fold(problem)
    assert fold is not None
    assert [len(group) for group in fold.groups] == [8, 16]
