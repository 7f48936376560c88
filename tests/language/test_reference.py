"""The reference of the language is true: what it shows can be read, and every key is in it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from language.test_schema import RECORDS, refused

from smv_planner.language import loads
from smv_planner.language.document import EXPANDED
from smv_planner.language.schema import WRITTEN
from smv_planner.language.shapes import Record

TEXT = (Path(__file__).parents[2] / "scenarios" / "LANGUAGE.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


SCENARIOS = [block for block in blocks("yaml") if "\nname: " in block]
FRAGMENTS = [block for block in blocks("yaml") if "\nname: " not in block]


@pytest.mark.parametrize("text", SCENARIOS, ids=lambda text: re.findall("^name: (.*)", text, re.MULTILINE)[0])
def test_a_scenario_of_the_reference_loads(text):
    loads(text)
    assert refused(text) == []


@pytest.mark.parametrize("text", FRAGMENTS, ids=lambda text: text.split(":")[0])
def test_a_part_of_a_scenario_has_its_shape(text):
    assert refused("smv_planner: 1\nname: x\n" + text) == []


def test_python_of_the_reference_runs():
    (text,) = blocks("python")
    made: dict[str, object] = {}
    exec(text, made)
    assert made["model"].system.transition["r2.move_shelf"]


@pytest.mark.parametrize("made", RECORDS, ids=lambda made: made.__name__)
def test_every_key_is_in_the_reference(made):
    for key in (*(entry.key for entry in Record(made).entries), *EXPANDED.get(made, ()), *WRITTEN):
        assert re.search(rf"\b{key}\b", TEXT), f"'{key}' is missing"


def test_its_links_lead_somewhere():
    headings = {re.sub(r"[^\w -]", "", line.lower()).replace(" ", "-") for line in re.findall(r"^#+ (.*)", TEXT, re.MULTILINE)}
    assert set(re.findall(r"\(#([^)]*)\)", TEXT)) <= headings
