"""Interfaces, and messages that fit them, for the tests of protocol and transport."""

from __future__ import annotations

from hypothesis import strategies as st

from smv_planner.model.domains import Bool, Domain, Enum, Range, Value
from smv_planner.protocol.interface import Interface
from smv_planner.protocol.messages import MAX_COUNT, GoalMessage, StateMessage

GATE = Interface(
    cell="hall-1",
    resource="gate",
    goals={"gate.ref": Enum(("closed", "opened")), "gate.lock": Bool(), "gate.speed": Range(-3, 3)},
    measured={"gate.pos": Enum(("closed", "opened", "1", "true", "null")), "gate.locked": Bool(), "gate.count": Range(0, 1)},
    model="f" * 64,
)
GOAL = GoalMessage("hall-1", "gate", 3, 17, "planner-a", "f" * 64, {"gate.ref": "opened", "gate.lock": False, "gate.speed": -2})
STATE = StateMessage(
    "hall-1",
    "gate",
    "boot-1",
    4,
    "f" * 64,
    {"gate.pos": "closed", "gate.locked": False, "gate.count": 1},
    {"gate.ref": "opened", "gate.lock": False, "gate.speed": -2},
    3,
    17,
    "planner-a",
)

words = st.text("abcXYZ019_-", min_size=1, max_size=8)
identities = st.text("abcXYZ019_.-", min_size=1, max_size=64)
counts = st.integers(1, MAX_COUNT)
domains: st.SearchStrategy[Domain] = st.one_of(
    st.just(Bool()),
    st.lists(words, min_size=1, max_size=5, unique=True).map(lambda found: Enum(tuple(found))),
    st.tuples(st.integers(-50, 50), st.integers(0, 100)).map(lambda pair: Range(pair[0], pair[0] + pair[1])),
)


@st.composite
def interfaces(draw: st.DrawFn) -> Interface:
    names = draw(st.lists(words, max_size=8, unique=True))
    cut = draw(st.integers(0, len(names)))
    goals, measured = ({f"r.{name}": draw(domains) for name in part} for part in (names[:cut], names[cut:]))
    return Interface(draw(identities), "r", goals, measured, draw(words))


@st.composite
def values(draw: st.DrawFn, variables: dict[str, Domain]) -> dict[str, Value]:
    return {name: draw(st.sampled_from(domain.values)) for name, domain in variables.items()}


@st.composite
def goals(draw: st.DrawFn, of: Interface) -> GoalMessage:
    numbers = draw(counts), draw(counts)
    return GoalMessage(of.cell, of.resource, *numbers, draw(identities), of.model, draw(values(of.goals)))


@st.composite
def states(draw: st.DrawFn, of: Interface) -> StateMessage:
    accepted = draw(st.one_of(st.just((0, 0, "")), st.tuples(counts, counts, identities)))
    measured, mirror = draw(values(of.measured)), draw(values(of.goals))
    return StateMessage(of.cell, of.resource, draw(identities), draw(counts), of.model, measured, mirror, *accepted)
