"""Distances in small parts of a system: never too far, and no other plan is found with them than without."""

from collections.abc import Iterator
from contextlib import suppress
from itertools import permutations, product
from random import Random

import pytest
from engines.questions import FLAG, LAMP, WORDS, Actions, ask, is_, step, up
from engines.test_auto import LIMITS, questions_about_one_system, same, stands
from engines.test_auto_deadlines import Clock
from generated import question

from smv_planner import clock
from smv_planner.clock import Over
from smv_planner.engines import auto, explicit
from smv_planner.engines.auto import patterns
from smv_planner.engines.auto.grounding import Ground
from smv_planner.engines.auto.guide import Guide
from smv_planner.engines.auto.search import Estimate, Paused, Search, Tables
from smv_planner.engines.auto.session import session_of
from smv_planner.lazy import replace
from smv_planner.model.domains import Bool, Domain, Range, Value
from smv_planner.model.expressions import TRUE, Const, Plus, Var, conjunction, disjunction, meaning, negation
from smv_planner.model.semantics import Steps
from smv_planner.model.system import Kind, State
from smv_planner.problem import Problem, Reached


def guided(seeds: range, widely: bool) -> Iterator[tuple[Problem, Tables, Estimate, Reached]]:
    """Questions that have a plan and goals of which something is known, with the plan found by search alone."""
    for seed in seeds:
        problem = question(seed)
        session = session_of(problem.system)
        ground, tables = session.variant(problem.allowed)
        estimate = session.guide(ground).estimate(problem, widely)
        if estimate is not None and tables.allows(ground.packing.pack(problem.initial)):
            for found in Search(tables, problem).explore():
                if isinstance(found, Reached) and found.path:
                    yield problem, tables, estimate, found


@pytest.mark.parametrize("widely", [False, True], ids=["quick", "wide"])
@pytest.mark.parametrize("seeds", [range(at, at + 60) for at in range(0, 120, 60)], ids=str)
def test_from_no_state_that_can_follow_a_distance_is_estimated_to_be_more_than_a_plan_takes(seeds: range, widely: bool) -> None:
    far = states = 0
    for problem, tables, estimate, _ in guided(seeds, widely):
        for state in seen_from(problem):
            for found in Search(tables, replace(problem, initial=state)).explore():
                if isinstance(found, Reached):
                    steps = estimate(tables.packing.pack(state), -1)
                    assert steps <= len(found.path)
                    far, states = far + (steps > 1), states + 1
    assert far > 300
    assert states > 800


def seen_from(problem: Problem, most: int = 40) -> list[State]:
    """Some allowed states that can follow on the first, in order."""
    steps = Steps(problem.system, problem.usable)
    allowed = meaning(conjunction(i.predicate for i in problem.allowed), problem.system.index)
    seen = {problem.initial: None}
    for state in (waiting := [problem.initial]):
        for _, after in steps(state):
            if after not in seen and allowed(after) and len(seen) < most:
                seen[after] = None
                waiting.append(after)
    return list(seen)


@pytest.mark.parametrize("widely", [False, True], ids=["quick", "wide"])
@pytest.mark.parametrize("seeds", [range(at, at + 60) for at in range(0, 120, 60)], ids=str)
def test_the_plan_is_the_one_found_without_leaving_out_what_is_too_far(seeds: range, widely: bool) -> None:
    fewer = 0
    for problem, tables, estimate, plan in guided(seeds, widely):
        search = Search(tables, problem)
        remaining = search.remaining(estimate)
        *_, found = search.explore(within=(remaining, len(plan.path)))
        assert found == plan
        *paused, beyond = search.explore(within=(remaining, len(plan.path) - 1))
        assert isinstance(beyond, Paused)
        assert beyond.depth == len(plan.path)
        fewer += bool(paused)
    assert fewer > 10


@pytest.mark.parametrize("seeds", [range(at, at + 12) for at in range(6000, 6024, 12)], ids=str)
def test_what_a_guide_says_does_not_depend_on_what_it_was_asked_before(seeds: range) -> None:
    """Questions about one system in a row, from other states; each left somewhere, and then asked again."""
    left = said = 0
    for seed in seeds:
        random = Random(seed)
        guides: dict[Ground, Guide] = {}
        for problem, widely in product(questions_about_one_system(seed, 8), (False, True)):
            session = session_of(problem.system)
            ground, tables = session.variant(problem.allowed)
            nodes = [tables.packing.pack(state) for state in seen_from(problem)]
            guide = guides.setdefault(ground, Guide(ground, session.abstraction(ground)))
            with suppress(Over), clock.watched(Clock(random.randrange(40))):
                left += 1
                asked(guide, problem, widely, nodes)
                left -= 1
            cold = asked(Guide(ground, session.abstraction(ground)), problem, widely, nodes)
            assert asked(guide, problem, widely, nodes) == cold
            said += sum(steps > 1 for steps in cold)
    assert left > 20
    assert said > 500


def asked(guide: Guide, problem: Problem, widely: bool, nodes: list[int]) -> list[int]:
    estimate = guide.estimate(problem, widely)
    return [] if estimate is None else [estimate(node, -1) for node in nodes]


def test_questions_in_a_row_are_answered_by_guided_search_as_by_the_explicit_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is answered by a first look. Each is also asked with a bound that just lets a plan be, or just not."""
    for name, states in (("SOME", 1), ("FEW", 1), ("STATES_PER_PAIR", 0), ("GLANCED", 100)):
        monkeypatch.setattr(auto, name, states)
    guided = 0
    for seed in range(6100, 6112):
        session_of.cache_clear()
        for problem in questions_about_one_system(seed, 6):
            expected = explicit.ask(problem, LIMITS)
            needed = [len(expected.path), len(expected.path) - 1] if isinstance(expected, Reached) and expected.path else []
            for bound in (problem.bound, *needed):
                bounded = replace(problem, bound=bound)
                answered = auto.ask(bounded, LIMITS)
                assert same(answered, explicit.ask(bounded, LIMITS)), f"question {seed}"
                assert stands(bounded, answered), f"question {seed}"
                guided += isinstance(answered, Reached) and answered.argument == auto.NEAR
    session_of.cache_clear()
    assert guided > 20


def test_what_has_too_many_states_says_nothing_and_is_not_measured_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    measured = []
    monkeypatch.setattr(
        patterns.Distances, "_measure", lambda self, real=patterns.Distances._measure: measured.append(1) or real(self)
    )
    for states, steps in ((10, range(9, 0, -1)), (5, [1] * 9)):
        problem = ask({"n": (Range(0, 9), 0)}, [up], is_("n", 9))
        monkeypatch.setattr(patterns, "STATES", states)
        ground, tables = session_of(problem.system).variant(())
        estimate = session_of(problem.system).guide(ground).estimate(problem, False)
        assert estimate is not None
        assert [estimate(tables.packing.pack((n,)), -1) for n in range(9)] == list(steps)
    assert len(measured) == 1


def test_what_is_half_explored_is_not_kept() -> None:
    problem = ask({"n": (Range(0, 1100), 1090)}, [up], is_("n", 1100))
    ground, tables = session_of(problem.system).variant(())
    estimate = session_of(problem.system).guide(ground).estimate(problem, False)
    assert estimate is not None
    first, left = tables.packing.pack((0,)), 0
    for looks in range(5):
        with suppress(Over), clock.watched(Clock(looks)):
            left += 1
            estimate(first, -1)
            left -= 1
    assert left > 2
    assert estimate(first, -1) == 1100


def test_orders_that_differ_in_other_targets_share_distances() -> None:
    """Of three targets there are six orders of all, two of each pair, and one of each alone."""
    problem = ask({"n": (Range(0, 9), 0)}, [up], is_("n", 9))
    ground, _ = session_of(problem.system).variant(())
    targets = [(0, frozenset([is_("n", at)])) for at in range(3)]
    pattern = patterns.Pattern(ground, (), frozenset("n"), (0,), (), targets, lambda at: ())
    orders = [tuple(sum(1 << other for other in order[: order.index(at)]) for at in range(3)) for order in permutations(range(3))]
    assert len({id(pattern.distances(still, order)) for still in range(1, 8) for order in orders}) == 6 + 3 * 2 + 3
    assert [pattern.distances(0b111, order)[0] for order in orders].count(2) == 1


def test_a_step_towards_several_goals_counts_once() -> None:
    """Two counters that are ended apart, and a step that counts in both. The wide estimate has a pattern for each."""
    more: dict[str, Actions] = {name: {name: Plus(Var(name), Const(1))} for name in ("n", "m")}
    steps = [step(f"more_{name}", TRUE, actions) for name, actions in more.items()]
    steps += [step(f"end_{name}", is_(name, 3), {f"{name}_ended": True}) for name in more]
    steps.append(step("more_of_both", TRUE, more["n"] | more["m"]))
    ended: dict[str, tuple[Domain, Value]] = {f"{name}_ended": (Bool(), False) for name in more}
    problem = ask({"n": (Range(0, 3), 0), "m": (Range(0, 3), 0)} | ended, steps, *map(Var, ended))
    ground, tables = session_of(problem.system).variant(())
    estimate = session_of(problem.system).guide(ground).estimate(problem, True)
    assert estimate is not None
    assert [estimate(tables.packing.pack((at, at, False, False)), -1) for at in range(4)] == [5, 4, 3, 2]


def test_goals_that_exclude_each_other_are_looked_at_in_every_order() -> None:
    """Whoever has the key has to lay it down before the other takes it."""
    free, at_a, at_b = (is_("key", who) for who in "cab")
    steps = [
        step("a_takes", free, {"key": "a"}),
        step("b_takes", free, {"key": "b"}),
        step("lay_down", negation(free), {"key": "c"}),
    ]
    problem = ask({"key": (WORDS, "c")}, steps, at_a, at_b)
    ground, tables = session_of(problem.system).variant(())
    estimate = session_of(problem.system).guide(ground).estimate(problem, True)
    assert estimate is not None
    assert estimate(tables.packing.pack(problem.initial), -1) == 3


@pytest.mark.parametrize("widely", [False, True], ids=["quick", "wide"])
def test_of_goals_that_hold_at_first_one_may_be_lost_alone(widely: bool) -> None:
    """The short way to have the first again leaves none for the second, which needs none as long as it is not lost."""
    steps = [
        step("away", negation(Var("gone")), {"first": False, "gone": True}, Kind.AUTOMATIC),
        step("lose", is_("n", 1), {"second": False}),
        step("gain", is_("n", 1), {"second": True}),
        *(step(f"to {n + 1}", is_("n", n), {"n": n + 1}) for n in range(3)),
        step("long", is_("n", 3), {"first": True}),
        step("short", is_("n", 0), {"first": True, "n": 4}),
    ]
    flags = {"first": (FLAG, True), "second": (FLAG, True), "gone": (FLAG, False)}
    problem = ask({**flags, "n": (Range(0, 4), 0)}, steps, Var("first"), Var("second"))
    ground, tables = session_of(problem.system).variant(())
    estimate = session_of(problem.system).guide(ground).estimate(problem, widely)
    assert estimate is not None
    assert estimate(tables.packing.pack((False, True, True, 0)), -1) == 1


@pytest.mark.parametrize("widely", [False, True], ids=["quick", "wide"])
def test_what_needs_an_action_that_is_never_enabled_is_estimated_all_the_same(widely: bool) -> None:
    """Relaxed reachability takes it, for its conditions exclude each other only when they are taken apart."""
    a, b = Var("a"), Var("b")
    never = conjunction(
        [disjunction([conjunction([a, negation(b)]), conjunction([a, negation(b), LAMP])]), disjunction([b, negation(a)])]
    )
    steps = [step("a", TRUE, {"a": True}), step("never", never, {"lamp": True}), step("end", LAMP, {"ended": True})]
    problem = ask(dict.fromkeys(("a", "b", "lamp", "ended"), (FLAG, False)), steps, Var("ended"))
    ground, tables = session_of(problem.system).variant(())
    estimate = session_of(problem.system).guide(ground).estimate(problem, widely)
    assert estimate is not None
    assert estimate(tables.packing.pack(problem.initial), -1) >= 1
