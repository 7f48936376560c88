"""Every stage of `auto` looks at the clock, is left when the time is up, and leaves nothing half done behind."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count, islice
from random import Random
from types import ModuleType

import pytest
from bench import instances
from engines.questions import ask, is_, step
from engines.test_auto import BY_CLAUSES, BY_SEARCH, LIMITS, questions_about_one_system, same, stands
from generated import question

from smv_planner import clock
from smv_planner.check import check_proof
from smv_planner.engines import auto, clauses, explicit
from smv_planner.engines.auto import Late, Means
from smv_planner.engines.auto import _search as searched
from smv_planner.engines.auto.search import Paused, Search
from smv_planner.engines.auto.session import session_of
from smv_planner.lazy import replace
from smv_planner.model.domains import Range
from smv_planner.model.expressions import TRUE, conjunction
from smv_planner.model.system import Any
from smv_planner.problem import Problem, Undecided, Unreachable, Verdict


class Clock:
    """Time is up after so many looks."""

    def __init__(self, looks: int) -> None:
        self.left = looks
        self.looks = 0

    def __call__(self) -> bool:
        self.looks += 1
        self.left -= 1
        return self.left >= 0


def asked(problem: Problem, looks: int, budget: int = auto.BUDGET) -> tuple[Verdict, int]:
    """The answer before so many looks at the clock, and how many there were."""
    watch = Clock(looks)
    with clock.watched(watch):
        return auto.ask(problem, LIMITS, budget), watch.looks


@pytest.mark.parametrize("budget", [BY_SEARCH, BY_CLAUSES], ids=["search alone", "clauses alone"])
def test_a_question_left_at_any_time_leaves_nothing_half_done(budget: int) -> None:
    """Questions about one system in a row, each left somewhere and then asked again to the end."""
    left = 0
    for seed in range(5000, 5010):
        random = Random(seed)
        session_of.cache_clear()
        for problem in questions_about_one_system(seed, 4):
            expected = explicit.ask(problem, LIMITS)
            for looks in random.choices(range(150), k=4):
                answered, _ = asked(problem, looks, budget)
                if isinstance(answered, Undecided):
                    assert answered.deadline
                    left += 1
                else:
                    assert same(answered, expected)
            answered = auto.ask(problem, LIMITS, budget)
            assert same(answered, expected)
            assert stands(problem, answered)
    assert left > 20


def test_every_look_can_be_the_last() -> None:
    problem = question(2)
    session_of.cache_clear()
    whole, number = asked(problem, 1 << 30, BY_CLAUSES)
    assert number > 50
    for looks in range(0, number, 7):
        session_of.cache_clear()
        answered, looked = asked(problem, looks, BY_CLAUSES)
        assert isinstance(answered, Undecided)
        assert looked == looks + 1
        assert same(auto.ask(problem, LIMITS, BY_CLAUSES), whole)


def sizes() -> dict[str, Callable[[], Problem]]:
    return {
        "8 of 24 bolts": lambda: instances.frozen(8).problem,
        "50 stations": lambda: instances.stations(50).problem,
        "entangled mutex": lambda: instances.mutex(24, entangled=True).problem,
    }


@pytest.mark.parametrize("name", sizes())
@pytest.mark.parametrize("engine", [auto, clauses], ids=["auto", "sat"])
def test_the_largest_questions_are_left_at_the_next_look(name: str, engine: ModuleType) -> None:
    """The stages that prepare an answer look at the clock for each transition, clause and pair that they go through."""
    problem = sizes()[name]()
    for looks in (0, 50, 500):
        session_of.cache_clear()
        watch = Clock(looks)
        with clock.watched(watch):
            answered = engine.ask(problem, LIMITS)
        assert isinstance(answered, Undecided), answered
        assert answered.deadline
        assert watch.looks == looks + 1
    session_of.cache_clear()


def test_a_search_pauses_by_what_it_does_and_not_by_states() -> None:
    """Few states, each with very many moves."""
    names = ("x", "y", "z")
    choosing = [step(f"choose {name}", TRUE, {name: Any()}) for name in names]
    problem = ask(dict.fromkeys(names, (Range(0, 300), 0)), choosing, conjunction(is_(name, 300) for name in names))
    tables = session_of(problem.system).variant(problem.allowed)[1]
    pauses = list(islice(Search(tables, problem).explore(chunk=10_000), 50))
    assert all(isinstance(pause, Paused) and pause.depth < 2 for pause in pauses)
    session_of.cache_clear()


def test_what_needs_too_much_memory_to_search_is_left_to_clauses() -> None:
    handed_on = 0
    for seed in range(40):
        problem = question(seed)
        session_of.cache_clear()
        warm = session_of(problem.system)
        means = Means(states=1 << 30, memory=auto.BYTES_PER_NODE * 5, on_time=lambda text: True)
        found = auto.by_states(problem, warm, *warm.variant(problem.allowed), means)
        assert not isinstance(found, Late)
        handed_on += isinstance(found, int) and found <= problem.bound
    assert handed_on > 5


def test_what_is_remembered_counts_as_memory() -> None:
    """There is room for the states, but not for what is known of them as well."""
    problem = instances.mutex(16, entangled=True).problem
    session_of.cache_clear()
    tables = session_of(problem.system).variant(problem.allowed)[1]
    counted = next(found for found in Search(tables, problem).explore() if isinstance(found, Paused) and found.memos > 100)
    little = Means(states=1 << 30, memory=auto.BYTES_PER_NODE * (counted.number + 100), on_time=lambda text: True)
    found = searched(Search(tables, problem).explore(), problem, little.states, little)
    assert isinstance(found, Late)
    assert not found.deadline
    assert found.depth == counted.depth
    session_of.cache_clear()


def test_a_slow_machine_proves_what_a_fast_one_proves(monkeypatch: pytest.MonkeyPatch) -> None:
    """How long a proof is looked for goes by work: here every look at the clock finds an hour gone."""
    problem = replace(instances.mutex(irrelevant=9, entangled=True).problem, bound=3)
    hours = count(0, 3600)
    monkeypatch.setattr(auto.time, "monotonic", lambda: next(hours))
    verdict = auto.ask(problem, replace(LIMITS, deadline=1e9), search=lambda: 0)
    assert isinstance(verdict, Unreachable)
    assert check_proof(problem, verdict.proof) is None
