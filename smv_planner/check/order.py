"""Is every linearisation of a partial order a plan? (Machines 2021, section 4.2: de-ordering after the search.)

Steps come in blocks: a step that the planner or the environment brings about, with the automatic steps it triggers,
which nothing can come between. The order's ideals (sets of blocks closed under predecessors) are explored within a
budget; in each, every block that may come next is fired by the model's own semantics.
"""

from __future__ import annotations

from collections.abc import Sequence

from smv_planner.clock import look
from smv_planner.model.ltl import Monitor, Obligations
from smv_planner.model.semantics import Steps
from smv_planner.model.system import State
from smv_planner.problem import Problem, Reached

Order = tuple[int, ...]
"""For each step the set of all steps that must come before it, as bits; transitively closed."""

BUDGET = 20_000
"""How many ideals are looked at before the order counts as not certified."""


def total_order(length: int) -> Order:
    return tuple((1 << at) - 1 for at in range(length))


def is_order(order: Order, length: int) -> bool:
    """Transitively closed, and no step waits for a later one."""
    return len(order) == length and all(
        before >> at == 0 and all(order[other] | before == before for other in _bits(before)) for at, before in enumerate(order)
    )


def reduced(order: Order) -> tuple[tuple[int, ...], ...]:
    """The transitive reduction: for each step only those it directly waits for."""
    result = []
    for before in order:
        implied = 0
        for other in _bits(before):
            implied |= order[other]
        result.append(tuple(_bits(before & ~implied)))
    return tuple(result)


def blocks(problem: Problem, path: Sequence[str]) -> list[range]:
    """The steps grouped: each automatic step belongs to the step that triggers it."""
    starts = [at for at, name in enumerate(path) if at == 0 or not problem.system.transition[name].kind.automatic]
    return [range(start, end) for start, end in zip(starts, [*starts[1:], len(path)], strict=False)]


def certified(problem: Problem, trace: Reached, order: Order) -> set[State] | None:
    """Every state that some linearisation visits, if all of them are possible, meet the goals and end alike; else None.

    Whether those states are allowed is for the caller to judge.
    """
    groups = blocks(problem, trace.path)
    waits = [_waits(group, order) for group in groups]
    if any(order[at] >> (at - 1) & 1 == 0 for group in groups for at in group[1:]):
        return None
    block_of = {at: number for number, group in enumerate(groups) for at in group}
    needs = [sum({1 << block_of[at] for at in _bits(wait)}) for wait in waits]
    if _too_many(needs):
        return None

    steps = problem.steps
    monitor = Monitor(problem.formula, problem.system.index)
    everything = (1 << len(groups)) - 1
    start: tuple[int, State, tuple[Obligations, ...]] = (0, problem.initial, (monitor.start,))
    seen, waiting = {start}, [start]
    visited = {problem.initial}
    while waiting:
        look()
        done, state, owed = waiting.pop()
        if done == everything:
            if state != trace.states[-1] or not any(monitor.met_by_idling(way, state) for way in owed):
                return None
            continue
        for number, group in enumerate(groups):
            if done >> number & 1 or needs[number] & ~done:
                continue
            run = _fire(problem, steps, trace, group, state)
            if run is None:
                return None
            ways = owed
            for before in run[:-1]:
                ways = _advance(monitor, ways, before)
            visited.update(run)
            following = (done | 1 << number, run[-1], ways)
            if ways and following not in seen:
                seen.add(following)
                waiting.append(following)
            if not ways or len(seen) > BUDGET:
                return None
    return visited


def _too_many(needs: Sequence[int]) -> bool:
    """Whether an order has more ideals than are looked at. To count them takes far less time than to fire their blocks."""
    if 1 << len(needs) <= BUDGET:
        return False
    seen, waiting = {0}, [0]
    while waiting and len(seen) <= BUDGET:
        done = waiting.pop()
        for number, needed in enumerate(needs):
            if not (done >> number & 1 or needed & ~done):
                following = done | 1 << number
                if following not in seen:
                    seen.add(following)
                    waiting.append(following)
    return len(seen) > BUDGET


def _fire(problem: Problem, steps: Steps, trace: Reached, group: range, state: State) -> list[State] | None:
    """The states when a block is fired from `state` with the trace's own choices; None if it goes otherwise there."""
    run = [state]
    for at in group:
        after = steps.again(run[-1], problem.system.transition[trace.path[at]], trace.states[at + 1])
        if after is None:
            return None
        run.append(after)
    return run if steps.settled(run[-1]) else None


def _advance(monitor: Monitor, ways: tuple[Obligations, ...], state: State) -> tuple[Obligations, ...]:
    return tuple(sorted({after for way in ways for after in monitor.after(way, state)}))


def _waits(group: range, order: Order) -> int:
    """All steps outside a block that any step of it waits for."""
    waits = 0
    for at in group:
        waits |= order[at]
    return waits & ~sum(1 << at for at in group)


def _bits(bits: int) -> list[int]:
    return [at for at in range(bits.bit_length()) if bits >> at & 1]
