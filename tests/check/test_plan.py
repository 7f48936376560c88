"""The kernel accepts what the explicit engine finds, and nothing that differs from a plan."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache
from itertools import islice, pairwise

from generated import question

from smv_planner.check import CheckedPlan, Refused, check_plan, check_proof
from smv_planner.check.order import blocks, certified, reduced, total_order
from smv_planner.engines import Limits, explicit
from smv_planner.model.ltl import holds
from smv_planner.model.semantics import Steps, slide
from smv_planner.model.system import Any
from smv_planner.planner.deorder import proposals
from smv_planner.problem import Exhausted, Reached, Unreachable

LIMITS = Limits(deadline=60, memory=1 << 30, progress=lambda text: None)


@cache
def verdict_of(seed):
    return explicit.ask(question(seed), LIMITS)


def plans(least_length=0):
    for seed in range(100_000):
        verdict = verdict_of(seed)
        if isinstance(verdict, Reached) and len(verdict.path) >= least_length:
            yield question(seed), verdict


def test_what_the_explicit_engine_finds_is_accepted():
    overlapping = 0
    for problem, trace in islice(plans(), 60):
        result = check_plan(problem, trace, proposals(problem, trace))
        assert isinstance(result, CheckedPlan), result
        overlapping += result.partial
    assert overlapping > 5


def test_a_corrupted_trace_is_accepted_only_if_it_is_a_plan_by_chance():
    refused: Counter[str] = Counter()
    for problem, trace in islice(plans(least_length=2), 40):
        for name, corrupted in mutations(problem, trace):
            result = check_plan(problem, corrupted)
            assert isinstance(result, CheckedPlan) is naively_right(problem, corrupted), (name, result)
            refused[name] += isinstance(result, Refused)
    assert min(refused.values()) > 5, refused


def mutations(problem, trace):
    """Fourteen ways in which a trace can be wrong."""
    path, states = trace.path, trace.states
    other = tuple(
        next((x for x in v.domain.values if x != value), value)
        for v, value in zip(problem.system.variables, states[0], strict=True)
    )
    unused = next((t.name for t in problem.system.transitions if t.name not in path), path[0])
    middle = len(path) // 2
    changed = lambda state, at: (*state[:at], other[at], *state[at + 1 :])  # noqa: E731
    yield "another initial state", replace(trace, states=(other, *states[1:]))
    yield "one initial value changed", replace(trace, states=(changed(states[0], 0), *states[1:]))
    yield "first step missing", Reached(path[1:], states[1:])
    yield "a step in the middle missing", Reached(path[:middle] + path[middle + 1 :], states[:middle] + states[middle + 1 :])
    yield "two steps in one", Reached(path[:middle] + path[middle + 1 :], states[: middle + 1] + states[middle + 2 :])
    yield "last step missing", Reached(path[:-1], states[:-1])
    yield "another transition's name", Reached((*path[:middle], unused, *path[middle + 1 :]), states)
    yield "an unknown name", Reached((*path[:middle], "no_such_transition", *path[middle + 1 :]), states)
    yield (
        "a value changed on the way",
        Reached(path, (*states[:middle], changed(states[middle], -1 % len(other)), *states[middle + 1 :])),
    )
    yield "a value changed at the end", Reached(path, (*states[:-1], changed(states[-1], 0)))
    yield "a step twice", Reached((*path[:middle], path[middle], *path[middle:]), (*states[: middle + 1], *states[middle:]))
    yield "two steps swapped", Reached((path[1], path[0], *path[2:]), states)
    yield "a state too many", Reached(path, (*states, states[-1]))
    yield "nothing at all", Reached((), ())


def naively_right(problem, trace):
    """The same question answered without the kernel's code."""
    if len(trace.states) != len(trace.path) + 1 or trace.states[0] != problem.initial:
        return False
    steps = Steps(problem.system, problem.usable)
    for name, before, after in zip(trace.path, trace.states, trace.states[1:], strict=False):
        if not any(transition.name == name and state == after for transition, state in steps(before)):
            return False
    invariants = [i.predicate for i in problem.system.invariants]
    safe = all(slide(problem.system, [state], invariants) is None for state in trace.states)
    return safe and steps.settled(trace.states[-1]) and holds(problem.formula, trace.states, problem.system.index)


def test_a_step_with_an_unusable_transition_is_refused():
    for problem, trace in islice(plans(least_length=1), 30):
        assert isinstance(check_plan(replace(problem, unusable=problem.unusable | {trace.path[0]}), trace), Refused)


def test_a_plan_through_a_forbidden_state_is_refused():
    refused = 0
    bounded = (problem for problem, _ in plans(least_length=1) if problem.allowed)
    for problem in islice(bounded, 60):
        verdict = explicit.ask(replace(problem, allowed=()), LIMITS)
        if isinstance(verdict, Reached):
            invariants = [i.predicate for i in problem.system.invariants]
            safe = all(slide(problem.system, [state], invariants) is None for state in verdict.states)
            assert isinstance(check_plan(problem, verdict), CheckedPlan) is safe
            refused += not safe
    assert refused > 3


def test_an_order_is_certified_just_when_every_linearisation_is_a_plan():
    """Against all linearisations one by one, for proposals and for orders with one dependency dropped."""
    judged = Counter()
    for problem, trace in islice(plans(least_length=3), 60):
        if len(blocks(problem, trace.path)) > 6:
            continue
        for order in [*proposals(problem, trace), *loosened(problem, trace)]:
            visited = certified(problem, trace, order)
            expected = all(runs_well(problem, trace, run) for run in linearisations(problem, trace, order))
            assert (visited is not None) is expected
            judged[expected, order == total_order(len(trace.path))] += 1
    assert judged[True, False] > 10
    assert judged[False, False] > 10


def loosened(problem, trace):
    """The total order without one pair of neighbouring blocks."""
    groups = blocks(problem, trace.path)
    for first, second in pairwise(groups):
        freed = sum(1 << at for at in first)
        yield tuple(before & ~freed if at in second else before for at, before in enumerate(total_order(len(trace.path))))


def linearisations(problem, trace, order):
    groups = blocks(problem, trace.path)

    def extend(done, left):
        if not left:
            yield [at for group in done for at in group]
        for group in left:
            waits = {other for at in group for other in range(len(order)) if order[at] >> other & 1} - set(group)
            if waits <= {at for other in done for at in other}:
                yield from extend([*done, group], [other for other in left if other is not group])

    yield from extend([], groups)


def runs_well(problem, trace, run):
    """Fire the steps in the given order with the trace's own choices: possible, same end, formula met."""
    steps = Steps(problem.system, problem.usable)
    groups = {group.start: group for group in blocks(problem, trace.path)}
    states = [problem.initial]
    for at in run:
        if at in groups and at != run[0] and not steps.settled(states[-1]):
            return False
        transition = problem.system.transition[trace.path[at]]
        free = {action.variable for action in transition.actions if isinstance(action.value, Any)}
        for other, after in steps(states[-1]):
            new, old = problem.system.named(after), problem.system.named(trace.states[at + 1])
            if other is transition and all(new[name] == old[name] for name in free):
                states.append(after)
                break
        else:
            return False
    return states[-1] == trace.states[-1] and steps.settled(states[-1]) and holds(problem.formula, states, problem.system.index)


def test_the_transitive_reduction_keeps_direct_predecessors_only():
    assert reduced(total_order(4)) == ((), (0,), (1,), (2,))
    assert reduced((0b0, 0b0, 0b11, 0b1)) == ((), (), (0, 1), (0,))


def test_a_proof_holds_and_every_smaller_one_is_refused():
    proofs = 0
    for seed in range(120):
        problem, verdict = question(seed), verdict_of(seed)
        if not isinstance(verdict, Unreachable):
            continue
        proofs += 1
        assert check_proof(problem, verdict.proof) is None
        for left_out in islice(sorted(verdict.proof.reached, key=repr), 5):
            assert isinstance(check_proof(problem, Exhausted(verdict.proof.reached - {left_out})), Refused)
    assert proofs > 20


def test_a_proof_of_a_reachable_goal_is_refused():
    for problem, trace in islice(plans(least_length=1), 20):
        everything = frozenset((state, owed) for state in trace.states for owed in range(16))
        assert isinstance(check_proof(problem, Exhausted(everything)), Refused)


def test_a_plan_longer_than_the_bound_is_refused():
    problem, trace = next(plans(least_length=3))
    assert isinstance(check_plan(replace(problem, bound=2), trace), Refused)
