"""The transition planner's problem for operations that execute together (Machines 2021, section 4.3).

The same operations come together again and again: systems, and the transitions and invariants in them, are made once, so
that whoever keeps something about them by identity (engines, the widening, `semantics`) finds it again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache

from smv_planner.lazy import dataclass, replace
from smv_planner.model.domains import Value
from smv_planner.model.expressions import (
    FALSE,
    TRUE,
    Const,
    Expr,
    Var,
    conjunction,
    disjunction,
    equality,
    meaning,
    negation,
    variables_of,
)
from smv_planner.model.model import Model, Operation, Outcome
from smv_planner.model.semantics import may_fire
from smv_planner.model.system import Any, Assignment, Invariant, Kind, State, System, Transition
from smv_planner.planner.operations import Task, post_condition, tasks_of

STAGES = 64
"""How many stages' systems are kept."""

PARTS = 4096
"""How many of their transitions, and how many of their invariants."""


@dataclass(frozen=True, slots=True)
class Execution:
    """An executing operation with the outcome that is planned for.

    `posts` are the post-conditions of all its outcomes, as values of decision variables, fixed when it started.
    """

    task: Task
    posts: Mapping[str, Mapping[str, Value]]

    @property
    def post(self) -> Mapping[str, Value]:
        return self.posts[self.task.name]


def start(model: Model, state: State, chosen: Sequence[Task]) -> tuple[State, tuple[Execution, ...]]:
    """Start operations: their `on_start` effects are applied, their post-conditions fixed (Def. 5)."""
    values = list(state)
    for task in chosen:
        for action in task.operation.on_start:
            if action.variable in model.system.index and not isinstance(action.value, Any):
                value = meaning(action.value, model.system.index)(state)
                if value in model.system.domains[action.variable]:
                    values[model.system.index[action.variable]] = value
    executing = (
        Execution(task, {peer.name: post_condition(model, peer, state) for peer in tasks_of(task.operation)}) for task in chosen
    )
    return tuple(values), tuple(executing)


def stage_system(model: Model, executing: Sequence[Execution]) -> System:
    """The resources with the completions of all operations; only an operation that executes can complete.

    Decision variables that operations assign, and that no executing operation's goal mentions, are frozen (ordered
    monotonic abstraction). A state in which something uncontrollable would change one is forbidden; maintenance may.
    """
    fixed = {execution.task.operation.name: _posts(execution) for execution in executing}
    running = tuple((operation.name, fixed[operation.name]) for operation in model.operations if operation.name in fixed)
    return _stage_system(model, running, frozen_variables(model, executing))


Posts = tuple[tuple[str, tuple[tuple[str, Value], ...]], ...]
"""The post-conditions of an execution, to look things up by."""


def _posts(execution: Execution) -> Posts:
    return tuple((name, tuple(post.items())) for name, post in execution.posts.items())


@lru_cache(maxsize=STAGES)
def _stage_system(model: Model, running: tuple[tuple[str, Posts], ...], frozen: tuple[str, ...]) -> System:
    posts = dict(running)
    completions = (
        _completion(model, at, number, posts.get(operation.name))
        for at, operation in enumerate(model.operations)
        for number, outcome in enumerate(operation.outcomes)
        if outcome.goal is not None
    )
    held = (_held(model, at, transition.assigned.intersection(frozen)) for at, transition in enumerate(model.transitions))
    nothing_slips = (invariant for name in frozen if (invariant := _frozen_invariant(model, name)))
    return System(model.variables, (*held, *completions), (*model.invariants, *nothing_slips), base=model.system)


def goal_of(model: Model, execution: Execution) -> Expr:
    """What a stage has to reach for an operation: its post-condition; its low-level goal if nothing is left to change."""
    goal = execution.task.outcome.goal
    post = reached(model, execution.post)
    completes = any(name in model.system.index for name in execution.post)  # measured copies alone show no completion
    if completes or goal is None:
        return post
    return conjunction([post, goal, _synchronised(model, execution.task.operation).guard])


def reached(model: Model, post: Mapping[str, Value]) -> Expr:
    """That a post-condition holds, as a predicate on states of the resources."""
    copies = {copy.name: copy.value for copy in model.copies}
    return conjunction(equality(copies.get(name, Var(name)), Const(value)) for name, value in post.items())


def frozen_variables(model: Model, executing: Iterable[Execution]) -> tuple[str, ...]:
    """The decision variables that some operation assigns and no executing operation's goal mentions, in order."""
    assigned = {
        action.variable
        for operation in model.operations
        for actions in (operation.on_start, *(outcome.effects for outcome in operation.outcomes))
        for action in actions
    }
    mentioned: set[str] = set()
    for execution in executing:
        for outcome in execution.task.operation.outcomes:
            mentioned |= variables_of(outcome.goal) if outcome.goal else frozenset()
        mentioned.update(*execution.posts.values())
        mentioned |= _synchronised(model, execution.task.operation).assigned
    return tuple(v.name for v in model.variables if v.name in assigned - mentioned)


def completion_name(operation: Operation, outcome: Outcome) -> str:
    return f"{operation.name}.complete" if outcome.name is None else f"{operation.name}.complete.{outcome.name}"


@lru_cache(maxsize=PARTS)
def _completion(model: Model, at: int, number: int, posts: Posts | None) -> Transition:
    """The automatic transition that completes an operation with an outcome; without `posts` it can never fire.

    Its guard joins the low-level goal with the synchronised transition's; no outcome comes after another.
    """
    operation, outcome = model.operations[at], model.operations[at].outcomes[number]
    assert outcome.goal is not None
    name = completion_name(operation, outcome)
    if posts is None:
        return Transition(name, Kind.OPERATION, FALSE, (), completes=operation.name)
    fixed = {name: dict(post) for name, post in posts}
    post = fixed[Task(operation, outcome).name]
    synchronised = _synchronised(model, operation)
    open_yet = [negation(reached(model, other)) for other in fixed.values() if other]
    guard = conjunction([outcome.goal, synchronised.guard, *open_yet])
    effects = [Assignment(variable, Const(value)) for variable, value in post.items() if variable in model.system.index]
    actions = (*synchronised.actions, *effects)
    return Transition(name, Kind.OPERATION, guard, actions, completes=operation.name)


def _synchronised(model: Model, operation: Operation) -> Transition:
    """The transition whose guard and actions join the completion; one that does nothing if there is none."""
    if operation.synchronised is None:
        return Transition(operation.name, Kind.OPERATION, TRUE, ())
    return model.system.transition[operation.synchronised]


@lru_cache(maxsize=PARTS)
def _held(model: Model, at: int, frozen: frozenset[str]) -> Transition:
    """A controlled transition that leaves frozen variables as they are; others are as they were."""
    transition = model.transitions[at]
    if transition.kind is not Kind.CONTROLLED or not frozen:
        return transition
    kept = (_keeps(action) for action in transition.actions if action.variable in frozen)
    return replace(transition, guard=conjunction([transition.guard, *kept]))


def _keeps(action: Assignment) -> Expr:
    return FALSE if isinstance(action.value, Any) else equality(action.value, Var(action.variable))


@lru_cache(maxsize=PARTS)
def _frozen_invariant(model: Model, name: str) -> Invariant | None:
    """Nothing uncontrollable is about to change a frozen variable: no transition of the model, for completions that can
    fire are those of executing operations, and what they change is not frozen."""
    changes = [
        conjunction([may_fire(model.system, transition), negation(_keeps(action))])
        for transition in model.transitions
        if transition.kind.uncontrollable
        for action in transition.actions
        if action.variable == name
    ]
    changing = disjunction(changes)
    return None if changing == FALSE else Invariant(f"frozen {name}", negation(changing))
