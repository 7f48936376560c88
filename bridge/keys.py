"""Under which keys the messages of an installation travel.

`smv/CELL/RESOURCE/...` is between planner and hubs, `smv_planner/CELL/...` is what the planner publishes for everybody
and where it takes orders. A cell is one installation; several may share a network.
"""

from __future__ import annotations

import re

from smv_planner.errors import Mistake, UsageError

PLANNERS = "smv_planner/"
"""How all keys begin where planners tell something and take orders."""


def goal(cell: str, resource: str) -> str:
    """Goal messages, from the planner to the hub of a resource."""
    return f"smv/{cell}/{resource}/goal"


def state(cell: str, resource: str = "*") -> str:
    """State messages, from the hub of a resource; without one, of all."""
    return f"smv/{cell}/{resource}/state"


def goals(cell: str) -> str:
    """The goal messages to all resources."""
    return goal(cell, "*")


def behaviour(cell: str, resource: str) -> str:
    """Where an emulated hub is asked to behave otherwise; real hubs do not answer there."""
    return f"smv/{cell}/{resource}/behaviour"


def perform(cell: str, resource: str) -> str:
    """Where an emulated device is told what a person has done to it."""
    return f"smv/{cell}/{resource}/perform"


def alive(cell: str, resource: str = "*") -> str:
    """Liveliness of hubs: a hint for people, never a reason to plan."""
    return f"smv/{cell}/{resource}/alive"


def situation(cell: str) -> str:
    return f"smv_planner/{cell}/situation"


def plan(cell: str) -> str:
    return f"smv_planner/{cell}/plan"


def event(cell: str) -> str:
    return f"smv_planner/{cell}/event"


def operator(cell: str) -> str:
    """What the operator is asked for and has not answered."""
    return f"smv_planner/{cell}/operator"


def order(cell: str) -> str:
    """Where the planner takes orders and answers them."""
    return f"smv_planner/{cell}/order"


def health(cell: str) -> str:
    return f"smv_planner/{cell}/health"


def planner(cell: str) -> str:
    """Liveliness of a planner."""
    return f"smv_planner/{cell}/alive"


def resource_of(key: str) -> str | None:
    """Whose key between planner and hubs this is."""
    match key.split("/"):
        case ["smv", _, resource, _]:
            return resource
    return None


def checked_cell(name: str) -> str:
    """The name, if it can stand in a key. Raises UsageError."""
    if not _CELL.fullmatch(name):
        hint = "a cell is named by 1 to 64 letters, digits, '_', '.' or '-'; name one with --cell"
        raise UsageError([Mistake(f"'{name[:80]}' cannot be the name of a cell", hint)])
    return name


_CELL = re.compile(r"[\w.-]{1,64}")
