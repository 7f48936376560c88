"""Every event and every situation of a run comes back from the journal as it was, and no journal makes a plan of what is none."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig import TWO_ARMS, Rig, station

from smv_planner import api
from smv_planner.model.expressions import And, Const, Equal, If, Less, Minus, Named, Not, Or, Plus, Var
from smv_planner.model.ltl import Atom, Both, Either, Next, Release, Until
from smv_planner.planner.operations import Task, tasks
from smv_planner.planner.stage import Execution
from smv_planner.protocol.messages import StateMessage
from smv_planner.runner.decision import Action, Course, Decision, Purpose
from smv_planner.runner.events import Answered, Approve, Assign, Began, Cancel, Confirm, Event, Heard, Order, Ordered, Pause, Tick
from smv_planner.runner.records import Known, Unreadable, entry, record
from smv_planner.runner.situation import Pursuit, Situation, Status, at_rest
from smv_planner.runner.step import step

KNOWN = Known(station().model, api.widened_system)

NARROW = TWO_ARMS + "invariants:\n  one_out: not (left.at == out and right.at == out)\n"


@dataclass
class Run:
    """What a journal would hold of a run: for each event its record, and the situation before it."""

    begun: Situation | None = None
    records: list[bytes] = field(default_factory=list)
    before: list[Situation] = field(default_factory=list)


class Recorded(Rig):
    def __init__(self, text: str = TWO_ARMS, **given) -> None:
        self.run = Run()
        super().__init__(text, **given)

    def do(self, event: Event):
        self.run.records.append(record(event))
        self.run.before.append(self.now)
        return super().do(event)


def help_out(rig: Recorded) -> None:
    """The operator does what is asked, whatever it is."""
    for wish in tuple(rig.now.wishes):
        rig.order(Approve(wish))
        for instruction in rig.instructions:
            if instruction.request == wish:
                arm = instruction.transition.split(".")[0]
                rig.measure(f"{arm}.at", "home")
        rig.order(Confirm(wish))


def go_on(rig: Recorded, rounds: int = 12, obedient: bool = True) -> Recorded:
    for _ in range(rounds):
        rig.wait(0.4)
        if rig.now.asked:
            rig.answer()
        for arm in ("left", "right"):
            if obedient and rig.measured[arm][f"{arm}.at"] != "dropped":
                rig.measure(f"{arm}.at", rig.value(f"{arm}.to"))
        help_out(rig)
    return rig


def smooth() -> Recorded:
    return go_on(Recorded())


def nothing_moves() -> Recorded:
    """Effects time out, operations fail, the operator is asked."""
    return go_on(Recorded(), rounds=20, obedient=False)


def the_left_arm_is_dropped() -> Recorded:
    rig = go_on(Recorded(), rounds=1, obedient=False)
    rig.measure("left.at", "dropped")
    return go_on(rig)


def the_right_hub_is_lost() -> Recorded:
    rig = go_on(Recorded(), rounds=1, obedient=False)
    for _ in range(6):
        rig.wait(0.6, silent=("right",))
        if rig.now.asked:
            rig.answer()
    rig.order(Pause("both"))
    rig.order(Assign({"told": False, "noted": True}))
    rig.order(Cancel("both"))
    return go_on(rig, rounds=3)


def both_are_where_they_must_not_be() -> Recorded:
    return go_on(Recorded(NARROW, left_at="out", right_at="out", left_to="out", right_to="out"))


RUNS = [smooth, nothing_moves, the_left_arm_is_dropped, the_right_hub_is_lost, both_are_where_they_must_not_be]


@pytest.fixture(scope="module", params=RUNS, ids=lambda run: run.__name__)
def rig(request) -> Recorded:
    return request.param()


def known(rig: Recorded) -> Known:
    return Known(rig.station.model, api.widened_system)


def test_every_event_is_read_as_it_was(rig):
    for payload in rig.run.records:
        assert record(entry(payload, known(rig))) == payload


def test_what_is_read_leads_to_the_same_situation(rig):
    now = rig.run.before[0]
    for payload, before in zip(rig.run.records, rig.run.before, strict=True):
        assert now == before
        now, _ = step(rig.station, now, entry(payload, known(rig)))
    assert now == rig.now


def test_from_any_situation_that_is_read_the_rest_is_the_same(rig):
    """What a journal that begins anew relies on."""
    records, before = rig.run.records, rig.run.before
    for at in range(0, len(records), 7):
        payload = record(before[at])
        now = entry(payload, known(rig))
        assert now == before[at]
        assert record(now) == payload
        for each in records[at : at + 9]:
            now, _ = step(rig.station, now, entry(each, known(rig)))
        assert now == [*before, rig.now][min(at + 9, len(records))]


def test_the_runs_have_what_is_to_be_stored():
    """Plans of each purpose, failures, wishes; else the tests above say little."""
    every = [situation for run in RUNS for situation in run().run.before]
    plans = [situation.following for situation in every if situation.following]
    assert {following.purpose for following in plans} == set(Purpose)
    assert any(following.done for following in plans)
    assert any(len(following.operations) == 2 for following in plans)
    assert any(following.plan.partial for following in plans)
    assert any(following.lifted for following in plans)
    assert any(situation.executing != situation.following.operations for situation in every if situation.following)
    for what in ("failed", "disabled", "lost", "timers", "wishes", "asked", "course", "failures"):
        assert any(getattr(situation, what) for situation in every), what


def test_sets_are_written_in_order_whatever_the_process():
    words = [f"operation {n}" for n in range(100, 140)]
    said = json.loads(record(replace(at_rest(station()), spent=frozenset(words))))
    assert said["spent"] == words


# --- values of all kinds

words = st.text(max_size=8)
values = st.booleans() | st.integers(-(2**31), 2**31) | words
assignments = st.dictionaries(words, values, max_size=3)
times = st.floats(0, 1e9)
counts = st.integers(0, 2**53)
a_task = st.sampled_from(tasks(KNOWN.model))
st.register_type_strategy(Task, a_task)
messages = st.builds(StateMessage, words, words, words, counts, words, assignments, assignments, counts, counts, words)
executions = st.builds(Execution, a_task, st.dictionaries(words, assignments, max_size=2))
decisions = st.builds(
    Decision,
    actions=st.lists(st.builds(Action, words, st.booleans(), words, st.booleans(), times, words), max_size=2).map(tuple),
    executing=st.lists(executions, max_size=2).map(tuple),
    course=st.none() | st.from_type(Course),
    following=st.none(),
    failed=st.dictionaries(words, words, max_size=2),
    possible=st.lists(words, max_size=2).map(tuple),
    given_up=st.dictionaries(words, words, max_size=2),
    undecided=st.none() | words,
    stuck=st.none() | words,
)
orders = st.one_of(
    *(
        st.builds(made, assignments) if made is Assign else st.builds(made, *[words] * len(made.__dataclass_fields__))
        for made in Order.__args__
    )
)
events = st.one_of(
    st.builds(Began, times, words),
    st.builds(Tick, times),
    st.builds(Heard, times, messages),
    st.builds(Answered, times, counts, decisions),
    st.builds(Ordered, times, orders),
)


@given(events)
def test_whatever_happens_is_read_as_it_was(event):
    payload = record(event)
    again = entry(payload, KNOWN)
    assert again == event
    assert record(again) == payload, "true is not 1"
    assert payload.isascii()


exprs = st.recursive(
    st.builds(Const, values) | st.builds(Var, words),
    lambda part: st.one_of(
        st.builds(Not, part),
        *(st.builds(made, st.lists(part, max_size=2).map(tuple)) for made in (And, Or)),
        *(st.builds(made, part, part) for made in (Equal, Less, Plus, Minus)),
        st.builds(If, part, part, part),
        st.builds(Named, words, part),
    ),
    max_leaves=6,
)
formulas = st.recursive(
    st.builds(Atom, exprs),
    lambda part: st.builds(Next, part) | st.one_of(*(st.builds(made, part, part) for made in (Both, Either, Until, Release))),
    max_leaves=4,
)


@given(formulas)
def test_what_is_still_owed_is_read_as_it_was(owed):
    situation = replace(at_rest(station()), intentions={"both": Pursuit(Status.EXECUTING, owed)})
    assert repr(entry(record(situation), KNOWN)) == repr(situation)


@given(st.binary(max_size=40) | st.text(max_size=40).map(str.encode))
def test_nothing_else_is_read_as_an_event(noise):
    with pytest.raises(Unreadable):
        entry(noise, KNOWN)


@pytest.mark.parametrize(
    "text",
    [
        '{"is":"Tick"}',
        '{"is":"Tick","at":1}',
        '{"is":"Tick","at":true}',
        '{"is":"Tick","at":NaN}',
        '{"is":"Tick","at":1.0,"more":1}',
        '{"is":"Tock","at":1.0}',
        '{"at":1.0}',
        '[{"is":"Tick","at":1.0}]',
        '{"is":"Ordered","at":1.0,"order":{"is":"Assign","values":{"x":1.5}}}',
        '{"is":"Answered","at":1.0,"revision":true,"decision":{}}',
        '{"is":"Answered","at":1.0,"revision":1,"decision":{"executing":[{"task":"walk","posts":{}}]}}',
        "[" * 100_000,
    ],
    ids=lambda text: text[:60],
)
def test_an_event_that_says_something_wrong_is_unreadable(text):
    with pytest.raises(Unreadable, match="no record of this model"):
        entry(text.encode(), KNOWN)


# --- plans


def lies():
    def another_state(plan):
        plan["steps"][0][1] = {"left.to": "home"}

    def a_value_of_no_domain(plan):
        plan["steps"][0][1] = {"left.to": "away"}

    def a_step_too_few(plan):
        del plan["steps"][-1]
        del plan["after"][-1]

    def no_order(plan):
        plan["after"] = [[] for _ in plan["after"]]

    def a_step_that_waits_for_itself(plan):
        plan["after"][1] = [1]

    def a_step_that_is_unusable(plan):
        plan["unusable"] = ["left.reach"]

    def a_bound_that_is_too_small(plan):
        plan["bound"] = 1

    def other_operations(plan):
        plan["operations"] = plan["operations"][:1]
        plan["operations"][0]["posts"] = {"work_left": {"left_done": False}}

    def another_start(plan):
        plan["initial"] = ["out", *plan["initial"][1:]]

    return [value for value in locals().values() if callable(value)]


@pytest.mark.parametrize("lie", lies(), ids=lambda lie: lie.__name__)
def test_a_journal_cannot_make_a_plan(lie):
    rig = Recorded()
    rig.wait(0.4)
    rig.answer()
    answers = [json.loads(payload) for payload in rig.run.records if b'"Answered"' in payload]
    said = answers[-1]
    entry(json.dumps(said).encode(), KNOWN)
    lie(said["decision"]["following"])
    with pytest.raises(Unreadable, match=r"the checker refuses|no domain|waits for a later one"):
        entry(json.dumps(said).encode(), KNOWN)
