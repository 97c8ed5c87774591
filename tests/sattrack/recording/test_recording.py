"""Recordings come back as they were written, and run again to the same bytes."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import msgspec
import pytest

from sattrack.cli.main import run
from sattrack.core.errors import BadInputError
from sattrack.recording.format import COMMAND, REPEAT, STATUS, Recording, from_ns, to_ns
from sattrack.recording.replay import Replay, replay
from sattrack.runtime.facts import build_engine, decode_facts, encode_facts

if TYPE_CHECKING:
    from collections import Counter
    from pathlib import Path

    from sattrack.control.engine import Engine

HIGH = ["--min-alt", "78", "--clock", "2026-10-02T13:05:15Z"]
PASS = ["track", "25544", "--virtual", "--mount", "sim", "--json", *HIGH]


@pytest.fixture(scope="module")
def whole(short: Path) -> Replay:
    return again(short)


def engine_of(spec: msgspec.Raw) -> Engine:
    return build_engine(decode_facts(spec))


def again(path: Path) -> Replay:
    return replay(Recording(path), engine_of)


def test_a_replay_gives_every_datagram_again(whole: Replay, held_in_short: Counter[str]) -> None:
    assert whole.divergence is None
    assert not whole.cut_off
    assert (whole.ticks, whole.statuses) == (held_in_short["command"], held_in_short["status"])


def test_datagrams_that_went_out_twice_on_a_lossy_link_come_again_too(tmp_path: Path) -> None:
    profile, path = tmp_path / "lossy.toml", tmp_path / "lossy.mcap"
    profile.write_text('[simulator]\nfaults = "loss=3%"\n')
    assert run([*PASS, "--profile", str(profile), "--record", str(path)]) == 0
    copies = [entry for entry in Recording(path).entries() if entry.topic == REPEAT]
    result = again(path)
    assert result.divergence is None
    assert len(copies) > 0.3 * result.ticks


def test_it_holds_every_datagram_whole(short: Path) -> None:
    lengths = {STATUS: set(), COMMAND: set()}
    for entry in Recording(short).entries():
        if entry.topic in lengths:
            lengths[entry.topic].add(len(entry.data))
    assert lengths == {STATUS: {160}, COMMAND: {82}}


def test_another_law_diverges_and_the_first_difference_is_named(short: Path) -> None:
    def other(spec: msgspec.Raw) -> Engine:
        facts = decode_facts(spec)
        return build_engine(msgspec.structs.replace(facts, bias_cross_deg=0.001))

    result = replay(Recording(short), other)
    assert result.divergence is not None
    assert result.divergence.recorded != result.divergence.replayed


def test_facts_come_back_as_they_were(short: Path) -> None:
    facts = decode_facts(Recording(short).header.spec)
    assert decode_facts(encode_facts(facts)) == facts


@pytest.mark.parametrize("share", [0.3, 0.55])
def test_a_file_that_is_cut_off_is_read_as_far_as_it_goes(
    short: Path, whole: Replay, tmp_path: Path, share: float
) -> None:
    cut = tmp_path / "cut.mcap"
    data = short.read_bytes()
    cut.write_bytes(data[: int(share * len(data))])
    part = again(cut)
    assert part.cut_off
    assert part.divergence is None
    assert share - 0.1 < part.ticks / whole.ticks < share + 0.1


def test_a_killed_run_leaves_a_readable_file_that_lacks_a_second_at_most(tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    demo = subprocess.Popen(
        [sys.executable, "-m", "sattrack", "demo", "--stream", "--record", str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    assert demo.stdout is not None
    last = {}
    for _, line in zip(range(40), demo.stdout, strict=False):
        last = json.loads(line)
    demo.send_signal(signal.SIGKILL)
    demo.wait()
    demo.stdout.close()
    result = again(path)
    assert result.cut_off
    assert result.divergence is None
    *_, end = (e for e in Recording(path).entries() if e.topic == COMMAND)
    assert last["utc_s"] - end.utc_s <= 1.0


@pytest.mark.parametrize("instant", [1790946123.4567891, 1790946123.0, 1790946124.9999998, 0.1])
def test_instants_come_back_as_the_same_float(instant: float) -> None:
    assert from_ns(to_ns(instant)) == instant


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    other.write_bytes(b"something else entirely" * 20)
    with pytest.raises(BadInputError, match=r"other\.mcap: not an MCAP file; give"):
        Recording(other)
    with pytest.raises(BadInputError, match="cannot be read"):
        Recording(tmp_path / "absent.mcap")


def test_an_existing_file_is_never_written_over(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = short.stat().st_size
    assert run([*PASS, "--record", str(short)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert short.stat().st_size == before
    assert run([*PASS, "--record", str(tmp_path / "no" / "such" / "folder.mcap")]) == 2
    assert not list(tmp_path.iterdir())
