"""The operation planner's view of a model (Machines 2021, sections 3 and 4.2).

Decision variables only, operations as single steps. A measured copy is a variable of its own here: it starts with its
expression's value and changes by the operations' effects. When an operation has several outcomes the planner may choose
any; what really happens is for the runner to see.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache

from smv_planner.lazy import dataclass
from smv_planner.model import ltl
from smv_planner.model.domains import Value
from smv_planner.model.expressions import Expr, Named, Var, meaning, rewritten, substitute, variables_of
from smv_planner.model.ltl import ALWAYS_TRUE, Formula
from smv_planner.model.model import Intention, Model, Operation, Outcome
from smv_planner.model.semantics import judge
from smv_planner.model.system import Any, Assignment, Invariant, Kind, State, System, Transition, Variable, VariableKind
from smv_planner.problem import Goal, Problem

MODELS = 16
"""Of how many models is kept what does not depend on the state."""


def abstracted(model: Model, expr: Expr) -> Expr:
    """An expression with measured copies as variables, as the operation planner reads it."""
    copies = {copy.name for copy in model.copies}
    return rewritten(expr, lambda node: Var(node.name) if isinstance(node, Named) and node.name in copies else None)


@dataclass(frozen=True, slots=True)
class Task:
    """An operation with the outcome that is planned for, and the step that stands for it on the operation level."""

    operation: Operation
    outcome: Outcome

    @property
    def name(self) -> str:
        return self.operation.name if self.outcome.name is None else f"{self.operation.name}.{self.outcome.name}"


def tasks_of(operation: Operation) -> tuple[Task, ...]:
    return tuple(Task(operation, outcome) for outcome in operation.outcomes)


@lru_cache(maxsize=MODELS)
def tasks(model: Model) -> tuple[Task, ...]:
    return tuple(task for operation in model.operations for task in tasks_of(operation))


@lru_cache(maxsize=MODELS)
def operation_system(model: Model) -> System:
    """The decision variables, and every task as a controlled transition."""
    values = decisions(model, model.system.initial)
    decided = [v for v in model.variables if v.kind is VariableKind.DECISION]
    variables = [*decided]
    variables += [Variable(c.name, VariableKind.DECISION, c.domain, values[c.name]) for c in model.copies]
    names = {variable.name for variable in variables}
    invariants = (Invariant(i.name, abstracted(model, i.predicate)) for i in model.invariants)
    return System(
        variables=tuple(variables),
        transitions=tuple(_as_step(model, task) for task in tasks(model)),
        invariants=tuple(i for i in invariants if variables_of(i.predicate) <= names),
    )


def decisions(model: Model, state: State) -> dict[str, Value]:
    """The value of every decision variable and measured copy in a state of the resources."""
    named = model.system.named(state)
    values = {v.name: named[v.name] for v in model.variables if v.kind is VariableKind.DECISION}
    return values | {copy.name: judge(model.system, copy.value)(state) for copy in model.copies}


def operation_state(model: Model, state: State) -> State:
    """A state of the resources as the operation planner sees it."""
    values = decisions(model, state)
    return tuple(values[variable.name] for variable in operation_system(model).variables)


def _as_step(model: Model, task: Task) -> Transition:
    """Start and completion in one: what `on_start` assigns is what the effects read."""
    begun = {a.variable: abstracted(model, a.value) for a in task.operation.on_start if not isinstance(a.value, Any)}
    ended = {
        a.variable: substitute(abstracted(model, a.value), begun) for a in task.outcome.effects if not isinstance(a.value, Any)
    }
    actions = tuple(Assignment(name, value) for name, value in (begun | ended).items())
    return Transition(task.name, Kind.CONTROLLED, abstracted(model, task.operation.guard), actions)


def pose_operations(model: Model, state: State, intentions: Iterable[Intention], disabled: frozenset[str], bound: int) -> Problem:
    """Which operations reach the goals of the intentions, each as `formula U goal`, without the `disabled` tasks?"""
    system = operation_system(model)
    goals = (Goal(abstracted(model, i.goal), _abstracted_formula(model, i.formula)) for i in intentions)
    return Problem(system, operation_state(model, state), tuple(goals), system.invariants, disabled, bound)


def _abstracted_formula(model: Model, formula: Formula | None) -> Formula:
    return ALWAYS_TRUE if formula is None else ltl.over_atoms(formula, lambda predicate: abstracted(model, predicate))


@lru_cache(maxsize=MODELS)
def footprints(model: Model) -> Mapping[str, frozenset[str]]:
    """The variables of every task, by its name."""
    return {task.name: _footprint(model, task) for task in tasks(model)}


def _footprint(model: Model, task: Task) -> frozenset[str]:
    """Every variable of an operation: guard, low-level goal, effects and the synchronised transition (section 4.2).

    Copies count by their own name and by what they are measured from.
    """
    step = _as_step(model, task)
    exprs = [task.operation.guard, *([task.outcome.goal] if task.outcome.goal else [])]
    exprs += [a.value for a in (*task.operation.on_start, *task.outcome.effects) if not isinstance(a.value, Any)]
    used = step.used.union(*(variables_of(expr) for expr in exprs))
    if task.operation.synchronised:
        used |= model.system.transition[task.operation.synchronised].used
    return used


def post_condition(model: Model, task: Task, state: State) -> dict[str, Value]:
    """What completing a task started in `state` changes, as values: the effects evaluated at the start (Def. 5).

    Judged against the state that `on_start` leaves; an effect that would leave a domain counts as none.
    """
    system, before = operation_system(model), operation_state(model, state)
    begun = list(before)
    for action in task.operation.on_start:
        if not isinstance(action.value, Any):
            begun[system.index[action.variable]] = meaning(abstracted(model, action.value), system.index)(before)
    post = {}
    for action in task.outcome.effects:
        if not isinstance(action.value, Any):
            value = meaning(abstracted(model, action.value), system.index)(tuple(begun))
            if value != begun[system.index[action.variable]] and value in system.domains[action.variable]:
                post[action.variable] = value
    return post
