"""A planner that writes down what happens before it acts stands, after any crash, where it stood."""

from __future__ import annotations

import errno

import pytest
from journal.disks import MemoryDisk, PowerCut
from runner.test_records import RUNS, Recorded, known

from smv_planner.journal import Journal, Unwritten
from smv_planner.runner.records import record, restored
from smv_planner.runner.situation import Situation

LIMIT = 6_000


def written(rig: Recorded, disk: MemoryDisk, stood: list[Situation]) -> None:
    """The shell of a planner that is told what `rig` was told; `stood` collects where it stands after each event."""
    journal = None
    after = [*rig.run.before[1:], rig.now]
    for payload, before, now in zip(rig.run.records, rig.run.before, after, strict=True):
        while True:  # it holds until it is written
            try:
                journal = journal or Journal.open(disk, rig.station.model.hash, LIMIT).journal
                if journal.full:
                    journal.anew([record(before)])
                journal.write([payload])
                break
            except Unwritten:
                continue
        stood.append(now)


def found(rig: Recorded, disk: MemoryDisk) -> Situation:
    opened = Journal.open(disk, rig.station.model.hash, LIMIT)
    return restored(rig.station, rig.run.before[0], opened.records, known(rig))


@pytest.fixture(scope="module", params=RUNS[2:], ids=lambda run: run.__name__)
def rig(request) -> Recorded:
    return request.param()


def test_a_journal_is_begun_anew_and_holds_everything(rig):
    disk, stood = MemoryDisk(), []
    written(rig, disk, stood)
    assert list(disk.files) >= ["00000003.journal"], "begun anew at least twice"
    assert found(rig, disk) == rig.now


def test_whenever_the_power_is_cut_it_stands_where_it_stood(rig):
    disk = MemoryDisk()
    written(rig, disk, [])
    for n in range(1, disk.changes + 1, 3):
        for seed in (n, n + 1):
            disk, stood = MemoryDisk({n: PowerCut}, seed=seed), [rig.run.before[0]]
            with pytest.raises(PowerCut):
                written(rig, disk, stood)
            possible = [*rig.run.before, rig.now][len(stood) - 1 :][:2]  # what was written last may not have been acted upon
            assert found(rig, disk.after_a_power_cut()) in possible, n


def test_while_the_disk_is_full_it_holds_and_then_goes_on(rig):
    disk = MemoryDisk()
    written(rig, disk, [])
    for n in range(1, disk.changes, 7):
        disk = MemoryDisk(dict.fromkeys(range(n, n + 9), errno.ENOSPC))
        written(rig, disk, [])
        assert found(rig, disk.after_a_power_cut()) == rig.now
