"""Sequences of operations: nested steps -> positions that wait for positions."""

from __future__ import annotations

from collections.abc import Sequence as AnySequence
from typing import NamedTuple

from smv_planner.language.document import Parallel, Scenario, Steps
from smv_planner.language.names import World
from smv_planner.language.reader import UNREADABLE, Path, other_one
from smv_planner.model.model import Sequence

Waited = tuple[int, ...]
"""The positions that something directly waits for."""


class Position(NamedTuple):
    operation: str
    after: Waited
    path: Path


def sequence_of(steps: Steps | None, manual: bool | None, path: Path, scenario: Scenario, world: World) -> Sequence | None:
    """The sequence that stands at `path`, if one does."""
    if steps is None or steps is UNREADABLE:
        if manual is not None and steps is None:
            hint = "it says that the sequence is the plan"
            world.report.wrong_key((*path[:-1], "manual"), "'manual' stands without 'sequence'", hint)
        return None
    positions: list[Position] = []
    _in_order(steps, path, (), positions, world)
    seen: dict[str, Path] = {}
    for each in positions:
        if each.operation in seen and manual is not True:
            line = other_one(world.report.nodes[seen[each.operation]])
            hint = "; ".join(filter(None, (line, "only a manual sequence repeats operations")))
            world.report.wrong(each.path, f"'{each.operation}' is in the sequence twice", hint)
        seen[each.operation] = each.path
        _known(each, scenario, world)
    return Sequence(tuple(each.operation for each in positions), tuple(each.after for each in positions), manual is True)


def _known(position: Position, scenario: Scenario, world: World) -> None:
    operations = scenario.operations if scenario.operations is not UNREADABLE else {}
    if position.operation not in operations and world.report.holes.isdisjoint(((), ("operations",))):
        hint = world.report.close(position.operation, tuple(operations))
        world.report.wrong(position.path, f"unknown operation '{position.operation}'", hint)


def _in_order(steps: AnySequence[object], path: Path, before: Waited, positions: list[Position], world: World) -> Waited:
    """What waits for the last of the steps waits for these positions."""
    if not steps:
        world.report.wrong(path, "there is no operation here", "name what runs, or leave it out")
    for at, step in enumerate(steps):
        before = _step(step, (*path, str(at)), before, positions, world)
    return before


def _step(step: object, path: Path, before: Waited, positions: list[Position], world: World) -> Waited:
    match step:
        case str(operation):
            positions.append(Position(operation, before, path))
            return (len(positions) - 1,)
        case list(steps):
            return _in_order(steps, path, before, positions, world)
        case Parallel(branches) if branches is not UNREADABLE:
            inner = (*path, "parallel")
            if not branches:
                world.report.wrong(inner, "there is no branch here", "name what runs side by side")
            ends = [_step(each, (*inner, str(at)), before, positions, world) for at, each in enumerate(branches)]
            return tuple(dict.fromkeys(end for branch in ends for end in branch)) or before
    return before
