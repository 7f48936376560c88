"""The JSON Schema of scenarios, for editors: what may stand where, and what each key is for.

It comes from the same shapes that the reader follows, with what `expand` writes out around them. A schema knows no
names and no types of expressions: what it accepts may still be wrong, but what it refuses is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from smv_planner.language import document
from smv_planner.language.document import NAME, PART, Resource, Scenario
from smv_planner.language.expand import TEMPLATE_KEYS, USE_KEYS
from smv_planner.language.shapes import Choice, ListOf, OneOf, Record, Shape, Table, Text, Truth, Whole

Schema = dict[str, Any]

ABOUT: Mapping[type, Mapping[str, str]] = {
    document.Scenario: {
        "smv_planner": "The version of the format. It is 1.",
        "name": "What the scenario is called.",
        "templates": "Resources, or abilities of resources, that are written once and used several times.",
        "resources": "The devices, tools and persons of the station, by name.",
        "predicates": "Names for conditions over all variables.",
        "transitions": "What happens between resources, or between resources and products. They belong to no resource.",
        "decision": "Abstract variables that operations plan over. Those with 'from' are measured copies.",
        "invariants": "Conditions that hold in every state. No plan comes close to a state that may slide out of them.",
        "operations": "What the operation planner plans: tasks over decision variables, with goals over resource variables.",
        "intentions": "What is wanted, and from when on.",
        "sequence": "Operations that run in this order only, whatever is intended.",
        "period": "How often goals are sent to the hubs: '200 ms'.",
        "on_error": "What becomes of a plan that replaces a failed one: continue, ask for approval, or halt.",
        "reenable": "When what failed is tried again: 'manual', 'on_change' or 'after 30 s'.",
    },
    document.Resource: {
        "use": "The templates that this resource is made of, in order.",
        "template": "The one template that this resource is made of.",
        "with": "What the parameters of the template stand for.",
        "as": "A name before every name that the template declares, so that it can be used twice.",
        "variables": "What the resource measures, is told, and what is estimated of it.",
        "predicates": "Names for conditions; inside the resource its own names come first.",
        "transitions": "What the resource, the planner and the operator can do with it. Automatic ones fire in this order.",
        "silent_after": "The resource counts as lost when its hub says nothing for so long: '500 ms', '1.5 s'.",
        "mirror_within": "How soon the hub mirrors a new command, or counts as stuck: '1 s'.",
        "deadman": "A hub that hears no goals for so long does what 'on_deadman' says: '1 s'.",
        "on_deadman": "hold: the hub keeps its goals. {variable: value, ...}: it sets these.",
        "on_error": "What becomes of a plan that replaces one which failed here: continue, ask for approval, or halt.",
        "reenable": "When the lost resource, or an effect of it that timed out, counts again: 'manual', 'after 30 s'.",
    },
    document.Variable: {
        "kind": "measured: the resource says it. goal: we tell the resource. estimated: nobody can measure it.",
        "domain": "bool, a list of words, or {min: 0, max: 9}.",
        "initial": "The value at the start. A live system asks the resource instead, if it is measured.",
    },
    document.Transition: {
        "kind": "controlled: when a plan says so. automatic: at once. effect: the resource does it. maintenance: a person does.",
        "guard": "When it is possible; always, if there is none.",
        "actions": "Variables and their new values, expressions over the state before. 'any': the planner chooses.",
        "within": "How long an effect may take before it counts as timed out: '500 ms', '2 s'.",
        "expected": "false: no plan relies on this effect, but every plan is safe when it happens.",
        "instruction": "What the operator has to do.",
        "reenable": "When the effect counts again after it timed out: 'manual', 'on_change' or 'after 30 s'.",
    },
    document.Decision: {
        "domain": "bool, a list of words, or {min: 0, max: 9}. A copy of a condition needs none.",
        "initial": "The value at the start. A copy has none.",
        "from": "What it is measured from: an expression, or {value: condition, ..., otherwise: value}.",
    },
    document.Bounds: {"min": "The smallest value.", "max": "The largest value."},
    document.Operation: {
        "guard": "When it may start, over decision variables.",
        "effects": "What it does to decision variables.",
        "goal": "When it is done, over variables of resources. Without one, transitions of the model bring the effects about.",
        "outcomes": "Several ways to end, each with its own effects and goal.",
        "with": "A transition that happens together with the completion: its guard joins the goal, its actions the effects.",
        "on_start": "What happens to decision variables when it starts.",
        "retries": "After so many failures it is not tried again.",
        "on_error": "What becomes of a plan that replaces one in which it failed: continue, ask for approval, or halt.",
        "reenable": "When it is tried again after it was disabled or failed too often: 'manual', 'after 30 s'.",
    },
    document.Outcome: {
        "effects": "What this outcome does to decision variables.",
        "goal": "When the operation has ended in this way, over variables of resources.",
    },
    document.Intention: {
        "start": "When it begins.",
        "goal": "What is to be reached, over decision variables.",
        "formula": "What holds until then: a condition, or a formula with G F X U R W, over decision variables.",
        "actions": "What happens to decision variables when it is reached.",
        "sequence": "Operations that run in this order only.",
        "manual": "true: the sequence is the plan; operations are not planned.",
    },
    document.Parallel: {"parallel": "Branches that run side by side: operations, or lists of operations in order."},
}
"""One line for every key."""

WRITTEN: Mapping[str, str] = {
    "foreach": "Repeats this for every combination: {i: 1..24, pose: [home, away]}. Names hold the placeholders: bolt_$i.",
    "where": "Only the combinations for which this holds: $a != $b, $i < 3, several joined by 'and'.",
    "is": "What is repeated.",
    "do": "What is repeated.",
    "all": "Conditions that all hold: a list, or one that 'foreach' repeats.",
    "any": "Conditions of which one holds: a list, or one that 'foreach' repeats.",
    "parameters": "Names, or a mapping of names to defaults. $name stands for what is passed; $resource is always known.",
}
"""One line for every key that `expand` writes out and that no document has."""

_PLACEHOLDER = {"type": "string", "pattern": r"\$"}
# Patterns are said so that they mean the same to all readers, whatever those take for a letter. Names may hold placeholders.
_NAMES = {
    NAME: r"^(?=.*[^0-9._-])[^\s!-#%-*,/:-@\[-^|~]+$",
    PART: r"^(?=.*[^0-9_-])[^\s!-#%-*,./:-@\[-^|~]+$",
}
_WORD = r"^[^\s!-@\[-^`{-~][^\s!-/:-@\[-^`{-~]*$"


def schema() -> Schema:
    """The schema of a scenario, draft 2020-12."""
    records, repeated = _records(Record(Scenario))
    definitions = {made.__name__: _record(made, made in repeated) for made in records if made is not Scenario}
    root = _record(Scenario, False)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **root,
        "description": "A scenario of smv_planner: resources, operations and intentions of a station.",
        "properties": {**root["properties"], "smv_planner": {"const": 1, "description": ABOUT[Scenario]["smv_planner"]}},
        "required": ["smv_planner", *root["required"]],
        "$defs": {**definitions, **_written_out()},
    }


def _records(shape: Shape) -> tuple[tuple[type, ...], frozenset[type]]:
    """The records in a shape, and those that are entries of tables: these may be repeated."""
    found: dict[type, bool] = {}

    def walk(inner: Shape, entry: bool) -> None:
        match inner:
            case Record(made):
                new = made not in found
                found[made] = found.get(made, False) or entry
                for field in inner.entries if new else ():
                    walk(field.shape, False)
            case Table(_, value):
                walk(value, True)
            case ListOf(item):
                walk(item, False)
            case OneOf(shapes):
                for each in shapes:
                    walk(each, entry)

    walk(shape, False)
    return tuple(found), frozenset(made for made, entry in found.items() if entry)


def _record(made: type, repeated: bool) -> Schema:
    entries = {each.key: each for each in Record(made).entries}
    properties: Schema = {}
    for key, about in ABOUT[made].items():
        known = _of(entries[key].shape) if key in entries else _EXPANDED[key]
        properties[key] = {"description": about, **known}
    if repeated:
        properties |= _foreach()
    return _object(made.__name__, properties, [each.key for each in entries.values() if each.required])


def _written_out() -> Schema:
    """What only `expand` knows."""
    body = {key: {"description": ABOUT[Resource][key], **_shapes(Resource)[key]} for key in TEMPLATE_KEYS[1:]}
    parameters = {"anyOf": [_list({"type": "string", "pattern": _WORD}), _table({"pattern": _WORD}, {})]}
    use = {key: {"description": ABOUT[Resource][key], **_EXPANDED[key]} for key in USE_KEYS}
    return {
        "Template": _object("Template", {"parameters": {"description": WRITTEN["parameters"], **parameters}, **body}),
        "Use": _any({"type": "string"}, _object("Use", use, ["template"])),
        "Foreach": {
            **_table({"pattern": _WORD}, _any({"type": "string", "pattern": r"\.\.|\$"}, _list(_ref("Word")))),
            "title": "Foreach",
            "type": "object",
            "minProperties": 1,
        },
        "Word": _any({"type": ["string", "integer", "boolean"]}, _repeated("is", {"type": "string"})),
        "Expression": _expression("Expression"),
        "Formula": _expression("Formula"),
    }


def _shapes(made: type) -> Mapping[str, Schema]:
    return {each.key: _of(each.shape) for each in Record(made).entries}


def _of(shape: Shape) -> Schema:
    """What a shape accepts, and what stands for it until it is written out."""
    match shape:
        case Text(reads="condition"):
            return _ref("Expression")
        case Text(reads="formula"):
            return _ref("Formula")
        case Text(_, ""):
            return {"type": ["string", "integer", "number", "boolean"]}
        case Text(_, pattern):
            return {"type": "string", "pattern": _NAMES.get(pattern, rf"^(?:{pattern})$|\$")}
        case Whole(low, high):
            return _any({"type": "integer", "minimum": low, "maximum": high}, _PLACEHOLDER)
        case Truth():
            return _any({"type": "boolean"}, _PLACEHOLDER)
        case Choice(words):
            return _any({"enum": list(words)}, _PLACEHOLDER)
        case ListOf(item):
            key = "is" if isinstance(item, Text) else "do"
            return _any(_list(_any(_of(item), _repeated(key, _of(item)))), _PLACEHOLDER)
        case Table(key, Record(made)):
            return _any(_table(_of(key), _ref(made.__name__)), _PLACEHOLDER)
        case Table(key, value):
            entry = _any(_of(value), _repeated("is", _of(value)))
            together = {"description": WRITTEN["foreach"], **_any(_ref("Foreach"), entry)}
            return _any({**_table(_of(key), entry), "properties": {"foreach": together}}, _PLACEHOLDER)
        case Record(made):
            return _ref(made.__name__)
        case OneOf(shapes):
            return _any(*map(_of, shapes))


def _any(*schemas: Schema) -> Schema:
    """One of several, each said once."""
    flat = [each for schema in schemas for each in (schema["anyOf"] if schema.keys() == {"anyOf"} else [schema])]
    return {"anyOf": [each for at, each in enumerate(flat) if each not in flat[:at]]}


def _ref(name: str) -> Schema:
    return {"$ref": f"#/$defs/{name}"}


def _list(item: Schema) -> Schema:
    return {"type": "array", "items": item}


def _table(names: Schema, value: Schema) -> Schema:
    return {"type": ["object", "null"], "propertyNames": names, "additionalProperties": value}


def _object(title: str, properties: Schema, required: Sequence[str] = ()) -> Schema:
    """A mapping with known keys. There may be nothing behind its own key if it needs none of them."""
    kind = "object" if required else ["object", "null"]
    return {"title": title, "type": kind, "properties": properties, "required": list(required), "additionalProperties": False}


def _foreach() -> Schema:
    return {
        "foreach": {"description": WRITTEN["foreach"], **_any(_ref("Foreach"), _PLACEHOLDER)},
        "where": {"description": WRITTEN["where"], "type": "string"},
    }


def _repeated(key: str, body: Schema) -> Schema:
    """`{foreach: ..., is: ...}` where there may be many of something."""
    return _object("Repeated", {key: {"description": WRITTEN[key], **body}, **_foreach()}, ["foreach", key])


def _expression(name: str) -> Schema:
    """A text, or a quantified condition."""
    part = _ref(name)
    parts = _any(_list(_any(part, _repeated("is", part))), part)
    forms = []
    for word in ("all", "any"):
        form = _object(word, {word: {"description": WRITTEN[word], **parts}, **_foreach()}, [word])
        whole_list = {"properties": {word: {"anyOf": [{"type": "array"}, _PLACEHOLDER]}}}
        forms.append({**form, "anyOf": [{"required": ["foreach"]}, whole_list]})
    return {"title": name, "anyOf": [{"type": ["string", "integer", "boolean"]}, *forms]}


_EXPANDED: Mapping[str, Schema] = {
    "templates": _table(_of(Text("", PART)), _ref("Template")),
    "use": _any(_list(_any(_ref("Use"), _repeated("is", _ref("Use")))), _ref("Use")),
    "template": {"type": "string"},
    "with": _any(_table({"pattern": _WORD}, {}), _PLACEHOLDER),
    "as": _of(Text("", NAME)),
}
