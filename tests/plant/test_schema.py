"""The schemas of what emulated hubs are told say what they take and answer."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import Any

import pytest
from bridge_wires import Network
from jsonschema import Draft202012Validator
from plant.test_plant import DOOR

from bridge import keys
from smv_planner.errors import SmvPlannerError
from smv_planner.plant.schema import schemas
from smv_planner.plant.serve import Emulation, perform, tell
from smv_planner.plant.told import WORDS

VALID = {kind: Draft202012Validator(schema) for kind, schema in schemas().items()}
ARGUMENTS = {"fail": "opens:2", "instead": "opens:jams", "lying": "pos:jammed", "set": "pos:closed"}


@pytest.fixture
def network() -> Network:
    network = Network()
    Emulation(DOOR, "c", network.link())
    return network


@pytest.mark.parametrize("kind", VALID)
def test_they_are_schemas(kind: str) -> None:
    Draft202012Validator.check_schema(schemas()[kind])


@pytest.mark.parametrize("word", WORDS)
def test_whatever_a_hub_is_told_and_says_is_valid(word: str, network: Network) -> None:
    words = [f"{word}={ARGUMENTS[word]}" if word in ARGUMENTS else word]
    VALID["behaviour"].validate({"format": 1, "tell": words})
    VALID["behaving"].validate(tell(network.link(), "c", "door", words))


def test_what_a_person_does_is_valid(network: Network) -> None:
    said: list[bytes] = []
    takes = network.answers[keys.perform("c", "door")]

    def hear(asked: bytes) -> bytes:
        said.extend((asked, takes(asked)))
        return said[-1]

    network.answers[keys.perform("c", "door")] = hear
    tell(network.link(), "c", "door", ["set=pos:jammed"])
    perform(network.link(), DOOR, "c", "door.reset")
    asked, answered = map(json.loads, said)
    VALID["perform"].validate(asked)
    VALID["performed"].validate(answered)


WRONG: list[Any] = [None, 1, "x", [], [1], ["nonsense"], ["silent"] * 65, {}]


@pytest.mark.parametrize("wrong", WRONG, ids=lambda wrong: repr(wrong)[:20])
def test_what_a_hub_takes_is_valid(wrong: Any, network: Network) -> None:
    """Whatever the schema refuses, a hub refuses as well."""
    link, taken = network.link(), 0
    door = {"behaviour": keys.behaviour("c", "door"), "perform": keys.perform("c", "door")}
    for kind, document in (
        ("behaviour", {"format": 1, "tell": wrong}),
        ("behaviour", {"format": wrong, "tell": []}),
        ("perform", {"format": 1, "transition": wrong}),
        ("perform", {"format": 1, "transition": "door.reset", "chosen": wrong}),
    ):
        with suppress(ValueError, SmvPlannerError):  # how a hub refuses
            link.ask(door[kind], json.dumps(document).encode())
            VALID[kind].validate(document)
            taken += 1
    assert taken <= 2
