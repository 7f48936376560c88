"""Between planner and hub: which variables of a resource travel, and what values they may have."""

from __future__ import annotations

from collections.abc import Mapping

from smv_planner.lazy import dataclass
from smv_planner.model.domains import Domain
from smv_planner.model.model import Model
from smv_planner.model.system import VariableKind


@dataclass(frozen=True, slots=True)
class Interface:
    """What is agreed on between the planner and the hub of one resource.

    Variables have their full names and stand in declared order, which is the order of every message. `cell` separates
    installations that share a network; `model` is the hash of the model, so that nobody obeys another version.
    """

    cell: str
    resource: str
    goals: Mapping[str, Domain]
    measured: Mapping[str, Domain]
    model: str


def interfaces(model: Model, cell: str) -> dict[str, Interface]:
    """The interface of every resource, by name, in declared order."""

    def domains(resource: str, kind: VariableKind) -> dict[str, Domain]:
        return {v.name: v.domain for v in model.variables if v.resource == resource and v.kind is kind}

    return {
        resource.name: Interface(
            cell,
            resource.name,
            domains(resource.name, VariableKind.GOAL),
            domains(resource.name, VariableKind.MEASURED),
            model.hash,
        )
        for resource in model.resources
    }
