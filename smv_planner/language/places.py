"""Where the parts of a scenario stand in its file, for what is told about a model that was read long ago."""

from __future__ import annotations

import os
from collections.abc import Mapping

from smv_planner.errors import Place
from smv_planner.language.document import Scenario
from smv_planner.language.expand import expand
from smv_planner.language.reader import Path, Report, read
from smv_planner.language.shapes import shape_of
from smv_planner.language.strict_yaml import Mapping as MappingNode
from smv_planner.language.strict_yaml import Source, parse, place

Places = Mapping[tuple[str, str], Place]
"""By kind and full name: `("transition", "door.open")`."""


def places(path: str | os.PathLike[str]) -> Places:
    """The names in a file, or in the `model.yaml` of a folder, that `load` has accepted."""
    file = os.path.join(path, "model.yaml") if os.path.isdir(path) else os.fspath(path)
    with open(file, encoding="utf-8-sig", newline="") as opened:
        root, mistakes = parse(Source(file, opened.read()))
    assert isinstance(root, MappingNode), "load has accepted it"
    report = Report(mistakes)
    read(expand(root, report), shape_of(Scenario), (), report)
    found = {}
    for way, key in report.keys.items():
        part, where = _part(way), place(key)
        if part and where:
            found[part] = where
    return found


def _part(way: Path) -> tuple[str, str] | None:
    match way:
        case ("resources", resource):
            return "resource", resource
        case ("resources", resource, ("variables" | "transitions") as table, name):
            return table.removesuffix("s"), f"{resource}.{name}"
        case ("decision", name):
            return "variable", name
        case (("transitions" | "invariants" | "operations" | "intentions") as table, name):
            return table.removesuffix("s"), name
    return None
