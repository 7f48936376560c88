"""Predicates on states as propositional clauses, for a SAT solver.

`Clauses` is a solver with gates, `Coding` an expression's literals over one table of variables: several codings, one for
each point in time, may share the clauses. `Predicates` asks about states, with one coding.

Every variable is coded directly: one literal per value, exactly one of them true. An expression of any type becomes a
table from each value it can have to a literal; Booleans have the literal of true. Shared parts are coded once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from smv_planner.clock import look
from smv_planner.engines.glucose import Glucose
from smv_planner.model.domains import Domain, Value
from smv_planner.model.expressions import And, Const, Equal, Expr, If, Less, Minus, Named, Not, Or, Plus, Var, variables_of

CONFLICTS = 2000
"""How many conflicts the solver may have before others get their turn."""

CLAUSES = 1_000_000
"""How many clauses may be kept before they are coded anew."""

Literals = Mapping[Value, int]
"""For every value that an expression can have, the literal that says it has it."""


class Predicates:
    """Asks whether predicates over one set of variables can be satisfied. Keeps what it has coded and learnt."""

    def __init__(self, domains: Mapping[str, Domain]) -> None:
        self._domains = domains
        self._begin()

    def _begin(self) -> None:
        self._clauses = Clauses()
        self._variables: dict[str, Literals] = {}
        self._coding = Coding(self._clauses, self._variable)

    def satisfiable(self, *predicates: Expr) -> bool:
        """Whether some state satisfies all the predicates."""
        if self._clauses.solver.clauses() > CLAUSES:
            self.close()
            self._begin()
        return self._clauses.solve([self._coding.literal(predicate) for predicate in predicates])

    def example(self, *predicates: Expr) -> dict[str, Value] | None:
        """What the variables that predicates read are worth in some state that satisfies all; None if there is none."""
        if not self.satisfiable(*predicates):
            return None
        true = frozenset(self._clauses.solver.model())
        found = {}
        for name in sorted(frozenset().union(*map(variables_of, predicates))):
            literals = self._variable(name)
            found[name] = next((value for value, literal in literals.items() if literal in true), next(iter(literals)))
        return found

    def close(self) -> None:
        self._clauses.close()

    def __enter__(self) -> Predicates:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _variable(self, name: str) -> Literals:
        if name not in self._variables:
            self._variables[name] = self._clauses.variable(self._domains[name].values)
        return self._variables[name]


class Coding:
    """Expressions over one table of variables, as literals."""

    def __init__(self, clauses: Clauses, variable: Callable[[str], Literals]) -> None:
        self._clauses = clauses
        self._variable = variable
        self._true = clauses.true
        self._coded: dict[Expr, int] = {}
        self._objects: dict[int, tuple[Expr, int]] = {}  # the same by identity: to compare large expressions takes time

    def literal(self, expr: Expr) -> int:
        known = self._objects.get(id(expr))
        if known is not None:
            return known[1]
        literal = self._coded.get(expr)
        if literal is None:
            literal = self._coded[expr] = self._code(expr)
        self._objects[id(expr)] = expr, literal
        return literal

    def _code(self, expr: Expr) -> int:
        match expr:
            case Not(part):
                return -self.literal(part)
            case Named(_, part):
                return self.literal(part)
            case And(parts):
                return -self._clauses.any([-self.literal(part) for part in parts])
            case Or(parts):
                return self._clauses.any([self.literal(part) for part in parts])
            case Equal(left, right):
                a, b = self.table(left), self.table(right)
                return self._clauses.any([self._both(a[value], b[value]) for value in a if value in b])
            case Less(left, right):
                return self._less(self.table(left), self.table(right))
        return self.table(expr).get(True, -self._true)

    def table(self, expr: Expr) -> Literals:
        """`expr` value by value."""
        match expr:
            case Var(name):
                return self._variable(name)
            case Const(value):
                return {value: self._true}
            case Named(_, part):
                return self.table(part)
            case If(condition, then, otherwise):
                chosen = self.literal(condition)
                return self._merged(
                    [(value, self._both(chosen, literal)) for value, literal in self.table(then).items()]
                    + [(value, self._both(-chosen, literal)) for value, literal in self.table(otherwise).items()]
                )
            case Plus(left, right) | Minus(left, right):
                sign = 1 if isinstance(expr, Plus) else -1
                return self._merged(
                    (int(x) + sign * int(y), self._both(a, b))
                    for x, a in self.table(left).items()
                    for y, b in self.table(right).items()
                )
        literal = self.literal(expr)
        return {False: -literal, True: literal}

    def _less(self, left: Literals, right: Literals) -> int:
        """Some value of `left`, and any larger one of `right`: the larger ones are gathered from the top down."""
        larger = -self._true
        found: list[int] = []
        above = sorted(right, reverse=True)
        at = 0
        for value in sorted(left, reverse=True):
            while at < len(above) and above[at] > value:  # type: ignore[operator]
                larger = self._clauses.any([larger, right[above[at]]])
                at += 1
            found.append(self._both(left[value], larger))
        return self._clauses.any(found)

    def _merged(self, cases: Iterable[tuple[Value, int]]) -> Literals:
        """The literals of each value taken together."""
        gathered: dict[Value, list[int]] = {}
        for value, literal in cases:
            if literal != -self._true:
                gathered.setdefault(value, []).append(literal)
        return {value: self._clauses.any(literals) for value, literals in gathered.items()}

    def _both(self, a: int, b: int) -> int:
        return -self._clauses.any([-a, -b])


class Clauses:
    """A solver, and literals that say what others say together. Keeps what it has learnt."""

    def __init__(self) -> None:
        self.solver = Glucose()
        self._last = 0
        self.true = self.new()
        self.solver.add_clause([self.true])

    def solve(self, assumptions: list[int]) -> bool:
        """Whether everything can hold with the assumptions; looks at the clock now and then."""
        while True:
            look()
            answer = self.solver.solve_limited(assumptions, CONFLICTS)
            if answer is not None:
                return answer

    def new(self) -> int:
        self._last += 1
        return self._last

    def add(self, *literals: int) -> None:
        self.solver.add_clause(literals)

    def variable(self, values: Sequence[Value]) -> Literals:
        """Literals for a variable that has exactly one of the values."""
        if tuple(values) == (False, True):
            literal = self.new()
            return {False: -literal, True: literal}
        literals = {value: self.new() for value in values}
        self.exactly_one(list(literals.values()))
        return literals

    def every(self, literals: Iterable[int]) -> int:
        """A literal that is true just when all of `literals` are."""
        return -self.any([-literal for literal in literals])

    def any(self, literals: Sequence[int]) -> int:
        """A literal that is true just when one of `literals` is."""
        if self.true in literals:
            return self.true
        kept = [literal for literal in dict.fromkeys(literals) if literal != -self.true]
        if len(kept) < 2:
            return kept[0] if kept else -self.true
        if any(-literal in kept for literal in kept):
            return self.true
        result = self.new()
        self.solver.add_clause([-result, *kept])
        for literal in kept:
            self.solver.add_clause([result, -literal])
        return result

    def exactly_one(self, literals: list[int]) -> None:
        """At least one, and at most one by a running 'one so far' (a sequential counter)."""
        self.solver.add_clause(literals)
        so_far = literals[0]
        for literal in literals[1:]:
            self.solver.add_clause([-so_far, -literal])
            following = self.new()
            self.solver.add_clause([-so_far, following])
            self.solver.add_clause([-literal, following])
            so_far = following

    def close(self) -> None:
        self.solver.close()
