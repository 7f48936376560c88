"""What is found by looking at each part alone is what is found by looking at everything at once."""

from random import Random

from generated import question

from smv_planner.check.slides import may_slide
from smv_planner.model.domains import Range, Value
from smv_planner.model.expressions import Const, Var, equality, negation
from smv_planner.model.semantics import slide
from smv_planner.model.system import Assignment, Kind, State, System, Transition, Variable, VariableKind


def test_a_slide_found_in_a_part_is_a_slide_of_the_whole() -> None:
    found = {True: 0, False: 0}
    for seed in range(150):
        random, problem = Random(seed), question(seed)
        states = [problem.initial]
        for _ in range(3):
            values: list[Value] = [random.choice(variable.domain.values) for variable in problem.system.variables]
            states.append(tuple(values))
        invariants = [invariant.predicate for invariant in problem.system.invariants]
        whole = slide(problem.system, states, invariants) is not None
        assert may_slide(problem.system, states, invariants) is whole, f"question {seed}"
        found[whole] += 1
    assert min(found.values()) > 10


def test_what_was_found_before_changes_no_answer() -> None:
    """What the kernel remembers of a system is that of the states that were asked about, one by one and together."""
    slides = 0
    for seed in range(150):
        random, problem = Random(seed), question(seed)
        held = [invariant.predicate for invariant in problem.system.invariants]
        for _ in range(8):
            values: list[Value] = [random.choice(variable.domain.values) for variable in problem.system.variables]
            state, some = tuple(values), random.sample(held, random.randint(0, len(held)))
            whole = slide(problem.system, [state], some) is not None
            assert may_slide(problem.system, [problem.initial, state], some) is (
                whole or slide(problem.system, [problem.initial], some) is not None
            ), f"question {seed}"
            assert may_slide(problem.system, [state], some) is whole, f"question {seed}"
            slides += whole
    assert slides > 50


def test_independent_counters_are_not_counted_together() -> None:
    """Six counters to 9 have a million states together."""
    names = [f"c{at}" for at in range(6)]
    steps = [
        Transition(f"{name}-{at}", Kind.EFFECT, equality(Var(name), Const(at)), (Assignment(name, Const(at + 1)),))
        for name in names
        for at in range(9)
    ]
    variables = tuple(Variable(name, VariableKind.MEASURED, Range(0, 9), 0) for name in names)
    system = System(variables, tuple(steps), ())
    start: State = (0,) * 6
    assert not may_slide(system, [start], [negation(equality(Var("c5"), Const(10)))])
    assert may_slide(system, [start], [negation(equality(Var(name), Const(9))) for name in names])
