"""What is kept of a system between questions: everything here depends on the system, nothing on an earlier question.

Systems compare by identity, so a session is found again for as long as the same system is asked about. What few questions
need is imported when one does: `smv-plan` starts for one question.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from smv_planner.engines.auto.grounding import Ground, Shared, ground
from smv_planner.engines.auto.parts import Part, Parts
from smv_planner.engines.auto.search import Tables
from smv_planner.model.system import Invariant, System

if TYPE_CHECKING:
    from smv_planner.engines.auto.bounded import Unrolled
    from smv_planner.engines.auto.guide import Guide
    from smv_planner.engines.auto.mutexes import Mutexes
    from smv_planner.engines.auto.relaxed import Abstraction
    from smv_planner.engines.auto.symmetry import Symmetries

SYSTEMS = 64
"""How many systems stay warm."""

VARIANTS = 16
"""How many sets of allowed invariants stay warm for one system."""

CLAUSES = 3_000_000
"""How many clauses the SAT solver may hold before the next question begins with a new one."""

QUESTIONS = 500
"""After how many questions it does so in any case, for it remembers their formulas."""


class Session:
    def __init__(self, system: System) -> None:
        self.shared: Shared = session_of(system.base).shared if system.base else Shared(system)
        self.actions = self.shared.actions(system)
        self._system = system
        self._variants: dict[tuple[int, ...], tuple[tuple[Invariant, ...], Ground, Tables]] = {}
        self._abstractions: dict[Ground, Abstraction] = {}
        self._hard: set[Ground] = set()
        self._guides: dict[Ground, Guide] = {}
        self._mutexes: dict[Ground, Mutexes] = {}
        self._parts: dict[Ground, Parts] = {}
        self._symmetries: dict[Ground, Symmetries] = {}
        self._sessions: WeakKeyDictionary[Part, Session] = WeakKeyDictionary()
        self._unrolled: Unrolled | None = None
        self._asked = 0

    def variant(self, allowed: tuple[Invariant, ...]) -> tuple[Ground, Tables]:
        """The system under a set of allowed invariants, and the moves of its actions."""
        key = tuple(map(id, allowed))  # to compare large expressions takes time
        found = self._variants.pop(key, None)
        if found is None:
            of = ground(self._system, self.actions, allowed, self.shared)
            found = allowed, of, Tables(of)
        self._variants[key] = found  # last in is last out
        if len(self._variants) > VARIANTS:
            _, dropped, _ = self._variants.pop(next(iter(self._variants)))
            self._abstractions.pop(dropped, None)
            self._hard.discard(dropped)
            self._guides.pop(dropped, None)
            self._mutexes.pop(dropped, None)
            self._parts.pop(dropped, None)
            self._symmetries.pop(dropped, None)
        _, of, tables = found
        self.shared.trim()
        tables.trim()
        return of, tables

    def hard(self, of: Ground) -> bool:
        """Whether a question was hard."""
        return of in self._hard

    def was_hard(self, of: Ground) -> None:
        self._hard.add(of)

    def abstraction(self, of: Ground) -> Abstraction:
        if of not in self._abstractions:
            from smv_planner.engines.auto.relaxed import Abstraction

            self._abstractions[of] = Abstraction(of)
        self._abstractions[of].trim()
        return self._abstractions[of]

    def guide(self, of: Ground) -> Guide:
        if of not in self._guides:
            from smv_planner.engines.auto.guide import Guide

            self._guides[of] = Guide(of, self.abstraction(of))
        return self._guides[of]

    def mutexes(self, of: Ground) -> Mutexes:
        if of not in self._mutexes:
            from smv_planner.engines.auto.mutexes import Mutexes

            self._mutexes[of] = Mutexes(of)
        return self._mutexes[of]

    def parts(self, of: Ground) -> Parts:
        if of not in self._parts:
            self._parts[of] = Parts(of)
        return self._parts[of]

    def symmetries(self, of: Ground) -> Symmetries:
        if of not in self._symmetries:
            from smv_planner.engines.auto.symmetry import Symmetries

            self._symmetries[of] = Symmetries(of)
        return self._symmetries[of]

    def of_part(self, part: Part) -> Session:
        """What is kept of a part of the system; for as long as the part is."""
        if part not in self._sessions:
            self._sessions[part] = Session(part.system)
        return self._sessions[part]

    def unrolled(self) -> Unrolled:
        """The layers for the SAT solver; made when they are first needed, and anew when they have grown too much."""
        self._asked += 1
        if self._unrolled is not None:
            too_many = not self._unrolled.whole or self._unrolled.clauses.solver.clauses() > CLAUSES
            if too_many or self._asked % QUESTIONS == 0:
                self._unrolled.clauses.close()
                self._unrolled = None
        if self._unrolled is None:
            from smv_planner.engines.auto.bounded import Unrolled

            self._unrolled = Unrolled(self._system, self.actions)
        return self._unrolled


@lru_cache(maxsize=SYSTEMS)
def session_of(system: System) -> Session:
    return Session(system)
