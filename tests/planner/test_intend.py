"""Planning on two levels: every problem it poses agrees with the explicit engine, every answer keeps its promises."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest
from generated_levels import model

from smv_planner.api import widened, widened_system
from smv_planner.engines import ENGINES, Limits, auto, explicit
from smv_planner.model.expressions import Named, Var, conjunction, meaning, rewritten
from smv_planner.model.ltl import co_safe
from smv_planner.model.model import Model
from smv_planner.model.system import Any, Assignment
from smv_planner.planner.answer import Answer, Question
from smv_planner.planner.intend import Levels, intend
from smv_planner.planner.operations import decisions, tasks
from smv_planner.planner.reach import Start
from smv_planner.planner.stage import completion_name, frozen_variables, reached, start
from smv_planner.problem import NotWithin, Problem, Reached, Verdict

LIMITS = Limits(deadline=60, memory=1 << 30, progress=lambda text: None)
BOUND = 30


def explicitly(problem: Problem) -> Verdict:
    return explicit.ask(problem, LIMITS)


def answered(generated: Model, solve=explicitly, disabled: frozenset[str] = frozenset()) -> Answer:
    begin = Start(generated.system.initial, widened(generated), disabled=disabled)
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


def automatically(problem: Problem) -> Verdict:
    return auto.ask(problem, LIMITS)


def without_arguments(answer: Answer) -> Answer:
    """Who is asked again may have a shorter proof of the same."""
    return replace(answer, reason=None, proof=None, arguments=(), warnings=())


def test_what_was_asked_before_changes_no_answer():
    """Systems, widenings and tables are kept for the next question about a model; a model made anew has none of them."""
    several = 0
    for seed in range(35):
        warm = model(seed)
        unavailable = [frozenset(), *(frozenset([t.name]) for t in warm.transitions[:3]), frozenset()]
        for disabled in unavailable:
            got = answered(warm, automatically, disabled)
            assert without_arguments(got) == without_arguments(answered(model(seed), automatically, disabled))
            several += len(got.stages) > 1
    assert several > 20


def test_answers_keep_their_promises():
    """Replayed with the model alone: guards hold at the start, post-conditions are reached, nothing frozen changes."""
    seen: Counter[str] = Counter()
    for seed in range(150):
        generated = model(seed)
        answer = answered(generated)
        seen[answer.verdict] += 1
        seen["operations disabled"] += bool(answer.disabled)
        seen["culprits named"] += bool(answer.culprits)
        seen["several intentions"] += len(generated.intentions) > 1
        seen["with a formula for ever"] += any(i.formula and not co_safe(i.formula) for i in generated.intentions)
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
        "several intentions": 20,
        "with a formula for ever": 10,
        "with frozen variables": 50,
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
            seen["with frozen variables"] += bool(frozen_variables(generated, executing))
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


def test_renaming_every_resource_changes_nothing_but_names():
    for seed in range(40):
        plain, renamed = answered(model(seed)), answered(renaming(model(seed)))
        assert plain.verdict == renamed.verdict
        assert [new_name(step.transition) for step in plain.steps] == [step.transition for step in renamed.steps]
        assert [step.after for step in plain.steps] == [step.after for step in renamed.steps]
        assert [operation.operation for operation in plain.operations] == [o.operation for o in renamed.operations]


def new_name(name: str) -> str:
    """Resources are called r0, r1, ...; everything of theirs begins with that and a dot."""
    return f"zz_{name}" if name.partition(".")[0] in ("r0", "r1", "r2") else name


def renaming(plain: Model) -> Model:
    def expr(old):
        return None if old is None else rewritten(old, lambda n: Var(new_name(n.name)) if isinstance(n, Var) else None)

    def actions(old):
        return tuple(Assignment(new_name(a.variable), a.value if isinstance(a.value, Any) else expr(a.value)) for a in old)

    def outcome(old):
        return replace(old, effects=actions(old.effects), goal=expr(old.goal))

    def copied(old):  # a copy's own name stands in conditions beside its definition
        return None if old is None else rewritten(old, lambda n: Named(n.name, expr(n.part)) if named(n) else variable(n))

    def named(node):
        return isinstance(node, Named) and node.name == "away"

    def variable(node):
        return Var(new_name(node.name)) if isinstance(node, Var) else None

    return replace(
        plain,
        resources=tuple(replace(r, name=new_name(r.name)) for r in plain.resources),
        variables=tuple(replace(v, name=new_name(v.name), resource=v.resource and new_name(v.resource)) for v in plain.variables),
        copies=tuple(replace(c, value=expr(c.value)) for c in plain.copies),
        transitions=tuple(
            replace(
                t,
                name=new_name(t.name),
                guard=copied(t.guard),
                actions=actions(t.actions),
                resource=t.resource and new_name(t.resource),
            )
            for t in plain.transitions
        ),
        operations=tuple(
            replace(
                o,
                guard=copied(o.guard),
                outcomes=tuple(map(outcome, o.outcomes)),
                synchronised=o.synchronised and new_name(o.synchronised),
            )
            for o in plain.operations
        ),
        intentions=tuple(replace(i, goal=copied(i.goal)) for i in plain.intentions),
    )
