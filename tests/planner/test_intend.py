"""Planning on two levels: every problem it poses agrees with the explicit engine, every answer keeps its promises."""

from __future__ import annotations

from collections import Counter

import pytest
from generated_levels import model

from smv_planner.api import widened, widened_system
from smv_planner.engines import ENGINES, Limits, explicit
from smv_planner.model.expressions import conjunction, meaning
from smv_planner.model.ltl import co_safe
from smv_planner.model.model import Model
from smv_planner.planner.answer import Answer, Question
from smv_planner.planner.intend import Levels, intend
from smv_planner.planner.operations import decisions, tasks
from smv_planner.planner.reach import Start
from smv_planner.planner.stage import completion_name, reached, start
from smv_planner.problem import NotWithin, Problem, Reached, Verdict

LIMITS = Limits(deadline=60, memory=1 << 30, progress=lambda text: None)
BOUND = 30


def explicitly(problem: Problem) -> Verdict:
    return explicit.ask(problem, LIMITS)


def answered(generated: Model, solve=explicitly) -> Answer:
    begin = Start(generated.system.initial, widened(generated))
    blank = Answer(
        model=generated.name,
        model_hash=generated.hash,
        question=Question(),
        engine="explicit",
        bound=BOUND,
        initial=generated.system.named(begin.state),
        verdict="undecided",
    )
    return intend(generated, generated.intentions, Levels(begin, solve, widened_system, BOUND), blank)


def test_answers_keep_their_promises():
    """Replayed with the model alone: guards hold at the start, post-conditions are reached, nothing frozen changes."""
    seen: Counter[str] = Counter()
    for seed in range(150):
        generated = model(seed)
        answer = answered(generated)
        seen[answer.verdict] += 1
        seen["operations disabled"] += bool(answer.disabled)
        seen["culprits named"] += bool(answer.culprits)
        seen["stages in parallel"] += any(len(stage.operations) > 1 for stage in answer.stages)
        if answer.reached:
            replay(generated, answer, seen)
        elif answer.verdict != "invariant_violated":
            assert answer.culprits
            assert {name for culprit in answer.culprits for name in culprit} <= {i.name for i in generated.intentions}
    print(dict(seen))
    quotas = {
        "reached": 50,
        "unreachable": 10,
        "operations disabled": 10,
        "stages in parallel": 5,
        "several outcomes": 5,
        "synchronised": 5,
        "by interaction": 5,
    }
    assert all(seen[kind] >= quota for kind, quota in quotas.items()), seen


def replay(generated: Model, answer: Answer, seen: Counter[str]) -> None:
    index = generated.system.index
    state = generated.system.initial
    by_name = {(task.operation.name, task.outcome.name): task for task in tasks(generated)}
    invariant = meaning(conjunction(i.predicate for i in generated.invariants), index)
    boundaries = [state]
    for stage in answer.stages:
        chosen = [by_name[o.operation, o.outcome] for o in answer.operations if o.index in stage.operations]
        assert all(meaning(task.operation.guard, index)(state) for task in chosen)
        state, executing = start(generated, state, chosen)
        for execution in executing:
            seen["several outcomes"] += len(execution.task.operation.outcomes) > 1
            seen["synchronised"] += execution.task.operation.synchronised is not None
            seen["by interaction"] += execution.task.outcome.goal is None
        mentioned = {name for execution in executing for post in execution.posts.values() for name in post}
        goals = [meaning(reached(generated, execution.post), index) for execution in executing]
        completions = {completion_name(task.operation, outcome) for task in chosen for outcome in task.operation.outcomes}
        met = [goal(state) for goal in goals]
        for step in answer.steps[stage.first : stage.last]:
            after = tuple(step.changes.get(v.name, value) for v, value in zip(generated.variables, state, strict=True))
            changed = set(step.changes)
            products = {name for name in changed if name.startswith("part")}
            assert products <= mentioned or not chosen, "a frozen variable changed"
            assert step.kind != "operation" or step.transition in completions
            assert invariant(after)
            state = after
            met = [before or goal(state) for before, goal in zip(met, goals, strict=True)]
        assert all(met)
        boundaries.append(state)
    for intention in generated.intentions:
        wanted = meaning(intention.goal, index)
        assert any(wanted(boundary) for boundary in boundaries)
    assert generated.system.named(state) == answer.final
    assert decisions(generated, state)


@pytest.mark.parametrize("seeds", [range(at, at + 10) for at in range(0, 40, 10)], ids=str)
@pytest.mark.parametrize("engine", ["nusmv"])
def test_every_problem_on_both_levels_agrees_with_the_explicit_engine(engine, seeds):
    if reason := ENGINES[engine].available():
        pytest.skip(reason)
    counts: Counter[str] = Counter()

    def both(problem: Problem) -> Verdict:
        verdict, expected = ENGINES[engine].ask(problem, LIMITS), explicitly(problem)
        match verdict:
            case Reached(path):
                assert isinstance(expected, Reached)
                assert len(path) == len(expected.path)
            case _:
                assert isinstance(verdict, NotWithin)
                assert not isinstance(expected, Reached)
        counts["lasso"] += not co_safe(problem.formula)
        counts["asked"] += 1
        return verdict

    for seed in seeds:
        answered(model(seed), both)
    assert counts["asked"] > 20
