"""An engine that lies: the real NuSMV runs, but what it is asked or what it answers is changed on the way.

Through the real `smv-plan`, in the place of the user's nuXmv. Every lie must end with exit 5, and never with a plan.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NUSMV = Path(sys.executable).with_name("NuSMV")
QUESTION = ["scenarios/tool_change", "--goal", "tool_e == robot", "--engine", "nuxmv", "--json"]

LIAR = """#!{python}
import re, subprocess, sys
from pathlib import Path
from xml.etree import ElementTree

model = Path("problem.smv")
text = model.read_text()
{ask}
model.write_text(text)
subprocess.run(["{nusmv}", *sys.argv[1:]], check=True)
trace = Path("trace.xml")
tree = ElementTree.parse(trace)
root = tree.getroot()
nodes = root.findall("node")
states = [{{value.get("variable"): value for value in node.find("state")}} for node in nodes]
steps = [node.find("input")[0] for node in nodes if node.find("input") is not None]
middle = len(nodes) // 2
{answer}
tree.write(trace)
{after}
"""

ASK = {
    "it was asked without invariants": "text = re.sub(r'^INVAR .*$', '', text, flags=re.M)",
    "it was asked without the guards": r"text = re.sub(r'^TRANS x_step = t_(.*) -> .*;$', r'TRANS TRUE;', text, flags=re.M)",
    "it was asked for another goal": "text = re.sub(r'^LTLSPEC.*$', 'LTLSPEC !(F x_done)', text, flags=re.M)",
    "it was asked from another start": "text = re.sub(r'init\\(v_robot__p_m\\) := \\w+', 'init(v_robot__p_m) := k_p0', text)",
}
ANSWER = {
    "another initial value": "states[0]['v_robot__p_m'].text = 'k_p0'",
    "a step left out": "root.remove(nodes[middle])",
    "two steps in one": "root.remove(nodes[2]); steps[2].text = steps[1].text",
    "the last step left out": "root.remove(nodes[-2])",
    "two steps swapped": "steps[0].text, steps[1].text = steps[1].text, steps[0].text",
    "another transition's name": "steps[0].text = 't_tool__open_d'",
    "an unknown transition": "steps[0].text = 't_tool__fly'",
    "a value changed on the way": "states[middle]['v_tool__opened_m'].text = 'TRUE'",
    "a decision variable changed on the way": "states[middle]['v_tool_e'].text = 'k_robot'",
    "a value out of its domain": "states[middle]['v_tool_e'].text = 'k_floor'",
    "an unknown variable": "states[middle]['v_tool_e'].set('variable', 'v_toll_e')",
    "another kind of trace": "root.set('desc', 'BMC Failed Induction')",
    "it never comes to rest": "steps[-1].text = steps[0].text",
}
AFTER = {
    "half a file": "trace.write_bytes(trace.read_bytes()[:700])",
    "no XML at all": "trace.write_text('Trace Type: Counterexample')",
    "entities": "trace.write_text('<!DOCTYPE a [<!ENTITY b \"c\">]>' + trace.read_text())",
}
LIES = [(name, "ASK") for name in ASK] + [(name, "ANSWER") for name in ANSWER] + [(name, "AFTER") for name in AFTER]


def asked_through(tmp_path: Path, ask: str = "", answer: str = "", after: str = "") -> subprocess.CompletedProcess[str]:
    if not NUSMV.exists():
        pytest.skip("there is no NuSMV executable beside Python")
    liar = tmp_path / "nuXmv"
    liar.write_text(LIAR.format(python=sys.executable, nusmv=NUSMV, ask=ask, answer=answer, after=after))
    liar.chmod(0o755)
    command = [sys.executable, "-c", "import sys; from smv_planner.cli.plan import main; sys.exit(main())", *QUESTION]
    environment = {**os.environ, "SMV_PLANNER_NUXMV": str(liar)}
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120)


def test_an_honest_engine_gives_a_plan(tmp_path: Path) -> None:
    done = asked_through(tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads(done.stdout)["length"] == 7


@pytest.mark.parametrize(("lie", "when"), LIES, ids=[name for name, _ in LIES])
def test_a_lie_ends_with_exit_5_and_never_with_a_plan(tmp_path: Path, lie: str, when: str) -> None:
    lies = {"ASK": ASK, "ANSWER": ANSWER, "AFTER": AFTER}[when]
    done = asked_through(tmp_path, **{when.lower(): lies[lie]})
    assert done.returncode == 5, done.stdout + done.stderr
    answer = json.loads(done.stdout)
    assert "steps" not in answer
    assert answer["problems"]
    assert "Traceback" not in done.stderr
