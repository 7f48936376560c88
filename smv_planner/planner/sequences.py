"""Operations in a prescribed order (Machines 2021, section 3: sequences are constraints on the planner).

A sequence adds to the operation planner's system, for each of its operations, a variable that says whether it has run.
A manual sequence takes the place of operation planning (Industry 4.0, section 4.7).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from functools import lru_cache

from smv_planner.lazy import dataclass, replace
from smv_planner.model.domains import Bool
from smv_planner.model.expressions import TRUE, Var, conjunction, negation
from smv_planner.model.model import Intention, Model, Sequence
from smv_planner.model.system import Assignment, System, Transition, Variable, VariableKind
from smv_planner.planner.operations import MODELS, Task, operation_system, tasks
from smv_planner.problem import Problem


@dataclass(frozen=True, slots=True)
class OperationPlan:
    """Tasks to carry out, and for each the positions of those it waits for."""

    tasks: tuple[Task, ...]
    after: tuple[tuple[int, ...], ...]

    def stages(self) -> list[list[int]]:
        """Positions by the stage in which they may start: all that they wait for is in earlier ones."""
        level: list[int] = []
        for after in self.after:
            level.append(1 + max((level[other] for other in after), default=-1))
        return [[at for at, own in enumerate(level) if own == stage] for stage in range(max(level, default=-1) + 1)]


def manual_plan(model: Model, sequence: Sequence, ran: Iterable[str] = ()) -> OperationPlan:
    """What is left of a manual sequence after operations have run; of several outcomes the first declared is expected."""
    left = dict(enumerate(sequence.operations))
    for name in ran:
        done = next((at for at, other in left.items() if other == name), None)
        if done is not None:
            del left[done]
    expected = {task.operation.name: task for task in reversed(tasks(model))}
    number = {at: new for new, at in enumerate(left)}
    after = (tuple(number[other] for other in sequence.after[at] if other in number) for at in left)
    return OperationPlan(tuple(expected[name] for name in left.values()), tuple(after))


def constraints(model: Model, intentions: Iterable[Intention]) -> tuple[Sequence, ...]:
    """The sequences that bind the planning of some intentions."""
    every = [model.sequence, *(intention.sequence for intention in intentions)]
    return tuple(sequence for sequence in every if sequence is not None and not sequence.manual)


def in_order(model: Model, problem: Problem, sequences: tuple[Sequence, ...], ran: Collection[str]) -> Problem:
    """The operation planner's problem with operations kept in order; `ran` names those that have run already."""
    if not sequences:
        return problem
    system = in_sequence(model, sequences)
    added = system.variables[len(problem.system.variables) :]
    has_run = {_ran(name) for name in ran}
    initial = (*problem.initial, *(variable.name in has_run for variable in added))
    return replace(problem, system=system, initial=initial)


@lru_cache(maxsize=MODELS)
def in_sequence(model: Model, sequences: tuple[Sequence, ...]) -> System:
    """The operation planner's system with variables for what has run.

    An operation waits for those before it, and cannot run again once one after it has run.
    """
    system = operation_system(model)
    for sequence in sequences:
        variables = [Variable(_ran(name), VariableKind.DECISION, Bool(), False) for name in sequence.operations]
        known = {variable.name for variable in system.variables}
        positions = {name: at for at, name in enumerate(sequence.operations)}
        operation_of = {task.name: task.operation.name for task in tasks(model)}
        system = replace(
            system,
            variables=(*system.variables, *(v for v in variables if v.name not in known)),
            transitions=tuple(
                _placed(t, sequence, positions[operation_of[t.name]]) if operation_of[t.name] in positions else t
                for t in system.transitions
            ),
        )
    return system


def _placed(step: Transition, sequence: Sequence, at: int) -> Transition:
    names = sequence.operations
    before = (Var(_ran(names[other])) for other in sequence.after[at])
    later = (negation(Var(_ran(names[other]))) for other, waits in enumerate(sequence.after) if at in waits)
    own = Assignment(_ran(names[at]), TRUE)
    actions = step.actions if own in step.actions else (*step.actions, own)
    return replace(step, guard=conjunction([step.guard, *before, *later]), actions=actions)


def _ran(operation: str) -> str:
    return f"ran {operation}"
