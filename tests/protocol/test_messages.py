"""Messages travel whole or not at all: whatever the bytes are, decoding gives a message that fits, or the reason."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from random import Random

import pytest
from generated_messages import GATE, GOAL, STATE, goals, interfaces, states
from hypothesis import given
from hypothesis import strategies as st

import smv_planner as sp
from smv_planner.model.domains import Bool
from smv_planner.protocol import interface
from smv_planner.protocol.messages import (
    MAX_BYTES,
    MAX_COUNT,
    GoalMessage,
    Reason,
    Rejected,
    StateMessage,
    decode_goal,
    decode_state,
    encode,
)

GOAL_TEXT = (
    '{"format":1,"kind":"goal","cell":"hall-1","resource":"gate","epoch":3,"seq":17,"planner":"planner-a",'
    f'"model":"{"f" * 64}","values":{{"gate.ref":"opened","gate.lock":false,"gate.speed":-2}}}}'
)
STATE_TEXT = (
    f'{{"format":1,"kind":"state","cell":"hall-1","resource":"gate","boot":"boot-1","seq":4,"model":"{"f" * 64}",'
    '"measured":{"gate.pos":"closed","gate.locked":false,"gate.count":1},'
    '"mirror":{"gate.ref":"opened","gate.lock":false,"gate.speed":-2},"epoch":3,"goal_seq":17,"planner":"planner-a"}'
)


def reason(found: GoalMessage | StateMessage | Rejected) -> Reason | None:
    return found.reason if isinstance(found, Rejected) else None


def test_the_form_on_the_wire():
    assert encode(GOAL).decode() == GOAL_TEXT
    assert encode(STATE).decode() == STATE_TEXT


@given(st.data())
def test_what_is_encoded_is_decoded(data):
    of = data.draw(interfaces())
    goal, state = data.draw(goals(of)), data.draw(states(of))
    for message, decoded in ((goal, decode_goal(encode(goal), of)), (state, decode_state(encode(state), of))):
        assert decoded == message
        assert encode(decoded) == encode(message)  # `==` alone takes True for 1


def test_the_order_of_members_does_not_matter_and_is_declared_order_afterwards():
    def turned(value):
        return {k: turned(v) for k, v in reversed(value.items())} if isinstance(value, dict) else value

    assert encode(decode_goal(json.dumps(turned(json.loads(GOAL_TEXT)), indent=1).encode(), GATE)).decode() == GOAL_TEXT
    assert encode(decode_state(json.dumps(turned(json.loads(STATE_TEXT))).encode(), GATE)).decode() == STATE_TEXT


LITERALS = r"""true false "true" "false" TRUE True 1 1.0 1e0 0 0.0 -0 -0.0 "1" "0" 2 -1 -2 -3 3 4 "closed" "opened" "CLOSED"
    "clos\u0065d" "closed\u0000" "\ud800" 'closed' null "null" [] [1] {} {"a":1} NaN Infinity -Infinity 1e999 -1e999 nan
    0x1 0b1 01 +1 1_0 .5 1. 4294967297 18446744073709551617 340282366920938463463374607431768211457 yes on""".split()  # noqa: SIM905
LITERALS += ["1" * 5000, "-" + "9" * 20, '" closed"', ""]
FITTING = {
    "gate.pos": {'"closed"', '"opened"', '"1"', '"true"', '"null"', '"clos\\u0065d"'},
    "gate.locked": {"true", "false"},
    "gate.count": {"0", "1"},
    "gate.ref": {'"closed"', '"opened"', '"clos\\u0065d"'},
    "gate.lock": {"true", "false"},
    "gate.speed": {"-1", "-2", "-3", "0", "1", "2", "3"},
}


@pytest.mark.parametrize("variable", FITTING)
def test_a_value_of_another_type_is_never_taken(variable):
    """Rows 26 and 27 of the fault model: every literal opposite every type."""
    known = {**STATE.measured, **STATE.mirror}
    old = f'"{variable}":{json.dumps(known[variable])}'
    accepted = set()
    for literal in LITERALS:
        new = f'"{variable}":{literal}'
        state = decode_state(STATE_TEXT.replace(old, new).encode(), GATE)
        if not isinstance(state, Rejected):
            accepted.add(literal)
            value = {**state.measured, **state.mirror}[variable]
            assert (type(value), value) == (type(json.loads(literal)), json.loads(literal))
        if variable in GATE.goals:
            assert (reason(decode_goal(GOAL_TEXT.replace(old, new).encode(), GATE)) is None) == (literal in accepted)
    assert accepted == FITTING[variable]


COUNTS = ["-0", "-1", "1.0", "1e3", "1e999", "NaN", "true", '"3"', "null", str(MAX_COUNT + 1), "9" * 5000, "0x3", "[]"]


@pytest.mark.parametrize("literal", COUNTS)
def test_a_count_is_a_number_that_every_hub_can_read(literal):
    for count in ('"epoch":3', '"seq":17'):
        assert reason(decode_goal(GOAL_TEXT.replace(count, f"{count[: count.index(':')]}:{literal}").encode(), GATE))
    for count in ('"epoch":3', '"seq":4', '"goal_seq":17'):
        assert reason(decode_state(STATE_TEXT.replace(count, f"{count[: count.index(':')]}:{literal}").encode(), GATE))


def test_the_largest_count_travels():
    assert decode_goal(encode(replace(GOAL, epoch=MAX_COUNT, seq=MAX_COUNT)), GATE).epoch == MAX_COUNT


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("3", "NaN", Reason.NUMBER),
        ("3", "1e999", Reason.NUMBER),
        ("3", "-0", Reason.NUMBER),
        ("3", "0", Reason.NUMBER),
        ("3", "3.0", Reason.NUMBER),
        ("3", "true", Reason.TYPE),
        ('"epoch":3', '"epoch":3,"epoch":4', Reason.REPEATED_KEY),
        ('"gate.lock":false', '"gate.lock":false,"gate.lock":true', Reason.REPEATED_KEY),
        ('"gate.lock":false', '"gate.lock":false,"gate.l\\u006fck":true', Reason.REPEATED_KEY),
        ('"gate.lock":false', '"gate.lock":0', Reason.TYPE),
        ('"gate.lock":false,', "", Reason.VARIABLES),
        ('"gate.lock":false', '"gate.lock":false,"gate.locked":true', Reason.VARIABLES),
        ('"gate.lock"', '"lock"', Reason.VARIABLES),
        ("opened", "jammed", Reason.DOMAIN),
        ("-2", "4", Reason.DOMAIN),
        ("-2", "18446744073709551614", Reason.NUMBER),
        ('"values":{', '"values":{"x":{', Reason.MALFORMED),
        ('"values":{', '"measured":{', Reason.FIELDS),
        (',"planner":"planner-a"', "", Reason.FIELDS),
        ('"epoch"', '"extra":1,"epoch"', Reason.FIELDS),
        ("planner-a", "", Reason.FIELDS),
        ("planner-a", "a" * 65, Reason.FIELDS),
        ("planner-a", "planner a", Reason.FIELDS),
        ("planner-a", "planner\\ud800", Reason.FIELDS),
        ('"planner-a"', "7", Reason.TYPE),
        ("hall-1", "hall-2", Reason.FOREIGN),
        ('"gate"', '"door"', Reason.FOREIGN),
        ('"gate"', "null", Reason.TYPE),
        ("f" * 64, "e" * 64, Reason.MODEL),
        ('"format":1', '"format":2', Reason.FORMAT),
        ('"format":1', '"format":true', Reason.FORMAT),
        ('"format":1,', "", Reason.FORMAT),
        ('"kind":"goal"', '"kind":"state"', Reason.FORMAT),
        ('"hall-1"', '"hall-\xfc"', Reason.MALFORMED),
        ("{", "[", Reason.MALFORMED),
        (GOAL_TEXT, "[]", Reason.MALFORMED),
        (GOAL_TEXT, "null", Reason.MALFORMED),
        (GOAL_TEXT, "", Reason.MALFORMED),
        (GOAL_TEXT, "[" * 60_000, Reason.MALFORMED),
        (GOAL_TEXT, '{"a":' * 10_000, Reason.MALFORMED),
        (GOAL_TEXT, GOAL_TEXT * 2, Reason.MALFORMED),
        (GOAL_TEXT, " " * MAX_BYTES + GOAL_TEXT, Reason.OVERSIZE),
    ],
)
def test_every_mistake_has_its_reason(old, new, expected):
    assert old in GOAL_TEXT
    found = decode_goal(GOAL_TEXT.replace(old, new, 1).encode("latin-1"), GATE)
    assert reason(found) is expected
    assert len(found.detail) < 250


def test_a_value_that_is_deep_is_refused_before_it_is_parsed():
    for deep in ("[" * 40 + "]" * 40, "[" * 30_000 + "]" * 30_000, '{"a":' * 5_000 + "1" + "}" * 5_000):
        assert reason(decode_goal(GOAL_TEXT.replace("-2", deep).encode(), GATE)) in (Reason.TYPE, Reason.MALFORMED)


def test_nothing_was_accepted_before_the_first_epoch():
    none = replace(STATE, epoch=0, goal_seq=0, planner="")
    assert decode_state(encode(none), GATE) == none
    for mixed in (
        replace(none, goal_seq=1),
        replace(none, planner="a"),
        replace(none, epoch=1),
        replace(STATE, planner=""),
        replace(STATE, goal_seq=0),
    ):
        assert isinstance(decode_state(encode(mixed), GATE), Rejected)


@pytest.mark.parametrize(("text", "decode"), [(GOAL_TEXT, decode_goal), (STATE_TEXT, decode_state)])
def test_what_is_cut_off_or_goes_on_is_refused(text, decode):
    whole = text.encode()
    assert not isinstance(decode(whole, GATE), Rejected)
    assert not isinstance(decode(whole + b" \n", GATE), Rejected)
    for end in range(len(whole)):
        assert isinstance(decode(whole[:end], GATE), Rejected)
    for byte in set(range(256)) - set(b" \t\r\n"):
        assert isinstance(decode(whole + bytes([byte]), GATE), Rejected)
    for other in (text.encode("utf-16"), text.encode("utf-32"), text.encode("utf-8-sig")):
        assert isinstance(decode(other, GATE), Rejected)


@given(st.binary(max_size=300))
def test_no_bytes_raise(payload):
    assert isinstance(decode_goal(payload, GATE), Rejected)
    assert isinstance(decode_state(payload, GATE), Rejected)


TOKENS = [
    *(b'{ } [ ] : , " \\ \\u0000 \\ud800 true false null NaN Infinity -0 1.0 1e999 99999999999999999999'.split()),
    *(b'0 1 -1 "1" "gate.lock" "gate.ref" "opened" "closed" 2 3 7 4 b'.split()),
    *(b'"epoch":9, "seq":9, "gate.lock":true, "gate.speed":1, "door" "hall-2" "state" "x":1,'.split()),
    b'"model":"' + b"e" * 64 + b'",',
    b"[" * 70,
    b" " * MAX_BYTES,
]


def mutated(payload: bytes, random: Random) -> bytes:
    """The payload after one to three of the accidents and tricks that happen to payloads."""
    for _ in range(random.randint(1, 3)):
        at, end = random.randrange(len(payload) + 1), random.randrange(len(payload) + 1)
        match random.randrange(6):
            case 0 if payload:
                flipped = bytearray(payload)
                flipped[at % len(payload)] ^= 1 << random.randrange(8)
                payload = bytes(flipped)
            case 1:
                payload = payload[:at] + payload[end:]  # cuts out, or repeats
            case 2:
                payload = payload[:at] + random.choice(TOKENS) + payload[at:]
            case 3:
                token = random.choice(TOKENS)
                payload = payload[:at] + token + payload[at + len(token) :]
            case _:  # where the value of a member begins
                at = payload.find(b":", at) + 1
                until = min((found for sign in b",}" if (found := payload.find(sign, at)) >= 0), default=at)
                payload = payload[:at] + random.choice(TOKENS) + payload[until:]
    return payload


def fuzz(rounds: int, seed: int) -> Counter[str]:
    random, seen = Random(seed), Counter[str]()
    sources = [encode(GOAL), encode(STATE)]
    for _ in range(rounds):
        payload = mutated(random.choice(sources), random)
        for decode in (decode_goal, decode_state):
            found = decode(payload, GATE)
            if isinstance(found, Rejected):
                seen[found.reason] += 1
                continue
            seen["accepted"] += 1
            assert decode(encode(found), GATE) == found
            domains = {**GATE.goals, **GATE.measured}
            taken = found.values if isinstance(found, GoalMessage) else {**found.measured, **found.mirror}
            assert all(value in domains[name] for name, value in taken.items())
            assert (found.cell, found.resource, found.model) == ("hall-1", "gate", GATE.model)
    return seen


DECODING = set(Reason) - {Reason.OLD_EPOCH, Reason.OTHER_PLANNER, Reason.OLD, Reason.CONFLICT}


def test_fuzzed_messages_are_refused_or_fit():
    seen = fuzz(50_000, seed=1)  # each is decoded twice
    assert seen.total() == 100_000
    assert {*DECODING, "accepted"} <= seen.keys(), seen


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2, 6))
def test_a_million_fuzzed_messages_are_refused_or_fit(seed):
    seen = fuzz(250_000, seed)
    assert min(seen[each] for each in {*DECODING, "accepted"}) > 10, seen


def test_the_interface_of_a_resource_is_what_it_is_told_and_what_it_measures():
    model = sp.load("scenarios/door")
    door = interface.interfaces(model, "hall-1")["door"]
    assert [*door.goals] == ["door.ref", "door.lock"]
    assert [*door.measured] == ["door.pos", "door.locked"]  # what is estimated does not travel
    assert door.goals["door.lock"] == Bool()
    assert (door.cell, door.resource, door.model) == ("hall-1", "door", model.hash)
