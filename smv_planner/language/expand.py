"""Templates, `foreach` and quantified conditions: a scenario as its author wrote it -> the same scenario, written out.

Nodes in, nodes out, led by the shapes of `document`; nothing behind it knows of any of this. Every node keeps its place
in the text and notes which instance it belongs to, so that a mistake says both.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from collections.abc import Mapping as AnyMapping
from collections.abc import Sequence as AnySequence
from typing import NamedTuple

from smv_planner.language.document import EXPANDED, NAME, NAME_RULE, PART, Resource, Scenario
from smv_planner.language.placeholders import (
    NOTHING,
    WORD,
    Given,
    Passed,
    Values,
    Writing,
    entry,
    key_of,
    noted,
    quantifier,
    resolved,
)
from smv_planner.language.reader import Report, bare, other_one, shorten
from smv_planner.language.shapes import ListOf, OneOf, Record, Shape, Table, Text, shape_of
from smv_planner.language.strict_yaml import Instance, Mapping, Node, Scalar, Sequence

TEMPLATE_KEYS = ("parameters", *(each.key for each in Record(Resource).entries))
USE_KEYS = EXPANDED[Resource][1:]

Entries = tuple[tuple[Scalar, Node], ...]


class Template(NamedTuple):
    """`parameters` with their defaults; None where there is none."""

    name: str
    parameters: AnyMapping[str, Node | None]
    body: Mapping


def expand(root: Node, report: Report) -> Node:
    """The scenario written out. Raises ModelError if that is too large to be judged."""
    if not isinstance(root, Mapping):
        return root
    writing = Writing(report)
    expansion = _Expansion(writing, *_declared(root, writing))
    return expansion.node(_without(root, "templates"), shape_of(Scenario), NOTHING)


class _Expansion:
    """The known templates. `sound` if they are all that were declared; only then is another one unknown."""

    def __init__(self, writing: Writing, templates: AnyMapping[str, Template], sound: bool) -> None:
        self._writing, self._templates, self._sound = writing, templates, sound

    def node(self, node: Node, shape: Shape, given: Given) -> Node:
        """A node and all that is in it, written out."""
        node, given = resolved(node, given)
        self._writing.spend(node, given)
        shapes = shape.shapes if isinstance(shape, OneOf) else (shape,)
        text = _text_of(shape)
        match node:
            case Scalar():
                return self._writing.scalar(node, given, text)
            case Sequence():
                for each in shapes:
                    if isinstance(each, ListOf):
                        return self._list(node, each, given)
            case Mapping():
                if text and text.reads and quantifier(node):
                    return self._writing.quantified(node, text, given)
                for each in shapes:
                    if isinstance(each, Table):
                        return self._table(node, each, given)
                    if isinstance(each, Record):
                        return self._record(node, each, given)
        return noted(node, given)

    def _list(self, node: Sequence, shape: ListOf, given: Given) -> Sequence:
        key = "is" if _text_of(shape.item) == shape.item else "do"
        items = (self.node(each, shape.item, inner) for each, inner in self._writing.items(node, given, key))
        return noted(Sequence(tuple(items), node.span), given)

    def _record(self, node: Mapping, shape: Record, given: Given) -> Mapping:
        shapes = {each.key: each.shape for each in shape.entries}
        entries: list[tuple[Scalar, Node]] = []
        for key, value in node.entries:
            self._writing.spend(key, given)
            known = key.text in shapes
            entries.append((noted(key, given), self.node(value, shapes[key.text], given) if known else noted(value, given)))
        return noted(Mapping(tuple(entries), node.dropped, node.span), given)

    def _table(self, node: Mapping, shape: Table, given: Given) -> Mapping:
        """Entries may be repeated one by one; those of a table of texts, such as actions, also together."""
        entries: list[tuple[Scalar, Node]] = []
        dropped = list(node.dropped)
        instances: list[Given] | None = [given]
        if _text_of(shape.value) and isinstance(entry(node, "foreach"), Mapping):
            instances = self._writing.instances(node, given)
            node = _without(node, "foreach", "where")
        for key, value in node.entries:
            found = None if instances is None else self._instances(key, value, shape, instances)
            if found is None:
                dropped.append("")
            else:
                entries += found
        return noted(Mapping(tuple(entries), tuple(dropped), node.span), given)

    def _instances(self, key: Scalar, node: Node, shape: Table, givens: AnySequence[Given]) -> list[tuple[Scalar, Node]] | None:
        """One entry as it is written, which may stand for many; None if it is wrong."""
        entries: dict[str, tuple[Scalar, Node]] = {}
        text = _text_of(shape.value)
        repeated = isinstance(node, Mapping) and entry(node, "foreach") and not (text and text.reads and quantifier(node))
        for outer in givens:
            body: Node | None = node
            inner: list[Given] | None = [outer]
            if repeated and isinstance(node, Mapping):
                body = self._writing.body(node, "is", outer) if text else _without(node, "foreach", "where")
                inner = self._writing.instances(node, outer)
            if inner is None or body is None:
                return None
            for given in inner:
                self._writing.spend(key, given)
                name = self._writing.scalar(key, given)
                if not isinstance(name, Scalar):
                    return None
                if name.text in entries:
                    absent = [each for each in given.values if f"${each}" not in key.text.replace("{", "")]
                    hint = f"put ${absent[-1]} into the name" if absent else None
                    self._writing.wrong(key, given, f"two instances have the name '{shorten(name.text)}'", hint)
                    return None
                entries[name.text] = name, self._value(name, body, shape.value, given)
        return list(entries.values())

    def _value(self, name: Scalar, node: Node, shape: Shape, given: Given) -> Node:
        if isinstance(shape, Record) and shape.made is Resource and isinstance(node, Mapping) and _uses(node):
            return self._resource(bare(name.text), node, shape, given)
        return self.node(node, shape, given)

    def _resource(self, name: str, node: Mapping, shape: Record, given: Given) -> Mapping:
        """A resource that uses templates. What it says itself comes behind what they say."""
        uses: Iterator[tuple[Node, Given]]
        use, own = entry(node, "use"), _without(node, "use")
        if entry(node, "template") is not None:
            if use is not None:
                self._writing.wrong(key_of(node, "use"), given, "'use' stands beside 'template'", "list all templates in 'use'")
            kept = tuple((key, value) for key, value in node.entries if key.text in USE_KEYS)
            uses, own = iter([(Mapping(kept, (), node.span), given)]), _without(own, *USE_KEYS)
        else:
            for key, _ in own.entries:
                if key.text in USE_KEYS:
                    self._writing.wrong(key, given, f"'{key.text}' stands without 'template'", "an entry of 'use' has its own")
            own = _without(own, *USE_KEYS)
            use, inner = resolved(use if use is not None and not _empty(use) else Sequence(()), given)
            uses = self._writing.items(use if isinstance(use, Sequence) else Sequence((use,), use.span), inner)
        bodies = [self._used(each, name, shape, inner) for each, inner in uses]
        whole = self._merged([*(body for body in bodies if body), self._record(own, shape, given)], node)
        if None in bodies:
            whole = whole._replace(dropped=(*whole.dropped, "variables", "predicates", "transitions"))
        return noted(whole, given)

    def _used(self, node: Node, resource: str, shape: Record, given: Given) -> Mapping | None:
        """What a template says for one resource; None if it is not clear what."""
        if isinstance(node, Scalar):
            node = Mapping(((Scalar("template", True, node.span), node),), (), node.span)
        if not isinstance(node, Mapping):
            self._writing.wrong(node, given, "expected a mapping {template: ..., with: ..., as: ...}")
            return None
        for key, _ in node.entries:
            if key.text not in USE_KEYS:
                self._writing.unknown_key(key, USE_KEYS, given)
        called = self._word(node, "template", given)
        as_ = self._word(node, "as", given)
        if called is None or (as_ is None and entry(node, "as") is not None):
            return None
        template = self._templates.get(called.text)
        if template is None:
            if self._sound:
                hint = self._writing.report.close(called.text, tuple(self._templates))
                self._writing.report.wrong_in(called, f"unknown template '{shorten(called.text)}'", hint)
            return None
        if as_ is not None and not re.fullmatch(NAME, as_.text):
            self._writing.report.wrong_in(as_, f"'{shorten(as_.text)}' is not a name", NAME_RULE)
            return None
        values = self._passed(node, template, resource, given)
        if values is None:
            return None
        note = f"in template '{template.name}'" + (f" as '{as_.text}'" if as_ else "") + f" for resource '{resource}'"
        prefix = f"{as_.text}." if as_ else ""
        return _prefixed(self._record(template.body, shape, Given(values, Instance(note, prefix))), prefix)

    def _word(self, node: Mapping, key: str, given: Given) -> Scalar | None:
        value = entry(node, key)
        if value is None:
            if key == "template" and not node.dropped:
                self._writing.wrong(node, given, "'template' is missing")
            return None
        value, given = resolved(value, given)
        if not isinstance(value, Scalar) or _empty(value):
            self._writing.wrong(value, given, f"expected a name behind '{key}'")
            return None
        word = self._writing.scalar(value, given)
        return word._replace(text=bare(word.text)) if isinstance(word, Scalar) else None

    def _passed(self, node: Mapping, template: Template, resource: str, given: Given) -> Values | None:
        """What the placeholders of a template stand for in one use of it."""
        with_, inner = resolved(entry(node, "with") or Mapping(()), given)
        if not isinstance(with_, Mapping) and not _empty(with_):
            self._writing.wrong(with_, inner, "expected a mapping {parameter: value, ...}")
            return None
        own: dict[str, Scalar | Passed] = {"resource": Scalar(resource, True)}
        values = dict(own)
        for name, default in template.parameters.items():
            self._writing.spend(node, given)
            if default is not None:
                values[name] = Passed(default, Given(own))
        entries, dropped = (with_.entries, with_.dropped) if isinstance(with_, Mapping) else ((), ())
        for key, value in entries:
            if key.text not in template.parameters:
                dropped = (*dropped, key.text)
                known = tuple(template.parameters)
                hint = self._writing.report.close(key.text, known) or shorten("it has " + ", ".join(known or ("none",)), 120)
                message = f"the template '{template.name}' has no parameter '{shorten(key.text)}'"
                self._writing.wrong(key, inner, message, hint)
            values[key.text] = Passed(value, inner)
        missing = [name for name in template.parameters if name not in values]
        if missing and not dropped and not node.dropped:
            names = " and ".join(f"'{name}'" for name in missing)
            at = entry(node, "template") or node
            hint = f"write with: {{{missing[0]}: ...}}"
            self._writing.wrong(at, given, f"the template '{template.name}' needs {names}", hint)
        return None if missing else values

    def _merged(self, bodies: AnySequence[Mapping], node: Mapping) -> Mapping:
        """Several descriptions of one resource as one, in their order."""
        keys: dict[str, Scalar] = {}
        values: dict[str, list[Node]] = {}
        for body in bodies:
            for key, value in body.entries:
                first = keys.setdefault(key.text, key)
                found = values.setdefault(key.text, [])
                if found and isinstance(value, Scalar) and isinstance(found[0], Scalar):
                    if value.text != found[0].text:
                        self._writing.report.wrong_in(key, f"'{key.text}' is here twice", other_one(first))
                elif found and key.text == "on_deadman" and isinstance(value, Scalar) != isinstance(found[0], Scalar):
                    self._writing.report.wrong_in(key, f"'{key.text}' is here twice", other_one(first))
                elif not _empty(value):
                    found.append(value)
        entries = tuple((keys[name], _one_table(found)) for name, found in values.items() if found)
        return Mapping(entries, tuple(key for body in bodies for key in body.dropped), node.span)


def _declared(root: Mapping, writing: Writing) -> tuple[AnyMapping[str, Template], bool]:
    """The templates of a scenario, and whether these are all: they may be under a key that is spelt wrong."""
    templates: dict[str, Template] = {}
    table = entry(root, "templates")
    known = {each.key for each in Record(Scenario).entries}
    sound = "templates" not in root.dropped and (table is not None or all(key.text in known for key, _ in root.entries))
    entries: Entries = ()
    if isinstance(table, Mapping):
        entries, sound = table.entries, sound and not table.dropped
    elif table is not None and not _empty(table):
        writing.wrong(table, NOTHING, "expected a mapping with a name before each ':'", "templates: {NAME: {...}}")
        sound = False
    for key, node in entries:
        name = bare(key.text)
        if not re.fullmatch(PART, name):
            writing.wrong(key, NOTHING, f"'{shorten(name)}' is not a name without dots", NAME_RULE)
        if not isinstance(node, Mapping):
            writing.wrong(node, NOTHING, "expected a mapping {" + ", ".join(f"{each}: ..." for each in TEMPLATE_KEYS) + "}")
            sound = False
            continue
        for each, _ in node.entries:
            if each.text in EXPANDED[Resource]:
                writing.wrong(each, NOTHING, f"'{each.text}' stands in a template", "templates do not use templates")
            elif each.text not in TEMPLATE_KEYS:
                writing.unknown_key(each, TEMPLATE_KEYS, NOTHING)
        body = tuple((each, value) for each, value in node.entries if each.text in TEMPLATE_KEYS[1:])
        parameters = dict(_parameters(entry(node, "parameters"), writing))
        templates[name] = Template(name, parameters, Mapping(body, node.dropped, node.span))
    return templates, sound


def _parameters(node: Node | None, writing: Writing) -> Iterator[tuple[str, Node | None]]:
    found: list[tuple[Node, Node | None]] = []
    match node:
        case Sequence(items):
            found = [(item, None) for item in items]
        case Mapping(entries):
            found = [(key, None if _empty(value) else value) for key, value in entries]
        case Scalar() if not _empty(node):
            writing.wrong(node, NOTHING, "expected a list [name, ...] or a mapping {name: default, ...}")
    seen: set[str] = set()
    for each, default in found:
        if not isinstance(each, Scalar) or not WORD.fullmatch(each.text):
            writing.wrong(each, NOTHING, "expected the name of a parameter", "letters, digits and '_', not a digit first")
        elif each.text == "resource" or each.text in seen:
            why = "is here twice" if each.text in seen else "always stands for the name of the resource"
            writing.wrong(each, NOTHING, f"'{each.text}' {why}")
        else:
            seen.add(each.text)
            yield each.text, default


def _text_of(shape: Shape) -> Text | None:
    """The text that a shape is, or may be."""
    shapes = shape.shapes if isinstance(shape, OneOf) else (shape,)
    return next((each for each in shapes if isinstance(each, Text)), None)


def _uses(node: Mapping) -> bool:
    return any(key.text in EXPANDED[Resource] for key, _ in node.entries)


def _without(node: Mapping, *keys: str) -> Mapping:
    return node._replace(entries=tuple((key, value) for key, value in node.entries if key.text not in keys))


def _empty(node: Node) -> bool:
    """Whether there is nothing behind the key."""
    return isinstance(node, Scalar) and node.plain and not node.text


def _one_table(found: AnySequence[Node]) -> Node:
    """Several tables as one; what is no table stays, for the reader to say so."""
    tables = [each for each in found if isinstance(each, Mapping)]
    if len(tables) < len(found):
        return next(each for each in found if not isinstance(each, Mapping))
    dropped = tuple(key for each in tables for key in each.dropped)
    return Mapping(tuple(pair for each in tables for pair in each.entries), dropped, tables[0].span)


def _prefixed(body: Mapping, prefix: str) -> Mapping:
    """What a template declares, with the prefix before each name."""
    if not prefix:
        return body
    entries: list[tuple[Scalar, Node]] = []
    for key, value in body.entries:
        if isinstance(value, Mapping):
            inner = tuple((_behind(prefix, name), each) for name, each in value.entries)
            value = value._replace(entries=inner, dropped=tuple(name and prefix + name for name in value.dropped))
        entries.append((key, value))
    return body._replace(entries=tuple(entries))


def _behind(prefix: str, key: Scalar) -> Scalar:
    """A key with the prefix before it; places in it do not matter, for a key is named as a whole."""
    return key._replace(text=prefix + bare(key.text))
