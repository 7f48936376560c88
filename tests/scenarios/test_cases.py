"""The scenarios do what their cases declare and what their READMEs claim.

What a case file may say stands in scenarios/README.md.
"""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

import smv_planner as sp
from smv_planner.engines import ENGINES

ROOT = Path(__file__).parents[2]
SCENARIOS = sorted(folder for folder in (ROOT / "scenarios").iterdir() if folder.is_dir())
CASES = sorted((ROOT / "scenarios").glob("*/cases/*.yaml"))

FOR_NUXMV = (
    "door/cases/open",
    "door/cases/locked_for_ever",
    "nutrunner/cases/both_bolts_fixed",
    "tool_change/cases/take_the_tool",
)
"""It is the user's own tool, so a few cases have to do."""

QUESTIONS = [(path, engine) for path in CASES for engine in ENGINES if engine != "nuxmv"] + [
    (ROOT / "scenarios" / f"{case}.yaml", "nuxmv") for case in FOR_NUXMV
]

SHORT = 15
"""A bounded model checker cannot say `unreachable`; it is asked for plans up to here and has to find none."""


@dataclass(frozen=True)
class Given:
    set: Mapping[str, bool | int | str] = field(default_factory=dict)
    maintenance: bool = False
    lift: tuple[str, ...] = ()


@dataclass(frozen=True)
class Ask:
    goal: str | list[str]
    formula: str | None = None
    bound: int = 100


@dataclass(frozen=True)
class Then:
    verdict: str
    length: int | None = None
    steps: tuple[str | Mapping[str, Mapping[str, Any]], ...] = ()
    never: tuple[str, ...] = ()
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


def read(text: str) -> Case:
    """A case from its text. Every key is known, and `then` says something."""
    data = yaml.load(text, Strict)
    parts = {
        "given": record(Given, data.get("given", {})),
        "ask": record(Ask, data.get("ask")),
        "then": record(Then, data.get("then")),
    }
    made: Case = record(Case, data, **parts)
    told = made.then
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


def usable(engine: str) -> str:
    missing = ENGINES[engine].available()
    if missing:
        pytest.skip(missing)
    return engine


@pytest.mark.parametrize(
    ("path", "engine"), QUESTIONS, ids=lambda each: each if isinstance(each, str) else f"{each.parents[1].name}/{each.stem}"
)
def test_a_case_has_the_outcome_that_it_declares(path: Path, engine: str) -> None:
    case = read(path.read_text())
    then = case.then
    bounded = usable(engine) != "explicit" and then.verdict == "unreachable"
    answer = sp.plan(
        model(path.parents[1] / case.model),
        case.ask.goal,
        formula=case.ask.formula,
        set=case.given.set,
        maintenance=case.given.maintenance,
        lift=case.given.lift,
        engine=engine,
        bound=SHORT if bounded else case.ask.bound,
    )
    assert answer.verdict == ("not_within" if bounded else then.verdict)
    assert answer.length == then.length
    assert answer.checked or answer.verdict == "not_within"
    assert goes_through(answer, then.steps), f"not in this order: {[step.transition for step in answer.steps]}"
    assert not {step.transition for step in answer.steps} & set(then.never)
    assert {variable: answer.final.get(variable) for variable in then.final} == then.final
    if then.warnings is not None:
        assert len(answer.warnings) == len(then.warnings), answer.warnings
        assert all(text in warning for text, warning in zip(then.warnings, answer.warnings, strict=True))
    assert {v.invariant: "now" if v.now else list(v.slide) for v in answer.violations} == then.violations


def goes_through(answer: sp.Answer, expected: tuple[str | Mapping[str, Mapping[str, Any]], ...]) -> bool:
    """Whether the plan has the expected steps in their order."""
    steps = iter(answer.steps)
    for each in expected:
        ((transition, changes),) = each.items() if isinstance(each, Mapping) else [(each, {})]
        if not any(step.transition == transition and changes.items() <= step.changes.items() for step in steps):
            return False
    return True


def test_a_case_is_read_strictly() -> None:
    good = "{description: d, ask: {goal: g}, then: {verdict: unreachable}}"
    assert read(good).then.verdict == "unreachable"
    for bad in (
        good.replace("goal: g", "goal: g, gaol: h"),
        good.replace("unreachable", "reachable"),
        good.replace("unreachable", "reached"),
        good.replace("unreachable", "invariant_violated"),
        good.replace("verdict: unreachable", ""),
        good.replace("goal: g", "goal: g, goal: h"),
        good.replace("}}", "}, given: {sets: {}}}"),
    ):
        with pytest.raises((AssertionError, TypeError)):
            read(bad)


@pytest.mark.parametrize("folder", SCENARIOS, ids=lambda folder: folder.name)
def test_a_scenario_is_complete(folder: Path) -> None:
    cases = [read(path.read_text()) for path in sorted(folder.glob("cases/*.yaml"))]
    assert (folder / "README.md").is_file()
    assert len(cases) >= 4
    assert {"reached", "unreachable", "invariant_violated"} <= {case.then.verdict for case in cases}
    assert any(case.then.length == 0 for case in cases)
    assert {case.model for case in cases} == {path.name for path in folder.glob("*.yaml")}
    assert model(folder / "model.yaml").name == folder.name


@pytest.mark.parametrize(
    ("folder", "variant", "invariants"),
    [("nutrunner", "model_fixed.yaml", {"stand_still"}), ("tool_change", "model_carry.yaml", {"spec_d"})],
)
def test_a_variant_differs_in_its_invariants_only(folder: str, variant: str, invariants: set[str]) -> None:
    one, other = model(ROOT / "scenarios" / folder / "model.yaml"), model(ROOT / "scenarios" / folder / variant)
    assert replace(one, invariants=()).hash == replace(other, invariants=()).hash
    assert {i.name for i in set(one.invariants) ^ set(other.invariants)} == invariants


@pytest.mark.parametrize("engine", ["explicit", "nusmv"])
def test_the_cure_of_the_nutrunner_costs_steps_and_silences_the_warning(engine: str) -> None:
    folder = ROOT / "scenarios" / "nutrunner"
    goal = "bolt_1 == tightened and bolt_2 == tightened"
    trap = sp.plan(model(folder / "model.yaml"), goal, engine=usable(engine))
    cured = sp.plan(model(folder / "model_fixed.yaml"), goal, engine=engine)
    runs = [[step.transition for step in answer.steps].count("nutrunner.start") for answer in (trap, cured)]
    assert runs == [1, 2]
    assert trap.length is not None
    assert cured.length is not None
    assert trap.length < cured.length
    assert ["late" in warning for warning in trap.warnings] == [True]
    assert cured.warnings == ()


NEEDED = {  # specification: what taking the tool, and carrying it away in either model, take without it
    "": (7, None, 13),
    "switches": (7, None, 13),
    "spec_a": (7, None, 11),
    "spec_b": (7, None, 13),
    "spec_c": (6, None, 12),
    "spec_d": (7, 13, 13),
    "spec_e": (7, None, 13),
}


@pytest.mark.parametrize("lifted", NEEDED)
def test_what_each_specification_of_the_tool_change_costs(lifted: str) -> None:
    folder = ROOT / "scenarios" / "tool_change"
    coded, meant = model(folder / "model.yaml"), model(folder / "model_carry.yaml")
    take, carry = "tool_e == robot", "tool_e == robot and robot.p_e == p1"
    lift = [lifted] if lifted else []
    asked = [(coded, take), (coded, carry), (meant, carry)]
    answers = [sp.plan(each, goal, lift=lift, engine="explicit") for each, goal in asked]
    assert tuple(answer.length for answer in answers) == NEEDED[lifted]
    row = re.search(rf"^\| {lifted or 'none'} .*$", (folder / "README.md").read_text(), re.MULTILINE)
    assert row, "the README has no such row"
    assert [cell.strip() for cell in row[0].split("|")[2:-1]] == [str(n or "unreachable") for n in NEEDED[lifted]]


# What a README claims: each command of a `sh` block is followed by a comment that says what it answers, as in
#
#     smv-plan scenarios/door --goal free
#     # reached in 5 steps

CLAIM = re.compile(
    r"# (?:(?P<reached>reached in (?P<length>\d+) steps?(?P<warning>, with a warning)?)|(?P<already>reached already)"
    r"|(?P<not_within>not within \d+ steps)|(?P<unreachable>unreachable)|(?P<invariant_violated>invariant violated))(?:: .*)?"
)


@dataclass(frozen=True)
class Claim:
    command: str
    result: str


def claims(readme: Path) -> Iterator[Claim]:
    """The commands of a README, each with the line that follows it."""
    for block in re.findall(r"^```sh\n(.*?)^```", readme.read_text(), re.MULTILINE | re.DOTALL):
        lines = block.replace("\\\n", " ").splitlines()
        for line, following in zip(lines, [*lines[1:], ""], strict=True):
            if line.startswith("smv-plan "):
                yield Claim(line, following)


@pytest.mark.parametrize("folder", SCENARIOS, ids=lambda folder: folder.name)
def test_a_readme_keeps_its_commands_where_they_are_checked(folder: Path) -> None:
    text = (folder / "README.md").read_text()
    found = list(claims(folder / "README.md"))
    assert len(found) >= 3
    assert len(found) == len(re.findall(r"smv-plan (?!`)", text)), "a command stands outside of the sh blocks"


@pytest.mark.parametrize(
    "claim", [pytest.param(c, id=f"{f.name}{n}") for f in SCENARIOS for n, c in enumerate(claims(f / "README.md"))]
)
def test_a_readme_tells_the_truth(claim: Claim) -> None:
    told = CLAIM.fullmatch(claim.result)
    assert told, f"what does it answer? {claim}"
    (_, *arguments) = shlex.split(claim.command)
    if "--engine" not in arguments:
        usable("nusmv")
    ran = subprocess.run(
        [Path(sys.executable).parent / "smv-plan", *arguments, "--json"], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert ran.stdout, ran.stderr
    answer = json.loads(ran.stdout)
    assert "verdict" in answer, answer
    verdict = "reached" if told["already"] else told.lastgroup
    length = 0 if told["already"] else told["length"] and int(told["length"])
    assert (answer["verdict"], answer["length"]) == (verdict, length)
    assert bool(answer["warnings"]) == bool(told["warning"])
    assert ran.returncode == {"reached": 0, "not_within": 4}.get(verdict or "", 1)
