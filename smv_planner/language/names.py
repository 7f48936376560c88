"""The names of a scenario: what is declared, with its domain, and what predicates and copies stand for.

All names are declared before any expression is read. A name whose declaration is wrong is known all the same, so that
its uses are not called unknown.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple, TypeVar

from smv_planner.language import document
from smv_planner.language.document import Bounds, Scenario
from smv_planner.language.expressions import (
    MAX_NODES,
    Asking,
    Level,
    Name,
    Scope,
    Typed,
    assigned_of,
    constant,
    domain_text,
    predicate_of,
)
from smv_planner.language.grammar import MAX_DEPTH
from smv_planner.language.reader import UNREADABLE, Path, Report, shorten
from smv_planner.model.domains import Bool, Domain, Enum, Range, Value, show_value
from smv_planner.model.expressions import If
from smv_planner.model.system import Variable, VariableKind

MAX_VARIABLES = 5_000
MAX_WIDTH = 4_096
MAX_WORDS = 1_024

T = TypeVar("T")


class World(NamedTuple):
    """What every part of a scenario is judged against."""

    report: Report
    names: dict[str, Name]
    declared: dict[str, Path]
    quiet: frozenset[str]
    sizes: list[int]

    def scope(self, path: Path, prefix: str, level: Level) -> Scope:
        return Scope(self.names, prefix, level, self.quiet, self.report.prefix(path))

    def asking(self, text: str, path: Path, prefix: str = "", level: Level = "any") -> Asking:

        def complain(message: str, hint: str | None, at: tuple[int, int]) -> None:
            self.report.wrong(path, message, hint, at)

        return Asking(text, self.scope(path, prefix, level), complain, _where(path), self.report.close, self.sizes)


def _where(path: Path) -> str:
    """Which expression this is, for messages: the place alone does not tell."""
    match path:
        case (*_, name, "guard" | "goal" | "start" | "formula" as what):
            return f" in the {what} of '{name}'"
        case (*_, "invariants" | "predicates" as what, name):
            return f" in the {what.removesuffix('s')} '{name}'"
        case ("decision", name, "from", *_):
            return f" in 'from' of '{name}'"
    return ""


def entries(table: Mapping[str, T] | None, path: Path) -> Iterator[tuple[Path, str, T]]:
    """The readable entries of a table, each with its path and its name."""
    if table is not None and table is not UNREADABLE:
        for name, entry in table.items():
            if entry is not UNREADABLE:
                yield (*path, name), name, entry


def all_entries(table: Mapping[str, T] | None, path: Path) -> Iterator[tuple[Path, str, T]]:
    """Like `entries`, with the entries that are `UNREADABLE`: their names count as known."""
    if table is not None and table is not UNREADABLE:
        for name, entry in table.items():
            yield (*path, name), name, entry


def quiet_in(holes: Iterable[Path]) -> frozenset[str]:
    """The beginnings of names that may be missing because a table was not read."""
    found = set()
    for hole in holes:
        match hole:
            case () | ("resources",) | ("predicates",) | ("decision",):
                found.add("")
            case ("resources", resource) | ("resources", resource, "variables" | "predicates"):
                found.add(resource + ".")
    return frozenset(found)


class Definition(NamedTuple):
    """A predicate or a copy: what it is called and the text that says what it stands for."""

    full: str
    path: Path
    prefix: str
    text: str | Mapping[str, str]


def declared(scenario: Scenario, world: World) -> tuple[tuple[Variable, ...], tuple[Definition, ...]]:
    """Makes every full name known. Gives the variables of the state, and what predicates and copies stand for."""
    variables: list[Variable] = []
    definitions: list[Definition] = []
    for path, resource, each in entries(scenario.resources, ("resources",)):
        for inner, name, variable in all_entries(each.variables, (*path, "variables")):
            variables += _variable(variable, f"{resource}.{name}", inner, resource, world)
        definitions += _predicates(each.predicates, (*path, "predicates"), f"{resource}.", world)
    definitions += _predicates(scenario.predicates, ("predicates",), "", world)
    for path, name, decision in all_entries(scenario.decision, ("decision",)):
        if decision is not UNREADABLE and decision.from_ is not None:
            definitions += _copy(decision, name, path, world)
        else:
            variables += _variable(decision, name, path, None, world)
    if len(variables) > MAX_VARIABLES:
        world.report.wrong((), f"there are {len(variables)} variables; the limit is {MAX_VARIABLES}")
    return tuple(variables), tuple(definitions)


def _declare(name: Name, path: Path, world: World) -> bool:
    """Whether the name was free."""
    if name.full in world.names:
        first, second = world.report.in_order(world.declared[name.full], path)
        hint = world.report.line_of(first) or "full names are unique"
        world.report.wrong_key(second, f"there is a variable or predicate '{name.full}' already", hint)
        return False
    world.names[name.full] = name
    world.declared[name.full] = path
    return True


def _predicates(table: Mapping[str, str], path: Path, prefix: str, world: World) -> Iterator[Definition]:
    for inner, name, text in all_entries(table, path):
        if _declare(Name(prefix + name, Bool(), "predicate"), inner, world) and text is not UNREADABLE:
            yield Definition(prefix + name, inner, prefix, text)


def _variable(
    entry: document.Variable | document.Decision, full: str, path: Path, resource: str | None, world: World
) -> Iterator[Variable]:
    if entry is UNREADABLE:
        _declare(Name(full, None, None), path, world)
        return
    domain = _domain(entry.domain, (*path, "domain"), world)
    if entry.domain is None:
        world.report.wrong_key(path, f"'domain' is missing in '{path[-1]}'")
    kind = None
    if isinstance(entry, document.Decision):
        kind = VariableKind.DECISION
        if entry.initial is None:
            hint = "every variable without 'from' starts with a value"
            world.report.wrong_key(path, f"'initial' is missing in '{path[-1]}'", hint)
    elif entry.kind is not UNREADABLE:
        kind = VariableKind(entry.kind)
    name = Name(full, domain, kind, None, full if resource else None, None if resource else full)
    _declare(name, path, world)
    if domain is not None and entry.initial is not None and entry.initial is not UNREADABLE:
        if entry.initial in domain:
            yield Variable(full, kind or VariableKind.MEASURED, domain, entry.initial, resource)
        else:
            no_value(entry.initial, domain, (*path, "initial"), world)


def no_value(value: Value, domain: Domain, path: Path, world: World) -> None:
    """Notes that a value is not in the domain."""
    if isinstance(domain, Enum):
        hint = world.report.close(str(value), domain.words)
    elif isinstance(domain, Bool):
        hint = "write true or false, without quotes"
    else:
        hint = None if type(value) is int else "write a whole number, without quotes, point or leading zeros"
    shown = str(value).lower() if type(value) is bool else shorten(str(value))
    world.report.wrong(path, f"'{shown}' is not in the domain, which is {domain_text(domain)}", hint)


def _domain(entry: document.Domain | None, path: Path, world: World) -> Domain | None:
    wrong = world.report.wrong
    match entry:
        case "bool":
            return Bool()
        case Bounds(low, high):
            if low is UNREADABLE or high is UNREADABLE:
                return None
            if low > high:
                wrong(path, f"this domain is empty: min {low} is larger than max {high}")
            elif high - low + 1 > MAX_WIDTH:
                wrong(path, f"this domain has {high - low + 1} values; the limit is {MAX_WIDTH}", "count in larger steps")
            else:
                return Range(low, high)
        case list():
            return _words(entry, path, world)
    return None


def _words(words: list[str], path: Path, world: World) -> Domain | None:
    wrong = world.report.wrong
    if not words:
        wrong(path, "this domain is empty", "name its values")
    if len(words) > MAX_WORDS:
        wrong(path, f"this domain has {len(words)} values; the limit is {MAX_WORDS}")
    sound = 0 < len(words) <= MAX_WORDS
    seen: set[str] = set()
    for at, word in enumerate(words):
        if word is UNREADABLE:
            sound = False
        elif word in ("true", "false"):
            wrong((*path, str(at)), f"'{word}' cannot be a value among others", "write 'domain: bool'")
            sound = False
        elif word in seen:
            wrong((*path, str(at)), f"the value '{word}' is here twice")
        else:
            seen.add(word)
    return Enum(tuple(dict.fromkeys(words))) if sound else None


def _copy(entry: document.Decision, full: str, path: Path, world: World) -> Iterator[Definition]:
    domain = _domain(entry.domain, (*path, "domain"), world)
    if entry.domain is None:
        domain = Bool() if isinstance(entry.from_, str) else None
        if isinstance(entry.from_, Mapping):
            world.report.wrong_key(path, f"'domain' is missing in '{path[-1]}'")
    if entry.initial is not None:
        world.report.wrong_key((*path, "initial"), f"'{full}' is a measured copy: 'from' gives its value", "remove 'initial'")
    free = _declare(Name(full, domain, "copy"), path, world)
    if free and domain is not None and entry.from_ is not UNREADABLE and entry.from_ is not None:
        yield Definition(full, (*path, "from"), "", entry.from_)


def define(definitions: tuple[Definition, ...], world: World) -> None:
    """Says for every predicate and copy what it stands for; those that need themselves are reported instead."""
    sound = {each.full: each for each in definitions}
    needs: dict[str, tuple[str, ...]] = {}
    for each in definitions:
        part, used = _meant(each, world)
        needs[each.full] = tuple(name for name in used if name in sound)
        if part is None:
            del sound[each.full]
    ordered, cycles = _ordered({full: tuple(n for n in names if n in sound) for full, names in needs.items() if full in sound})
    for cycle in cycles:
        first = min(cycle, key=list(sound).index)
        turned = [*cycle[cycle.index(first) :], *cycle[: cycle.index(first)], first]
        way = " -> ".join(turned if len(turned) <= 8 else [*turned[:4], "...", *turned[-3:]])
        world.report.wrong_key(_key_of(sound[first]), f"'{first}' is defined by itself: {way}", "break the circle")
    for full in ordered:
        part, used = _meant(sound[full], world)
        reads = [world.names[name] for name in used]
        name = world.names[full]._replace(part=part)
        if name.kind == "predicate":
            resources = next((read.resources for read in reads if read.resources), None)
            name = name._replace(resources=resources, decisions=next((read.decisions for read in reads if read.decisions), None))
        world.names[full] = name


def _key_of(definition: Definition) -> Path:
    return definition.path[:-1] if definition.path[0] == "decision" else definition.path


def _meant(definition: Definition, world: World) -> tuple[Typed | None, tuple[str, ...]]:
    """What a definition stands for as far as it is known, and the names that it uses."""
    name = world.names[definition.full]
    assert name.domain is not None
    if isinstance(definition.text, str):
        asking = world.asking(definition.text, definition.path, definition.prefix)
        if isinstance(name.domain, Bool):
            return predicate_of(asking), tuple(asking.used)
        part = assigned_of(asking, name, may_choose=False)
        if isinstance(part, Typed) and not _inside(part.domain, name.domain):
            world.report.wrong(definition.path, f"this may lie outside the domain, which is {domain_text(name.domain)}")
            part = None
        return part if isinstance(part, Typed) else None, tuple(asking.used)
    return _first_match(definition, name.domain, definition.text, world)


def _inside(inner: Domain, outer: Domain) -> bool:
    match inner, outer:
        case Range(low, high), Range(least, most):
            return least <= low and high <= most
        case Enum(words), Enum(others):
            return set(words) <= set(others)
    return True


def _first_match(
    definition: Definition, domain: Domain, table: Mapping[str, str], world: World
) -> tuple[Typed | None, tuple[str, ...]]:
    """A copy whose value is that of the first condition which holds."""
    used: dict[str, Name] = {}
    sound = True
    cases: list[tuple[Value, Typed]] = []
    last: Value | None = None
    values = {show_value(value): value for value in domain.values}
    if "otherwise" not in table:
        world.report.wrong_key(definition.path, "'otherwise' is missing", "it is the value when no condition holds")
    for path, key, text in all_entries(table, definition.path):
        if text is UNREADABLE:
            sound = False
            continue
        word = text.strip() if key == "otherwise" else key
        value = values.get(word[1:-1] if len(word) > 2 and word[0] == word[-1] == "'" else word)
        if value is None and key == "otherwise":
            no_value(word, domain, path, world)
        elif value is None:
            hint = world.report.close(word, tuple(values))
            world.report.wrong_key(path, f"'{shorten(word)}' is not in the domain, which is {domain_text(domain)}", hint)
        if key == "otherwise":
            last = value
            continue
        asking = world.asking(text, path)
        condition = predicate_of(asking)
        used.update(asking.used)
        if condition is None or value is None:
            sound = False
        else:
            cases.append((value, condition))
    if last is None or not sound:
        return None, tuple(used)
    whole = constant(last)
    for value, condition in reversed(cases):
        expr = If(condition.expr, constant(value).expr, whole.expr)
        size, depth = 2 + condition.size + whole.size, 1 + max(condition.depth, whole.depth)
        whole = Typed(expr, domain, size, depth)
    if whole.depth > MAX_DEPTH or whole.size > MAX_NODES:
        world.report.wrong(definition.path, "these conditions are too many or too large", f"at most {MAX_DEPTH - 1}")
        return None, tuple(used)
    return whole, tuple(used)


def _ordered(needs: Mapping[str, tuple[str, ...]]) -> tuple[list[str], list[list[str]]]:
    """The names, each behind those that it needs, and the circles among them, if any."""
    done: list[str] = []
    cycles: list[list[str]] = []
    state: dict[str, bool] = {}  # True once it is done
    circular: set[str] = set()
    for root in needs:
        way, waiting = [root], [iter(needs[root])]
        if root in state:
            continue
        state[root] = False
        while way:
            need = next(waiting[-1], None)
            if need is None:
                state[way[-1]] = True
                waiting.pop()
                done.append(way.pop())
            elif need not in state:
                state[need] = False
                way.append(need)
                waiting.append(iter(needs[need]))
            elif not state[need] and circular.isdisjoint((need, way[-1])):
                cycles.append(way[way.index(need) :])
                circular.update(cycles[-1])
    return [name for name in done if name not in circular], cycles
