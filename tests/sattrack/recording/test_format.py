"""Whatever became of a file, what can be read is read, and what is wrong is said."""

from __future__ import annotations

import random
import struct
import tracemalloc
import zlib
from pathlib import Path

import msgspec
import pytest
import zstandard
from mcap.writer import IndexType, Writer

from sattrack.cli.main import run
from sattrack.core.errors import BadInputError
from sattrack.recording.format import (
    CHANNELS,
    COMMAND,
    FORMAT_VERSION,
    GAP,
    RUN,
    STATUS,
    SUMMARY,
    Entry,
    Recording,
)
from sattrack.recording.recorder import Recorder

ZSTD = b"\x04\x00\x00\x00zstd"
DATA = Path(__file__).parent / "data"


def read(path: Path, data: bytes) -> Recording:
    path.write_bytes(data)
    return Recording(path)


def is_prefix(part: list[Entry], whole: list[Entry]) -> bool:
    return part == whole[: len(part)]


def is_rest(part: list[Entry], whole: list[Entry]) -> bool:
    """Tell whether a reading is the whole with some messages missing, and a gap wherever that is."""
    messages = [entry for entry in part if entry.topic != GAP]
    left = iter(whole)
    return all(any(entry == other for other in left) for entry in messages)


def test_cut_off_anywhere_it_is_read_up_to_a_second_before(short: Path, tmp_path: Path) -> None:
    whole, data = list(Recording(short).entries()), short.read_bytes()
    ends = {entry.utc_s for entry in whole if entry.topic == COMMAND}
    duration_s = max(ends) - min(ends)
    rng = random.Random(5)
    header_ends = data.index(ZSTD, data.index(ZSTD) + 1)
    for _ in range(300):
        length = rng.randrange(header_ends, len(data))
        recording = read(tmp_path / "cut.mcap", data[:length])
        assert recording.cut_off
        assert recording.whole
        part = list(recording.entries())
        assert is_prefix(part, whole)
        if part:
            share = (part[-1].utc_s - min(ends)) / duration_s
            assert share > (length - 6000) / len(data) - 0.25


def small(path: Path, short: Path) -> Path:
    """Write the first seconds of a recording as a recording of its own."""
    recording = Recording(short)
    with path.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        for entry in list(recording.entries())[:120]:
            recorder.write(*entry)
        recorder.close()
    return path


@pytest.mark.parametrize("step", [29, pytest.param(1, marks=pytest.mark.soak)])
def test_with_any_byte_flipped_the_rest_is_read_and_nothing_wrong_comes_out(
    short: Path, tmp_path: Path, step: int
) -> None:
    source = small(tmp_path / "small.mcap", short)
    data = source.read_bytes()
    whole = list(Recording(source).entries())
    header = Recording(source).header
    damaged, refusals = 0, []
    for place in range(random.Random(7).randrange(step), len(data), step):
        broken = bytearray(data)
        broken[place] ^= 0xFF
        try:
            recording = read(tmp_path / "flipped.mcap", bytes(broken))
        except BadInputError as error:
            refusals.append((place, str(error)))
            continue
        entries = list(recording.entries())
        assert recording.header == header
        assert is_rest(entries, whole)
        assert len(entries) > 0.6 * len(whole)
        if len(entries) < len(whole) or not recording.whole:
            damaged += 1
            assert recording.problems
    assert damaged > len(refusals) > 0
    assert not any("\n" in words for _, words in refusals)
    assert max(place for place, _ in refusals) < 4000, "only what the header stands in may cost the file"


def test_two_recordings_in_one_file_are_told_and_both_can_be_had(short: Path, tmp_path: Path) -> None:
    both = tmp_path / "both.mcap"
    data = short.read_bytes()
    both.write_bytes(data + data)
    for part in (1, 2):
        recording = Recording(both, part)
        assert recording.parts == 2
        assert not recording.cut_off
        assert list(recording.entries()) == list(Recording(short).entries())
        assert any("2 recordings in one file" in words for words in recording.problems)
    with pytest.raises(BadInputError, match="no recording number 3: it holds 2"):
        Recording(both, 3)
    both.write_bytes(data[: len(data) // 2] + data)
    assert Recording(both, 1).cut_off
    assert not Recording(both, 2).cut_off


def test_what_is_no_recording_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    path.write_bytes(b"something else entirely" * 200)
    with pytest.raises(BadInputError, match=r"other\.mcap: not an MCAP file; give one that --record wrote"):
        Recording(path)
    path.write_bytes(b"")
    with pytest.raises(BadInputError, match=r"other\.mcap: is empty"):
        Recording(path)
    with pytest.raises(BadInputError, match=r"absent\.mcap: cannot be read: No such file"):
        Recording(tmp_path / "absent.mcap")
    with pytest.raises(BadInputError, match="cannot be read: Is a directory"):
        Recording(tmp_path)


def test_an_mcap_file_of_another_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "robot.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "a robot's")
        channel = writer.register_channel("/scan", "cdr", 0)
        for i in range(500):
            writer.add_message(channel, i, bytes([i % 256]) * 40, i)
        writer.finish()
    with pytest.raises(BadInputError, match="of another program, or cut off"):
        Recording(path)


@pytest.mark.parametrize("size", [200, 2**19], ids=["small", "large"])
def test_a_file_that_unpacks_to_much_more_than_it_has_is_refused_before_it_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], size: int
) -> None:
    path = tmp_path / "bomb.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=2**20, index_types=IndexType.NONE)
        writer.start("sattrack", "sattrack 99")
        channel = writer.register_channel(STATUS, "ros1", 0)
        for _ in range(2**24 // (size + 31)):
            writer.add_message(channel, 0, bytes(size), 0)
        writer.finish()
    tracemalloc.start()
    code = run(["recording", "info", str(path)])
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most_bytes < 2**23
    told = capsys.readouterr().err
    assert (code, told.count("\n")) == (2, 1)
    assert f"bomb.mcap: unpacks to more than 20 times its {path.stat().st_size} bytes" in told


def test_messages_without_their_heads_are_none(short: Path, tmp_path: Path) -> None:
    content = struct.pack("<BQ", 5, 0) * 5000
    packed = zstandard.compress(content)
    head = struct.pack("<BQQQQI", 6, 40 + len(packed), 0, 0, len(content), zlib.crc32(content))
    chunk = head + ZSTD + struct.pack("<Q", len(packed)) + packed
    data = short.read_bytes()
    recording = read(tmp_path / "short.mcap", data[: -len(data) // 4] + chunk)
    assert any("no chunk of messages" in words for words in recording.problems)
    assert is_rest(list(recording.entries()), list(Recording(short).entries()))


def write_with_header(path: Path, header: object) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("sattrack", "sattrack 99")
        channel = writer.register_channel(RUN, "json", 0)
        writer.add_message(channel, 0, msgspec.json.encode(header), 0, 1)
        writer.finish()


def test_a_newer_format_is_refused_naming_its_version(tmp_path: Path) -> None:
    path = tmp_path / "newer.mcap"
    write_with_header(path, {"format_version": 99, "program_version": "7.1", "ways": ["quantum"]})
    with pytest.raises(BadInputError, match=r"format 99, written by a newer sattrack, 7\.1"):
        Recording(path)


@pytest.mark.parametrize(
    ("spec", "why"),
    [
        (b'{"site":3}', "the run's facts, written by sattrack 0.1, cannot be read"),
        (b'{"refraction":"\xff"}', "the recording's header cannot be read"),
        (b'{"more":' * 2000 + b"1" + b"}" * 2000, "the recording's header cannot be read"),
    ],
    ids=["no facts", "no UTF-8", "nested too deep"],
)
def test_facts_that_are_none_are_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], spec: bytes, why: str
) -> None:
    path = tmp_path / "facts.mcap"
    write_with_header(path, {"format_version": 1, "program_version": "0.1", "spec": msgspec.Raw(spec)})
    assert run(["replay", str(path)]) == 2
    told = capsys.readouterr().err
    assert why in told
    assert told.count("\n") == 1


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_file_of_each_format_is_read_and_replayed(version: int, capsys: pytest.CaptureFixture[str]) -> None:
    path = DATA / f"version_{version}.mcap"
    recording = Recording(path)
    assert recording.header.format_version == version
    assert not recording.problems
    assert {entry.topic for entry in recording.entries()} <= set(CHANNELS)
    code = run(["replay", str(path), "--json"])
    told = msgspec.json.decode(capsys.readouterr().out)
    assert told["ticks"] > 300
    assert told["recorded"]["rms_arcsec"] < 0.02
    if version == FORMAT_VERSION:
        assert code == 0
        assert told["agrees"]
    else:
        # Made with another way onto the target, it is the same until the slew there has ended.
        assert told["divergence"]["tick"] > 100
        assert told["replayed"]["ended_by"] is not None


def test_the_last_message_of_a_run_that_ended_is_its_summary(short: Path) -> None:
    *_, last = Recording(short).entries()
    assert last.topic == SUMMARY
    assert msgspec.json.decode(last.data)["ended_by"] == "set"


def test_a_recording_holds_its_file_and_not_what_that_unpacks_to(short: Path) -> None:
    entries = list(Recording(short).entries())
    tracemalloc.start()
    try:
        recording = Recording(short)
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    size = short.stat().st_size
    assert size <= held < 1.5 * size < sum(len(entry.data) for entry in entries)
    assert list(recording.entries()) == list(recording.entries()) == entries
    assert len(recording) == len(entries)
