"""A planning question as SMV text, and the way back from a trace to the question's own names.

The text means what `model/semantics.py` means and only says it in another language, with constructs that NuSMV 2.5,
NuSMV 2.6 and nuXmv share. Its shape stands in `smv_templates/problem.smv.j2`; what fills it is decided here.

A plan of n steps is a counterexample whose first n inputs name transitions and whose next one is `x_idle`. `x_done`
holds from then on, so the shortest trace that shows it has n + 1 transitions. A formula that looks beyond the states it
has seen (`G`, `R`, `W`, `X`) needs a second idle step, over which the trace closes into a loop.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, cached_property

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from smv_planner.errors import EngineError
from smv_planner.export.names import Sort, identifier
from smv_planner.lazy import dataclass
from smv_planner.model.domains import Bool, Domain, Enum, Range, Value
from smv_planner.model.expressions import (
    TRUE,
    And,
    Const,
    Equal,
    Expr,
    If,
    Less,
    Minus,
    Named,
    Not,
    Or,
    Plus,
    Var,
)
from smv_planner.model.ltl import ALWAYS_FALSE, ALWAYS_TRUE, Atom, Both, Either, Formula, Next, Release, Until
from smv_planner.model.semantics import possible, ready
from smv_planner.model.system import Any, Assignment, State, System, Transition
from smv_planner.problem import Goal, Problem, Reached

STEP, IDLE, DONE, SETTLED, NONE = (identifier(Sort.INTERNAL, name) for name in ("step", "idle", "done", "settled", "none"))

TRACE_FILE = "trace.xml"
"""Where the command script has the counterexample written."""

_WIDE = 8  # operands in a row: NuSMV recurses over them, and some thousand end in a segmentation fault
_MANY = 256  # branches of one `case`, sections of one kind: for the same reason


@dataclass(frozen=True, slots=True)
class RawTrace:
    """What a model checker reports, in its own words: for each state its variables, and the inputs in between."""

    states: tuple[Mapping[str, str], ...]
    inputs: tuple[Mapping[str, str], ...]


@dataclass(frozen=True)
class Encoding:
    """A problem as SMV, the commands that put the question, and what the identifiers stand for.

    `bound` is the length of the longest trace needed to find every plan within the problem's bound, as NuSMV counts.
    `loop` is where the trace has to close into a loop, as NuSMV writes it: "-1" over the last step, "X" nowhere.
    """

    problem: Problem
    text: str
    script: str
    bound: int
    loop: str
    variables: Mapping[str, str]
    transitions: Mapping[str, str]
    defines: frozenset[str]

    def decode(self, trace: RawTrace) -> Reached:
        """The plan in a counterexample. Raises EngineError unless every name, value and length is one of ours."""
        if not 0 <= len(trace.inputs) == len(trace.states) - 1 <= self.bound:
            raise EngineError(f"a trace of {len(trace.states)} states and {len(trace.inputs)} inputs is none of ours")
        states = tuple(map(self._state, trace.states))
        steps = tuple(map(self._step, trace.inputs))
        path = tuple(steps[: steps.index(IDLE)] if IDLE in steps else steps)
        length = len(path)
        if IDLE not in steps or length > self.problem.bound:
            raise EngineError(f"the trace does not come to rest within {self.problem.bound} steps")
        if set(steps[length:]) != {IDLE} or set(states[length:]) != {states[length]}:
            raise EngineError("the trace moves on after it has come to rest")
        if [state[DONE] for state in trace.states] != ["FALSE" if at <= length else "TRUE" for at in range(len(states))]:
            raise EngineError(f"{DONE} does not tell when the trace has come to rest")
        return Reached(tuple(self.transitions[step] for step in path), states[: length + 1])

    def _state(self, state: Mapping[str, str]) -> State:
        wanted = {*self.variables, DONE}
        if not wanted <= state.keys() <= wanted | self.defines:
            raise EngineError(f"a state of the trace does not fit the model: {_few(wanted ^ state.keys())}")
        for name, values in self._values.items():
            if state[name] not in values:
                raise EngineError(f"a value of the trace does not fit the model: {_few([name, state[name]])}")
        return tuple(values[state[name]] for name, values in self._values.items())

    def _step(self, inputs: Mapping[str, str]) -> str:
        step = inputs.get(STEP, "")
        if len(inputs) != 1 or (step != IDLE and step not in self.transitions):
            raise EngineError(f"an input of the trace does not fit the model: {_few([*inputs, step])}")
        return step

    @cached_property
    def _values(self) -> Mapping[str, Mapping[str, Value]]:
        """How each variable's values are written."""
        domains = self.problem.system.domains
        return {at: {_literal(value): value for value in domains[name].values} for at, name in self.variables.items()}


def encode(problem: Problem) -> Encoding:
    """The question in SMV: each counterexample is a plan, and the shortest counterexample is a shortest plan."""
    system = problem.system
    transitions = problem.usable  # those that can never fire included: whoever reads the text sees what is switched off
    writer = _Writer()
    ready_to = {t.name: writer.keep(_internal(f"ready.{t.name}"), writer.text(ready(system, t))) for t in transitions}
    automatic = [t.name for t in transitions if t.kind.automatic]
    earlier, any_automatic = _priority([ready_to[name] for name in automatic], writer)
    settled = writer.keep(SETTLED, f"!{_joined('|', any_automatic)}") if automatic else None
    blocked = dict(zip(automatic, earlier, strict=True))

    rules = []
    for transition in transitions:
        needs = [ready_to[transition.name]]
        if before := blocked.get(transition.name):
            needs.append(f"!{_joined('|', before)}")
        elif settled and not transition.kind.automatic:
            needs.append(settled)
        needs += _choices(transition, system, writer)
        rules.append(f"{STEP} = {_step(transition)} -> {_joined('&', needs)}")
    if not transitions:
        rules.append(f"{STEP} != {NONE}")  # as in `_type`: an input that can only be idle would be a constant

    actions = [(_step(t), action) for t in transitions for action in t.actions]
    moving = {action.variable for _, action in actions}
    values: dict[str, dict[str, list[str]]] = {name: {} for name in system.index if name in moving}
    for step, action in actions:
        values[action.variable].setdefault(_assigned(action, system, writer), []).append(step)

    declared = [(name, _variable(name), _type(domain)) for name, domain in system.domains.items()]
    goals = _joined("&", [_goal(goal, settled, writer) for goal in problem.goals] or ["TRUE"])
    allowed = [writer.named(Sort.PROPERTY, i.name, i.predicate) for i in problem.allowed if i.predicate != TRUE]
    loop, idle = ("-1", 2) if _looks_ahead(problem.formula) else ("X", 1)
    bound = problem.bound + idle
    words = {_literal(word) for domain in system.domains.values() if isinstance(domain, Enum) for word in domain.words}
    text = _template("problem.smv.j2").render(
        words=_lines([word for word in writer.words if word not in words]),
        steps=_lines([IDLE, *(map(_step, transitions) if transitions else [NONE])]),
        variables=[(at, domain) for name, at, domain in declared if name in moving],
        constants=[(at, domain) for name, at, domain in declared if name not in moving],
        defines=list(writer.defines.items()),
        initial=[(_variable(name), _literal(value)) for name, value in system.named(problem.initial).items()],
        changes=[(_variable(name), _cases(steps, _variable(name))) for name, steps in values.items()],
        rules=_sections(rules),
        settled=settled,
        allowed=_sections(allowed),
        goals=goals,
    )
    return Encoding(
        problem=problem,
        text=text,
        script=_template("problem.cmd.j2").render(bound=bound, loop=loop, trace=TRACE_FILE),
        bound=bound,
        loop=loop,
        variables={_variable(name): name for name in system.index},
        transitions={_step(t): t.name for t in transitions},
        defines=frozenset(writer.defines),
    )


class _Writer:
    """Expressions as SMV text. The defines that the text refers to are kept, each after those it refers to itself."""

    def __init__(self) -> None:
        self.defines: dict[str, str] = {}
        self.words: dict[str, None] = {}  # enumeration values in expressions; a set that keeps their order

    def keep(self, name: str, text: str) -> str:
        self.defines[name] = text
        return name

    def named(self, sort: Sort, name: str, expr: Expr) -> str:
        """A define under the name its author gave; if that already stands for something else, the text itself."""
        text = self.text(expr)
        return self.keep(at, text) if self.defines.get(at := identifier(sort, name), text) == text else text

    def text(self, expr: Expr) -> str:
        match expr:
            case Const(value):
                if type(value) is str:
                    self.words.setdefault(_literal(value))
                return f"({_literal(value)})" if type(value) is int and value < 0 else _literal(value)
            case Var(name):
                return _variable(name)
            case Named(name, part):
                return self.named(Sort.PREDICATE, name, part)
            case Not(Equal(left, right)):
                return self._compared(left, "!=", right)
            case Not(Less(left, right)):
                return self._compared(left, ">=", right)
            case Not(part):
                return f"!{self.text(part)}"
            case And(parts):
                return _joined("&", [self.text(part) for part in parts])
            case Or(parts):
                return _joined("|", [self.text(part) for part in parts])
            case Equal(left, right):
                return self._compared(left, "=", right)
            case Less(left, right):
                return self._compared(left, "<", right)
            case Plus(left, right):
                return f"({self.text(left)} + {self.text(right)})"
            case Minus(left, right):
                return f"({self.text(left)} - {self.text(right)})"
            case If(condition, then, otherwise):
                return f"({self.text(condition)} ? {self.text(then)} : {self.text(otherwise)})"

    def _compared(self, left: Expr, operator: str, right: Expr) -> str:
        if isinstance(left, Const):  # people write the constant last
            left, operator, right = right, {"<": ">", ">=": "<="}.get(operator, operator), left
        return f"({self.text(left)} {operator} {self.text(right)})"

    def formula(self, formula: Formula) -> str:
        match formula:
            case Atom(predicate):
                return self.text(predicate)
            case Both(left, right):
                return f"({self.formula(left)} & {self.formula(right)})"
            case Either(left, right):
                return f"({self.formula(left)} | {self.formula(right)})"
            case Next(part):
                return f"(X {self.formula(part)})"
            case Until(left, right):
                return f"(F {self.formula(right)})" if left == ALWAYS_TRUE else self._binary(left, "U", right)
            case Release(left, right):
                return f"(G {self.formula(right)})" if left == ALWAYS_FALSE else self._binary(left, "V", right)

    def _binary(self, left: Formula, operator: str, right: Formula) -> str:
        return f"({self.formula(left)} {operator} {self.formula(right)})"


def _goal(goal: Goal, settled: str | None, writer: _Writer) -> str:
    """`Problem.formula` for one goal, with the settled states under their own name."""
    reached = _joined("&", [writer.text(goal.predicate), *([settled] if settled else [])])
    return f"(F {reached})" if goal.until == ALWAYS_TRUE else f"({writer.formula(goal.until)} U {reached})"


def _looks_ahead(formula: Formula) -> bool:
    """Whether a finite trace can leave the formula open: `X` asks for one state more, `Release` for all of them."""
    match formula:
        case Atom():
            return False
        case Both(left, right) | Either(left, right) | Until(left, right):
            return _looks_ahead(left) or _looks_ahead(right)
        case Next() | Release():
            return True


def _priority(names: Sequence[str], writer: _Writer) -> tuple[list[list[str]], list[str]]:
    """For each name in order, what holds if an earlier one does; and what holds if any does. A tree, where it is wide."""
    earlier: list[list[str]] = [[] for _ in names]
    blocks = [(name, [at]) for at, name in enumerate(names)]
    while True:
        groups = [blocks[at : at + _WIDE] for at in range(0, len(blocks), _WIDE)]
        for group in groups:
            for place, (_, members) in enumerate(group):
                for member in members:
                    earlier[member] = [name for name, _ in group[:place]] + earlier[member]
        if len(groups) < 2:
            return earlier, [name for name, _ in blocks]
        blocks = [
            (
                writer.keep(_internal(f"any.{len(writer.defines)}"), _joined("|", [name for name, _ in group])),
                [member for _, members in group for member in members],
            )
            for group in groups
        ]


def _assigned(action: Assignment, system: System, writer: _Writer) -> str:
    """What `next(variable)` may be: one value, or a set of which `_choices` leaves what is meant."""
    domain = system.domains[action.variable]
    if isinstance(action.value, Any) or not _fits(action, system):
        return f"{domain.low}..{domain.high}" if isinstance(domain, Range) else _set(map(_literal, domain.values))
    return writer.text(action.value)


def _choices(transition: Transition, system: System, writer: _Writer) -> list[str]:
    """What a step owes beyond its readiness: values that only readiness keeps inside the domain, and change after `any`."""
    rules = [
        f"(next({_variable(action.variable)}) = {writer.text(action.value)})"
        for action in transition.actions
        if not isinstance(action.value, Any) and not _fits(action, system)
    ]
    if any(isinstance(action.value, Any) for action in transition.actions):
        names = [_variable(action.variable) for action in transition.actions]
        rules.append(_joined("|", [f"(next({name}) != {name})" for name in names]))
    return rules


def _fits(action: Assignment, system: System) -> bool:
    """Whether the shape of a value alone keeps it inside the domain; NuSMV warns about any other in a `case`."""
    assert not isinstance(action.value, Any)
    match system.domains[action.variable], possible(action.value, system.domains):
        case Range(low, high), Range(least, most):
            return low <= least and most <= high
        case Enum(words), Enum(others):
            return set(others) <= set(words)
    return True


def _cases(values: Mapping[str, Sequence[str]], otherwise: str) -> str:
    """A `case` on the step; steps that assign the same value share a branch."""
    branches = [(_joined("|", [f"{STEP} = {step}" for step in steps]), value) for value, steps in values.items()]
    while len(branches) > _MANY:
        groups = [branches[at : at + _MANY] for at in range(0, len(branches), _MANY)]
        branches = [(_joined("|", [when for when, _ in group]), _case(group, otherwise)) for group in groups]
    return _case(branches, otherwise)


def _case(branches: Sequence[tuple[str, str]], otherwise: str) -> str:
    return "".join(["case\n", *(f"    {when} : {value};\n" for when, value in branches), f"    TRUE : {otherwise};\n  esac"])


def _sections(parts: Sequence[str]) -> list[str]:
    """Conjuncts in sections of their own; very many of them share sections."""
    if len(parts) <= _MANY:
        return list(parts)
    size = -(-len(parts) // _MANY)
    closed = [f"({part})" for part in parts]
    return [_joined("&", closed[at : at + size]) for at in range(0, len(parts), size)]


def _joined(operator: str, parts: Sequence[str]) -> str:
    """The parts under one operator, as a balanced tree; a part alone is left as it is."""
    while len(parts) > 1:
        rows = [parts[at : at + _WIDE] for at in range(0, len(parts), _WIDE)]
        parts = [f"({f' {operator} '.join(row)})" if len(row) > 1 else row[0] for row in rows]
    return parts[0]


def _lines(words: Iterable[str]) -> list[str]:
    return textwrap.wrap(", ".join(words), 110, break_long_words=False, break_on_hyphens=False)


def _set(values: Iterable[str]) -> str:
    return f"{{{', '.join(values)}}}"


def _type(domain: Domain) -> str:
    """A domain of one value gets a second one that never comes: NuSMV takes such a variable for a constant."""
    match domain:
        case Bool():
            return "boolean"
        case Enum(words):
            return _set([*map(_literal, words), *([NONE] if len(words) == 1 else [])])
        case Range(low, high):
            return f"{low}..{max(high, low + 1)}"


def _literal(value: Value) -> str:
    if type(value) is bool:
        return str(value).upper()
    return str(value) if type(value) is int else identifier(Sort.VALUE, str(value))


def _variable(name: str) -> str:
    return identifier(Sort.VARIABLE, name)


def _step(transition: Transition) -> str:
    return identifier(Sort.TRANSITION, transition.name)


def _internal(name: str) -> str:
    return identifier(Sort.INTERNAL, name)


def _few(words: Iterable[str]) -> str:
    """Words of an engine for an error message, cut to size."""
    return ", ".join(ascii(word[:60]) for word in sorted(words)[:3])


@cache
def _template(name: str) -> Template:
    return Environment(
        loader=PackageLoader("smv_templates", "."),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    ).get_template(name)
