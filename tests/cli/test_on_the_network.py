"""Commands among others on a network, who may say anything."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
from argparse import Namespace
from pathlib import Path
from typing import Any

import pytest
from bridge_wires import Network
from jsonschema import Draft202012Validator

import smv_planner as sp
from bridge import keys
from bridge.errors import LinkError, RefusedError
from smv_planner.cli import heard, outcome
from smv_planner.cli.asking import Events, document
from smv_planner.cli.main import command
from smv_planner.cli.network import cell_of, named_cell
from smv_planner.cli.operator import Desk
from smv_planner.cli.staged import Staged
from smv_planner.daemon.schema import schemas
from smv_planner.errors import EngineError, UsageError
from smv_planner.simulate.script import case

ROOT = Path(__file__).parents[2]
DOOR = sp.load(ROOT / "scenarios/door")
CLEAR = "\x1b[2J"
REQUEST = {"request": "w1", "kind": "maintenance", "answer": "confirm", "text": "Look", "transition": "door.reset"}
ASKED: dict[str, Any] = {
    "format": 1,
    "kind": "operator",
    "cell": "c",
    "model": "m",
    "planner": "p",
    "epoch": 1,
    "at": 0.5,
    "requests": [{**REQUEST, "values": {"door.pos": "closed"}, "confirmed": False}],
}
EVENT: dict[str, Any] = {
    **{name: ASKED[name] for name in ("format", "cell", "model", "planner", "epoch", "at")},
    "kind": "event",
    "number": 1,
    "event": "lost",
    "text": "'r1'",
    "data": {},
}
ACTION = {"name": "TP", "reached": True, "what": "work", "ordinary": False, "seconds": 0.1, "reason": ""}
DECISION = {**EVENT, "event": "decision", "data": {"cause": "timeout", "actions": [ACTION]}}
MEASURED = {**EVENT, "event": "measured", "data": {"resource": "door", "effects": ["door.opens"]}}
OPERATION = {**EVENT, "event": "operation", "data": {"operation": "work", "state": "executing"}}
GARBAGE = [b"", b"\xff", b"{", b"[]", b"null", b"{}", b"[" * 100_000, b'{"requests": [{}]}', b'{"number": "1", "planner": []}']
WRONG: list[Any] = [None, "", -1, 7, True, 0.5, [], {}, [None], {"x": None}, {"x": 1}, ["x"], "missing", "unknown"]


def every(found: Any, wrong: Any) -> list[Any]:
    """The document with each member in turn replaced, left out, or joined by another, at any depth."""
    made: list[Any] = []
    if isinstance(found, dict):
        for name, value in found.items():
            others = {each: found[each] for each in found if each != name}
            made.append(
                others if wrong == "missing" else {**found, "other": 1} if wrong == "unknown" else {**others, name: wrong}
            )
            made += [{**others, name: deeper} for deeper in every(value, wrong)]
    elif isinstance(found, list):
        made += [[deeper, *found[1:]] for deeper in every(found[0], wrong)] if found else []
    return made


@pytest.mark.parametrize("kind", schemas())
@pytest.mark.parametrize("wrong", WRONG, ids=repr)
def test_what_is_taken_is_as_the_schema_says(kind: str, wrong: Any) -> None:
    schema = schemas()[kind]
    judge = Draft202012Validator(schema)
    for sound in (ASKED, EVENT, DECISION, MEASURED, OPERATION, {"order": "set", "values": {"x": 1}}, {"order": "proceed"}):
        for said in [sound, *every(sound, wrong)]:
            assert heard.fits(said, schema) == judge.is_valid(said), said


@pytest.mark.parametrize("garbage", GARBAGE, ids=lambda garbage: repr(garbage[:20]))
def test_garbage_is_no_document_and_hurts_nobody(garbage: bytes) -> None:
    network = Network()
    other = network.link()
    desk, events = Desk(network.link(), "c", as_json=False), Events(network.link(), "c")
    other.answer(keys.operator("c"), lambda _: garbage)
    other.answer(keys.event("c"), lambda _: garbage)
    other.publish(keys.operator("c"), garbage)
    other.publish(keys.event("c"), garbage)
    desk.run(lambda: False)
    assert events.new() == []
    with pytest.raises(LinkError, match="no document"):
        document(other, keys.operator("c"), "operator")


def test_events_are_told_once() -> None:
    network = Network()
    events, other = Events(network.link(), "c"), network.link()
    other.answer(keys.event("c"), lambda _: json.dumps([EVENT]).encode())
    other.publish(keys.event("c"), json.dumps(EVENT).encode())
    assert [each["number"] for each in events.new()] == [1]
    assert events.new() == []


def test_nobody_hides_what_happens_behind_a_number_that_no_planner_has_reached() -> None:
    network = Network()
    events, other = Events(network.link(), "c"), network.link()
    said = [{**EVENT, "number": number} for number in (1, 2, 3)]
    other.publish(keys.event("c"), json.dumps({**EVENT, "number": 10**14}).encode())
    assert events.new() == [], "nobody confirms it"
    other.answer(keys.event("c"), lambda _: json.dumps(said[:2]).encode())
    other.publish(keys.event("c"), json.dumps({**EVENT, "number": 10**14}).encode())
    assert [each["number"] for each in events.new()] == [1, 2], "what the planner says when it is asked"
    other.publish(keys.event("c"), json.dumps(said[2]).encode())
    assert [each["number"] for each in events.new()] == [3]


@pytest.mark.parametrize("data", [{}, {"actions": 1}, {"actions": [{}]}, {"actions": [{**ACTION, "name": 1}]}])
def test_a_decision_that_is_none_is_no_event(data: dict[str, Any]) -> None:
    assert heard.document(json.dumps({**DECISION, "data": data}).encode(), "event") is None


def test_a_case_takes_decisions_from_the_network_with_more_in_them_than_it_knows() -> None:
    network = Network()
    nothing = case("description: nothing\nwhen: []\nthen: {never: [door.locked]}", DOOR)
    staged = Staged(network.link(), "c", DOOR, nothing, 1.0)
    later = {**DECISION, "data": {"actions": [{**ACTION, "of_a_later_version": 1}]}}
    network.link().publish(keys.event("c"), json.dumps(later).encode())
    staged.look()
    assert [action.name for action in staged.record.recovery] == ["TP"]


def test_nobody_writes_to_the_terminal_of_the_operator(capsys: pytest.CaptureFixture[str]) -> None:
    network = Network()
    desk = Desk(network.link(), "c", as_json=False)
    forged = {**ASKED, "requests": [{**ASKED["requests"][0], "text": CLEAR, "request": CLEAR}]}
    network.link().publish(keys.operator("c"), json.dumps(forged).encode())
    lines: queue.Queue[str | None] = queue.Queue()
    lines.put("list")
    lines.put("approve")
    desk.run(lambda: desk.answers(lines) and False)
    told = capsys.readouterr()
    assert "asked" in told.out
    assert "\x1b" not in told.out + told.err


def test_an_operator_by_itself_does_what_it_can(capsys: pytest.CaptureFixture[str]) -> None:
    """Whoever asks for what the scenario does not have is told so, and the next request is looked at."""
    network = Network()
    ordered: list[bytes] = []
    other = network.link()
    other.answer(keys.order("c"), lambda order: ordered.append(order) or b"{}")
    other.answer(keys.perform("c", "door"), lambda _: b"{}")
    desk = Desk(network.link(), "c", as_json=False)
    unknown = {**ASKED["requests"][0], "request": "w0", "transition": f"door.fly{CLEAR}"}
    other.publish(keys.operator("c"), json.dumps({**ASKED, "requests": [unknown, *ASKED["requests"]]}).encode())
    desk.run(lambda: desk.by_itself(DOOR, 0.0) and False)
    assert [json.loads(order) for order in ordered] == [{"order": "confirm", "request": "w1"}]
    told = capsys.readouterr()
    assert "not done: there is no transition 'door.fly" in told.err
    assert "\x1b" not in told.out + told.err


@pytest.mark.parametrize("cell", ["x#", "", "a/b", "x" * 65, "**"])
@pytest.mark.parametrize(
    "words",
    [
        ("interface", "scenarios/door"),
        ("security", "acl", "scenarios/door"),
        ("emulate", "scenarios/door"),
        ("operator", "scenarios/door"),
        ("watch", "--for", "0"),
        ("watch", "--mirror"),
    ],
    ids=" ".join,
)
def test_what_can_be_no_cell_is_refused(words: tuple[str, ...], cell: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    with pytest.raises(UsageError, match="name of a cell"):
        command([*words, "--cell", cell])


def test_a_cell_is_named_by_the_flag_or_the_environment_or_the_scenario(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SMV_PLANNER_CELL", raising=False)
    assert (cell_of(Namespace(cell=None), DOOR), named_cell(Namespace(cell=None))) == ("door", None)
    monkeypatch.setenv("SMV_PLANNER_CELL", "line-1")
    assert (cell_of(Namespace(cell=None), DOOR), cell_of(Namespace(cell="line-2"), DOOR)) == ("line-1", "line-2")


def test_a_hub_has_to_be_told_something(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    with pytest.raises(UsageError, match="'door' is told nothing"):
        command(["emulate", "scenarios/door", "--tell", "door"])


@pytest.mark.parametrize(("words", "told"), [(["plans"], "is no question and no order"), (["plan", "x"], "is not how to say it")])
def test_what_cannot_be_asked_is_refused_before_anybody_is_asked(words: list[str], told: str) -> None:
    with pytest.raises(UsageError, match=told):
        command(["ask", *words])


@pytest.mark.parametrize(
    ("error", "code"), [(RefusedError("no"), 2), (LinkError("nobody answers"), 6), (EngineError("it broke"), 5)], ids=repr
)
def test_the_exit_code_says_who_is_to_blame(error: EngineError, code: int) -> None:
    def fail(_: object) -> int:
        raise error

    assert outcome.run(fail, []) == code


def test_what_the_terminal_cannot_show_is_told_all_the_same() -> None:
    program = "from smv_planner.cli import outcome; raise SystemExit(outcome.run(lambda _: print('sk\\u00e5p') or 0, []))"
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([sys.executable, "-c", program], env=environment, cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "sk\\xe5p\n", "")
