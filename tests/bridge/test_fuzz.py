"""Whatever bytes the network brings, a hub obeys sound goals only, counts the rest by reason, and does not grow."""

from __future__ import annotations

import tracemalloc
from collections import Counter
from math import inf
from random import Random

import pytest
from bridge_wires import Network
from generated_messages import GATE, GOAL, STATE

from bridge import keys
from bridge.link import MAX_BYTES
from bridge.overheard import overheard
from bridge.wire import Wire
from smv_planner.protocol import hub as automaton
from smv_planner.protocol.hub import Hold
from smv_planner.protocol.messages import GoalMessage, Reason, Rejected, StateMessage, encode

SOUND = [
    encode(GOAL),
    encode(GoalMessage("hall-1", "gate", 3, 18, "planner-a", "f" * 64, {**GOAL.values, "gate.speed": 3})),
    encode(GoalMessage("hall-1", "gate", 2, 99, "planner-b", "f" * 64, GOAL.values)),
    encode(STATE),
]
TOKENS = [b"NaN", b"1e999", b"-0", b"true", b"null", b'"', b"{", b"}", b"[", b",", b":", b"\\u0000", b"\xff\xfe", b"9" * 20]
TOKENS += [b'"epoch":', b'"values":{', b'"gate.ref":"opened",', b'"kind":"state"', b"\x00", b" " * 30, b"[" * 80, b'{"":' * 20]


def payload(random: Random) -> bytes:
    """Something like a message."""
    base = random.choice(SOUND)
    match random.randrange(9):
        case 0:
            return random.randbytes(random.randrange(200))
        case 1:
            return base[: random.randrange(len(base))]
        case 2:
            other = random.choice(SOUND)
            return base[: random.randrange(len(base))] + other[random.randrange(len(other)) :]
        case 3:
            return base + random.choice(TOKENS)
        case 4 if random.random() < 0.001:
            return base + b" " * MAX_BYTES
        case 5:
            return base
    changed = bytearray(base)
    for _ in range(random.randrange(1, 4)):
        place = random.randrange(len(changed))
        if random.random() < 0.5:
            changed[place] ^= 1 << random.randrange(8)
        else:
            changed[place : place + random.randrange(6)] = random.choice(TOKENS)
    return bytes(changed)


def hub_under(payloads: int, seed: int) -> Counter[str]:
    """How often what was refused, after so many payloads."""
    random, network = Random(seed), Network()
    sender, wire = network.link(), Wire(network.link(), GATE, lambda: None)
    accepted = 0
    memory = 0
    for number in range(payloads):
        if number % 1000 == 0:  # a goal whose damage went unnoticed may claim the last epoch there is
            hub = automaton.start(GATE, "boot-1", 0.0, dict(GOAL.values), Hold(inf))
        sent = payload(random)
        sender.publish(keys.goal("hall-1", "gate"), sent)
        before, refused = hub, sum(wire.rejected.values())
        goals = wire.goals()
        assert len(goals) + sum(wire.rejected.values()) - refused == 1, "each is taken or counted"
        for message in goals:
            assert all(message.values[name] in domain for name, domain in GATE.goals.items())
            match automaton.receive(hub, message, 0.0):
                case Rejected() as rejected:
                    wire.refuse(rejected)
                    assert hub is before
                case hub:
                    accepted += 1
        assert isinstance(overheard(sent), GoalMessage | StateMessage | None)
        if number == payloads // 10:
            tracemalloc.start()
            memory = tracemalloc.get_traced_memory()[0]
        elif tracemalloc.is_tracing() and number == payloads // 10 + 2000:
            grown = tracemalloc.get_traced_memory()[0] - memory
            tracemalloc.stop()
            assert grown < 200_000, "two thousand payloads leave nothing behind"
    return wire.rejected + Counter(accepted=accepted)


@pytest.mark.parametrize(("payloads", "seed"), [(10**5, 1), pytest.param(10**6, 2, marks=pytest.mark.long)])
def test_no_payload_brings_a_hub_down(payloads: int, seed: int) -> None:
    counts = hub_under(payloads, seed)
    assert sum(counts.values()) == payloads
    assert counts["accepted"] > payloads // 50
    expected = {Reason.MALFORMED, Reason.NUMBER, Reason.FORMAT, Reason.FIELDS, Reason.VARIABLES, Reason.DOMAIN, Reason.OLD_EPOCH}
    assert expected <= counts.keys()
