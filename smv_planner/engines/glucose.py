"""The SAT solver Glucose 4, as python-sat brings it along.

`pysat.solvers` knows all solvers there are, and to import it takes longer than most questions. This is the extension beneath it,
of the one version that is tried out (pyproject.toml). Literals are numbers other than 0; a negative one says no.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence

import pysolvers

CALL, CLAUSE = 400, 20
"""How many propagations take as long as to ask once, and to add a clause."""


class Glucose:
    """A solver. It keeps its clauses and what it has learnt from them."""

    def __init__(self) -> None:
        self._solver = pysolvers.glucose41_new()
        self._answer: bool | None = None
        self._calls = 0

    def add_clause(self, literals: Iterable[int]) -> None:
        pysolvers.glucose41_add_cl(self._solver, literals)

    def solve_limited(self, assumptions: Sequence[int], conflicts: int) -> bool | None:
        """Whether the clauses can be satisfied together with the assumptions; None if so many conflicts did not tell."""
        self._calls += 1
        pysolvers.glucose41_cbudget(self._solver, conflicts)
        self._answer = pysolvers.glucose41_solve_lim(self._solver, assumptions, _in_main_thread(), False)
        return self._answer

    def model(self) -> list[int]:
        """What was true, for every variable, when the clauses could be satisfied."""
        assert self._answer, "there is no model"
        found: list[int] = pysolvers.glucose41_model(self._solver)
        return found

    def core(self) -> list[int]:
        """Assumptions that cannot be satisfied together; none if the clauses alone cannot."""
        assert self._answer is False, "there is no core"
        return pysolvers.glucose41_core(self._solver) or []

    def clauses(self) -> int:
        """How many there are, without those that were learnt."""
        number: int = pysolvers.glucose41_nof_cls(self._solver)
        return number

    def work(self) -> int:
        """How much there was to do so far, in propagations: eight or nine million a second. The same on every machine."""
        propagations: int = pysolvers.glucose41_acc_stats(self._solver)["propagations"]
        return propagations + CALL * self._calls + CLAUSE * self.clauses()

    def close(self) -> None:
        if self._solver is not None:
            pysolvers.glucose41_del(self._solver)
            self._solver = None

    def __del__(self) -> None:
        self.close()


def _in_main_thread() -> int:
    """Where Ctrl-C ends a search."""
    return threading.current_thread() is threading.main_thread()
