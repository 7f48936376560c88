"""What a model checker says is read strictly: anything that is not exactly an answer to the question is an error."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from engines.questions import QUESTIONS
from engines.stand_ins import StandIn

from smv_planner.engines import Limits, nusmv, nuxmv
from smv_planner.errors import EngineError
from smv_planner.export.smv import RawTrace, encode
from smv_planner.problem import NotWithin, Problem, Reached, Undecided

PROBLEM, _ = QUESTIONS["up to the border"]
LIMITS = Limits(30, 1 << 30, lambda text: None)
PLAN = Reached(("up", "up", "up"), ((0,), (1,), (2,), (3,)))

NODE = '<node><state id="1"><value variable="v_n">{}</value><value variable="x_done">{}</value></state>{}</node>\n'
INPUT = '<input id="2"><value variable="x_step">{}</value></input>'
HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<counter-example type="0" desc="BMC Counterexample" >\n'
NODES = [
    *(NODE.format(n, "FALSE", INPUT.format("t_up" if n < 3 else "x_idle")) for n in range(4)),
    NODE.format(3, "TRUE", ""),
]
XML = f"{HEAD}{''.join(NODES)}<loops> </loops>\n</counter-example>\n"

Write = Callable[[str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def to_file(text: str) -> Path:
        path = tmp_path / "said"
        path.write_text(text, encoding="utf-8", errors="surrogateescape")
        return path

    return to_file


@pytest.fixture
def nuxmv_says(tmp_path: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch):
    """Asks while the executable does as it is told."""

    def ask(body: str, problem: Problem = PROBLEM) -> object:
        monkeypatch.setenv(nuxmv.SETTING, str(StandIn(tmp_path, body).path))
        return nuxmv.ask(problem, LIMITS)

    return ask


@pytest.fixture
def nusmv_says(temporary: Path, monkeypatch: pytest.MonkeyPatch, write: Write):
    """Asks while the child process prints what it is told."""
    monkeypatch.setattr(nusmv, "available", lambda: None)
    return lambda said: nusmv.ask(PROBLEM, LIMITS, child=("/bin/sh", "-c", f"cat {shlex.quote(str(write(said)))}"))


def said_in_json(trace: RawTrace, description: str = "BMC Counterexample") -> str:
    return json.dumps({"description": description, "states": list(trace.states), "inputs": list(trace.inputs)})


def test_a_trace_is_read(nuxmv_says, write: Write) -> None:
    assert nuxmv_says(f"cat {write(XML)} > trace.xml") == PLAN


def test_a_trace_may_leave_out_what_did_not_change() -> None:
    same = '<value variable="x_step">t_up</value>'
    shorter = XML.replace('<value variable="x_done">FALSE</value>', "").replace(same, "")
    shorter = shorter.replace("</value></state>", '</value><value variable="x_done">FALSE</value></state>', 1)
    shorter = shorter.replace('<input id="2">', f'<input id="2">{same}', 1)
    assert len(shorter) < len(XML)
    assert encode(PROBLEM).decode(nuxmv.read(shorter.encode())) == PLAN


def test_a_trace_in_json_is_read(nusmv_says) -> None:
    assert nusmv_says(said_in_json(nuxmv.read(XML.encode()))) == PLAN


WRONG_XML = {
    "nothing": "",
    "garbage": "\x00\x01\x02 garbage",
    "not closed": XML[:-20],
    "half a node": XML[: len(XML) // 2],
    "another kind of trace": XML.replace("BMC Counterexample", "BMC Failed Induction"),
    "a simulation": XML.replace("BMC Counterexample", "Simulation Trace"),
    "no description": XML.replace(' desc="BMC Counterexample"', ""),
    "another document": XML.replace("counter-example", "html"),
    "two documents": XML + XML,
    "a document type": XML.replace("<counter", "<!DOCTYPE x [<!ENTITY e 'v_n'>]><counter", 1),
    "a bomb": XML.replace("<counter", "<!DOCTYPE x [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]><counter", 1).replace("t_up", "&b;"),
    "an external entity": XML.replace("<counter", "<!DOCTYPE x [<!ENTITY e SYSTEM '/etc/passwd'>]><counter", 1),
    "an undefined entity": XML.replace("t_up", "&up;"),
    "an unknown encoding": XML.replace("UTF-8", "none"),
    "another encoding": XML.replace("UTF-8", "UTF-16"),
    "letters beyond ASCII": XML.replace("t_up", "t_üp"),
    "no nodes": f"{HEAD}</counter-example>",
    "a node too few": XML.replace(NODES[4], ""),
    "a step skipped": XML.replace(NODES[3], ""),
    "a state too many in a node": "".join(XML.rpartition("</state>")[:2]) + '<state id="9"></state></node></counter-example>',
    "an input too many in a node": XML.replace("</input>", "</input>" + INPUT.format("t_up"), 1),
    "an unknown part": XML.replace("<loops> </loops>", "<extra></extra>"),
    "an unknown part of a node": XML.replace("</node>", "<extra></extra></node>", 1),
    "a node without state": XML.replace("state", "stat"),
    "a value without name": XML.replace(' variable="v_n"', "", 1),
    "a value without value": XML.replace(">0<", "><", 1),
    "a value with parts": XML.replace(">0<", "><b>0</b><", 1),
    "a value twice": XML.replace('<value variable="v_n">0</value>', '<value variable="v_n">0</value>' * 2, 1),
    "an unknown variable": XML.replace("v_n", "v_m"),
    "an unknown define": XML.replace('<value variable="v_n">0', '<value variable="d_n">0</value><value variable="v_n">0', 1),
    "an unmangled variable": XML.replace("v_n", "n"),
    "an unknown transition": XML.replace("t_up", "t_down"),
    "a value outside": XML.replace(">3<", ">4<"),
    "a value that is no number": XML.replace(">3<", ">three<"),
    "never at rest": XML.replace("x_idle", "t_up"),
    "deep nesting": HEAD + "<node>" * 200_000 + "</node>" * 200_000 + "</counter-example>",
}


@pytest.mark.parametrize("wrong", WRONG_XML)
def test_a_wrong_trace_is_an_error(wrong: str) -> None:
    with pytest.raises(EngineError):
        encode(PROBLEM).decode(nuxmv.read(WRONG_XML[wrong].encode()))


def test_a_wrong_trace_of_an_executable_is_an_error(nuxmv_says, write: Write, temporary: Path) -> None:
    with pytest.raises(EngineError, match="t_down"):
        nuxmv_says(f"cat {write(WRONG_XML['an unknown transition'])} > trace.xml")
    assert not list(temporary.iterdir())


@pytest.mark.parametrize("make", ["ln -s /dev/zero", "mkfifo", "mkdir"])
def test_a_trace_that_is_no_file_is_not_read(nuxmv_says, make: str) -> None:
    with pytest.raises(EngineError, match="not a file of at most"):
        nuxmv_says(f"{make} trace.xml")


@pytest.mark.parametrize(
    ("body", "verdict"),
    [
        ("for k in 0 1 2; do echo -- no counterexample found with bound $k and no loop; done", NotWithin),
        ("echo -- no counterexample found with bound 13 and no loop", NotWithin),
        ("for k in 13 12; do echo -- no counterexample found with bound $k and no loop; done", Undecided),
        ("echo -- no counterexample found with bound 12", Undecided),
        ("echo -- no counterexample found with bound 130", Undecided),
        ("echo '-- specification !(F x_done) is true'", Undecided),
        ("echo 'x -- no counterexample found with bound 13'", Undecided),
        ("echo -- no counterexample found with bound 13; exit 1", Undecided),
    ],
)
def test_no_plan_is_believed_only_up_to_the_bound_that_was_asked_for(nuxmv_says, body: str, verdict: type) -> None:
    problem, _ = QUESTIONS["up to the border"]
    bound = 1 if "0 1 2" in body else problem.bound
    asked = Problem(problem.system, problem.initial, problem.goals, problem.allowed, bound=bound)
    assert isinstance(nuxmv_says(body, asked), verdict)


TRACE = nuxmv.read(XML.encode())
ANSWER = json.loads(said_in_json(TRACE))

WRONG_JSON = {
    "garbage": "\x00garbage",
    "not JSON": "None",
    "half": said_in_json(TRACE)[:-5],
    "twice": said_in_json(TRACE) * 2,
    "null": "null",
    "a number": "1",
    "a list": json.dumps([ANSWER]),
    "an empty object": "{}",
    "another bound": '{"none_within": 12}',
    "a bound that is true": '{"none_within": true}',
    "a bound and more": '{"none_within": 13, "states": []}',
    "another kind of trace": said_in_json(TRACE, "BMC Failed Induction"),
    "no description": json.dumps({name: value for name, value in ANSWER.items() if name != "description"}),
    "no inputs": json.dumps({name: value for name, value in ANSWER.items() if name != "inputs"}),
    "more than a trace": json.dumps(ANSWER | {"bound": 4}),
    "states by number": json.dumps(ANSWER | {"states": dict(enumerate(TRACE.states))}),
    "states of lists": json.dumps(ANSWER | {"states": [list(state.items()) for state in TRACE.states]}),
    "values that are numbers": json.dumps(ANSWER | {"states": [state | {"v_n": 0} for state in TRACE.states]}),
    "values that are null": json.dumps(ANSWER | {"inputs": [{"x_step": None}] * 4}),
    "an unknown variable": said_in_json(TRACE).replace("v_n", "v_m"),
    "an unknown transition": said_in_json(TRACE).replace("t_up", "up"),
    "deep nesting": "[" * 100_000 + "]" * 100_000,
    "letters beyond UTF-8": "\udcff\udcfe",
}


@pytest.mark.parametrize("wrong", WRONG_JSON)
def test_a_wrong_answer_of_the_child_is_an_error(nusmv_says, wrong: str, temporary: Path) -> None:
    with pytest.raises(EngineError):
        nusmv_says(WRONG_JSON[wrong])
    assert not list(temporary.iterdir())


def test_the_child_is_believed_that_there_is_no_plan_within_the_bound(nusmv_says) -> None:
    assert nusmv_says('{"none_within": 13}') == NotWithin(12)


def test_an_engine_that_is_not_there_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv(nuxmv.SETTING, raising=False)
    assert nuxmv.SETTING in str(nuxmv.available())
    with pytest.raises(EngineError, match=nuxmv.SETTING):
        nuxmv.ask(PROBLEM, LIMITS)
    monkeypatch.setenv(nuxmv.SETTING, str(tmp_path / "nuXmv"))
    assert "not an executable file" in str(nuxmv.available())
    monkeypatch.setitem(sys.modules, "pynusmv", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr(nusmv, "find_spec", lambda name: None)
    assert "make nusmv" in str(nusmv.available())
    with pytest.raises(EngineError, match="pynusmv"):
        nusmv.ask(PROBLEM, LIMITS)
