"""Execution cases as text: from which state a station starts, what happens to it, and what has to come of it.

A case is `given / when / then` (scenarios/README.md). Like a scenario it is read strictly: every mistake is reported, with
its place. Everything in a `Case` fits the model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from decimal import Decimal
from itertools import product
from pathlib import Path
from typing import Any, Literal

from smv_planner.errors import Mistake, ModelError, UsageError, did_you_mean
from smv_planner.language import document
from smv_planner.language.document import Count, Duration, Expression, Name, Prose
from smv_planner.language.expressions import Asking, predicate_of
from smv_planner.language.questions import scope
from smv_planner.language.reader import UNREADABLE, Report, read
from smv_planner.language.shapes import shape_of
from smv_planner.language.strict_yaml import Mapping as MappingNode
from smv_planner.language.strict_yaml import Node, Scalar, Source, parse
from smv_planner.language.strict_yaml import Sequence as SequenceNode
from smv_planner.lazy import dataclass, field, fields
from smv_planner.model.domains import Value
from smv_planner.model.expressions import Expr
from smv_planner.model.model import Model
from smv_planner.model.system import Kind, VariableKind
from smv_planner.planner.operations import tasks

WITHIN = 300.0
"""Seconds of virtual time that a case has, if it does not say."""

Values = Mapping[Name, document.Value]
Names = Sequence[Name] | Name
"""One, or several."""

STATUS = Literal["initial", "executing", "finished", "paused", "cancelled", "error"]

# --- as it is written -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class GivenText:
    set: Values | Sequence[Values] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class OperatorText:
    delay: Duration | None = None
    ignores: Names = ()
    pretends: Names = ()
    forgets: Names = ()
    agrees: bool = True
    times: Count | None = None


@dataclass(frozen=True, slots=True)
class EntryText:
    """When: `at` seconds after the start, or after what `after` or `once` name. What: any of the others."""

    at: Duration | None = None
    after: Name | None = None
    once: Expression | None = None
    fail: Names = ()
    instead: Mapping[Name, Name] = field(default_factory=dict)
    times: Count | None = None
    well: Names = ()
    dead: Names = ()
    silent: Names = ()
    stuck: Names = ()
    lying: Values = field(default_factory=dict)
    restart: Names = ()
    set: Values = field(default_factory=dict)
    activate: Names = ()
    pause: Names = ()
    cancel: Names = ()
    reenable: Names = ()
    proceed: bool = False
    operator: OperatorText | None = None
    planner_killed: Duration | None = None


@dataclass(frozen=True, slots=True)
class ThenText:
    actions: Sequence[Prose] | None = None
    operator: Sequence[Name] | None = None
    intentions: Mapping[Name, STATUS] = field(default_factory=dict)
    failed: Sequence[Name] | None = None
    operations: Sequence[Name] = ()
    final: Values = field(default_factory=dict)
    never: Sequence[Expression] = ()
    always: Sequence[Expression] = ()
    alarms: Sequence[Prose] | None = None
    within: Duration | None = None


@dataclass(frozen=True, slots=True)
class CaseText:
    description: Prose
    when: Sequence[EntryText]
    then: ThenText
    given: GivenText = GivenText()
    model: Prose = "model.yaml"


# --- as it is meant -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Habits:
    """How the operator is from now on; what is None stays as it is."""

    delay: float | None = None
    ignores: tuple[str, ...] = ()
    pretends: tuple[str, ...] = ()
    forgets: tuple[str, ...] = ()
    agrees: bool = True
    times: int | None = None


@dataclass(frozen=True, slots=True)
class Entry:
    """`delay` seconds after the start, after a transition was taken or an operation has started, or once a predicate holds."""

    delay: float = 0.0
    after: str | None = None
    once: Expr | None = None
    fail: tuple[str, ...] = ()
    instead: Mapping[str, str] = field(default_factory=dict)
    times: int | None = None
    well: tuple[str, ...] = ()
    dead: tuple[str, ...] = ()
    silent: tuple[str, ...] = ()
    stuck: tuple[str, ...] = ()
    lying: Mapping[str, Value] = field(default_factory=dict)
    restart: tuple[str, ...] = ()
    set: Mapping[str, Value] = field(default_factory=dict)
    activate: tuple[str, ...] = ()
    pause: tuple[str, ...] = ()
    cancel: tuple[str, ...] = ()
    reenable: tuple[str, ...] = ()
    proceed: bool = False
    operator: Habits | None = None
    planner_killed: float | None = None


@dataclass(frozen=True, slots=True)
class Then:
    """What has to come of it; None where nothing is asked. `never` and `always` keep their text for people."""

    actions: tuple[str, ...] | None = None
    operator: tuple[str, ...] | None = None
    intentions: Mapping[str, str] = field(default_factory=dict)
    failed: tuple[str, ...] | None = None
    operations: tuple[str, ...] = ()
    final: Mapping[str, Value] = field(default_factory=dict)
    never: tuple[tuple[str, Expr], ...] = ()
    always: tuple[tuple[str, Expr], ...] = ()
    alarms: tuple[str, ...] | None = None
    within: float = WITHIN


@dataclass(frozen=True, slots=True)
class Case:
    """A start, in which only what differs from the model's own is `given`, what happens when, and what then."""

    name: str
    description: str
    given: Mapping[str, Value]
    when: tuple[Entry, ...]
    then: Then


# --- from the one to the other --------------------------------------------------------------------------------------------------


def cases(folder: Path, load: Callable[[Path], Model]) -> dict[str, tuple[Model, Case]]:
    """The execution cases of a scenario by name, each with the model that it is about. Raises ModelError."""
    found: dict[str, tuple[Model, Case]] = {}
    for path in sorted(folder.glob("cases/*.yaml")):
        for name, text in texts(path.read_text(encoding="utf-8"), path.stem):
            root = tree(text, str(path))
            if entry(root, "when") is not None:
                model = load(folder / written_model(root))
                found[name] = model, case(text, model, name, str(path))
    return found


def case(text: str, model: Model, name: str = "case", file: str = "<text>") -> Case:
    """The case in a text. Raises ModelError with every mistake in it."""
    root, mistakes = parse(Source(file, text))
    report = Report(mistakes)
    if root is None:
        raise ModelError(mistakes)
    if isinstance(root, MappingNode):
        root = root._replace(entries=tuple(pair for pair in root.entries if pair[0].text != "foreach"))
    written = read(root, shape_of(CaseText), (), report)
    meant = None
    if isinstance(written, CaseText):
        meant = _Meaning(model, report).case(written, name)
    if report.mistakes:
        raise ModelError(report.mistakes)
    assert meant is not None
    return meant


def texts(text: str, name: str) -> Iterator[tuple[str, str]]:
    """A file's cases by name: one, or with `foreach` one for every combination of what its placeholders stand for."""
    foreach = entry(tree(text, name), "foreach")
    if not isinstance(foreach, MappingNode):
        yield name, text
        return
    pools = [_pool(value) for _, value in foreach.entries]
    for words in product(*pools):
        one = text
        for (key, _), word in zip(foreach.entries, words, strict=True):
            one = one.replace(f"${key.text}", word)
        yield "-".join([name, *words]), one


def _pool(node: Node) -> list[str]:
    if isinstance(node, SequenceNode):
        return [each.text for each in node.items if isinstance(each, Scalar)]
    low, _, high = node.text.partition("..") if isinstance(node, Scalar) else ("", "", "")
    if not (low.isdecimal() and high.isdecimal()):
        raise ModelError([Mistake("'foreach' has a list of words or numbers for each name", "as in {i: 1..6, robot: [r1, r2]}")])
    return [str(number) for number in range(int(low), int(high) + 1)]


def tree(text: str, file: str) -> Node:
    root, mistakes = parse(Source(file, text))
    if root is None:
        raise ModelError(mistakes)
    return root


def entry(node: Node, key: str) -> Node | None:
    if not isinstance(node, MappingNode):
        return None
    return next((value for name, value in node.entries if name.text == key), None)


def written_model(root: Node) -> str:
    found = entry(root, "model")
    return found.text if isinstance(found, Scalar) else "model.yaml"


_SECONDS = {"ms": Decimal("0.001"), "s": Decimal(1), "min": Decimal(60), "h": Decimal(3600)}


class _Meaning:
    """A case being resolved against a model; every mistake goes to the report, and its part is left out."""

    def __init__(self, model: Model, report: Report) -> None:
        self.model, self.report, self.scope = model, report, scope(model)
        self.variables = {variable.name: variable for variable in model.variables}
        self.resources = [resource.name for resource in model.resources]
        self.intentions = [intention.name for intention in model.intentions]
        self.operations = list(dict.fromkeys(n for t in tasks(model) for n in (t.operation.name, t.name)))
        self.transitions = [t.name for t in model.transitions]
        self.effects = [t.name for t in model.transitions if t.kind is Kind.EFFECT]
        self.maintenance = [t.name for t in model.transitions if t.kind is Kind.MAINTENANCE]

    def case(self, written: CaseText, name: str) -> Case:
        given: dict[str, Value] = {}
        if isinstance(written.given, GivenText):
            several = written.given.set
            if isinstance(several, list):
                for at, each in enumerate(several):
                    given |= self.values(each, ("given", "set", str(at)))
            else:
                given |= self.values(several, ("given", "set"))
        when = []
        if isinstance(written.when, list):
            for at, each in enumerate(written.when):
                if isinstance(each, EntryText):
                    when.append(self.entry(each, ("when", str(at))))
        then = self.then(written.then) if isinstance(written.then, ThenText) else Then()
        return Case(name, str(written.description), given, tuple(when), then)

    def entry(self, written: EntryText, path: tuple[str, ...]) -> Entry:
        said = [name.name for name in fields(EntryText) if getattr(written, name.name) not in (None, (), [], {}, False)]
        if not set(said) - {"at", "after", "once", "times"}:
            self.report.wrong(path, "nothing happens here", "say what, as in {at: 2 s, silent: r2}")
        if "after" in said and "once" in said:
            self.report.wrong(path, "'after' and 'once' do not go together")
        both = [*self.effects, *self.resources, *self.intentions, *self.operations]
        commanded = [v for v in written.set or () if v in self.variables and self.variables[v].kind is VariableKind.GOAL]
        for name in commanded:
            hint = "that is what the planner commands; set what is measured"
            self.report.wrong_key((*path, "set", name), f"'{name}' is a goal variable", hint)
        return Entry(
            delay=self.seconds(written.at, 0.0),
            after=self.one(written.after, [*self.transitions, *self.operations], "transition or operation", (*path, "after")),
            once=self.predicate(written.once, (*path, "once")),
            fail=self.names(written.fail, self.effects, "effect", (*path, "fail")),
            instead=self.exchanged(written.instead, (*path, "instead")),
            times=written.times if isinstance(written.times, int) else None,
            well=self.names(written.well, self.resources, "resource", (*path, "well")),
            dead=self.names(written.dead, self.resources, "resource", (*path, "dead")),
            silent=self.names(written.silent, self.resources, "resource", (*path, "silent")),
            stuck=self.names(written.stuck, self.resources, "resource", (*path, "stuck")),
            lying=self.values(written.lying, (*path, "lying"), measured=True),
            restart=self.names(written.restart, self.resources, "resource", (*path, "restart")),
            set=self.values(written.set, (*path, "set")),
            activate=self.names(written.activate, self.intentions, "intention", (*path, "activate")),
            pause=self.names(written.pause, self.intentions, "intention", (*path, "pause")),
            cancel=self.names(written.cancel, [*self.intentions, *self.operations], "intention or operation", (*path, "cancel")),
            reenable=self.names(written.reenable, both, "effect, resource, operation or intention", (*path, "reenable")),
            proceed=written.proceed is True,
            operator=self.habits(written.operator, (*path, "operator")),
            planner_killed=None if written.planner_killed is None else self.seconds(written.planner_killed, 0.0),
        )

    def habits(self, written: OperatorText | None, path: tuple[str, ...]) -> Habits | None:
        if not isinstance(written, OperatorText):
            return None
        return Habits(
            delay=None if written.delay is None else self.seconds(written.delay, 0.0),
            ignores=self.names(written.ignores, self.maintenance, "maintenance transition", (*path, "ignores")),
            pretends=self.names(written.pretends, self.maintenance, "maintenance transition", (*path, "pretends")),
            forgets=self.names(written.forgets, self.maintenance, "maintenance transition", (*path, "forgets")),
            agrees=written.agrees is not False,
            times=written.times if isinstance(written.times, int) else None,
        )

    def then(self, written: ThenText) -> Then:
        path = ("then",)
        if written == ThenText():
            self.report.wrong(path, "nothing is expected here", "say what, as in {intentions: {tighten_bolts: finished}}")
        said = written.intentions if isinstance(written.intentions, dict) else {}
        for name in said:
            if name not in self.intentions:
                self.unknown_key((*path, "intentions", name), name, self.intentions, "intention")
        return Then(
            actions=self.prose(written.actions),
            operator=self.some(written.operator, self.maintenance, "maintenance transition", (*path, "operator")),
            intentions={name: status for name, status in said.items() if status is not UNREADABLE},
            failed=self.some(written.failed, self.operations, "operation", (*path, "failed")),
            operations=self.names(written.operations, self.operations, "operation", (*path, "operations")),
            final=self.values(written.final, (*path, "final")),
            never=self.predicates(written.never, (*path, "never")),
            always=self.predicates(written.always, (*path, "always")),
            alarms=self.prose(written.alarms),
            within=self.seconds(written.within, WITHIN),
        )

    # --- parts

    def seconds(self, text: str | None, otherwise: float) -> float:
        if not isinstance(text, str):
            return otherwise
        unit = text.lstrip("0123456789. ")
        return float(Decimal(text.removesuffix(unit).strip()) * _SECONDS[unit])

    def predicate(self, text: str | None, path: tuple[str, ...]) -> Expr | None:
        if not isinstance(text, str):
            return None
        part = predicate_of(Asking(text, self.scope, lambda message, hint, at: self.report.wrong(path, message, hint, at)))
        return part.expr if part else None

    def predicates(self, written: Any, path: tuple[str, ...]) -> tuple[tuple[str, Expr], ...]:
        found = []
        for at, text in enumerate(written if isinstance(written, list) else ()):
            expr = self.predicate(text, (*path, str(at)))
            if expr is not None:
                found.append((text, expr))
        return tuple(found)

    def values(self, written: Any, path: tuple[str, ...], measured: bool = False) -> dict[str, Value]:
        found: dict[str, Value] = {}
        own = [v.name for v in self.model.variables if not measured or v.kind is VariableKind.MEASURED]
        for name, value in (written if isinstance(written, dict) else {}).items():
            if name not in own:
                self.unknown_key((*path, name), name, own, "measured variable" if measured else "variable")
            elif value is not UNREADABLE and value not in self.variables[name].domain:
                shown = str(value).lower() if isinstance(value, bool) else value
                self.report.wrong((*path, name), f"'{shown}' is not a value of '{name}'", f"{self.variables[name].domain}")
            elif value is not UNREADABLE:
                found[name] = value
        return found

    def exchanged(self, written: Any, path: tuple[str, ...]) -> dict[str, str]:
        found = {}
        for name, other in (written if isinstance(written, dict) else {}).items():
            if name not in self.effects:
                self.unknown_key((*path, name), name, self.effects, "effect")
            elif other is not UNREADABLE and other not in self.effects:
                self.unknown((*path, name), other, self.effects, "effect")
            elif other is not UNREADABLE:
                found[name] = other
        return found

    def one(self, name: Any, known: Sequence[str], what: str, path: tuple[str, ...]) -> str | None:
        if not isinstance(name, str):
            return None
        if name not in known:
            self.unknown(path, name, known, what)
        return name

    def names(self, written: Any, known: Sequence[str], what: str, path: tuple[str, ...]) -> tuple[str, ...]:
        items = written if isinstance(written, list) else ()
        several = [(written, path)] if isinstance(written, str) else [(n, (*path, str(at))) for at, n in enumerate(items)]
        for name, where in several:
            if name is not UNREADABLE and name not in known:
                self.unknown(where, name, known, what)
        return tuple(name for name, _ in several if name is not UNREADABLE)

    def some(self, written: Any, known: Sequence[str], what: str, path: tuple[str, ...]) -> tuple[str, ...] | None:
        return None if written is None else self.names(written, known, what, path)

    def prose(self, written: Any) -> tuple[str, ...] | None:
        return tuple(written) if isinstance(written, list) else None

    def unknown(self, path: tuple[str, ...], name: str, known: Sequence[str], what: str) -> None:
        self.report.wrong(path, f"there is no {what} '{name}'", did_you_mean(name, known))

    def unknown_key(self, path: tuple[str, ...], name: str, known: Sequence[str], what: str) -> None:
        self.report.wrong_key(path, f"there is no {what} '{name}'", did_you_mean(name, known))


def chosen(found: Mapping[str, tuple[Model, Case]], name: str) -> tuple[Model, Case]:
    """The case of a name. Raises UsageError if there is none."""
    if name not in found:
        hint = did_you_mean(name, found) or ("there are " + ", ".join(found) if found else "the scenario has no execution cases")
        raise UsageError([Mistake(f"there is no execution case '{name}'", hint)])
    return found[name]
