"""Whether what planner and hubs tell each other fits into a message, whatever the values are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from smv_planner.errors import Mistake
from smv_planner.model.domains import Domain, Value
from smv_planner.protocol.interface import Interface
from smv_planner.protocol.messages import MAX_BYTES, MAX_COUNT, GoalMessage, StateMessage, encode

_IDENTITY = "x" * 64


def too_large(interfaces: Mapping[str, Interface]) -> Iterator[Mistake]:
    """One for each resource whose longest message would be dropped on its way."""
    for name, one in interfaces.items():
        goals, measured = _longest(one.goals), _longest(one.measured)
        goal = GoalMessage(one.cell, name, MAX_COUNT, MAX_COUNT, _IDENTITY, one.model, goals)
        state = StateMessage(one.cell, name, _IDENTITY, MAX_COUNT, one.model, measured, goals, MAX_COUNT, MAX_COUNT, _IDENTITY)
        size = max(len(encode(goal)), len(encode(state)))
        if size > MAX_BYTES:
            text = f"a message about resource '{name}' can have {size} bytes, and at most {MAX_BYTES} are read"
            yield Mistake(text, "make several resources of it, or shorten its names and values")


def _longest(domains: Mapping[str, Domain]) -> dict[str, Value]:
    return {name: max(domain.values, key=lambda value: len(ascii(value))) for name, domain in domains.items()}
