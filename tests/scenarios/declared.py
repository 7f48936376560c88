"""The cases of the scenarios: read strictly, asked, and compared with what they declare.

What a case file may say stands in scenarios/README.md.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import yaml

import smv_planner as sp

ROOT = Path(__file__).parents[2]
SCENARIOS = sorted(folder for folder in (ROOT / "scenarios").iterdir() if folder.is_dir())

PROVING = ("auto", "sat", "explicit")
"""Engines that can say `unreachable`."""

SHORT = 15
"""A bounded model checker cannot say `unreachable`; it is asked for plans up to here and has to find none."""


@dataclass(frozen=True)
class Given:
    """`set` may be several mappings, of which the later ones prevail."""

    set: Mapping[str, bool | int | str] | tuple[Mapping[str, bool | int | str], ...] = field(default_factory=dict)
    maintenance: bool = False
    lift: tuple[str, ...] = ()
    disabled: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()

    @property
    def settings(self) -> Mapping[str, bool | int | str]:
        return dict(ChainMap(*reversed(self.set))) if isinstance(self.set, tuple) else self.set


@dataclass(frozen=True)
class Ask:
    """Either `goal`, or `intentions` (those that are named, or the `active` ones), or `exit_forbidden`."""

    goal: str | tuple[str, ...] | None = None
    intentions: str | tuple[str, ...] = ()
    exit_forbidden: bool = False
    formula: str | None = None
    bound: int = 100
    deadline: float = 60


@dataclass(frozen=True)
class Then:
    verdict: str
    length: int | None = None
    steps: tuple[str | Mapping[str, Mapping[str, Any]], ...] = ()
    never: tuple[str, ...] = ()
    maintenance: tuple[str, ...] | None = None
    operations: tuple[str, ...] = ()
    disabled: tuple[str, ...] | None = None
    culprits: tuple[list[str], ...] | None = None
    final: Mapping[str, bool | int | str] = field(default_factory=dict)
    warnings: tuple[str, ...] | None = None
    violations: Mapping[str, str | list[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Case:
    description: str
    ask: Ask
    then: Then
    given: Given = Given()
    model: str = "model.yaml"


class Strict(yaml.SafeLoader):
    """YAML in which no entry silently replaces another one."""


def distinct(loader: Strict, node: yaml.MappingNode) -> dict[Any, Any]:
    pairs = loader.construct_pairs(node, deep=True)
    twice = [key for at, (key, _) in enumerate(pairs) if key in dict(pairs[:at])]
    assert not twice, f"twice in one mapping: {twice}"
    return dict(pairs)


Strict.add_constructor("tag:yaml.org,2002:map", distinct)


def cases(path: Path) -> dict[str, Case]:
    """The questions of a file by name: one, or with `foreach` one for each combination of what the placeholders stand for.

    Cases with `when` are no questions; tests/simulate plays them.
    """
    text = path.read_text()
    whole = yaml.load(text, Strict)
    if "when" in whole:
        return {}
    foreach = whole.get("foreach", {})
    found: dict[str, Case] = {}
    for words in product(*map(pool, foreach.values())):
        one = text
        for name, word in zip(foreach, words, strict=True):
            one = one.replace(f"${name}", word)
        found["-".join([path.stem, *words])] = read(one)
    return found


def pool(values: list[str] | str) -> list[str]:
    """What a placeholder stands for: words, or numbers 1..9."""
    if isinstance(values, list):
        return [str(each) for each in values]
    low, high = map(int, values.split(".."))
    return [str(each) for each in range(low, high + 1)]


def read(text: str) -> Case:
    """A case from its text. Every key is known, and `then` says something."""
    data = {key: value for key, value in yaml.load(text, Strict).items() if key != "foreach"}
    parts = {
        "given": record(Given, data.get("given", {})),
        "ask": record(Ask, data.get("ask")),
        "then": record(Then, data.get("then")),
    }
    made: Case = record(Case, data, **parts)
    told, asked = made.then, made.ask
    assert [bool(asked.goal), bool(asked.intentions), asked.exit_forbidden].count(True) == 1, "ask one question"
    assert isinstance(asked.intentions, tuple) or asked.intentions == "active", "name the intentions, or say 'active'"
    known = ("reached", "unreachable", "not_within", "invariant_violated")
    assert told.verdict in known, f"verdict '{told.verdict}' is none of {known}"
    assert told.verdict != "reached" or told.length is not None, "a plan that is reached has a length"
    assert told.verdict != "invariant_violated" or told.violations, "say which invariants are violated, and how"
    return made


def record(made: type, data: object, **parts: object) -> Any:
    assert isinstance(data, dict), f"a mapping is missing for {made.__name__}"
    unknown = set(data) - {each.name for each in fields(made)}
    assert not unknown, f"{made.__name__} has no {sorted(unknown)}"
    return made(**{key: tuple(value) if isinstance(value, list) else value for key, value in data.items()} | parts)


@cache
def model(path: Path) -> sp.Model:
    return sp.load(path)


CASES = {
    folder.name: {name: case for path in sorted(folder.glob("cases/*.yaml")) for name, case in cases(path).items()}
    for folder in SCENARIOS
}
"""The cases of every scenario by name."""


def answer(case: Case, model: sp.Model, engine: str = "explicit") -> sp.Answer:
    """What a model answers to the question of a case."""
    asked, given = case.ask, case.given
    bounded = engine not in PROVING and case.then.verdict == "unreachable"
    return sp.plan(
        model,
        asked.goal,
        intentions=() if isinstance(asked.intentions, str) else asked.intentions,
        exit_forbidden=asked.exit_forbidden,
        formula=asked.formula,
        set=given.settings,
        maintenance=given.maintenance,
        lift=given.lift,
        disable=given.disabled,
        lose=given.lost,
        engine=engine,
        bound=SHORT if bounded else asked.bound,
        deadline=asked.deadline,
    )


def differences(case: Case, got: sp.Answer) -> list[str]:
    """What an answer has otherwise than the case declares; nothing if all is well."""
    then = case.then
    bounded = got.engine not in PROVING and then.verdict == "unreachable"
    maintenance = tuple(step.transition for step in got.steps if step.kind == "maintenance")
    violations = {v.invariant: "now" if v.now else list(v.slide) for v in got.violations}
    told = {
        "verdict": (got.verdict, "not_within" if bounded else then.verdict),
        "length": (got.length, then.length),
        "never": ({step.transition for step in got.steps} & set(then.never), set()),
        "maintenance": (maintenance, maintenance if then.maintenance is None else then.maintenance),
        "disabled": (got.disabled, got.disabled if then.disabled is None else then.disabled),
        "culprits": (got.culprits, got.culprits if then.culprits is None else tuple(map(tuple, then.culprits))),
        "final": ({variable: got.final.get(variable) for variable in then.final}, then.final),
        "violations": (violations, then.violations),
        "checked": (got.checked or got.verdict == "not_within", True),
    }
    found = [f"{name} is {value}, not {expected}" for name, (value, expected) in told.items() if value != expected]
    if not goes_through(got, then.steps):
        found.append(f"the steps are not in this order: {[step.transition for step in got.steps]}")
    operations = [each.operation for each in got.operations]
    if [name for name in operations if name in then.operations] != list(then.operations):
        found.append(f"the operations are not in this order: {operations}")
    if then.warnings is not None and not (
        len(then.warnings) == len(got.warnings)
        and all(text in warning for text, warning in zip(then.warnings, got.warnings, strict=True))
    ):
        found.append(f"other warnings: {got.warnings}")
    return found


def goes_through(answer: sp.Answer, expected: tuple[str | Mapping[str, Mapping[str, Any]], ...]) -> bool:
    """Whether the plan has the expected steps in their order."""
    steps = iter(answer.steps)
    for each in expected:
        ((transition, changes),) = each.items() if isinstance(each, Mapping) else [(each, {})]
        if not any(step.transition == transition and changes.items() <= step.changes.items() for step in steps):
            return False
    return True
