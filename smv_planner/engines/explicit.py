"""Breadth-first search over explicit states: slow, exact, and right by inspection.

It looks at every state that can follow, together with what the formula still asks for there, nearest first. The first
hit is a shortest plan; running out of states proves that there is none. All other engines are held to this one.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from smv_planner.model.expressions import conjunction, meaning
from smv_planner.model.ltl import Monitor, Obligations
from smv_planner.model.semantics import Steps
from smv_planner.model.system import State
from smv_planner.problem import Exhausted, NotWithin, Problem, Reached, Undecided, Unreachable, Verdict

if TYPE_CHECKING:
    from smv_planner.engines import Limits

Node = tuple[State, Obligations]

BYTES_PER_NODE = 1000
"""A generous guess, so that the memory limit ends the search before the machine does."""


def ask(problem: Problem, limits: Limits) -> Verdict:
    """Search as far as `problem.bound`, `limits.deadline` and `limits.memory` allow."""
    ends = time.monotonic() + limits.deadline
    steps = Steps(problem.system, problem.usable)
    monitor = Monitor(problem.formula, problem.system.index)
    allowed = meaning(conjunction(i.predicate for i in problem.allowed), problem.system.index)

    start: Node = (problem.initial, monitor.start)
    came_from: dict[Node, tuple[Node, str] | None] = {start: None}
    frontier = [start] if allowed(problem.initial) else []
    for depth in range(problem.bound + 1):
        limits.progress(f"{len(came_from)} states, {depth} steps deep")
        following: list[Node] = []
        for node in frontier:
            state, owed = node
            if steps.settled(state) and monitor.met_by_idling(owed, state):
                return _trace(node, came_from)
            if time.monotonic() > ends:
                return Undecided(f"the deadline passed {depth} steps deep", deadline=True)
            if len(came_from) * BYTES_PER_NODE > limits.memory:
                return Undecided(f"memory limit at {len(came_from)} states, {depth} steps deep", deadline=False)
            ways = monitor.after(owed, state)
            if not ways:
                continue
            for transition, after in steps(state):
                for way in ways:
                    if (after, way) not in came_from and allowed(after):
                        came_from[after, way] = (node, transition.name)
                        following.append((after, way))
        if not following:
            return Unreachable(Exhausted(frozenset(came_from)), "breadth-first search looked at every state that can follow")
        frontier = following
    return NotWithin(problem.bound, "breadth-first search looked at every plan within the bound")


def _trace(node: Node, came_from: dict[Node, tuple[Node, str] | None]) -> Reached:
    path, states = [], [node[0]]
    while (origin := came_from[node]) is not None:
        node, name = origin
        path.append(name)
        states.append(node[0])
    return Reached(tuple(reversed(path)), tuple(reversed(states)), "breadth-first search looked at every shorter plan")
