"""The engine `auto`: each of its ways alone agrees with the explicit engine, warm answers are cold answers, proofs are proofs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest
from bench import instances
from generated import BOUND, Maker, question

import smv_planner as sp
from smv_planner.check import CheckedPlan, Refused, check_plan, check_proof
from smv_planner.engines import Limits, auto, explicit
from smv_planner.engines.auto.grounding import Shared
from smv_planner.engines.auto.relaxed import out_of_reach
from smv_planner.engines.auto.search import Tables
from smv_planner.engines.auto.session import session_of
from smv_planner.model.domains import Bool, Enum, Range, Value
from smv_planner.model.expressions import TRUE, Const, Expr, Var, conjunction, disjunction, equality, meaning, negation
from smv_planner.model.semantics import Steps
from smv_planner.model.system import Assignment, Kind, System, Transition, Variable, VariableKind
from smv_planner.problem import (
    Clause,
    Exhausted,
    Goal,
    Inductive,
    NotWithin,
    Problem,
    Reached,
    Relaxed,
    Undecided,
    Unreachable,
    Verdict,
)

SCENARIOS = Path(__file__).parents[2] / "scenarios"

LIMITS = Limits(deadline=120, memory=4 << 30, progress=lambda text: None)
BY_SEARCH, BY_CLAUSES = 1 << 30, 0
"""Budgets that leave everything, or nothing, to the search of states."""


def same(answered: Verdict, expected: Verdict) -> bool:
    match answered, expected:
        case Reached(path), Reached(shortest):
            return len(path) == len(shortest)
        case Unreachable() | NotWithin(), Unreachable() | NotWithin():
            return True
    return False


def stands(problem: Problem, verdict: Verdict) -> bool:
    """Whether the kernel accepts what there is to accept."""
    match verdict:
        case Reached():
            return isinstance(check_plan(problem, verdict), CheckedPlan)
        case Unreachable(proof):
            return check_proof(problem, proof) is None
    return True


@pytest.mark.parametrize("budget", [BY_SEARCH, BY_CLAUSES], ids=["search alone", "clauses alone"])
@pytest.mark.parametrize("seeds", [range(at, at + 30) for at in range(1000, 1060, 30)], ids=str)
def test_each_way_to_an_answer_agrees_with_the_explicit_engine(budget: int, seeds: range) -> None:
    for seed in seeds:
        problem = question(seed)
        answered = auto.ask(problem, LIMITS, budget)
        assert same(answered, explicit.ask(problem, LIMITS)), f"question {seed}"
        assert stands(problem, answered), f"question {seed}"


def test_both_kinds_of_proof_come_up_where_clauses_have_to_do() -> None:
    kinds = Counter(type(proof).__name__ for _, proof in proofs(range(100), BY_CLAUSES))
    assert kinds["Relaxed"] > 3
    assert kinds["Inductive"] > 15


def test_what_is_out_of_reach_even_if_nothing_is_lost_is_unreachable() -> None:
    for seed in range(200):
        problem = question(seed)
        session = session_of(problem.system)
        ground, _ = session.variant(problem.allowed)
        proof = out_of_reach(session.abstraction(ground), ground, problem)
        if proof:
            assert check_proof(problem, proof) is None, f"question {seed}"
            assert not isinstance(explicit.ask(problem, LIMITS), Reached), f"question {seed}"


@pytest.mark.parametrize("budget", [BY_SEARCH, BY_CLAUSES], ids=["search alone", "clauses alone"])
@pytest.mark.parametrize("seed", range(2000, 2008))
def test_a_warm_answer_is_a_cold_answer(seed: int, budget: int) -> None:
    """Questions in a row about one system, in an order that tempts what was learnt to leak into the next."""
    session_of.cache_clear()
    asked = list(questions_about_one_system(seed, 8))
    warm = [auto.ask(problem, LIMITS, budget) for problem in asked]
    for problem, answered in zip(asked, warm, strict=True):
        session_of.cache_clear()
        cold = auto.ask(problem, LIMITS, budget)
        assert same(answered, cold)
        assert same(answered, explicit.ask(problem, LIMITS))
        assert stands(problem, answered)


def test_a_memo_that_leaks_into_the_next_question_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The test above can tell: moves remembered for one set of usable transitions are used for all."""
    monkeypatch.setattr(Tables, "ways", lambda self, usable: self._ways.setdefault(0, {}))
    leaked = 0
    for seed in range(2000, 2030):
        session_of.cache_clear()
        for problem in questions_about_one_system(seed, 6):
            try:
                answered = auto.ask(problem, LIMITS, BY_SEARCH)
            except AssertionError:
                leaked += 1
            else:
                leaked += not (same(answered, explicit.ask(problem, LIMITS)) and stands(problem, answered))
    session_of.cache_clear()
    assert leaked > 0


def test_a_condition_on_one_variable_is_judged_once_for_each_of_its_values() -> None:
    """However many alternatives it has, as what is left of a large range."""
    values = tuple(range(300))
    shared = Shared(System((Variable("n", VariableKind.ESTIMATED, Range(0, 299), 0),), (), ()))
    truth = shared.truth(disjunction(equality(Var("n"), Const(value)) for value in values[1:]), ["n"])
    assert [truth[at] for at in values] == [False] + [True] * 299
    assert shared.judged == 300


def questions_about_one_system(seed: int, number: int) -> Iterator[Problem]:
    """Other starts, goals, formulas, unusable transitions and allowed invariants, over the same `System` object."""
    first = question(seed)
    made = Maker(random := Random(seed))
    made.system()
    steps = Steps(first.system, first.system.transitions)
    for _ in range(number):
        allowed = tuple(invariant for invariant in first.allowed if random.random() < 0.7)
        state = first.initial
        for _ in range(random.randrange(12)):
            holds = [meaning(invariant.predicate, first.system.index) for invariant in allowed]
            following = [after for _, after in steps(state) if all(hold(after) for hold in holds)]
            state = random.choice(following) if following else state
        unusable = frozenset(t.name for t in first.system.transitions if random.random() < 0.15)
        goals = tuple(made.goal(random.choice((first.initial, state))) for _ in range(random.choice((1, 1, 2))))
        yield replace(
            first, initial=state, allowed=allowed, unusable=unusable, goals=goals, bound=random.choice((BOUND, BOUND, 4))
        )


def proofs(seeds: range, budget: int) -> Iterator[tuple[Problem, Exhausted | Relaxed | Inductive]]:
    for seed in seeds:
        verdict = auto.ask(question(seed), LIMITS, budget)
        if isinstance(verdict, Unreachable):
            yield question(seed), verdict.proof


def test_a_corrupted_proof_is_refused_or_still_proves_it() -> None:
    """A value left out, a clause left out, a fact left out of a clause. Some corruption is harmless; unsound is none."""
    refused: Counter[str] = Counter()
    for problem, proof in proofs(range(100), BY_CLAUSES):
        for name, corrupted in corruptions(problem, proof):
            refused[name] += isinstance(check_proof(problem, corrupted), Refused)
            refused["of " + name] += 1
    for name in ("a value reached is left out", "no clauses", "a clause is false at the start", "values are missing"):
        assert refused[name] == refused["of " + name] > 3, (name, refused)
    assert refused["a clause is left out"] > refused["of a clause is left out"] // 3, refused
    assert refused["a clause says more"] > refused["of a clause says more"] // 3, refused


def corruptions(problem: Problem, proof: object) -> Iterator[tuple[str, Relaxed | Inductive]]:
    system = problem.system
    match proof:
        case Relaxed(values):
            yield "values are missing", Relaxed(values[:-1])
            for at, value in enumerate(problem.initial):
                without = tuple(other for other in values[at] if other != value)
                yield "a value reached is left out", Relaxed((*values[:at], without, *values[at + 1 :]))
        case Inductive(clauses):
            yield "no clauses", Inductive(())
            start = tuple(zip((variable.name for variable in system.variables), problem.initial, strict=True))
            yield "a clause is false at the start", Inductive((*clauses, Clause(start)))
            for at, clause in enumerate(clauses):
                yield "a clause is left out", Inductive(clauses[:at] + clauses[at + 1 :])
                for fact in clause.differs:
                    less = Clause(tuple(other for other in clause.differs if other != fact), clause.owes)
                    yield "a clause says more", Inductive((*clauses[:at], less, *clauses[at + 1 :]))


def test_no_proof_of_one_question_passes_for_a_question_with_a_plan() -> None:
    """Every proof about a system, put to a question about it that has a plan."""
    judged = 0
    for seed in range(2000, 2030):
        asked = list(questions_about_one_system(seed, 6))
        answers = [auto.ask(problem, LIMITS, BY_CLAUSES) for problem in asked]
        planned = [problem for problem, answer in zip(asked, answers, strict=True) if isinstance(answer, Reached)]
        for answer in answers:
            for problem in planned if isinstance(answer, Unreachable) else ():
                assert isinstance(check_proof(problem, answer.proof), Refused)
                judged += 1
    assert judged > 50


def test_an_inductive_proof_that_names_what_does_not_exist_is_refused() -> None:
    problem = question(0)
    assert isinstance(check_proof(problem, Inductive((Clause((("no such", 1),)),))), Refused)


@pytest.mark.parametrize("budget", [BY_SEARCH, BY_CLAUSES])
def test_a_deadline_that_has_passed_ends_the_search(budget: int) -> None:
    over = Limits(deadline=0, memory=4 << 30, progress=lambda text: None)
    answers = [auto.ask(question(seed), over, budget) for seed in range(20)]
    assert all(isinstance(answer, Unreachable | Undecided | Reached) for answer in answers)
    assert any(isinstance(answer, Undecided) and answer.deadline for answer in answers)


@pytest.mark.parametrize("budget", [BY_SEARCH, BY_CLAUSES])
def test_too_little_memory_is_no_answer(budget: int) -> None:
    little = Limits(deadline=120, memory=2000, progress=lambda text: None)
    answers = [auto.ask(question(seed), little, budget) for seed in range(20)]
    assert any(isinstance(answer, Undecided) and not answer.deadline for answer in answers)
    assert all(
        same(answers[seed], explicit.ask(question(seed), LIMITS))
        for seed in range(20)
        if not isinstance(answers[seed], Undecided)
    )


def test_progress_is_told() -> None:
    told: list[str] = []
    for seed in range(10):
        auto.ask(question(seed), Limits(60, 4 << 30, told.append))
    assert any("steps deep" in text for text in told)


@pytest.mark.parametrize(
    ("scenario", "goal", "reason"),
    [
        ("door", "door.pos == jammed", "even if nothing ever got in the way, 'door.pos' can never become jammed"),
        (
            "dummy_robots",
            "r1.act_pos == at and r2.act_pos == at",
            "even if nothing but the invariants ever got in the way, the goals can never be met",
        ),
    ],
)
def test_an_answer_says_in_words_why_there_is_no_plan(scenario: str, goal: str, reason: str) -> None:
    answer = sp.plan(sp.load(SCENARIOS / scenario), goal, engine="auto")
    assert (answer.verdict, answer.proof, answer.checked) == ("unreachable", "relaxed", True)
    assert answer.reason == reason


def test_many_states_are_proved_by_few_clauses() -> None:
    """Two tokens for three workers: any two may be at work, so no pair of facts excludes the third, and switches multiply."""
    problem = instances.mutex(9, entangled=True).problem
    verdict = auto.ask(problem, LIMITS)
    assert isinstance(verdict, Unreachable)
    assert isinstance(verdict.proof, Inductive)
    assert check_proof(problem, verdict.proof) is None


def test_choices_that_do_not_matter_do_not_multiply_the_work() -> None:
    """Six of 24 switches are to be flipped while the token goes round: which when does not matter."""
    problem = token_ring(switches=24)
    flipped = conjunction([equality(Var("p2"), Const("works")), *(Var(f"s{at}") for at in range(6))])
    problem = replace(problem, goals=(Goal(flipped),))
    verdict = auto.ask(problem, LIMITS)
    assert isinstance(verdict, Reached)
    assert len(verdict.path) == 8 + 6
    assert stands(problem, verdict)


def token_ring(switches: int) -> Problem:
    def worth(name: str, value: Value) -> Expr:
        return equality(Var(name), Const(value))

    variables = [Variable("token", VariableKind.ESTIMATED, Range(0, 2), 0)]
    transitions = []

    def add(name: str, guard: Expr, **assigned: Expr) -> None:
        actions = tuple(Assignment(variable, value) for variable, value in assigned.items())
        transitions.append(Transition(name, Kind.CONTROLLED, guard, actions))

    for at in range(3):
        process = f"p{at}"
        variables.append(Variable(process, VariableKind.ESTIMATED, Enum(("idle", "wants", "works")), "idle"))
        add(f"{process}.ask", worth(process, "idle"), **{process: Const("wants")})
        add(f"{process}.begin", conjunction([worth(process, "wants"), worth("token", at)]), **{process: Const("works")})
        add(f"{process}.end", worth(process, "works"), **{process: Const("idle"), "token": Const((at + 1) % 3)})
    for at in range(switches):
        variables.append(Variable(f"s{at}", VariableKind.ESTIMATED, Bool(), False))
        add(f"s{at}.flip", TRUE, **{f"s{at}": negation(Var(f"s{at}"))})
    system = System(tuple(variables), tuple(transitions), ())
    both_work = conjunction([worth("p0", "works"), worth("p1", "works")])
    return Problem(system, system.initial, (Goal(both_work),), (), frozenset())
