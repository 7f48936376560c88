"""What is wrong or suspicious in a scenario that loads. No plan is made and no state space searched.

Every rule asks whether certain states exist, and shows one. A state counts when the widened invariants allow it, whether
or not a plan can lead there: that a rule finds nothing is a proof, what it finds may be out of reach.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from smv_planner.model.domains import Domain
from smv_planner.model.expressions import variables_of
from smv_planner.model.model import Model
from smv_planner.planner.operations import operation_system, tasks
from smv_planner.planner.preflight.finding import Finding, Scene, Solver, core, quoted
from smv_planner.planner.preflight.firing import effects_disagree, leaves_domain, never_fires
from smv_planner.planner.preflight.operations import intentions, operations
from smv_planner.planner.preflight.settling import Copied, settling
from smv_planner.planner.preflight.values import Values, never_changes, never_produced, no_maintenance
from smv_planner.planner.reach import violations
from smv_planner.planner.widening import Widened

__all__ = ["Finding", "Solver", "Scene", "domains", "preflight", "scene"]


def domains(model: Model) -> Copied:
    """The domains of all names that the questions may use."""
    return Copied(dict[str, Domain](model.system.domains) | {copy.name: copy.domain for copy in model.copies})


def scene(model: Model, widened: Iterable[Widened], ask: Solver) -> Scene:
    """The transition planner's level of a model."""
    return Scene(model.system, tuple(one.invariant for one in widened), ask)


def preflight(model: Model, widened: tuple[Widened, ...], ask: Solver) -> tuple[Finding, ...]:
    """Everything found, rule by rule. `ask` has to know the `domains` of the model."""
    return tuple(_findings(model, widened, ask))


def _findings(model: Model, widened: tuple[Widened, ...], ask: Solver) -> Iterator[Finding]:
    here = scene(model, widened, ask)
    if here.possible(here.allowed):
        yield from _initial(here, widened)
    else:
        yield _nothing_allowed(here)
        here = Scene(here.system, (), ask)  # all else would follow from this, and say nothing
    values = Values(here, model)
    above = operation_system(model)
    abstract = Scene(above, above.invariants, ask)
    yield from settling(here)
    yield from never_fires(here)
    yield from leaves_domain(here)
    yield from leaves_domain(abstract, {task.name: task.operation.name for task in tasks(model)})
    yield from operations(here, abstract, values)
    yield from intentions(here, values)
    yield from never_changes(values)
    yield from never_produced(values)
    yield from effects_disagree(here)
    yield from no_maintenance(model)


def _nothing_allowed(here: Scene) -> Finding:
    at = core(here, [invariant.predicate for invariant in here.invariants])
    names = [here.invariants[position].name for position in at]
    violated = quoted(names) if len(names) == 1 else f"one of {quoted(names)}"
    message = f"every state violates {violated}, or may come to without any command"
    return Finding("error", "nothing-allowed", "invariant", names[0], message, "weaken one of the invariants")


def _initial(here: Scene, widened: tuple[Widened, ...]) -> Iterator[Finding]:
    """Invariants that the initial state breaks, or from which it may slide into breaking them."""
    read = {one.declared.name: variables_of(one.invariant.predicate) for one in widened}
    for found in violations(here.system, here.system.initial, widened):
        violates = f"violates '{found.invariant}'"
        slides = f"may come to violate '{found.invariant}' by {' then '.join(found.slide) or 'a long slide'}"
        yield Finding(
            "error",
            "initial-forbidden",
            "invariant",
            found.invariant,
            f"the initial state {violates if found.now else slides}: nothing can be planned from it",
            "correct the initial values, or the invariant",
            here.shown(here.system.initial, read[found.invariant]),
        )
