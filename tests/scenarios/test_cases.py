"""The scenarios do what their cases declare and what their READMEs claim."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from scenarios.declared import CASES, ROOT, SCENARIOS, Case, answer, differences, model, read

import smv_planner as sp
from smv_planner.engines import ENGINES


def long(deadline: float) -> tuple[pytest.MarkDecorator, ...]:
    """What is given more time than usual is a long test."""
    return (pytest.mark.long,) if deadline > 60 else ()


FOR_NUXMV = (
    "door/open",
    "door/locked_for_ever",
    "nutrunner/both_bolts_fixed",
    "tool_change/take_the_tool",
)
"""It is the user's own tool, so a few cases have to do."""

QUESTIONS = [
    pytest.param(folder, case, engine, id=f"{folder}/{name}-{engine}", marks=long(case.ask.deadline))
    for folder, found in CASES.items()
    for name, case in found.items()
    for engine in ENGINES
    if engine != "nuxmv" or f"{folder}/{name}" in FOR_NUXMV
]


def usable(engine: str) -> str:
    missing = ENGINES[engine].available()
    if missing:
        pytest.skip(missing)
    return engine


@pytest.mark.parametrize(("folder", "case", "engine"), QUESTIONS)
def test_a_case_has_the_outcome_that_it_declares(folder: str, case: Case, engine: str) -> None:
    assert not differences(case, answer(case, model(ROOT / "scenarios" / folder / case.model), usable(engine)))


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
        good.replace("goal: g", "goal: g, intentions: active"),
        good.replace("goal: g", ""),
        good.replace("goal: g", "intentions: every"),
        good.replace("}}", "}, given: {sets: {}}}"),
    ):
        with pytest.raises((AssertionError, TypeError)):
            read(bad)


@pytest.mark.parametrize("folder", SCENARIOS, ids=lambda folder: folder.name)
def test_a_scenario_is_complete(folder: Path) -> None:
    found = CASES[folder.name].values()
    assert (folder / "README.md").is_file()
    assert len(found) >= 4
    assert {"reached", "unreachable", "invariant_violated"} <= {case.then.verdict for case in found}
    assert any(case.then.length == 0 for case in found)
    assert {case.model for case in found} == {path.name for path in folder.glob("*.yaml")}
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

    @property
    def deadline(self) -> float:
        given = re.search(r"--deadline (\d+)", self.command)
        return float(given[1]) if given else 0.0


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
    "claim",
    [
        pytest.param(claim, id=f"{folder.name}{number}", marks=long(claim.deadline))
        for folder in SCENARIOS
        for number, claim in enumerate(claims(folder / "README.md"))
    ],
)
def test_a_readme_tells_the_truth(claim: Claim) -> None:
    told = CLAIM.fullmatch(claim.result)
    assert told, f"what does it answer? {claim}"
    (_, *arguments) = shlex.split(claim.command)
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
