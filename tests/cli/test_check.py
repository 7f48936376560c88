"""`smv-planner check` through real processes: findings with places, exit codes, guards and reports."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from smv_planner import language
from smv_planner.engines.sat import Predicates
from smv_planner.language.places import places
from smv_planner.model.expressions import negation

ROOT = Path(__file__).parents[2]
PLANNER = [sys.executable, "-c", "import sys; from smv_planner.cli.main import main; sys.exit(main())"]
SCENARIOS = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "scenarios").glob("*/model*.yaml"))
MEMBERS = {"severity", "rule", "kind", "name", "file", "line", "column", "message", "hint", "example"}

SWING = """\
smv_planner: 1
name: swing
resources:
  swing:
    variables:
      left: {kind: goal, domain: bool, initial: false}
      push: {kind: goal, domain: bool, initial: false}
    transitions:
      start: {kind: controlled, guard: not push, actions: {push: true}}
      to:    {kind: automatic, guard: push and not left, actions: {left: true}}
      fro:   {kind: automatic, guard: left, actions: {left: false}}
"""


def check(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*PLANNER, "check", *arguments], capture_output=True, text=True, cwd=ROOT, timeout=120)


@pytest.fixture
def swing(tmp_path: Path) -> str:
    (tmp_path / "model.yaml").write_text(SWING)
    return str(tmp_path)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_scenarios_have_no_errors(scenario):
    done = check(scenario, "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(finding["severity"] == "warning" for finding in json.loads(done.stdout)["findings"])


def test_findings_come_with_their_place_a_state_and_what_to_do(swing):
    done = check(swing)
    assert done.returncode == 3
    assert done.stderr == ""
    first, state, advice, *_, last = done.stdout.splitlines()
    circle = "automatic transitions fire for ever: swing.to -> swing.fro -> swing.to"
    assert first == f"{swing}/model.yaml:10:7: error: {circle} [does-not-settle]"
    assert state == "    in the state: swing.left = false, swing.push = true"
    assert advice == "    to do: let a guard become false by what follows it"
    assert last == "swing: 1 error, 1 warning"


def test_json_has_the_fixed_members(swing):
    done = check(swing, "--json")
    assert done.returncode == 3
    told = json.loads(done.stdout)
    assert told.keys() == {"findings"}
    error, warning = told["findings"]
    assert error.keys() == warning.keys() == MEMBERS
    assert (error["severity"], error["rule"], error["name"], error["line"], error["column"]) == (
        *("error", "does-not-settle", "swing.to"),
        *(10, 7),
    )
    assert error["example"] == {"swing.left": False, "swing.push": True}
    assert (warning["rule"], warning["kind"], warning["name"], warning["line"]) == ("no-maintenance", "resource", "swing", 4)
    assert warning["example"] is None


def test_strict_makes_warnings_count():
    assert check("scenarios/tool_change").returncode == 0
    assert check("scenarios/tool_change", "--strict").returncode == 3
    assert check("scenarios/door", "--strict").returncode == 0


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_extra_guards_are_written_in_the_language_of_scenarios(scenario):
    guards = json.loads(check(scenario, "--guards", "--json").stdout)["guards"]
    model = language.load(ROOT / scenario)
    with Predicates(model.system.domains) as predicates:
        for guard in guards:
            again = language.predicate(model, guard["guard"])
            assert predicates.satisfiable(negation(again)), "it asks for nothing"


def test_guards_and_report_are_for_people_too():
    told = check("scenarios/door", "--guards", "--report").stdout
    assert "guard: 'door.close' also has to wait for\n    not door.locked and not door.lock" in told
    assert "'never_move_locked' forbids 8 states as declared, and 4 besides" in told
    assert "'door.relocked' leads there from: door.lock and door.moving" in told
    assert told.endswith("door: 0 errors, 0 warnings\n")


def test_the_report_counts_and_names_what_grew():
    (report,) = json.loads(check("scenarios/dummy_robots", "--report", "--json").stdout)["report"]
    assert (report["invariant"], report["states"], report["forbidden"], report["added"]) == ("table_zone", 2304, 144, 297)
    assert {"transition": "r1.arrives", "from": "r1.active and r1.ref_pos == at and r2.act_pos == at"} in report["through"]


def test_a_scenario_that_does_not_load_is_told_as_everywhere(tmp_path):
    (tmp_path / "model.yaml").write_text(SWING.replace("guard: left", "guard: lft"))
    done = check(str(tmp_path))
    assert done.returncode == 3
    assert "did you mean" in done.stderr
    assert json.loads(check(str(tmp_path), "--json").stdout).keys() == {"problems"}
    assert check(str(tmp_path / "nothing")).returncode == 2


def test_places_know_every_part():
    for scenario in SCENARIOS:
        model = language.load(ROOT / scenario)
        parts = [("resource", resource.name) for resource in model.resources]
        parts += [("variable", part.name) for part in (*model.variables, *model.copies)]
        parts += [("transition", transition.name) for transition in model.transitions]
        parts += [("invariant", invariant.name) for invariant in model.invariants]
        parts += [("operation", operation.name) for operation in model.operations]
        parts += [("intention", intention.name) for intention in model.intentions]
        where = places(ROOT / scenario)
        for kind, name in parts:
            place = where[kind, name]
            assert place.instance or name.endswith(place.source[place.column - 1 :][: place.length])
