"""Recordings without the site, the hour and the names: what they tell, and that they still run."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest

from sattrack.cli import recording as commands
from sattrack.cli.main import run
from sattrack.core.errors import BadInputError
from sattrack.mount.xerxes.datagrams import decode_status
from sattrack.recording.export import LEAST_S, MOST_S, random_shift_s, write_anonymous
from sattrack.recording.format import GAP, OPERATOR, STATUS, SUMMARY, Recording
from sattrack.recording.recorder import Recorder
from sattrack.recording.replay import replay
from sattrack.runtime.facts import engine_of, open_recording
from tle.instants import Utc
from tle.propagator import Propagator

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "passes" / "faults.mcap"
SHIFT_S = 30011
CULMINATION_S = 1790946324.0
LONGITUDE_AT, LATITUDE_AT = 80, 72
"""Offsets in the status by the paper's table."""


def moved(source: Path, folder: Path, shift_s: int = SHIFT_S) -> Path:
    path = folder / f"moved{shift_s}.mcap"
    with path.open("wb") as stream:
        write_anonymous(Recording(source), stream, shift_s)
    return path


@pytest.fixture(scope="module")
def anonymous(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return moved(EXAMPLE, tmp_path_factory.mktemp("anonymous"))


def sidereal_longitude_deg(recording: Recording) -> float:
    """Where sidereal time of the statuses, with the instants of their arrival, puts the mount (IAU 1982)."""
    entry = next(entry for entry in recording.entries() if entry.topic == STATUS)
    days = entry.utc_s / 86400.0 + 2440587.5 - 2451545.0
    greenwich_deg = 280.46061837 + 360.98564736629 * days
    return (decode_status(entry.data).sidereal_h * 15.0 - greenwich_deg + 180.0) % 360.0 - 180.0


def test_the_site_by_sidereal_time_is_the_moved_one_and_nowhere_the_true_one(anonymous: Path) -> None:
    recording, facts = open_recording(anonymous)
    _, true = open_recording(EXAMPLE)
    east_deg = -SHIFT_S * 360.98564736629 / 86400.0
    expected_deg = (true.site.longitude_deg + east_deg + 180.0) % 360.0 - 180.0
    assert facts.site.longitude_deg == pytest.approx(expected_deg, abs=1e-3)
    assert facts.site.latitude_deg == pytest.approx(true.site.latitude_deg, abs=1e-3)
    assert sidereal_longitude_deg(recording) == pytest.approx(expected_deg, abs=0.02)
    assert sidereal_longitude_deg(Recording(EXAMPLE)) == pytest.approx(true.site.longitude_deg, abs=0.02)
    for entry in recording.entries():
        if entry.topic == STATUS and len(entry.data) == 160:
            (told_deg,) = struct.unpack_from("<d", entry.data, LONGITUDE_AT)
            assert told_deg == 0.0 or abs(told_deg - expected_deg) < 0.01


def test_no_name_no_path_and_no_instant_of_the_run_is_left(anonymous: Path) -> None:
    original, true = open_recording(EXAMPLE)
    texts = b"\n".join(
        [bytes(Recording(anonymous).header.spec)]
        + [entry.data for entry in Recording(anonymous).entries() if entry.data[:1] == b"{"]
    ).decode()
    for word in (
        "ISS",
        "ZARYA",
        "25544",
        "1998-067",
        "faults",
        "iss_leiden",
        f"{true.site.longitude_deg:.3f}",
        "2026-10-02T13",
        true.elements.epoch.isoformat("seconds")[:16],
    ):
        # Digits of a longer number are no catalog number.
        pattern = rf"(?<!\d){word}(?!\d)" if word.isdigit() else re.escape(word)
        assert not re.search(pattern, texts), word
    began, ended = (f(e.utc_s for e in original.entries() if e.topic == STATUS) for f in (min, max))
    instants = [float(text) for text in re.findall(r"\b1[67]\d{8}(?:\.\d+)?\b", texts)]
    assert instants
    assert not [one for one in instants if began - 600.0 < one < ended + 600.0]
    epoch = float(true.elements.epoch.unix_s)
    assert not [one for one in instants if abs(one - epoch) < 600.0]
    assert [e for e in Recording(anonymous).entries() if e.topic == OPERATOR], "observations are kept"


def test_why_a_mount_was_never_on_target_may_name_its_address(short: Path, tmp_path: Path) -> None:
    why = b'{"why_not_acquired":"no status from xerxes://192.0.2.7:15001 within 10 s","samples":0}'
    path = tmp_path / "unheard.mcap"
    with path.open("wb") as stream:
        recorder = Recorder(stream, Recording(short).header.spec)
        recorder.write(SUMMARY, CULMINATION_S, why)
        recorder.close()
    (summary,) = Recording(moved(path, tmp_path)).entries()
    assert msgspec.json.decode(summary.data) == {"why_not_acquired": "withheld", "samples": 0}


def test_its_biases_are_not_remembered(short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are those of elements that no satellite has."""
    kept = []
    monkeypatch.setattr(commands, "trace", lambda *_: SimpleNamespace(engine=SimpleNamespace(spec=None)))
    monkeypatch.setattr(commands, "make_report", lambda *_: ("report", "fit"))
    monkeypatch.setattr(commands, "keep_fit", lambda fit, *_: kept.append(fit))
    options = {"part": 1, "tdm": None, "bias_memory": "on"}
    for path in (short, moved(short, tmp_path)):
        commands._reported(path, None, options)
    assert kept == ["fit"]


def test_directions_are_what_they_were(anonymous: Path) -> None:
    _, there = open_recording(anonymous)
    _, true = open_recording(EXAMPLE)
    for share in (0.1, 0.5, 0.9):
        utc_s = true.plan.start_utc_s + share * (true.plan.end_utc_s - true.plan.start_utc_s)
        one = Propagator(true.elements, true.site.place()).at(Utc(utc_s))
        other = Propagator(there.elements, there.site.place()).at(Utc(utc_s + SHIFT_S))
        assert float(other.ra_deg) == pytest.approx(float(one.ra_deg), abs=0.01 / 3600.0)
        assert float(other.dec_deg) == pytest.approx(float(one.dec_deg), abs=0.01 / 3600.0)
        assert float(other.alt_deg) == pytest.approx(float(one.alt_deg), abs=0.01 / 3600.0)
        assert float(other.range_km) == pytest.approx(float(one.range_km), abs=1e-4)


def test_it_replays_with_the_figures_of_the_original(anonymous: Path) -> None:
    result = replay(Recording(anonymous), engine_of)
    assert result.choice.mode == "figures"
    assert "its site and its time were moved" in result.choice.why
    assert result.agrees, result.reasons
    assert result.recorded.rms_arcsec is not None
    assert result.replayed.rms_arcsec == pytest.approx(result.recorded.rms_arcsec, abs=0.01)


def test_shifts_are_whole_seconds_of_hours_either_way() -> None:
    shifts = [random_shift_s() for _ in range(200)]
    assert all(LEAST_S <= abs(shift) < MOST_S for shift in shifts)
    assert min(shifts) < 0 < max(shifts)


def test_a_gap_stays_a_gap_and_a_mount_that_knows_no_site_is_told_none(short: Path, tmp_path: Path) -> None:
    recording = Recording(short)
    path = tmp_path / "gap.mcap"
    with path.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec, recording.header)
        for number, entry in enumerate(list(recording.entries())[:60]):
            data = bytearray(entry.data)
            if entry.topic == STATUS:
                struct.pack_into("<dd", data, LATITUDE_AT, 0.0, 0.0)
            recorder.write(entry.topic, entry.utc_s, bytes(data))
            if number == 30:
                recorder.skip()
        recorder.close()
    entries = list(Recording(moved(path, tmp_path)).entries())
    assert [entry.topic for entry in entries].count(GAP) == 1
    seen = [struct.unpack_from("<dd", e.data, LATITUDE_AT) for e in entries if e.topic == STATUS]
    assert set(seen) == {(0.0, 0.0)}


def test_the_command_moves_whatever_it_writes(short: Path, tmp_path: Path) -> None:
    true, there = tmp_path / "true.csv", tmp_path / "there.csv"
    assert run(["recording", "export", str(short), str(true)]) == 0
    assert run(["recording", "export", str(short), str(there), "--anonymous"]) == 0
    names, *rows = (line.split(",") for line in there.read_text().splitlines())
    _, *true_rows = (line.split(",") for line in true.read_text().splitlines())
    apart_s = float(rows[0][names.index("utc_s")]) - float(true_rows[0][names.index("utc_s")])
    assert LEAST_S - 1 < abs(apart_s) < MOST_S + 1
    ra = names.index("ra_h")
    assert [row[ra] for row in rows] == [row[ra] for row in true_rows]
    longitude = names.index("site_longitude_deg")
    assert abs(float(rows[0][longitude]) - float(true_rows[0][longitude])) > 10.0


def test_a_damaged_recording_is_written_out_as_far_as_it_is_whole(short: Path, tmp_path: Path) -> None:
    cut, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    cut.write_bytes(short.read_bytes()[:40_000])
    assert run(["recording", "export", str(cut), str(out)]) == 0
    assert list(Recording(out).entries()) == list(Recording(cut).entries())
    assert not Recording(out).cut_off
    assert replay(Recording(out), engine_of).differing == 0


def test_facts_that_are_none_are_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "odd.mcap"
    with path.open("wb") as stream:
        recorder = Recorder(stream, msgspec.Raw(b'{"site": 3}'))
        recorder.close()
    with pytest.raises(BadInputError, match="facts cannot be read") as error:
        moved(path, tmp_path)
    assert "\n" not in str(error.value)
