"""Execution cases played with real processes: the same cases, the same outcome declared as in simulation."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from daemon.stations import PATIENCE, Station, station

from smv_planner import api
from smv_planner.cli.staged import Staged
from smv_planner.model.domains import Value
from smv_planner.runner import situation
from smv_planner.runner.records import Known
from smv_planner.simulate.play import Record
from smv_planner.simulate.replay import payloads, replay
from smv_planner.simulate.script import Case, Then


def differences(here: Station, staged: Staged) -> list[str]:
    """Play to the end; what came otherwise than the case declares."""
    then, record = staged.case.then, staged.record
    ends = time.monotonic() + PATIENCE + then.within / staged.pace
    while not staged.over and time.monotonic() < ends:
        staged.look()
        time.sleep(0.003)
    # At this pace something may come about while the planners think; then they are simply asked again.
    actions = [action.name for action in record.recovery if action.name != "TP" or "TP" in (then.actions or ())]
    told: dict[str, tuple[object, object]] = {
        "actions": (tuple(actions), then.actions),
        "operator": (tuple(record.operator), then.operator),
        "failed": (tuple(record.failed), then.failed),
        "final": ({name: value for name, value in at_the_end(here, then).items() if name in then.final}, then.final),
        "intentions": ({name: record.intentions.get(name, "initial") for name in then.intentions}, then.intentions),
    }
    found = [f"{name} is {got}, not {want}" for name, (got, want) in told.items() if want is not None and got != want]
    started = iter(record.operations)
    if not all(name in started for name in then.operations):
        found.append(f"the operations are not in this order: {record.operations}")
    return found + [f"'when' has not come: {each}" for each in staged.coming]


def at_the_end(here: Station, then: Then) -> Mapping[str, Value]:
    """The state in which the intentions came to be as declared, by the journal: the station goes on while we look."""
    of = situation.Station(here.model, api.widened(here.model), here.cell)
    record, now = Record(), situation.at_rest(of)
    for told in replay(of, Known(here.model, api.widened_system), payloads(here.folder / "journal", of)):
        now = told.situation
        for note in told.notes:
            record.take(note)
        if then.intentions.items() <= record.intentions.items():
            break
    return of.system.named(now.state)


@contextmanager
def playing(endpoint: str, folder: Path, case: Case, pace: float) -> Iterator[tuple[Station, Staged]]:
    with station(endpoint, folder, f"play_{case.name}", given=case.given) as found:
        found.hubs(pace=pace)
        staged = Staged(found.link, found.cell, found.model, case, pace)
        staged.look()  # what happens at the start happens before anybody plans
        found.operator()
        found.planner()
        yield found, staged
