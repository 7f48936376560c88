"""Predicates on states as propositional clauses, for python-sat.

Every variable is coded directly: one literal per value, exactly one of them true. An expression of any type becomes a
table from each value it can have to a literal; Booleans have the literal of true. Shared parts are coded once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from pysat.solvers import Solver

from smv_planner.model.domains import Domain, Value
from smv_planner.model.expressions import And, Const, Equal, Expr, If, Less, Minus, Named, Not, Or, Plus, Var, variables_of

SOLVER = "glucose4"

Literals = Mapping[Value, int]
"""For every value that an expression can have, the literal that says it has it."""


class Predicates:
    """Asks whether predicates over one set of variables can be satisfied. Keeps what it has coded and learnt."""

    def __init__(self, domains: Mapping[str, Domain]) -> None:
        self._domains = domains
        self._solver = Solver(name=SOLVER)
        self._last = 0
        self._true = self._new()
        self._solver.add_clause([self._true])
        self._variables: dict[str, Literals] = {}
        self._coded: dict[Expr, int] = {}
        self._objects: dict[int, tuple[Expr, int]] = {}  # the same by identity: to compare large expressions takes time

    def satisfiable(self, *predicates: Expr) -> bool:
        """Whether some state satisfies all the predicates."""
        return bool(self._solver.solve(assumptions=[self._literal(predicate) for predicate in predicates]))

    def example(self, *predicates: Expr) -> dict[str, Value] | None:
        """What the variables that predicates read are worth in some state that satisfies all; None if there is none."""
        if not self.satisfiable(*predicates):
            return None
        true = frozenset(self._solver.get_model())
        found = {}
        for name in sorted(frozenset().union(*map(variables_of, predicates))):
            literals = self._variable(name)
            found[name] = next((value for value, literal in literals.items() if literal in true), next(iter(literals)))
        return found

    def close(self) -> None:
        self._solver.delete()

    def __enter__(self) -> Predicates:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _literal(self, expr: Expr) -> int:
        if id(expr) not in self._objects:
            if expr not in self._coded:
                self._coded[expr] = self._code(expr)
            self._objects[id(expr)] = expr, self._coded[expr]
        return self._objects[id(expr)][1]

    def _code(self, expr: Expr) -> int:
        match expr:
            case Not(part):
                return -self._literal(part)
            case Named(_, part):
                return self._literal(part)
            case And(parts):
                return -self._any([-self._literal(part) for part in parts])
            case Or(parts):
                return self._any([self._literal(part) for part in parts])
            case Equal(left, right):
                a, b = self._table(left), self._table(right)
                return self._any([self._both(a[value], b[value]) for value in a if value in b])
            case Less(left, right):
                return self._less(self._table(left), self._table(right))
        return self._table(expr).get(True, -self._true)

    def _table(self, expr: Expr) -> Literals:
        """`expr` value by value."""
        match expr:
            case Var(name):
                return self._variable(name)
            case Const(value):
                return {value: self._true}
            case Named(_, part):
                return self._table(part)
            case If(condition, then, otherwise):
                chosen = self._literal(condition)
                return self._merged(
                    [(value, self._both(chosen, literal)) for value, literal in self._table(then).items()]
                    + [(value, self._both(-chosen, literal)) for value, literal in self._table(otherwise).items()]
                )
            case Plus(left, right) | Minus(left, right):
                sign = 1 if isinstance(expr, Plus) else -1
                return self._merged(
                    (int(x) + sign * int(y), self._both(a, b))
                    for x, a in self._table(left).items()
                    for y, b in self._table(right).items()
                )
        literal = self._literal(expr)
        return {False: -literal, True: literal}

    def _variable(self, name: str) -> Literals:
        if name not in self._variables:
            values = self._domains[name].values
            if values == (False, True):
                literal = self._new()
                self._variables[name] = {False: -literal, True: literal}
            else:
                self._variables[name] = {value: self._new() for value in values}
                self._exactly_one(list(self._variables[name].values()))
        return self._variables[name]

    def _less(self, left: Literals, right: Literals) -> int:
        """Some value of `left`, and any larger one of `right`: the larger ones are gathered from the top down."""
        larger = -self._true
        found: list[int] = []
        above = sorted(right, reverse=True)
        at = 0
        for value in sorted(left, reverse=True):
            while at < len(above) and above[at] > value:  # type: ignore[operator]
                larger = self._any([larger, right[above[at]]])
                at += 1
            found.append(self._both(left[value], larger))
        return self._any(found)

    def _merged(self, cases: Iterable[tuple[Value, int]]) -> Literals:
        """The literals of each value taken together."""
        gathered: dict[Value, list[int]] = {}
        for value, literal in cases:
            if literal != -self._true:
                gathered.setdefault(value, []).append(literal)
        return {value: self._any(literals) for value, literals in gathered.items()}

    def _both(self, a: int, b: int) -> int:
        return -self._any([-a, -b])

    def _any(self, literals: list[int]) -> int:
        """A literal that is true just when one of `literals` is."""
        if self._true in literals:
            return self._true
        kept = [literal for literal in dict.fromkeys(literals) if literal != -self._true]
        if len(kept) < 2:
            return kept[0] if kept else -self._true
        if any(-literal in kept for literal in kept):
            return self._true
        result = self._new()
        self._solver.add_clause([-result, *kept])
        for literal in kept:
            self._solver.add_clause([result, -literal])
        return result

    def _exactly_one(self, literals: list[int]) -> None:
        """At least one, and at most one by a running 'one so far' (a sequential counter)."""
        self._solver.add_clause(literals)
        so_far = literals[0]
        for literal in literals[1:]:
            self._solver.add_clause([-so_far, -literal])
            following = self._new()
            self._solver.add_clause([-so_far, following])
            self._solver.add_clause([-literal, following])
            so_far = following

    def _new(self) -> int:
        self._last += 1
        return self._last
