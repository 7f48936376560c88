"""Records come back as they were written, or it is said where they do not."""

from __future__ import annotations

from zlib import crc32

from hypothesis import given, settings
from hypothesis import strategies as st

from smv_planner.journal import Damaged, Header, Sound, Torn, frame, opening, read
from smv_planner.journal.framing import MAGIC

HEADER = Header("5ca1ab1e" * 8, 7)
RECORDS = (b"{}", b'{"at":1.5}', b"x" * 300, b'{"zeros":"' + bytes(20) + b'"}', b"7")

payloads = st.binary(min_size=1, max_size=40).map(lambda data: data + b"}")


def written(records, header=HEADER):
    """A segment, and where each record ends."""
    data, checksum = opening(header)
    ends = [len(data)]
    for record in records:
        framed, checksum = frame(record, checksum)
        data += framed
        ends.append(len(data))
    return data, ends


@given(st.lists(payloads, max_size=6), st.integers(1, 10**6))
def test_what_was_written_is_read(records, segment):
    data, _ = written(records, Header("ab12", segment))
    reading = read(data)
    assert isinstance(reading, Sound)
    assert (reading.header, reading.records, reading.end) == (Header("ab12", segment), tuple(records), len(data))


@given(st.lists(payloads, max_size=4), st.lists(payloads, max_size=4))
def test_writing_goes_on_where_reading_ended(first, second):
    data, _ = written(first)
    reading = read(data)
    assert isinstance(reading, Sound)
    checksum = reading.checksum
    for record in second:
        framed, checksum = frame(record, checksum)
        data += framed
    assert data == written([*first, *second])[0]


def test_every_flipped_byte_is_found_in_the_record_that_it_is_in():
    data, ends = written(RECORDS)
    begins = [len(MAGIC), *ends]
    for at in range(len(data)):
        record = next((n for n, end in enumerate(ends) if at < end))
        for bits in (0x01, 0x20, 0x80, 0xFF):
            broken = data[:at] + bytes([data[at] ^ bits]) + data[at + 1 :]
            if broken[at:].strip(b"\0") == b"":
                continue  # the last byte has become zero: as if it had not been written
            reading = read(broken)
            assert isinstance(reading, Damaged), (at, bits)
            assert (reading.offset, reading.record) == ((begins[record], record) if at >= len(MAGIC) else (0, 0))


def test_cut_at_every_length_the_whole_records_before_are_kept():
    data, ends = written(RECORDS)
    for length in range(len(data)):
        for zeros in (0, 1, 11, 500):
            reading = read(data[:length] + bytes(zeros))
            kept = sum(end <= length for end in ends) - 1
            if kept < 0:
                assert isinstance(reading, Damaged), "a segment has its name only when its header is there"
            elif length == ends[kept] and not zeros:
                assert isinstance(reading, Sound)
                assert reading.records == RECORDS[:kept]
            else:
                assert isinstance(reading, Torn), (length, zeros)
                assert (reading.before.records, reading.before.end) == (RECORDS[:kept], ends[kept])


def test_a_record_that_is_missing_doubled_or_from_elsewhere_is_damage():
    data, ends = written(RECORDS)
    other, _ = written(RECORDS, Header(HEADER.model, 8))
    one, two, three = ends[:3]
    assert isinstance(read(data[:one] + data[two:]), Damaged)
    assert isinstance(read(data[:two] + data[one:]), Damaged)
    assert isinstance(read(data[:one] + data[two:three] + data[one:two] + data[three:]), Damaged)
    assert isinstance(read(data[:one] + other[one:]), Damaged)


def test_zeroed_blocks_in_the_middle_are_no_torn_tail():
    data, ends = written(RECORDS)
    for start in range(ends[0], ends[-1] - 20):
        broken = data[:start] + bytes(16) + data[start + 16 :]
        assert broken == data or isinstance(read(broken), Damaged)


@settings(max_examples=300)
@given(st.binary(max_size=80), st.booleans())
def test_any_bytes_are_read_as_something(noise, begun):
    reading = read(written([b"{}"])[0] + noise if begun else noise)
    if begun:
        kept = reading.before if isinstance(reading, Torn) else reading
        assert isinstance(kept, Damaged) or kept.records[0] == b"{}"
    else:
        assert isinstance(reading, Damaged)


def test_another_format_is_refused_by_name():
    said = b'{"format": 2, "model": "x", "segment": 1}'
    framed, _ = frame(said, crc32(MAGIC))
    assert read(MAGIC + framed) == Damaged(len(MAGIC), 0, "it has format 2, and this program reads 1")
    for nonsense in (b"[]", b"{}", b'{"format": 1}', b'{"format": 1, "model": "x", "segment": "y"}', b"\xff"):
        framed, _ = frame(nonsense, crc32(MAGIC))
        assert isinstance(read(MAGIC + framed), Damaged)
