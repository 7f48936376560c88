"""`smv-planner check`: what is wrong or suspicious in a scenario that loads."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Mapping, Sequence

from smv_planner import language
from smv_planner.api import widened
from smv_planner.cli import outcome
from smv_planner.engines.sat import Predicates
from smv_planner.errors import Place
from smv_planner.language.places import Places, places
from smv_planner.model.domains import Value, show_value
from smv_planner.model.expressions import show
from smv_planner.planner.preflight import Finding, domains, preflight, scene
from smv_planner.planner.preflight.growth import Grown, growth
from smv_planner.planner.preflight.guards import ExtraGuard, extra_guards

PIECES = 12
"""How many pieces of an invariant's growth are shown."""


def add_check(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", help="a scenario file, or a folder that holds model.yaml")
    parser.add_argument("--strict", action="store_true", help="warnings count as errors")
    parser.add_argument("--guards", action="store_true", help="also show what invariants ask of each controlled transition")
    parser.add_argument("--report", action="store_true", help="also show which states invariants forbid beyond those declared")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def check(asked: argparse.Namespace) -> int:
    """Look into a scenario; the exit code."""
    model = language.load(asked.scenario)
    where = places(asked.scenario)
    with Predicates(domains(model)) as predicates:
        findings = in_order(preflight(model, widened(model), predicates), where)
        guards = tuple(extra_guards(scene(model, widened(model), predicates))) if asked.guards else None
    grown = tuple(growth(model.system, widened(model))) if asked.report else None
    if asked.json:
        told: dict[str, object] = {"findings": [_finding_json(finding, where) for finding in findings]}
        if guards is not None:
            told["guards"] = [_guard_json(guard, where) for guard in guards]
        if grown is not None:
            told["report"] = [_grown_json(each) for each in grown]
        print(json.dumps(told, indent=2))
    else:
        _show_findings(findings, where)
        _show_guards(guards or (), where)
        _show_growth(grown or (), where)
        errors = sum(finding.severity == "error" for finding in findings)
        print(f"{model.name}: {_count(errors, 'error')}, {_count(len(findings) - errors, 'warning')}")
    bad = findings if asked.strict else [finding for finding in findings if finding.severity == "error"]
    return outcome.INVALID_SCENARIO if bad else 0


def in_order(findings: Sequence[Finding], where: Places) -> list[Finding]:
    """Errors first, each in the order of the text."""

    def key(finding: Finding) -> tuple[bool, int, int]:
        place = where.get((finding.kind, finding.name))
        return finding.severity == "warning", place.line if place else 0, place.column if place else 0

    return sorted(findings, key=key)


def _show_findings(findings: Sequence[Finding], where: Places) -> None:
    for finding in findings:
        print(f"{_at(finding.kind, finding.name, where)}{finding.severity}: {finding.message} [{finding.rule}]")
        if finding.example:
            print(f"    in the state: {_values(finding.example)}")
        print(f"    to do: {finding.hint}")


def _show_guards(guards: Iterable[ExtraGuard], where: Places) -> None:
    for guard in guards:
        chosen = f" with {_values(guard.choice)}" if guard.choice else ""
        print(f"{_at('transition', guard.transition, where)}guard: '{guard.transition}'{chosen} also has to wait for")
        print(f"    {show(guard.guard)}")


def _show_growth(grown: Iterable[Grown], where: Places) -> None:
    for each in grown:
        print(f"{_at('invariant', each.invariant, where)}report: '{each.invariant}' {_counted(each)}")
        print(f"    of {each.states} combinations of {', '.join(each.variables)}")
        for piece in each.growth[:PIECES]:
            print(f"    '{piece.transition}' leads there from: {show(piece.states)}")
        if len(each.growth) > PIECES:
            print(f"    and from {_count(len(each.growth) - PIECES, 'set')} of states more (--json has them all)")


def _at(kind: str, name: str, where: Places) -> str:
    place = where.get((kind, name))
    return f"{place}: " if place else ""


def _counted(grown: Grown) -> str:
    declared = "too many to count" if grown.forbidden is None else _count(grown.forbidden, "state")
    more = f"more than {max(len(grown.growth) - 1, 0)}" if grown.added is None else str(grown.added)
    return f"forbids {declared} as declared, and {more} besides" if grown.growth else f"forbids {declared}, and no other"


def _finding_json(finding: Finding, where: Places) -> dict[str, object]:
    return {
        "severity": finding.severity,
        "rule": finding.rule,
        "kind": finding.kind,
        "name": finding.name,
        **_place_json(where.get((finding.kind, finding.name))),
        "message": finding.message,
        "hint": finding.hint,
        "example": None if finding.example is None else dict(finding.example),
    }


def _guard_json(guard: ExtraGuard, where: Places) -> dict[str, object]:
    place = _place_json(where.get(("transition", guard.transition)))
    return {"transition": guard.transition, **place, "choice": dict(guard.choice), "guard": show(guard.guard)}


def _grown_json(grown: Grown) -> dict[str, object]:
    return {
        "invariant": grown.invariant,
        "variables": list(grown.variables),
        "states": grown.states,
        "forbidden": grown.forbidden,
        "added": grown.added,
        "added_at_least": len(grown.growth) if grown.added is None else grown.added,
        "through": [{"transition": piece.transition, "from": show(piece.states)} for piece in grown.growth],
    }


def _place_json(place: Place | None) -> dict[str, object]:
    return {
        "file": place.file if place else None,
        "line": place.line if place else None,
        "column": place.column if place else None,
    }


def _values(values: Mapping[str, Value]) -> str:
    return ", ".join(f"{name} = {show_value(value)}" for name, value in values.items())


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
