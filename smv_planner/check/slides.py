"""May the system slide from some states into breaking an invariant? Looked at part by part.

What nobody can hold back is looked at apart where it touches nothing in common: transitions hang together by the
variables that one of them writes and another one uses, and by the invariants that read what several write. From any
state, what can follow in one part can follow whatever the others do, and an invariant is broken in its part or nowhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from smv_planner.lazy import dataclass
from smv_planner.model.expressions import Expr, variables_of
from smv_planner.model.semantics import once, slide
from smv_planner.model.system import State, System, Transition


def may_slide(system: System, states: Iterable[State], invariants: Sequence[Expr]) -> bool:
    """Whether automatic and effect transitions, in any order, may lead from one of some states to breaking an invariant.

    Raises OverflowError where one part alone is too large to be looked at, and no other slides.
    """
    starts = list(states)
    too_large: OverflowError | None = None
    for part in _parts(system, invariants):
        try:
            if slide(system, _alike(system, starts, part), part.invariants, among=part.transitions) is not None:
                return True
        except OverflowError as error:
            too_large = error
    if too_large:
        raise too_large
    return False


@dataclass(frozen=True, slots=True)
class _Part:
    """Transitions and invariants that hang together, and all variables that they use."""

    used: frozenset[str]
    transitions: tuple[Transition, ...]
    invariants: tuple[Expr, ...]


def _alike(system: System, states: list[State], part: _Part) -> Iterable[State]:
    """The states as far as they matter to a part; all else is as in the first."""
    kept = [variable.name in part.used for variable in system.variables]
    for state in states:
        yield tuple([value if keep else other for value, other, keep in zip(state, states[0], kept, strict=True)])


def _parts(system: System, invariants: Sequence[Expr]) -> Iterable[_Part]:
    moves = [transition for transition in system.transitions if transition.kind.uncontrollable and transition.actions]
    written = frozenset().union(*(transition.assigned for transition in moves))
    uses = {id(each): each.used for each in moves}
    uses |= {id(each): once(system, "reads", each, lambda _, expr: variables_of(expr)) for each in invariants}
    part_of = {name: name for name in written}

    def part(name: str) -> str:
        while part_of[name] != name:
            part_of[name] = name = part_of[part_of[name]]
        return name

    for used in uses.values():
        first, *others = sorted(used & written) or [""]
        for other in others:
            part_of[part(other)] = part(first)
    together: dict[str, tuple[list[Transition], list[Expr]]] = {}
    for move in moves:
        together.setdefault(part(min(move.assigned)), ([], []))[0].append(move)
    for invariant in invariants:  # what nothing writes is a part of its own
        name = min(uses[id(invariant)] & written, default="")
        together.setdefault(part(name) if name else name, ([], []))[1].append(invariant)
    for transitions, held in together.values():
        if held:
            used = frozenset().union(*(uses[id(each)] for each in (*transitions, *held)))
            yield _Part(used, tuple(transitions), tuple(held))
