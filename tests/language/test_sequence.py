"""Sequences: which operation waits for which, and what is wrong with them."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from language.marked import expected, mistakes

from smv_planner.language import Decision, Intention, Operation, Parallel, Scenario, build, loads
from smv_planner.model.model import Sequence

OPERATIONS = """\
smv_planner: 1
name: ladder_frame
decision:
  bolt_$i: {foreach: {i: 1..6}, domain: [empty, placed, tight], initial: empty}
  frame: {domain: [away, there], initial: away}
operations:
  locate: {effects: {frame: there}}
  attach: {effects: {frame: there}}
  detach: {effects: {frame: away}}
  place_$i: {foreach: {i: 1..6}, effects: {bolt_$i: placed}}
  tighten_$i: {foreach: {i: 1..6}, effects: {bolt_$i: tight}}
"""


def intended(sequence, more=""):
    return OPERATIONS + f"intentions:\n  assemble: {{start: 'true', goal: frame == there, sequence: {sequence}{more}}}\n"


def waits(sequence):
    """Each operation with those that it directly waits for."""
    assert sequence is not None
    assert len(sequence.operations) == len(sequence.after)
    return [
        (operation, *(sequence.operations[at] for at in after))
        for operation, after in zip(sequence.operations, sequence.after, strict=True)
    ]


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("[locate]", [("locate",)]),
        ("[locate, attach, detach]", [("locate",), ("attach", "locate"), ("detach", "attach")]),
        (
            "[locate, attach, {parallel: [tighten_1, [place_2, tighten_2]]}, detach]",
            [
                ("locate",),
                ("attach", "locate"),
                ("tighten_1", "attach"),
                ("place_2", "attach"),
                ("tighten_2", "place_2"),
                ("detach", "tighten_1", "tighten_2"),
            ],
        ),
        (
            "[{parallel: [locate, {parallel: [place_1, place_2]}]}, attach]",
            [("locate",), ("place_1",), ("place_2",), ("attach", "locate", "place_1", "place_2")],
        ),
        (
            "[{parallel: [[place_1, {parallel: [tighten_1, place_2]}], locate]}]",
            [("place_1",), ("tighten_1", "place_1"), ("place_2", "place_1"), ("locate",)],
        ),
        ("[locate, [attach, detach]]", [("locate",), ("attach", "locate"), ("detach", "attach")]),
        (
            "[{foreach: {i: 1..2}, do: [place_$i, tighten_$i]}, {foreach: {i: 3..4}, do: place_$i}]",
            [
                ("place_1",),
                ("tighten_1", "place_1"),
                ("place_2", "tighten_1"),
                ("tighten_2", "place_2"),
                ("place_3", "tighten_2"),
                ("place_4", "place_3"),
            ],
        ),
        (
            "[locate, {parallel: [{foreach: {i: 1..6}, where: $i != 2, do: tighten_$i}]}]",
            [("locate",), *((f"tighten_{i}", "locate") for i in (1, 3, 4, 5, 6))],
        ),
        (
            "[{parallel: [{foreach: {i: 1..2}, do: [place_$i, tighten_$i]}]}]",
            [("place_1",), ("tighten_1", "place_1"), ("place_2",), ("tighten_2", "place_2")],
        ),
    ],
)
def test_each_operation_waits_for_what_is_directly_before_it(written, meant):
    (intention,) = loads(intended(written)).intentions
    assert waits(intention.sequence) == meant
    assert not intention.sequence.manual


def test_only_a_manual_sequence_repeats_operations():
    (intention,) = loads(intended("[locate, place_1, locate]", ", manual: true")).intentions
    assert intention.sequence == Sequence(("locate", "place_1", "locate"), ((), (0,), (1,)), manual=True)


def test_a_sequence_at_the_top_binds_every_intention():
    model = loads(OPERATIONS + "sequence: [locate, {parallel: [place_1, place_2]}]")
    assert waits(model.sequence) == [("locate",), ("place_1", "locate"), ("place_2", "locate")]
    assert loads(OPERATIONS).sequence is None


def test_a_sequence_changes_the_hash():
    hashes = {loads(intended(each)).hash for each in ("[locate, attach]", "[attach, locate]", "[{parallel: [locate, attach]}]")}
    assert len(hashes | {loads(OPERATIONS).hash, loads(OPERATIONS + "sequence: [locate, attach]").hash}) == 5


def test_python_writes_the_same():
    scenario = Scenario(
        "ladder_frame",
        decision={"frame": Decision(["away", "there"], "away")},
        operations={name: Operation(effects={"frame": "there"}) for name in ("a", "b", "c", "d")},
        intentions={"i": Intention("true", "frame == there", sequence=["a", Parallel(["b", ["c", "d"]])], manual=False)},
    )
    (intention,) = build(scenario).intentions
    assert waits(intention.sequence) == [("a",), ("b", "a"), ("c", "a"), ("d", "c")]


def case(sequence, *messages, more=""):
    return pytest.param(intended(sequence, more), messages, id=sequence + more)


@pytest.mark.parametrize(
    ("text", "messages"),
    [
        case("[«locat»]", "unknown operation 'locat' (did you mean 'locate'?)"),
        case("[locate, {parallel: [attach, [«tighten_7»]]}]", "unknown operation 'tighten_7' (did you mean 'tighten_6'?)"),
        case(
            "[locate, attach, «locate»]",
            "'locate' is in the sequence twice (the other one is in line 13; only a manual sequence repeats operations)",
        ),
        case(
            "[locate, «locate»]",
            "'locate' is in the sequence twice (the other one is in line 13; only a manual sequence repeats operations)",
            more=", manual: false",
        ),
        case("«[]»", "there is no operation here (name what runs, or leave it out)"),
        case("[locate, «[]»]", "there is no operation here (name what runs, or leave it out)"),
        case("[{parallel: «[]»}]", "there is no branch here (name what runs side by side)"),
        case("[{parallel: [locate, «[]»]}]", "there is no operation here (name what runs, or leave it out)"),
        case("[{parallel: «[{foreach: {i: 1..0}, do: place_$i}]»}]", "there is no branch here (name what runs side by side)"),
        case("[{«paralell»: [locate]}]", "unknown key 'paralell' (did you mean 'parallel'?)"),
        case("[locate, «3»]", "'3' is not a name (letters, digits, '_' and inner '-', with at least one letter between dots)"),
        case("[{foreach: {i: 1..2}, «doo»: x, do: place_$i}]", "unknown key 'doo' (did you mean 'do'?)"),
        case("[locate]", "expected true or false, not '1'", more=", manual: «1»"),
        pytest.param(
            OPERATIONS + "intentions: {i: {start: 'true', goal: frame == there, «manual»: true}}\n",
            ("'manual' stands without 'sequence' (it says that the sequence is the plan)",),
            id="manual",
        ),
        pytest.param(OPERATIONS + "sequence: [«lcate»]\n", ("unknown operation 'lcate' (did you mean 'locate'?)",), id="top"),
    ],
)
def test_a_mistake_in_a_sequence_is_reported_where_it_is(text, messages):
    plain, found = expected(text, *messages)
    assert mistakes(plain) == found


def test_operations_that_are_not_read_make_no_step_unknown():
    text = OPERATIONS.replace("operations:", "operation:") + "sequence: [locate]\n"
    assert [message for message, *_ in mistakes(text)] == ["unknown key 'operation' (did you mean 'operations'?)"]


STEPS = st.recursive(
    st.just("operation"),
    lambda step: st.lists(step | st.lists(step, min_size=1, max_size=3), min_size=1, max_size=3).map(Parallel),
    max_leaves=8,
)


@settings(deadline=None)
@given(steps=st.lists(STEPS, min_size=1, max_size=4))
def test_positions_wait_for_earlier_ones_and_for_nothing_that_those_wait_for(steps):
    names = []

    def named(step):
        match step:
            case Parallel(branches):
                return Parallel(named(branches))
            case list(several):
                return [named(each) for each in several]
        names.append(f"o{len(names)}")
        return names[-1]

    sequence = named(steps)
    decision = {"v": Decision("bool", False)}
    operations = {name: Operation(effects={"v": "true"}) for name in names}
    model = build(Scenario("x", decision=decision, operations=operations, sequence=sequence))
    assert model.sequence is not None
    assert model.sequence.operations == tuple(names)
    before: list[set[int]] = []
    for at, after in enumerate(model.sequence.after):
        assert all(each < at for each in after)
        earlier = [before[each] for each in after]
        assert set().union(*earlier).isdisjoint(after)
        before.append(set(after).union(*earlier))
