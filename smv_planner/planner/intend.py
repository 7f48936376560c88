"""Plan intentions on two levels (Machines 2021, section 4): operations first, then stage by stage the transitions that
carry them out from the predicted states. An operation that no transition plan can complete is disabled and the
operations are planned again, as the transition runner would."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from smv_planner.check import CheckedPlan
from smv_planner.lazy import dataclass, replace
from smv_planner.model.domains import Value
from smv_planner.model.expressions import TRUE, meaning
from smv_planner.model.ltl import ALWAYS_TRUE, Atom, Until, counts_steps, holds
from smv_planner.model.model import Intention, Model
from smv_planner.model.model import Sequence as Prescribed
from smv_planner.model.semantics import Steps
from smv_planner.model.system import Invariant, State, System
from smv_planner.planner.answer import Answer, PlannedOperation, PlanStep, Stage
from smv_planner.planner.conflict import Asked, conflict
from smv_planner.planner.culprits import goals_to_blame
from smv_planner.planner.decide import NoPlan, Solve, decide
from smv_planner.planner.deorder import disjoint
from smv_planner.planner.operations import Task, footprints, pose_operations, tasks
from smv_planner.planner.reach import Start, plan_steps, pose, violated, violations, warnings, without_plan
from smv_planner.planner.sequences import OperationPlan, constraints, in_order, manual_plan
from smv_planner.planner.stage import goal_of, stage_system, start
from smv_planner.planner.widening import Widened
from smv_planner.problem import Goal, NotWithin, Problem, Unreachable

Widen = Callable[[System], tuple[Widened, ...]]

REPLANS = 20
"""How often the operations may be planned anew because the predicted state is not what the operation plan expected."""


@dataclass(frozen=True, slots=True)
class Levels:
    """What both levels of planning need: what may be used, how to ask an engine, how to widen, the longest plan.

    `explain` is asked, often, why there is no plan.
    """

    begin: Start
    solve: Solve
    widen: Widen
    bound: int
    explain: Solve | None = None

    def allowed(self, system: System) -> tuple[Invariant, ...]:
        """The system's invariants as widened, without those that are lifted."""
        return tuple(w.invariant for w in self.widen(system) if w.declared.name not in self.begin.lifted)


@dataclass(frozen=True, slots=True)
class _Progress:
    """What has been planned so far, and the states that it goes through."""

    states: tuple[State, ...]
    steps: tuple[PlanStep, ...] = ()
    stages: tuple[Stage, ...] = ()
    operations: tuple[PlannedOperation, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def state(self) -> State:
        """The state reached."""
        return self.states[-1]

    def with_stage(self, chosen: Sequence[tuple[Task, tuple[int, ...]]], plan: CheckedPlan) -> _Progress:
        """After one more stage: its tasks, each with the indices of the operations it waits for, and its plan."""
        index, first = len(self.stages), len(self.steps)
        steps = plan_steps(plan, first, index, waits_for=_last(self.steps))
        numbers = range(len(self.operations), len(self.operations) + len(chosen))
        operations = (
            PlannedOperation(number, task.operation.name, task.outcome.name, after, started(task, plan))
            for number, (task, after) in zip(numbers, chosen, strict=True)
        )
        return _Progress(
            states=self.states + plan.trace.states,
            steps=self.steps + steps,
            stages=(*self.stages, Stage(index, tuple(numbers), first, first + len(steps))),
            operations=(*self.operations, *operations),
            warnings=(*self.warnings, *(f"stage {index}: {warning}" for warning in warnings(plan))),
        )


def intend(model: Model, intentions: Sequence[Intention], levels: Levels, blank: Answer) -> Answer:
    """Fill in `blank` with the plan for some intentions.

    Raises EngineError if what an engine answers does not stand up to the checker.
    """
    begin = levels.begin
    found = violations(model.system, begin.state, begin.widened)
    if found:
        return violated(blank, found)
    first = _settled(model, levels)
    for intention in intentions:
        if isinstance(first, _Progress) and intention.sequence and intention.sequence.manual:
            first = _by_hand(model, intention, intention.sequence, first, levels)
    if isinstance(first, NoPlan):
        return without_plan(blank, first)
    planned = [i for i in intentions if not (i.sequence and i.sequence.manual)]
    disabled: dict[str, NoPlan] = {}
    progress = first
    for _ in range(len(tasks(model)) + REPLANS):
        unmet = [intention for intention in planned if not _met(model, intention, progress)]
        plan = plan_operations(model, progress, unmet, frozenset(disabled), levels)
        if isinstance(plan, NoPlan):
            return _no_operations(model, progress, unmet, disabled, levels, blank, plan)
        progress, stopped = _carry_out(model, plan, progress, levels)
        match stopped:
            case None if not plan.tasks or all(_met(model, intention, progress) for intention in planned):
                return _judged(model, blank, progress, disabled, intentions, levels)
            case Unanswered(why):
                return without_plan(replace(blank, disabled=tuple(disabled)), why)
            case Failed(failed):
                disabled |= failed
                progress = first
    circles = f"the operations were planned {REPLANS} times, and each plan undoes what its own operations count on"
    culprits = (tuple(intention.name for intention in intentions),)
    return without_plan(replace(blank, disabled=tuple(disabled), culprits=culprits), NoPlan(NotWithin(levels.bound), circles))


def _settled(model: Model, levels: Levels) -> _Progress | NoPlan:
    """Where planning begins: automatic transitions that are due come before any operation starts."""
    begin = levels.begin
    problem = pose(model, begin, [Goal(TRUE)], levels.bound)
    if Steps(model.system, problem.usable).settled(begin.state):
        return _Progress((begin.state,))
    result = decide(problem, levels.solve)
    return result if isinstance(result, NoPlan) else _Progress((begin.state,)).with_stage([], result)


def _by_hand(model: Model, intention: Intention, sequence: Prescribed, progress: _Progress, levels: Levels) -> _Progress | NoPlan:
    """Carry out a manual sequence as it stands; its intention's goal has to hold in the end."""
    progress, stopped = _carry_out(model, manual_plan(model, sequence, levels.begin.ran), progress, levels)
    of = f"the manual sequence of '{intention.name}'"
    match stopped:
        case Unanswered(why):
            return why
        case Failed(failed):
            name, why = next(iter(failed.items()))
            return NoPlan(why.verdict, f"operation '{name}' in {of} cannot be completed: {why.reason}")
        case Astray():
            return NoPlan(NotWithin(levels.bound), f"an operation in {of} cannot start where it stands: its guard does not hold")
    if not meaning(intention.goal, model.system.index)(progress.state):
        return NoPlan(NotWithin(levels.bound), f"{of} ends without reaching its goal")
    return progress


def plan_operations(
    model: Model, progress: _Progress, intentions: Sequence[Intention], disabled: frozenset[str], levels: Levels
) -> OperationPlan | NoPlan:
    """The operation plan, de-ordered: two operations without a common variable may run at the same time."""
    problem = _operations_problem(model, progress, intentions, disabled, levels)
    by_name = {task.name: task for task in tasks(model)}
    result = decide(problem, levels.solve, lambda problem, trace: disjoint(problem, trace, footprints(model)))
    if isinstance(result, NoPlan):
        return result
    return OperationPlan(tuple(by_name[name] for name in result.trace.path), result.after)


def _operations_problem(
    model: Model, progress: _Progress, intentions: Sequence[Intention], disabled: frozenset[str], levels: Levels
) -> Problem:
    problem = pose_operations(model, progress.state, intentions, disabled, levels.bound)
    ran = {*levels.begin.ran, *(operation.operation for operation in progress.operations)}
    allowed = tuple(invariant for invariant in problem.allowed if invariant.name not in levels.begin.lifted)
    return in_order(model, replace(problem, allowed=allowed), constraints(model, intentions), ran)


@dataclass(frozen=True, slots=True)
class Failed:
    """Tasks that no transition plan can complete, by name."""

    tasks: Mapping[str, NoPlan]


@dataclass(frozen=True, slots=True)
class Astray:
    """The steps lead to a state in which the next operations cannot start; they have to be planned again from there."""


@dataclass(frozen=True, slots=True)
class Unanswered:
    """Nobody knows whether the operations can be carried out."""

    why: NoPlan


Stopped = Failed | Astray | Unanswered
"""Why carrying out an operation plan ended early."""


def _carry_out(model: Model, plan: OperationPlan, progress: _Progress, levels: Levels) -> tuple[_Progress, Stopped | None]:
    """Plan the transitions of every stage of an operation plan."""
    offset = len(progress.operations)
    placed: dict[int, int] = {}  # position in the operation plan -> index in the answer
    waiting = plan.stages()
    split: dict[int, int] = {}  # position -> the one that it has to wait for besides
    while waiting:
        stage = waiting.pop(0)
        now = [plan.tasks[at] for at in stage]
        if not all(meaning(task.operation.guard, model.system.index)(progress.state) for task in now):
            return progress, Astray()
        problem = pose_stage(model, progress.state, now, levels)
        result = decide(problem, levels.solve)
        if isinstance(result, CheckedPlan):
            placed |= {at: offset + len(placed) + number for number, at in enumerate(stage)}
            waits = [{*plan.after[at], *([split[at]] if at in split else [])} for at in stage]
            after = [tuple(sorted(placed[other] for other in others)) for others in waits]
            progress = progress.with_stage(list(zip(now, after, strict=True)), result)
        elif not result.decided:
            return progress, Unanswered(result)
        else:
            sets = goals_to_blame(problem, result, levels.solve)
            if isinstance(sets, NoPlan):
                return progress, Unanswered(sets)
            failed = [goals[0] for goals in sets if len(goals) == 1]
            if failed:
                return progress, Failed({now[goal].name: result for goal in failed})
            split |= dict(zip(stage[1:], stage, strict=False))
            waiting[:0] = [[at] for at in stage]  # each is possible, together they are not: one after the other
    return progress, None


def pose_stage(model: Model, state: State, chosen: Sequence[Task], levels: Levels) -> Problem:
    """Which transitions bring about the post-conditions of operations that start together in `state`?"""
    begun, executing = start(model, state, chosen)
    system = stage_system(model, executing)
    return Problem(
        system=system,
        initial=begun,
        goals=tuple(Goal(goal_of(model, execution)) for execution in executing),
        allowed=levels.allowed(system),
        unusable=levels.begin.unusable(system),
        bound=levels.bound,
    )


def _no_operations(
    model: Model,
    progress: _Progress,
    intentions: Sequence[Intention],
    disabled: dict[str, NoPlan],
    levels: Levels,
    blank: Answer,
    result: NoPlan,
) -> Answer:
    """No operation plan: name the intentions that are the cause, and the operations that had to be left out."""
    blank = replace(blank, disabled=tuple(disabled))
    if not result.decided:
        return without_plan(blank, result)
    problem = _operations_problem(model, progress, intentions, frozenset(disabled), levels)
    sets = goals_to_blame(problem, result, levels.solve)
    if isinstance(sets, NoPlan):
        return without_plan(blank, sets)
    relative = disabled or progress.stages  # judged from states that one plan led to; another plan may do better
    verdict = NotWithin(levels.bound) if relative else result.verdict
    failed = [f"operation '{name}' cannot be completed: {why.reason}" for name, why in disabled.items()]
    if progress.stages and not failed:
        failed = [
            f"the steps of {len(progress.stages)} stages undo what their operations promise, and from there {result.reason}"
        ]
    reason = "; ".join(failed or [result.reason])
    names = tuple(tuple(intentions[at].name for at in goals) for goals in sets)
    blank = replace(blank, culprits=names)
    if levels.explain and isinstance(verdict, Unreachable):
        every = tuple(intention.name for intention in intentions)
        asked = Asked(problem, every, frozenset(), frozenset(), lambda disabled, lost: problem.unusable)
        blank = replace(blank, conflict=conflict(asked, levels.explain))
    return without_plan(blank, NoPlan(verdict, reason))


def _met(model: Model, intention: Intention, progress: _Progress) -> bool:
    """Whether `formula U goal` holds on the states gone through; goals need not hold at once.

    A formula with `X` counts operations, not steps, and is left to the operation planner.
    """
    formula = intention.formula or ALWAYS_TRUE
    promised = Until(ALWAYS_TRUE if counts_steps(formula) else formula, Atom(intention.goal))
    return holds(promised, progress.states, model.system.index)


def _judged(
    model: Model,
    blank: Answer,
    progress: _Progress,
    disabled: dict[str, NoPlan],
    intentions: Sequence[Intention],
    levels: Levels,
) -> Answer:
    """The answer, if the steps do what the operations promise."""
    for intention in intentions:
        if not _met(model, intention, progress):
            reason = (
                f"the operations reach '{intention.name}', but the steps that carry them out break its formula or undo its goal"
            )
            broken = replace(blank, disabled=tuple(disabled), culprits=((intention.name,),))
            return without_plan(broken, NoPlan(NotWithin(levels.bound), reason))
    return _reached(model, blank, progress, disabled)


def _reached(model: Model, blank: Answer, progress: _Progress, disabled: dict[str, NoPlan]) -> Answer:
    left_out = [f"operation '{name}' had to be left out: {why.reason}" for name, why in disabled.items()]
    return replace(
        blank,
        verdict="reached",
        checked=True,
        steps=progress.steps,
        stages=progress.stages,
        operations=progress.operations,
        disabled=tuple(disabled),
        final=model.system.named(progress.state),
        warnings=(*blank.warnings, *left_out, *progress.warnings),
    )


def started(task: Task, plan: CheckedPlan) -> dict[str, Value]:
    """What `on_start` of a task gives a value at the beginning of its stage."""
    initial = plan.problem.system.named(plan.problem.initial)
    return {action.variable: initial[action.variable] for action in task.operation.on_start if action.variable in initial}


def _last(steps: Sequence[PlanStep]) -> tuple[int, ...]:
    """The steps that nothing waits for: a new stage starts after them."""
    waited_for = {other for step in steps for other in step.after}
    return tuple(step.index for step in steps if step.index not in waited_for)
