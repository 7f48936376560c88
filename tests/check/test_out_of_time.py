"""A checker that has run out of time says neither yes nor no."""

from engines.test_auto import LIMITS
from engines.test_auto_deadlines import Clock
from generated import question

from smv_planner.clock import watched
from smv_planner.engines import auto
from smv_planner.planner.decide import NoPlan, decide
from smv_planner.problem import Exhausted, Inductive, Problem, Reached, Relaxed, Undecided, Unreachable, Verdict


def checked(problem: Problem, verdict: Verdict, looks: int) -> tuple[object, int]:
    """What comes of an engine's answer with so many looks at the clock, and how many there were."""
    watch = Clock(looks)
    with watched(watch):
        return decide(problem, lambda problem: verdict), watch.looks


def test_every_look_of_the_kernel_can_be_the_last() -> None:
    seen: set[type] = set()
    for seed in range(25):
        problem = question(seed)
        for budget in (auto.BUDGET, 0):
            verdict = auto.ask(problem, LIMITS, budget)
            if not isinstance(verdict, Reached | Unreachable):
                continue
            seen.add(type(verdict.proof) if isinstance(verdict, Unreachable) else Reached)
            checked(problem, verdict, 1 << 30)  # what it remembers saves looks
            whole, number = checked(problem, verdict, 1 << 30)
            for looks in range(0, number, 1 + number // 4):
                cut, looked = checked(problem, verdict, looks)
                assert looked == looks + 1
                assert isinstance(cut, NoPlan)
                assert isinstance(cut.verdict, Undecided)
                assert cut.verdict.deadline
            assert checked(problem, verdict, number)[0] == whole
    assert seen >= {Reached, Exhausted, Relaxed, Inductive}
