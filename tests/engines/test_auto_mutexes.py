"""Pairwise mutexes: facts that are kept apart never hold together, the kernel sees that for itself, and it is worth it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from random import Random

import pytest
from engines.test_auto import LIMITS, questions_about_one_system, same, stands, token_ring
from engines.test_auto_parts import beside, small, together
from engines.test_auto_symmetry import workshop
from generated import question

from smv_planner.check import Refused, check_proof
from smv_planner.engines import auto, explicit
from smv_planner.engines.auto.mutexes import kept_apart
from smv_planner.engines.auto.relaxed import out_of_reach
from smv_planner.engines.auto.session import session_of
from smv_planner.model.domains import Value
from smv_planner.model.expressions import FALSE, Const, Var, conjunction, disjunction, equality, negation
from smv_planner.model.semantics import Steps
from smv_planner.model.system import Invariant
from smv_planner.problem import Exhausted, Goal, Pairs, Problem, Projected, Proof, Reached, Unreachable, Verdict

NEVER = (Goal(FALSE),)

Fact = tuple[str, Value]


def kept(problem: Problem) -> Pairs | None:
    session = session_of(problem.system)
    ground, _ = session.variant(problem.allowed)
    return kept_apart(session.mutexes(ground), ground, problem, lambda: True)


def linked_ring(switches: int) -> Problem:
    """Three processes share a token; an invariant that reads all switches keeps them from being left aside."""
    problem = token_ring(switches)
    never = conjunction([equality(Var("p0"), Const("works")), *(Var(f"s{at}") for at in range(switches))])
    return replace(problem, allowed=(Invariant("never", negation(never)),))


def states(problem: Problem) -> list[dict[str, Value]]:
    verdict = explicit.ask(problem, LIMITS)
    assert isinstance(verdict, Unreachable)
    assert isinstance(verdict.proof, Exhausted)
    return [problem.system.named(state) for state, _ in verdict.proof.reached]


@pytest.mark.parametrize("seeds", [range(4000, 4020)], ids=str)
def test_what_is_kept_apart_never_holds_together(seeds: range) -> None:
    """In any state that can be reached; and the kernel accepts every such set of pairs."""
    pairs = 0
    for seed in seeds:
        problem = replace(question(seed), goals=NEVER)
        proof = kept(problem)
        assert proof is not None
        assert check_proof(problem, proof) is None, f"question {seed}"
        for state in states(problem):
            for (one, value), (other, worth) in proof.apart:
                assert not (state[one] == value and state[other] == worth), f"question {seed}"
        pairs += sum(one != other for one, other in proof.apart)
    assert pairs > 100


def test_a_goal_is_out_of_reach_by_pairs_only_if_there_is_no_plan() -> None:
    """And whatever is out of reach by single values is so by pairs."""
    found: Counter[str] = Counter()
    for seed in range(100):
        problem = question(seed)
        session = session_of(problem.system)
        ground, _ = session.variant(problem.allowed)
        by_values, by_pairs = out_of_reach(session.abstraction(ground), ground, problem), kept(problem)
        assert by_pairs or not by_values, f"question {seed}"
        if by_pairs:
            assert check_proof(problem, by_pairs) is None, f"question {seed}"
            assert not isinstance(explicit.ask(problem, LIMITS), Reached), f"question {seed}"
        found["by pairs"] += bool(by_pairs)
    assert found["by pairs"] > 3


def test_processes_that_share_a_token_never_work_together() -> None:
    """No value is out of reach, the switches double the states, and the proof takes nine pairs."""
    problem = linked_ring(switches=24)
    session = session_of(problem.system)
    ground, _ = session.variant(problem.allowed)
    assert out_of_reach(session.abstraction(ground), ground, problem) is None
    verdict = auto.ask(problem, LIMITS)
    assert isinstance(verdict, Unreachable)
    assert isinstance(verdict.proof, Pairs)
    assert len(verdict.proof.apart) == 9
    assert check_proof(problem, verdict.proof) is None
    assert "pairwise mutexes" in verdict.argument


def test_a_search_for_pairs_that_has_no_time_left_says_nothing() -> None:
    problem = linked_ring(switches=8)
    session = session_of(problem.system)
    ground, _ = session.variant(problem.allowed)
    looks = iter(range(100))
    assert kept_apart(session.mutexes(ground), ground, problem, lambda: next(looks) < 5) is None
    assert next(looks) == 6


def test_a_corrupted_proof_by_pairs_is_refused() -> None:
    problem = linked_ring(switches=4)
    proof = kept(problem)
    assert proof is not None
    start = tuple(problem.system.named(problem.initial).items())
    works = (("p0", "works"), ("p1", "works"))
    refused = [
        Pairs(()),
        Pairs((works,)),
        Pairs((*proof.apart, (start[0], start[1]))),
        Pairs((*proof.apart, (("s0", True), ("s0", True)))),
        Pairs((*proof.apart, (("s0", True), ("s1", True)))),
        Pairs((*proof.apart, (("p0", "works"), ("s0", True)))),
        Pairs((*proof.apart, (("no such", 1), ("p0", "idle")))),
        Pairs((*proof.apart, (("p0", "asleep"), ("p0", "idle")))),
    ]
    for corrupted in refused:
        assert isinstance(check_proof(problem, corrupted), Refused), corrupted
    needed = [pair for pair in proof.apart if isinstance(check_proof(problem, Pairs(without(proof, pair))), Refused)]
    assert len(needed) == 6
    assert all("token" in dict(pair) for pair in needed)
    planned = replace(problem, goals=(Goal(conjunction([equality(Var("p2"), Const("works")), Var("s0")])),))
    assert isinstance(auto.ask(planned, LIMITS), Reached)
    assert isinstance(check_proof(planned, proof), Refused)


def without(proof: Pairs, pair: tuple[Fact, Fact]) -> tuple[tuple[Fact, Fact], ...]:
    return tuple(other for other in proof.apart if other != pair)


def test_more_pairs_than_hold_are_refused() -> None:
    """Every pair of values that some state has, added to what is kept apart."""
    judged = 0
    for seed in range(4100, 4112):
        problem = replace(question(seed), goals=NEVER)
        proof = kept(problem)
        assert proof is not None
        random = Random(seed)
        reached = states(problem)
        for _ in range(8):
            state = random.choice(reached)
            one, other = random.choices(list(state.items()), k=2)
            corrupted = Pairs((*proof.apart, (one, other)))
            assert isinstance(check_proof(problem, corrupted), Refused), f"question {seed}: {one}, {other}"
            judged += 1
    assert judged == 96


def rings(seed: int) -> Iterator[Problem]:
    """Questions about one ring: some have a plan, some are impossible for pairs of processes, for switches, or for good."""
    random = Random(seed)
    first = linked_ring(switches=8)
    places = [equality(Var(f"p{at}"), Const(word)) for at in range(3) for word in ("wants", "works")]
    steps = Steps(first.system, first.usable)
    for _ in range(8):
        state = first.initial
        for _ in range(random.randrange(10)):
            state = random.choice([after for _, after in steps(state)])
        wanted = [*random.sample(places, 2), Var(f"s{random.randrange(8)}")]
        unusable = frozenset(t.name for t in first.system.transitions if random.random() < 0.05)
        allowed = random.choice((first.allowed, first.allowed, ()))
        yield replace(first, initial=state, allowed=allowed, unusable=unusable, goals=(Goal(conjunction(wanted)),), bound=30)


def workshops(seed: int) -> Iterator[Problem]:
    """Questions about one workshop: some parts stay alike, some do not."""
    random, first = Random(seed), workshop(seed)
    for _ in range(8):
        wanted = random.sample([v for v in first.system.variables if v.name.startswith("p")], random.randint(1, 3))
        goal = (disjunction if random.random() < 0.2 else conjunction)(
            equality(Var(v.name), Const(random.choice(("held", "done")))) for v in wanted
        )
        unusable = frozenset(t.name for t in first.system.transitions if random.random() < 0.08)
        start = tuple(random.choice(v.domain.values) if random.random() < 0.2 else v.initial for v in first.system.variables)
        yield replace(first, initial=start, goals=(Goal(goal),), unusable=unusable)


def side_by_side(seed: int) -> Iterator[Problem]:
    """Questions about two systems as one, for each of the two a question after the other."""
    random = Random(seed)
    one, other = list(small(range(seed * 100, seed * 100 + 60)))[:2]
    whole = together(random, one, other)
    for a, b in zip(questions_about_one_system_like(one, seed), questions_about_one_system_like(other, seed + 1), strict=True):
        first, second = beside(a, "a."), beside(b, "b.")
        goals = (*first.goals, *second.goals)[: random.choice((2, 2, 1))]
        yield replace(whole, initial=(*a.initial, *b.initial), goals=goals, unusable=first.unusable | second.unusable, bound=50)


def questions_about_one_system_like(problem: Problem, seed: int) -> Iterator[Problem]:
    random = Random(seed)
    steps = Steps(problem.system, problem.usable)
    for _ in range(8):
        state = problem.initial
        for _ in range(random.randrange(6)):
            state = random.choice([after for _, after in steps(state)] or [state])
        unusable = frozenset(t.name for t in problem.system.transitions if random.random() < 0.1)
        variable = random.choice(problem.system.variables)
        goal = equality(Var(variable.name), Const(random.choice(variable.domain.values)))
        yield replace(problem, initial=state, unusable=unusable, goals=(Goal(goal),))


SEQUENCES = {
    "by pairs": [rings(seed) for seed in range(4)],
    "folded": [workshops(seed) for seed in range(6)],
    "apart": [side_by_side(seed) for seed in range(60, 62)],
    "any": [questions_about_one_system(seed, 6) for seed in range(2100, 2106)],
}


@pytest.mark.parametrize("kind", SEQUENCES)
def test_a_warm_answer_is_a_cold_answer_on_every_way(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is answered by a first look, so that questions in a row go on to parts, folding and pairs."""
    monkeypatch.setattr(auto, "SOME", 1)
    monkeypatch.setattr(auto, "FEW", 1)
    monkeypatch.setattr(auto, "MANY", 0)
    monkeypatch.setattr(auto, "GLANCED", 0)
    monkeypatch.setattr(auto, "GUIDED", 0)
    ways: Counter[str] = Counter()
    for questions in SEQUENCES[kind]:
        asked = list(questions)
        session_of.cache_clear()
        warm = [auto.ask(problem, LIMITS) for problem in asked]
        for problem, answered in zip(asked, warm, strict=True):
            session_of.cache_clear()
            assert same(answered, auto.ask(problem, LIMITS))
            assert same(answered, explicit.ask(problem, LIMITS))
            assert stands(problem, answered)
            ways.update(way(answered))
    wanted = {"by pairs": "Pairs", "folded": "swaps", "apart": "parts", "any": "Relaxed"}[kind]
    assert ways[wanted] > 1, ways


def way(verdict: Verdict) -> list[str]:
    """Which of the ways an answer was found by."""
    found = [word for word in ("swaps", "parts") if word in getattr(verdict, "argument", "")]
    if isinstance(verdict, Unreachable):
        inner: Proof = verdict.proof.proof if isinstance(verdict.proof, Projected) else verdict.proof
        found.append(type(inner).__name__)
        found += ["parts"] if isinstance(verdict.proof, Projected) else []
    return found
