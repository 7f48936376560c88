"""What execution cases declare comes to pass, and a case is read strictly."""

from __future__ import annotations

from dataclasses import fields

import pytest
from simulate.played import CASES, LOAD, ROOT, play

from smv_planner.errors import ModelError
from smv_planner.model.model import Model
from smv_planner.simulate.script import Entry, case, texts

LONG = 3600.0
"""A case that is given more virtual time than this is a long test."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (case.then.within > LONG)) for name, (_, case) in CASES.items()]
)
def test_a_case_comes_out_as_it_declares(name: str) -> None:
    assert play(name).run() == []


@pytest.mark.long
@pytest.mark.parametrize("seed", range(1, 6))
@pytest.mark.parametrize("name", [f"assembly_station/e{number}" for number in range(1, 10)])
def test_the_error_situations_come_out_the_same_however_fast_devices_are(name: str, seed: int) -> None:
    assert play(name, seed).run() == []


GOOD = """\
description: d
given: {set: {bolt_1: placed}}
when:
  - {at: 2 s, fail: r2_connector.attaches}
  - {after: r2.sets_out, silent: [r2]}
then:
  intentions: {tighten_bolts: finished}
  never: [r2.moving]
"""

BAD = {
    "fail: r2_connector.attaches": {
        "fail: r2_connector.ataches": "4:21: there is no effect 'r2_connector.ataches' (did you mean 'r2_connector.attaches'?)",
        "fail: r2_connector.lock_on": "4:21: there is no effect 'r2_connector.lock_on'",
        "fails: r2_connector.attaches": "unknown key 'fails'",
        "times: 2": "nothing happens here",
        "set: {r1.ref_pos: home}": "'r1.ref_pos' is a goal variable (that is what the planner commands; set what is measured)",
        "lying: {bolt_1: placed}": "there is no measured variable 'bolt_1'",
        "instead: {nutrunner.torque: nutrunner.fail}": "there is no effect 'nutrunner.fail'",
        "once: r1.still, after: r2.sets_out, silent: r1": "'after' and 'once' do not go together",
        "cancel: tighten": "there is no intention or operation 'tighten'",
        "operator: {ignores: r2.arrives}": "there is no maintenance transition 'r2.arrives'",
    },
    "at: 2 s": {"at: soon": "'soon' is not a duration", "at: 2": "'2' is not a duration"},
    "bolt_1: placed": {"bolt_1: here": "'here' is not a value of 'bolt_1'", "bolt1: placed": "did you mean 'bolt_1'?"},
    "finished": {"done": "expected one of initial, executing, finished", "finished, tighten: error": "no intention 'tighten'"},
    "r2.moving": {"r2.movin": "unknown variable 'r2.movin'", "bolt_1": "expected a condition"},
    "[r2]": {"[r3]": "there is no resource 'r3'"},
    "when:": {"when: []\nwhat:": "unknown key 'what'"},
}


def station_model() -> Model:
    return LOAD(ROOT / "scenarios" / "assembly_station")


@pytest.mark.parametrize(("good", "bad", "told"), [(good, bad, told) for good, all_ in BAD.items() for bad, told in all_.items()])
def test_a_mistake_in_a_case_is_told_with_its_place(good: str, bad: str, told: str) -> None:
    assert case(GOOD, station_model()).then.intentions == {"tighten_bolts": "finished"}
    with pytest.raises(ModelError) as raised:
        case(GOOD.replace(good, bad), station_model(), file="case.yaml")
    assert told in str(raised.value)


def test_the_example_in_the_readme_is_a_case() -> None:
    told = (ROOT / "scenarios" / "README.md").read_text().split("### Cases that are played")[1]
    example = case(told.split("```yaml\n")[1].split("```")[0], station_model())
    known = {field.name for field in fields(Entry)}
    used = {name for each in example.when for name in known if getattr(each, name) != getattr(Entry(), name)}
    assert used == known, "every key is explained"


def test_every_mistake_is_told_at_once() -> None:
    text = GOOD.replace("r2.sets_out", "r2.set_out").replace("bolt_1: placed", "bolt_1: here").replace("r2.moving", "r2.movin")
    with pytest.raises(ModelError) as raised:
        case(text, station_model(), file="case.yaml")
    assert [mistake.place.line for mistake in raised.value.mistakes if mistake.place] == [2, 5, 8]


def test_one_file_may_hold_a_case_for_each_of_several_words() -> None:
    text = "foreach: {robot: [r1, r2], i: 1..2}\n" + GOOD.replace("bolt_1", "bolt_$i").replace("r2", "$robot")
    found = dict(texts(text, "e"))
    assert list(found) == ["e-r1-1", "e-r1-2", "e-r2-1", "e-r2-2"]
    assert case(found["e-r1-2"], station_model()).when[1].silent == ("r1",)


def test_the_same_seed_tells_the_same_story_and_another_seed_another_one() -> None:
    def story(seed: int) -> list[tuple[float, str]]:
        played = play("door/played_jam", seed)
        assert played.run() == []
        return [(at, note.text) for at, note in played.world.notes]

    one, again, other = story(1), story(1), story(2)
    assert one == again
    assert one != other
