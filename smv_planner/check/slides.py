"""May the system slide from some states into breaking an invariant? Looked at part by part.

What nobody can hold back is looked at apart where it touches nothing in common: transitions hang together by the
variables that one of them writes and another one uses, and by the invariants that read what several write. From any
state, what can follow in one part can follow whatever the others do, and an invariant is broken in its part or nowhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import compress

from smv_planner.model.expressions import Expr, variables_of
from smv_planner.model.semantics import REMEMBERED, once, slide
from smv_planner.model.system import State, System, Transition


def may_slide(system: System, states: Iterable[State], invariants: Sequence[Expr]) -> bool:
    """Whether automatic and effect transitions, in any order, may lead from one of some states to breaking an invariant.

    Raises OverflowError where one part alone is too large to be looked at, and no other slides.
    """
    starts = list(states)
    too_large: OverflowError | None = None
    for part in _parts(system, invariants):
        try:
            if part.may_slide(system, starts):
                return True
        except OverflowError as error:
            too_large = error
    if too_large:
        raise too_large
    return False


class _Part:
    """Transitions and invariants that hang together; it remembers from where nothing slides."""

    def __init__(self, system: System, used: frozenset[str], transitions: tuple[Transition, ...], invariants: tuple[Expr, ...]):
        self.transitions, self.invariants = transitions, invariants
        self._uses = [variable.name in used for variable in system.variables]
        self._safe: set[State] = set()

    def may_slide(self, system: System, states: Iterable[State]) -> bool:
        """Whether its transitions may lead from one of the states to breaking one of its invariants."""
        alike = {tuple(compress(state, self._uses)): state for state in states}
        fresh = [state for values, state in alike.items() if values not in self._safe]
        if fresh and slide(system, self._with_the_rest_alike(fresh), self.invariants, among=self.transitions) is not None:
            return True
        if len(self._safe) > REMEMBERED:
            self._safe.clear()
        self._safe.update(alike)
        return False

    def _with_the_rest_alike(self, states: list[State]) -> Iterable[State]:
        """The states as far as they matter to the part; all else is as in the first."""
        for state in states:
            yield tuple([value if used else other for value, other, used in zip(state, states[0], self._uses, strict=True)])


def _parts(system: System, invariants: Sequence[Expr]) -> Sequence[_Part]:
    """The parts, known again by identity; those that are the same in systems with the same base are one."""
    asked = once(system, _none_asked, system)
    if (key := _ids(invariants)) not in asked:
        of_base = once(system, _none_made, system.variables)
        found = []
        for used, transitions, held in _apart(system, invariants):
            own = _ids(transitions), _ids(held)
            if own not in of_base:
                of_base[own] = _Part(system, used, transitions, held)
            found.append(of_base[own])
        asked[key] = tuple(invariants), found
    return asked[key][1]


Ids = tuple[int, ...]


def _none_asked(system: System, of: System) -> dict[Ids, tuple[tuple[Expr, ...], list[_Part]]]:
    """By invariants: these, and their parts."""
    return {}


def _none_made(system: System, of: object) -> dict[tuple[Ids, Ids], _Part]:
    """By transitions and invariants."""
    return {}


def _reads(system: System, invariant: Expr) -> frozenset[str]:
    return variables_of(invariant)


def _ids(things: Iterable[object]) -> Ids:
    return tuple(map(id, things))


def _apart(
    system: System, invariants: Sequence[Expr]
) -> Iterator[tuple[frozenset[str], tuple[Transition, ...], tuple[Expr, ...]]]:
    """For each part the variables that it uses, its transitions and its invariants."""
    moves = [transition for transition in system.transitions if transition.kind.uncontrollable and transition.actions]
    written = frozenset().union(*(transition.assigned for transition in moves))
    uses = {id(each): each.used for each in moves}
    uses |= {id(each): once(system, _reads, each) for each in invariants}
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
            yield used, tuple(transitions), tuple(held)
