"""What widening adds to invariants: how many states, and through which transitions (Machines 2021, section 3)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import prod

from smv_planner.lazy import dataclass
from smv_planner.model.expressions import Const, Expr, conjunction, meaning, negation, substitute, variables_of
from smv_planner.model.system import System
from smv_planner.planner.widening import Growth, Widened

BUDGET = 20_000
"""How many different expressions counting may come across."""


@dataclass(frozen=True, slots=True)
class Grown:
    """An invariant's states, as combinations of the variables that its widened form reads.

    `forbidden` are those that break it as declared, `added` those that its widening adds, of `states` in all. The two are
    None if there are too many different cases to count; every piece of `growth` adds one state at least.
    """

    invariant: str
    variables: tuple[str, ...]
    states: int
    forbidden: int | None
    added: int | None
    growth: tuple[Growth, ...]


def growth(system: System, widened: Iterable[Widened]) -> Iterator[Grown]:
    for one in widened:
        read = variables_of(one.invariant.predicate)
        variables = tuple(variable.name for variable in system.variables if variable.name in read)
        bad = negation(one.declared.predicate)
        yield Grown(
            one.declared.name,
            variables,
            prod(len(system.domains[name].values) for name in variables),
            count(system, bad, variables),
            count(system, conjunction([one.declared.predicate, negation(one.invariant.predicate)]), variables),
            one.growth,
        )


def count(system: System, predicate: Expr, variables: tuple[str, ...], budget: int = BUDGET) -> int | None:
    """How many combinations of values of `variables` satisfy a predicate over them; None beyond the budget.

    Variables are set one after the other; what remains of the predicate is counted once.
    """
    sizes = {name: len(system.domains[name].values) for name in variables}
    done: dict[Expr, int] = {}

    def of(expr: Expr) -> int:
        """Over the variables that the expression reads."""
        read = variables_of(expr)
        if not read:
            return int(meaning(expr, {})(()))
        if expr not in done:
            if len(done) >= budget:
                raise OverflowError
            chosen = next(name for name in variables if name in read)
            rests = (substitute(expr, {chosen: Const(value)}) for value in system.domains[chosen].values)
            done[expr] = sum(of(rest) * prod(sizes[name] for name in read - variables_of(rest) - {chosen}) for rest in rests)
        return done[expr]

    try:
        return of(predicate) * prod(sizes[name] for name in set(variables) - variables_of(predicate))
    except OverflowError:
        return None
