"""The planners of a simulation: an engine that fails, is late or lies, and a memory of what was decided before.

A decision depends on the question alone, so that a thousand seeds need not think a thousand times about the same. What is
remembered makes no difference to a run but its duration.
"""

from __future__ import annotations

from collections.abc import Hashable

from smv_planner.emulation.draw import Draw
from smv_planner.lazy import dataclass, field, replace
from smv_planner.model.model import Model
from smv_planner.planner.stage import Execution
from smv_planner.problem import Exhausted, Problem, Reached, Undecided, Unreachable, Verdict
from smv_planner.runner.decision import Decision, Following, Request
from smv_planner.runner.recovery import Planners, recover


@dataclass
class Memory:
    """Decisions by question, for one model."""

    model: Model
    planners: Planners
    known: dict[Hashable, Decision] = field(default_factory=dict)
    hits: int = 0

    def __call__(self, request: Request) -> Decision:
        question = key(self.model, request)
        decision = self.known.get(question)
        if decision is None:
            decision = self.known[question] = recover(self.model, request, self.planners)
        else:
            self.hits += 1
        return decision


def key(model: Model, request: Request) -> Hashable:
    """The same for requests that get the same decision: of causes counts whether something went wrong, of what is in error
    its names, and what has run only where an order is prescribed."""
    following, course = request.following, request.course
    ordered = model.sequence or any(intention.sequence for intention in model.intentions)
    return (
        request.cause.ordinary,
        request.state,
        request.wanted,
        _executions(request.executing),
        course and (tuple(task.name for task in course.plan.tasks), course.plan.after, course.begun, course.done),
        following and _plan(following),
        request.disabled,
        request.lost,
        frozenset(request.failed),
        request.spent,
        request.given_up,
        request.ran if ordered else (),
        request.recheck,
    )


def _executions(executing: tuple[Execution, ...]) -> Hashable:
    return tuple((e.task.name, tuple((name, tuple(post.items())) for name, post in e.posts.items())) for e in executing)


def _plan(following: Following) -> Hashable:
    plan = following.plan
    rest = following.purpose, following.done, following.lifted, following.approved, _executions(following.operations)
    return plan.trace.path, plan.trace.states, plan.after, plan.problem.unusable, rest


def failing(planners: Planners) -> Planners:
    """An engine that comes to no end."""
    return replace(planners, solve=lambda problem: Undecided("the engine was killed by signal 11", False))


def lying(planners: Planners, draw: Draw) -> Planners:
    """An engine whose answers are wrong: nothing may come of them."""
    solve, asked = planners.solve, iter(range(1_000_000))
    return replace(planners, solve=lambda problem: lie(problem, solve(problem), draw.of(next(asked))))


def lie(problem: Problem, verdict: Verdict, draw: Draw) -> Verdict:
    """Something that looks like the verdict and is not true, where there is a way to lie about it."""
    if not isinstance(verdict, Reached) or not verdict.path:
        return Reached((), (problem.initial,))
    path, states = verdict.path, verdict.states
    at = int(draw.unit("where") * len(path))
    match int(draw.unit("how") * 5):
        case 0:  # a step is missing
            return Reached(path[:at] + path[at + 1 :], states[:at] + states[at + 1 :])
        case 1:  # a state is not what the step makes
            return Reached(path, (*states[: at + 1], states[at], *states[at + 2 :]))
        case 2:  # another step
            other = problem.system.transitions[int(draw.unit("which") * len(problem.system.transitions))].name
            return Reached((*path[:at], other, *path[at + 1 :]), states) if other != path[at] else Reached((), (states[0],))
        case 3:  # it ends too early
            return Reached(path[:-1], states[:-1])
        case _:  # there is none, and no proof of that
            return Unreachable(Exhausted(frozenset([(problem.initial, 0)])))
