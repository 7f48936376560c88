"""The schemas of messages say what the codecs do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from generated_messages import GATE, GOAL, STATE, goals, interfaces, states
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

import smv_planner as sp
from bridge.descriptions import descriptions, written
from bridge.schemas import schemas
from smv_planner.protocol.messages import Rejected, decode_goal, decode_state, encode

ROOT = Path(__file__).parents[2]
VALID = {kind: Draft202012Validator(schema) for kind, schema in schemas().items()}


@pytest.mark.parametrize("kind", VALID)
def test_the_schemas_are_schemas(kind: str) -> None:
    Draft202012Validator.check_schema(schemas()[kind])


@given(st.data())
def test_every_message_that_is_sent_is_valid(data: st.DataObject) -> None:
    of = data.draw(interfaces())
    VALID["goal"].validate(json.loads(encode(data.draw(goals(of)))))
    VALID["state"].validate(json.loads(encode(data.draw(states(of)))))


WRONG: list[Any] = [None, "", 0, -1, 2**60, True, [], {}, {"x": None}, {"x": 1.5}, "a b", "x" * 65, "missing", "unknown"]


@pytest.mark.parametrize("wrong", WRONG, ids=repr)
def test_what_is_accepted_is_valid(wrong: Any) -> None:
    """Every member in turn replaced, left out, or joined by another."""
    for kind, message in (("goal", GOAL), ("state", STATE)):
        sound = json.loads(encode(message))
        refused = 0
        for member in sound:
            document = {**sound, member: wrong}
            if wrong == "missing":
                del document[member]
            elif wrong == "unknown":
                document = {**sound, f"{member}s": 1}
            payload = json.dumps(document).encode()
            decoded = decode_goal(payload, GATE) if kind == "goal" else decode_state(payload, GATE)
            if isinstance(decoded, Rejected):
                refused += 1
            else:
                VALID[kind].validate(document)
        assert refused > 5


def test_a_hub_that_obeys_nobody_names_nobody() -> None:
    fresh = {**json.loads(encode(STATE)), "epoch": 0, "goal_seq": 0, "planner": ""}
    assert VALID["state"].is_valid(fresh)
    for member, value in (("goal_seq", 1), ("planner", "p"), ("epoch", 1)):
        assert not VALID["state"].is_valid({**fresh, member: value})


@pytest.mark.parametrize("scenario", ["door", "nutrunner", "assembly_station", "engine_line", "dummy_robots"])
def test_every_interface_description_is_valid(scenario: str) -> None:
    for described in descriptions(sp.load(ROOT / "scenarios" / scenario), "cell").values():
        VALID["interface"].validate(written(described))
