"""Whatever the disk does, what was acknowledged is found again, and nothing else than what was tried."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import textwrap
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from journal.disks import MemoryDisk, PowerCut

from smv_planner.journal import Damaged, Folder, Journal, Refused, Unwritten, read

MODEL = "5ca1ab1e" * 8
LIMIT = 400


def test_a_new_journal_is_empty_and_goes_on_where_it_was(tmp_path):
    for expected in ([], [b"one"], [b"one", b"one"]):
        opened = Journal.open(Folder(tmp_path), MODEL)
        assert (list(opened.records), opened.torn) == (expected, 0)
        opened.journal.write([b"one"])
        opened.journal.close()


class Station:
    """What a planner does with its journal: it counts, and acts on a number only when the journal has it."""

    def __init__(self, disk, limit=LIMIT, pace=1):
        self.disk, self.limit, self.pace = disk, limit, pace
        self.acted: list[int] = []
        self.safe: list[int] = []
        self.tried: list[int] = []
        self.journal: Journal | None = None

    def open(self):
        opened = Journal.open(self.disk, MODEL, self.limit)
        self.journal, self.acted = opened.journal, restored(opened.records)
        self.tried = list(self.acted)

    def open_at_last(self):
        while self.journal is None:
            with suppress(Unwritten):
                self.open()
        self.safe = self.acted

    def work(self, numbers):
        for number in numbers:
            try:
                if self.journal is None:
                    self.open()
                if self.journal.full:
                    self.journal.anew([json.dumps(self.acted).encode()])
                    self.safe = self.acted
            except Unwritten:
                if self.journal is None or self.journal.broken:
                    continue  # hold
            self.tried = [*self.acted, number]
            try:
                self.journal.write([b"%d" % number], durable=number % self.pace == 0)
            except Unwritten:
                continue
            self.acted = self.tried
            if number % self.pace == 0:
                self.safe = self.acted


def restored(records):
    numbers: list[int] = []
    for record in records:
        said = json.loads(record)
        numbers = said if isinstance(said, list) else [*numbers, said]
    return numbers


def changes_of(numbers):
    disk = MemoryDisk()
    Station(disk).work(numbers)
    return disk.changes


NUMBERS = range(40)


def test_without_faults_everything_is_kept_in_little_room():
    disk = MemoryDisk()
    station = Station(disk)
    station.work(NUMBERS)
    assert station.acted == list(NUMBERS)
    assert restored(Journal.open(disk, MODEL).records) == list(NUMBERS)
    assert len(disk.files) == 1
    assert all(name > "00000001.journal" for name in disk.files), "it was begun anew"


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO])
def test_whichever_change_fails_what_was_acted_upon_is_found(number, seed):
    for n in range(1, changes_of(NUMBERS) + 1):
        disk = MemoryDisk({n: number}, seed=seed)
        station = Station(disk)
        station.work(NUMBERS)
        assert len(station.acted) >= len(NUMBERS) - 2, "one failure costs one record, or one while it begins anew"
        for found in (disk, disk.after_a_power_cut()):
            assert restored(Journal.open(found, MODEL).records) in (station.acted, station.tried), n


@pytest.mark.parametrize("seed", range(4))
def test_when_the_power_is_cut_at_any_change_what_was_acted_upon_is_found(seed):
    for n in range(1, changes_of(NUMBERS) + 1):
        disk = MemoryDisk({n: PowerCut}, seed=seed)
        station = Station(disk)
        with pytest.raises(PowerCut):
            station.work(NUMBERS)
        again = Station(disk.after_a_power_cut())
        again.open()
        assert again.acted in (station.acted, station.tried), n
        before = again.acted
        again.work(range(100, 105))
        assert restored(Journal.open(again.disk, MODEL).records) == [*before, *range(100, 105)]


@pytest.mark.parametrize("seed", range(3))
def test_a_disk_that_is_full_for_a_while_is_waited_for(seed):
    for n in range(1, changes_of(NUMBERS), 5):
        disk = MemoryDisk(dict.fromkeys(range(n, n + 8), errno.ENOSPC), seed=seed)
        station = Station(disk)
        station.work(range(60))
        assert station.acted[-1] == 59, "it recovers by itself"
        assert restored(Journal.open(disk, MODEL).records) == station.acted


FAULTS = st.dictionaries(st.integers(1, 120), st.sampled_from([errno.ENOSPC, errno.EIO, PowerCut, PowerCut]), max_size=25)


@settings(deadline=None)
@given(FAULTS, st.integers(0, 10**6), st.integers(1, 4))
def test_whatever_comes_together_what_was_durable_is_found_in_order(faults, seed, pace):
    """Of what was not to be durable the power takes an end, never a middle."""
    disk, numbers, count = MemoryDisk(dict(faults), seed=seed), list(NUMBERS), 0
    safe: list[int] = []
    while True:
        station = Station(disk, pace=pace)
        try:
            station.open_at_last()
            assert station.acted[: len(safe)] == safe
            assert station.acted == sorted(set(station.acted)), "in order, and nothing twice"
            while count < len(numbers):
                count += 1
                station.work([numbers[count - 1]])
            break
        except PowerCut:
            safe = station.safe or safe
            rest = {n - disk.changes: fault for n, fault in disk.fails.items() if n > disk.changes}
            disk = disk.after_a_power_cut()
            disk.fails = rest
    assert restored(Journal.open(MemoryDisk({}, disk.files), MODEL, LIMIT).records) in (station.acted, station.tried)


def test_when_no_new_segment_can_be_begun_the_old_one_grows_to_a_bound():
    class Full(MemoryDisk):
        def create(self, name):
            if name > "00000002":
                raise OSError(errno.ENOSPC, "No space left on device")
            super().create(name)

    disk = Full()
    station = Station(disk)
    station.work(range(400))
    assert 2 * LIMIT < sum(len(file.data) for file in disk.files.values()) < 4 * LIMIT
    assert restored(Journal.open(disk, MODEL).records) == station.acted
    with pytest.raises(Unwritten, match="no new segment"):
        station.journal.write([b"1" * 50])


class Renames(MemoryDisk):
    """Once it renames, and says that it could not."""

    spoilt = False

    def rename(self, name, to):
        super().rename(name, to)
        if to > "00000002" and not self.spoilt:
            self.spoilt = True
            raise OSError(errno.EIO, "Input/output error")


def test_once_a_new_segment_may_have_its_name_nothing_goes_into_the_old_one():
    disk = Renames()
    journal = Journal.open(disk, MODEL).journal
    journal.write([b"one"])
    with pytest.raises(Unwritten, match="cannot be named"):
        journal.anew([b"until one"])
    with pytest.raises(Unwritten, match="cannot be named"):
        journal.write([b"two"])
    assert journal.full
    journal.anew([b"until one"])
    journal.write([b"two"])
    assert Journal.open(disk, MODEL).records == (b"until one", b"two")


def test_damage_is_refused_with_the_byte_and_what_to_do(tmp_path):
    journal = Journal.open(Folder(tmp_path), MODEL).journal
    journal.write([b"one", b"two", b"three"])
    journal.close()
    file = tmp_path / "00000001.journal"
    data = bytearray(file.read_bytes())
    data[data.index(b"two")] ^= 1
    file.write_bytes(data)
    damage = read(bytes(data))
    assert isinstance(damage, Damaged)
    folder = Folder(tmp_path)
    with pytest.raises(Refused) as caught:
        Journal.open(folder, MODEL)
    folder.close()
    command = f"truncate -s {damage.offset} 00000001.journal"
    assert str(caught.value) == (
        f"00000001.journal: damaged at byte {damage.offset} (record 2): a record is not what was written "
        f"(to begin anew, move '00000001.journal' away; to give up what follows, keep a copy and cut it there: {command})"
    )
    subprocess.run(command.split(), cwd=tmp_path, check=True)
    opened = Journal.open(Folder(tmp_path), MODEL)
    assert (opened.records, opened.torn) == ((b"one",), 0)


def test_a_torn_tail_is_cut_and_reported(tmp_path):
    journal = Journal.open(Folder(tmp_path), MODEL).journal
    journal.write([b"one", b"two"])
    journal.close()
    file = tmp_path / "00000001.journal"
    whole = file.read_bytes()
    file.write_bytes(whole[:-2])
    opened = Journal.open(Folder(tmp_path), MODEL)
    assert (opened.records, opened.torn) == ((b"one",), 13)
    opened.journal.write([b"two"])
    opened.journal.close()
    assert file.read_bytes() == whole


def test_a_journal_of_another_model_or_name_is_refused(tmp_path):
    folder = Folder(tmp_path)
    Journal.open(folder, MODEL)
    with pytest.raises(Refused, match="for another model"):
        Journal.open(folder, "0" * 64)
    (tmp_path / "00000001.journal").rename(tmp_path / "00000005.journal")
    with pytest.raises(Refused, match="says that it is segment 1"):
        Journal.open(folder, MODEL)
    folder.close()


def test_two_processes_cannot_have_it(tmp_path):
    folder = Folder(tmp_path)
    with pytest.raises(Refused, match="in use by another process"):
        Folder(tmp_path)
    folder.close()
    Folder(tmp_path).close()


@pytest.mark.parametrize("where", ["a file", "\0"])
def test_a_folder_that_cannot_be_had_is_unwritten(tmp_path, where):
    (tmp_path / "a file").write_text("")
    with pytest.raises((Unwritten, ValueError)):
        Folder(tmp_path / where)


WRITER = textwrap.dedent("""\
    import resource, signal, sys
    from smv_planner.journal import Folder, Journal, Unwritten

    opened = Journal.open(Folder(sys.argv[1]), "m")
    journal, number = opened.journal, len(opened.records)
    if sys.argv[2:]:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
    while True:
        try:
            journal.write([b"%d" % number], durable=False)
        except Unwritten as error:
            print(error)
            resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
            journal.anew([b"snapshot %d" % number])
            journal.write([b"%d" % number])
            break
        print(number, flush=True)
        number += 1
""")


def test_a_real_file_that_may_not_grow_is_unwritten_until_it_is_begun_anew(tmp_path):
    run = subprocess.run([sys.executable, "-c", WRITER, str(tmp_path), "1000"], capture_output=True, text=True, timeout=60)
    *numbers, why = run.stdout.splitlines()
    assert run.returncode == 0, run.stderr
    assert why == f"the journal cannot be written: {os.strerror(errno.EFBIG)}"
    assert len(numbers) > 20
    opened = Journal.open(Folder(tmp_path), "m")
    assert opened.records == (b"snapshot %d" % len(numbers), b"%d" % len(numbers))
    assert sorted(each.name for each in tmp_path.iterdir()) == ["00000002.journal"]


def test_a_killed_process_has_written_what_it_said(tmp_path):
    with subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True) as writer:
        said = [next(writer.stdout) for _ in range(50)]
        writer.send_signal(signal.SIGKILL)
        said += writer.stdout.readlines()
    opened = Journal.open(Folder(tmp_path), "m")
    assert [int(record) for record in opened.records][: len(said)] == [int(line) for line in said]
    assert len(opened.records) <= len(said) + 1
