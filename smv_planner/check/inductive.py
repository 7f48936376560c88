"""Do these clauses hold whatever happens, and rule the goals out? An encoding of the kernel's own asks a SAT solver.

It shares nothing with the engines' encoding: conditions that are not plain connectives become tables of what
`expressions.meaning` says for all values of their variables, every transition is asked about by itself, and the solver
is another one. Obligations are expanded as `ltl.Monitor` does it, but may leave more than they have to.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import combinations, product
from math import prod

from pysat.solvers import Solver

from smv_planner.clock import look
from smv_planner.model.domains import Value
from smv_planner.model.expressions import And, Expr, If, Named, Not, Or, meaning, variables_of
from smv_planner.model.ltl import Atom, Both, Either, Formula, Next, Release, Until
from smv_planner.model.semantics import ready
from smv_planner.model.system import Any, System, Transition
from smv_planner.problem import Clause, Inductive, Problem

SOLVER = "minisat22"

CONFLICTS = 2000
"""How many conflicts there may be before the clock is looked at."""

TABLE = 100_000
"""How many rows a table may have; beyond that a proof is refused rather than checked for ever."""


def broken(problem: Problem, proof: Inductive) -> str | None:
    """Why the clauses prove nothing; None if they do. Raises OverflowError if a condition reads too much to be looked at."""
    domains = problem.system.domains
    for clause in proof.clauses:
        if not all(name in domains and value in domains[name].values for name, value in clause.differs):
            return "the proof speaks of variables or values that do not exist"
    with Solver(name=SOLVER) as solver:
        return _Check(problem, proof, solver).broken()


class _Check:
    def __init__(self, problem: Problem, proof: Inductive, solver: Solver) -> None:
        self.problem, self.proof, self.solver = problem, proof, solver
        self.last = 0
        self.now = _Instant(self, problem.system)
        self.later = _Instant(self, problem.system)
        self.formulas: list[tuple[Formula, tuple[int, ...]]] = []
        self.start = self.number(problem.formula)
        self.owed = [self.new() for _ in self.formulas]
        self.left = [self.new() for _ in self.formulas]

    def broken(self) -> str | None:
        state = self.problem.system.named(self.problem.initial)
        for clause in self.proof.clauses:
            if self.start not in clause.owes and all(state[name] == value for name, value in clause.differs):
                return "the initial state breaks one of the proof's clauses"
        allowed = [invariant.predicate for invariant in self.problem.allowed]
        for clause in self.proof.clauses:
            self.add(*(-self.now.values[name][value] for name, value in clause.differs), *self.bits(clause, self.owed))
        for predicate in allowed:
            self.add(self.now.literal(predicate))
        ends, goes_on = self.new(), self.new()
        for number, owed in enumerate(self.owed):
            self.add(-ends, -owed, self.idling(number))
            self.add(-goes_on, -owed, self.expanded(number))
        settled = self.now.literal(self.problem.settled)
        if self.solved([ends, settled]):
            return "the proof's clauses do not rule out that the goals are met"
        for predicate in allowed:
            self.add(-goes_on, self.later.literal(predicate))
        self.add(-goes_on, *map(self.violated, self.proof.clauses))
        return self.leaves(goes_on, settled)

    def leaves(self, goes_on: int, settled: int) -> str | None:
        """The transition that leads to a state where a clause does not hold."""
        steps = {transition.name: self.new() for transition in self.problem.usable}
        before: list[int] = []
        for transition in self.problem.usable:
            look()
            enabled = self.now.literal(ready(self.problem.system, transition))
            first = [-other for other in before] if transition.kind.automatic else [settled]
            for needed in (enabled, *first):
                self.add(-steps[transition.name], needed)
            if transition.kind.automatic:
                before.append(enabled)
            self.assigns(transition, steps[transition.name])
        for name, values in self.now.values.items():
            writers = [steps[t.name] for t in self.problem.usable if name in t.assigned]
            for value, literal in values.items():
                self.add(-literal, self.later.values[name][value], *writers)
        for transition in self.problem.usable:
            alone = [literal if name == transition.name else -literal for name, literal in steps.items()]
            if self.solved([goes_on, *alone]):
                return f"the proof's clauses do not hold after '{transition.name}'"
        return None

    def assigns(self, transition: Transition, step: int) -> None:
        for action in transition.actions:
            if isinstance(action.value, Any):
                continue
            after = self.later.values[action.variable]
            for conditions, rows in self.now.cases(action.value):
                for row, value in rows:
                    if value in after:
                        self.add(-step, *(-literal for literal in (*conditions, *row)), after[value])
        if any(isinstance(action.value, Any) for action in transition.actions):
            self.add(-step, *(-self.stays(name) for name in sorted(transition.assigned)))

    def stays(self, name: str) -> int:
        """That a variable keeps its value."""
        stays = self.new()
        for value, literal in self.now.values[name].items():
            after = self.later.values[name][value]
            self.add(-stays, -literal, after)
            self.add(stays, -literal, -after)
        return stays

    def violated(self, clause: Clause) -> int:
        """That a clause does not hold later."""
        literal = self.new()
        for name, value in clause.differs:
            self.add(-literal, self.later.values[name][value])
        for bit in self.bits(clause, self.left):
            self.add(-literal, -bit)
        return literal

    def bits(self, clause: Clause, literals: list[int]) -> list[int]:
        return [literals[number] for number in clause.owes if 0 <= number < len(literals)]

    def number(self, formula: Formula) -> int:
        """Subformulas after their parts, as `ltl.Monitor` numbers them."""
        match formula:
            case Atom():
                parts: tuple[int, ...] = ()
            case Next(part):
                parts = (self.number(part),)
            case Both(left, right) | Either(left, right) | Until(left, right) | Release(left, right):
                parts = (self.number(left), self.number(right))
        self.formulas.append((formula, parts))
        return len(self.formulas) - 1

    def idling(self, number: int) -> int:
        """That staying here for ever meets a formula."""
        formula, parts = self.formulas[number]
        match formula:
            case Atom(predicate):
                return self.now.literal(predicate)
            case Both():
                return self.every(map(self.idling, parts))
            case Either():
                return -self.every(-self.idling(part) for part in parts)
            case Next() | Until() | Release():
                return self.idling(parts[-1])

    def expanded(self, number: int) -> int:
        """That a formula is met by what holds now and what is left."""
        formula, parts = self.formulas[number]
        match formula:
            case Atom(predicate):
                return self.now.literal(predicate)
            case Next():
                return self.left[parts[0]]
            case Both():
                return self.every(map(self.expanded, parts))
            case Either():
                return -self.every(-self.expanded(part) for part in parts)
            case Until():
                first, second = map(self.expanded, parts)
                return -self.every([-second, -self.every([first, self.left[number]])])
            case Release():
                first, second = map(self.expanded, parts)
                return self.every([second, -self.every([-first, -self.left[number]])])

    def every(self, literals: Iterable[int]) -> int:
        parts = list(literals)
        result = self.new()
        for literal in parts:
            self.add(-result, literal)
        self.add(result, *(-literal for literal in parts))
        return result

    def solved(self, assumptions: list[int]) -> bool:
        while True:
            look()
            self.solver.conf_budget(CONFLICTS)
            answer: bool | None = self.solver.solve_limited(assumptions=assumptions)
            if answer is not None:
                return answer

    def new(self) -> int:
        self.last += 1
        return self.last

    def add(self, *literals: int) -> None:
        self.solver.add_clause(literals)


Row = tuple[tuple[int, ...], Value]
"""Literals of the values of some variables, and what an expression is worth there."""


class _Instant:
    """The state at one time."""

    def __init__(self, check: _Check, system: System) -> None:
        self._check = check
        self.values: Mapping[str, Mapping[Value, int]] = {
            v.name: {value: check.new() for value in v.domain.values} for v in system.variables
        }
        for literals in self.values.values():
            check.add(*literals.values())
            for one, other in combinations(literals.values(), 2):
                check.add(-one, -other)
        self._coded: dict[Expr, int] = {}

    def literal(self, expr: Expr) -> int:
        if expr not in self._coded:
            self._coded[expr] = self._code(expr)
        return self._coded[expr]

    def _code(self, expr: Expr) -> int:
        match expr:
            case Named(_, part):
                return self.literal(part)
            case Not(part):
                return -self.literal(part)
            case And(parts):
                return self._check.every(map(self.literal, parts))
            case Or(parts):
                return -self._check.every(-self.literal(part) for part in parts)
        result = self._check.new()
        for row, worth in self._table(expr):
            self._check.add(*(-literal for literal in row), result if worth else -result)
        return result

    def cases(self, expr: Expr) -> list[tuple[tuple[int, ...], list[Row]]]:
        """What an expression is worth: under conditions, a table."""
        match expr:
            case Named(_, part):
                return self.cases(part)
            case If(condition, then, otherwise):
                chosen = self.literal(condition)
                return [
                    ((case, *conditions), rows)
                    for case, branch in ((chosen, then), (-chosen, otherwise))
                    for conditions, rows in self.cases(branch)
                ]
            case And() | Or() | Not():
                literal = self.literal(expr)
                return [((literal,), [((), True)]), ((-literal,), [((), False)])]
        return [((), self._table(expr))]

    def _table(self, expr: Expr) -> list[Row]:
        names = sorted(variables_of(expr))
        if prod(len(self.values[name]) for name in names) > TABLE:
            raise OverflowError("a condition reads too many variables for the proof to be checked")
        worth = meaning(expr, {name: at for at, name in enumerate(names)})
        return [
            (tuple(self.values[name][value] for name, value in zip(names, row, strict=True)), worth(row))
            for row in product(*(self.values[name] for name in names))
        ]
