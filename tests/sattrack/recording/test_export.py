"""What is exported is what was recorded, as other programs read it."""

from __future__ import annotations

import csv
import json
import math
import re
import resource
import struct
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from mcap.reader import make_reader
from mcap_ros1.decoder import DecoderFactory

from sattrack.cli.main import run
from sattrack.recording.export import SeenDirection, table_of, tdm_text
from sattrack.recording.format import COMMAND, OPERATOR, STATUS, Recording, clock_steps, look, messages
from sattrack.recording.recorder import Recorder
from sattrack.runtime import demo_pass
from sattrack.views.messages import StopNow
from tle.errors import ObservationError
from tle.formats.observations import Stations, read_observations
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction
from tle.site import Site

if TYPE_CHECKING:
    from collections import Counter

SCRIPT = Path(__file__).resolve().parents[3] / "extras" / "wireshark" / "xerxes.lua"
EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
SEEN = [
    '{"type":"observation","utc":"2026-10-02T13:05:20.250000Z","ra_deg":201.5,"dec_deg":31.25,'
    '"frame":"icrs","sigma_arcsec":20.0}',
    '{"type":"observation","utc":"2026-10-02T13:05:21.500000Z","ra_deg":202.5,"dec_deg":32.25,'
    '"frame":"icrs","sigma_arcsec":10.0,"catalog_number":25544}',
    '{"type":"observation","utc":"2026-10-02T13:05:22Z","ra_deg":1.0,"dec_deg":2.0,'
    '"frame":"icrs","sigma_arcsec":10.0,"catalog_number":7}',
]


def with_words(path: Path, short: Path, words: list[str], later_s: float = 0.0) -> Path:
    """Write a copy of a recording with messages in its middle, and a clock set ahead from there on."""
    recording = Recording(short)
    with path.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        for number, entry in enumerate(recording.entries()):
            if number == 400:
                for line in words:
                    recorder.write(OPERATOR, entry.utc_s, line.encode())
            ahead_s = later_s if number >= 400 else 0.0
            recorder.write(entry.topic, entry.utc_s + ahead_s, entry.data)
        recorder.close()
    return path


def blocks(data: bytes) -> list[tuple[int, bytes]]:
    """Return the blocks of a pcapng file by its draft: type, length, body, length again."""
    found = []
    while data:
        kind, length = struct.unpack_from("<II", data)
        assert length % 4 == 0
        assert struct.unpack_from("<I", data, length - 4)[0] == length
        found.append((kind, data[8 : length - 4]))
        data = data[length:]
    return found


def test_pcapng_holds_every_datagram_with_its_instant(short: Path, tmp_path: Path) -> None:
    out = tmp_path / "short.pcapng"
    assert run(["recording", "export", str(short), str(out)]) == 0
    kinds = blocks(out.read_bytes())
    assert [kind for kind, _ in kinds[:2]] == [0x0A0D0D0A, 1]
    entries = [e for e in Recording(short).entries() if e.topic in {STATUS, COMMAND}]
    assert len(kinds) == len(entries) + 2
    for (kind, body), entry in zip(kinds[2:], entries, strict=True):
        assert kind == 6
        _, high, low, length, _ = struct.unpack_from("<IIIII", body)
        assert (high << 32 | low) / 10**9 == entry.utc_s
        packet = body[20 : 20 + length]
        assert sum(struct.unpack(">10H", packet[:20])) % 0xFFFF == 0
        assert packet[28:] == entry.data


@pytest.mark.needs("tshark")
def test_wireshark_dissects_the_export(short: Path, tmp_path: Path) -> None:
    out = tmp_path / "short.pcapng"
    noted = with_words(tmp_path / "noted.mcap", short, ['{"type":"nudge","along_s":0.5}'])
    assert run(["recording", "export", str(noted), str(out)]) == 0
    fields = ["-T", "fields", "-e", "_ws.col.Protocol", "-e", "frame.comment"]
    done = subprocess.run(
        ["tshark", "-X", f"lua_script:{SCRIPT}", "-r", str(out), *fields],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = [line.split("\t") for line in done.stdout.splitlines()]
    assert {line[0] for line in lines} == {"XERXES"}
    assert [line[1] for line in lines if len(line) > 1 and line[1]] == ['{"type":"nudge","along_s":0.5}']


def test_csv_holds_the_numbers_of_the_datagrams(
    short: Path, held_in_short: Counter[str], tmp_path: Path
) -> None:
    out = tmp_path / "short.csv"
    assert run(["recording", "export", str(short), str(out)]) == 0
    with out.open(newline="") as stream:
        table = list(csv.DictReader(stream))
    entries = [e for e in Recording(short).entries() if e.topic == STATUS]
    assert len(table) == len(entries)
    for row, entry in zip(table, entries, strict=True):
        assert float(row["utc_s"]) == entry.utc_s
        # Bytes 24 and 40 of the status: declination, right ascension in hours.
        assert float(row["dec_deg"]) == struct.unpack_from("<d", entry.data, 24)[0]
        assert float(row["ra_h"]) == struct.unpack_from("<d", entry.data, 40)[0]
    commands = tmp_path / "commands.csv"
    assert run(["recording", "export", str(short), str(commands), "--table", "command"]) == 0
    assert len(commands.read_text().splitlines()) == held_in_short["command"] + 1
    views = tmp_path / "views.csv"
    assert run(["recording", "export", str(short), str(views), "--table", "view"]) == 0
    assert "error.total_arcsec" in views.read_text().splitlines()[0].split(",")


def test_a_message_has_its_arrival_and_the_instant_that_it_is_about(short: Path, tmp_path: Path) -> None:
    seen = with_words(tmp_path / "seen.mcap", short, [*SEEN[:1], '{"type":"nudge","along_s":0.5}'])
    table = table_of(Recording(seen), OPERATOR)
    assert [Utc.parse(utc).unix_s for utc in table["utc"]] == pytest.approx(table["utc_s"], abs=1e-6)
    assert table["message_utc"] == ["2026-10-02T13:05:20.250000Z", None]


def test_a_table_without_rows_has_its_head(short: Path, tmp_path: Path) -> None:
    out = tmp_path / "operator.csv"
    assert run(["recording", "export", str(short), str(out), "--table", "operator"]) == 0
    assert out.read_text() == "utc,utc_s\n"


def test_messages_that_are_none_are_left_out_of_tables(short: Path, tmp_path: Path) -> None:
    path = tmp_path / "odd.mcap"
    with path.open("wb") as stream:
        recorder = Recorder(stream, Recording(short).header.spec)
        deep = b'{"type":"stop","x":' + b"[" * 2000
        for k, said in enumerate((b'{"type":"\xff"}', b"[1]", b"3", deep, b'{"type":"stop"}')):
            recorder.write(OPERATOR, float(k), said)
        recorder.close()
    recording = Recording(path)
    assert table_of(recording, OPERATOR)["type"] == ["stop"]
    assert [message for _, message in messages(recording)] == [StopNow()]


def test_parquet_needs_pyarrow_and_says_so_in_a_line(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert run(["recording", "export", str(short), str(tmp_path / "short.parquet")]) == 1
    assert (
        capsys.readouterr().err
        == "sattrack: Parquet needs pyarrow: run `pip install '.[parquet]'` in the folder of the clone\n"
    )


def test_parquet_holds_what_csv_holds(short: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    out = tmp_path / "short.parquet"
    assert run(["recording", "export", str(short), str(out)]) == 0
    table = parquet.read_table(out).to_pydict()
    entries = [e for e in Recording(short).entries() if e.topic == STATUS]
    assert table["utc_s"] == [e.utc_s for e in entries]
    assert table["dec_deg"] == [struct.unpack_from("<d", e.data, 24)[0] for e in entries]


@pytest.mark.usefixtures("traced_once")
@pytest.mark.parametrize("name", ["short", pytest.param("faults", marks=pytest.mark.soak)])
def test_a_reports_figures_can_be_made_again_from_the_exported_errors(
    name: str, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = short if name == "short" else EXAMPLES / "passes" / f"{name}.mcap"
    out, text = tmp_path / "errors.json", tmp_path / "errors.csv"
    for target in (out, text):
        assert run(["recording", "export", str(source), str(target), "--table", "error"]) == 0
    rows = json.loads(out.read_text())
    with text.open(newline="") as stream:
        in_text = list(csv.DictReader(stream))
    assert [(float(row["total_arcsec"]), row["doing"]) for row in in_text] == [
        (row["total_arcsec"], row["doing"]) for row in rows
    ]
    errors = [row["total_arcsec"] for row in rows if row["doing"] == "following"]
    rms = math.sqrt(sum(error * error for error in errors) / len(errors))
    capsys.readouterr()
    assert run(["report", str(source), "--bias-memory", "off"]) == 0
    told = capsys.readouterr().out
    assert f"{rms:.3f}″ RMS, {max(errors):.3f}″ peak" in told
    assert f"{len(errors)} samples" in told
    assert len(rows) > 1.5 * len(errors), "the way there is in it as well"


def test_sigmas_of_a_tdm_come_back_each_with_its_own_observation(tmp_path: Path) -> None:
    site = Site(52.1541, 4.4908, 0.0)
    seen = [
        SeenDirection(1790946324.0 + k, 10.0 + 0.123456789012 * k, -20.0 + k / 7.0, frame, sigma)
        for k, (frame, sigma) in enumerate(
            [("icrs", 2.5), ("icrs", 20.0), ("icrs", 2.5), ("icrs", None), ("of_date", 0.1), ("of_date", 0.3)]
        )
    ]
    out = tmp_path / "seen.tdm"
    out.write_text(tdm_text(seen, demo_pass.elements(), site, 1790946400.0, "made up"))
    back = read_observations(out, Stations({}, site))
    found = sorted((float(one.utc.unix_s), one.ra_deg, one.dec_deg, one.sigma_arcsec or -1.0) for one in back)
    wanted = [(one.utc_s, one.ra_deg, one.dec_deg, one.sigma_arcsec or -1.0) for one in seen]
    for got, was in zip(found, wanted, strict=True):
        assert got == pytest.approx(was, abs=1e-9)
    bad = out.read_text().replace("SIGMA_ARCSEC = 2.5", "SIGMA_ARCSEC = two")
    out.write_text(bad)
    with pytest.raises(ObservationError, match=r"seen.tdm:\d+: SIGMA_ARCSEC is 'two': no number"):
        read_observations(out, Stations({}, site))


def test_every_channel_is_described_to_other_tools(short: Path) -> None:
    with short.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        by_topic = {one.topic: summary.schemas[one.schema_id] for one in summary.channels.values()}
        messages = {
            channel.topic: message.data for _, channel, message in make_reader(stream).iter_messages()
        }
    for topic, schema in by_topic.items():
        if schema.encoding == "jsonschema":
            described = json.loads(schema.data)
            assert "$ref" not in schema.data.decode()
            # Foxglove's rules: every object names its properties, every array its items.
            nested = [described]
            while nested:
                one = nested.pop()
                assert one["type"] != "object" or isinstance(one["properties"], dict), topic
                nested += [*one.get("properties", {}).values(), *([one["items"]] if "items" in one else [])]
            if topic in messages:
                assert set(json.loads(messages[topic])) <= set(described["properties"]), topic


def test_another_reader_decodes_the_datagrams_with_their_names(short: Path) -> None:
    with short.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        decoded = {
            channel.topic: (message.data, found)
            for _, channel, message, found in reader.iter_decoded_messages(["status", "command"])
        }
    data, status = decoded["status"]
    assert status.site_latitude_deg == pytest.approx(52.1541)
    assert (status.azimuth_deg,) == struct.unpack_from("<d", data, 16)
    assert status.connected
    assert bytes(status.dec_rate_dtics_s) == data[32:40]
    data, command = decoded["command"]
    assert command.header == 0x5555AAAA
    assert (command.counter,) == struct.unpack_from("<q", data, 8)
    assert (command.move_ra_rate_deg_s,) == struct.unpack_from("<d", data, 40)


def test_other_tools_see_a_recording_that_begins_when_the_run_does(short: Path) -> None:
    with short.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        times = [
            message.log_time for _, channel, message in make_reader(stream).iter_messages(["run", "status"])
        ]
    assert summary.statistics.message_start_time == min(times)
    assert max(times) - min(times) < 600e9


def test_a_tdm_gives_the_observations_back_to_a_reader_of_its_own(short: Path, tmp_path: Path) -> None:
    seen = with_words(tmp_path / "seen.mcap", short, SEEN)
    out = tmp_path / "seen.tdm"
    assert run(["recording", "export", str(seen), str(out)]) == 0
    found = read_observations(out, Stations({}, Site(52.1541, 4.4908, 0.0)))
    assert [(o.utc.isoformat("milliseconds"), o.ra_deg, o.dec_deg, o.frame) for o in found] == [
        ("2026-10-02T13:05:20.250Z", 201.5, 31.25, "icrf"),
        ("2026-10-02T13:05:21.500Z", 202.5, 32.25, "icrf"),
    ]
    assert found[0].object_key == "1998-067A"


def test_places_of_date_are_without_air_in_a_tdm(short: Path, tmp_path: Path) -> None:
    """What an observer reports in the frame of the mount has the air in it that the run feeds."""
    propagator = Propagator(demo_pass.elements(), demo_pass.SITE.place(), refraction=Refraction.standard(0.0))
    utc = Utc.parse("2026-10-02T13:05:20.250000Z")
    fed, airless = propagator.at(utc), propagator.with_place("apparent").at(utc)
    words = (
        f'{{"type":"observation","utc":"{utc.isoformat()}","ra_deg":{fed.ra_deg},"dec_deg":{fed.dec_deg},'
        '"frame":"of_date","sigma_arcsec":2.0}'
    )
    out = tmp_path / "seen.tdm"
    assert run(["recording", "export", str(with_words(tmp_path / "s.mcap", short, [words])), str(out)]) == 0
    (found,) = read_observations(out, Stations({}, demo_pass.SITE.place()))
    assert found.frame == "of_date"
    assert abs(float(fed.dec_deg) - found.dec_deg) > 5.0 / 3600.0
    assert (found.ra_deg, found.dec_deg) == pytest.approx((airless.ra_deg, airless.dec_deg), abs=1e-5)


def test_without_observations_there_is_no_tdm_and_the_reason_is_told(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["recording", "export", str(short), str(tmp_path / "none.tdm")]) == 1
    assert "holds no observation" in capsys.readouterr().err
    assert not (tmp_path / "none.tdm").exists()


def test_info_tells_what_a_recording_holds(
    short: Path, held_in_short: Counter[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["recording", "info", str(short), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert held_in_short["summary"] == 1
    assert {"run": 1, **told["messages"]} == held_in_short
    assert told["whole"]
    assert told["ended_properly"]
    assert told["summary"]["ended_by"] == "set"
    assert run(["recording", "info", str(short)]) == 0
    assert "nothing is wrong with it" in capsys.readouterr().out


@pytest.mark.parametrize("first", [0, 1, 300])
@pytest.mark.parametrize("waited", [15, 60])
def test_statuses_that_waited_and_came_at_once_set_no_clock(
    waited: int, first: int, short: Path, tmp_path: Path
) -> None:
    """The first of them for 0.75 s, or for 3 s; the last came as it was sent."""
    recording, queued, seen = Recording(short), tmp_path / "queued.mcap", 0
    came_s = [entry.utc_s for entry in recording.entries() if entry.topic == STATUS]
    with queued.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        for entry in recording.entries():
            held = entry.topic == STATUS and first <= seen < first + waited
            recorder.write(entry.topic, came_s[first + waited] if held else entry.utc_s, entry.data)
            seen += entry.topic == STATUS
        recorder.close()
    assert clock_steps(Recording(queued)) == []


@pytest.mark.parametrize("waited", [1, 18])
def test_statuses_that_were_read_late_at_the_beginning_set_no_clock(
    waited: int, short: Path, tmp_path: Path
) -> None:
    """As in runs on a busy machine: all of the first ones are dated a second after the next one."""
    recording, late, seen = Recording(short), tmp_path / "late.mcap", 0
    came_s = [entry.utc_s for entry in recording.entries() if entry.topic == STATUS]
    with late.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        for entry in recording.entries():
            held = entry.topic == STATUS and seen < waited
            recorder.write(entry.topic, came_s[waited] + 0.98 if held else entry.utc_s, entry.data)
            seen += entry.topic == STATUS
        recorder.close()
    assert clock_steps(Recording(late)) == []


@pytest.mark.parametrize("ahead_s", [2.5, -40.0, 3600.5])
def test_a_clock_that_was_set_in_the_middle_is_told_where_and_by_how_much(
    ahead_s: float, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stepped = with_words(tmp_path / "stepped.mcap", short, [], ahead_s)
    (step,) = clock_steps(Recording(stepped))
    assert step.ahead_s == pytest.approx(ahead_s, abs=0.002)
    assert run(["recording", "info", str(stepped)]) == 0
    assert f"a clock was set at 2026-10-02T1{4 if ahead_s > 3600.0 else 3}:0" in capsys.readouterr().out
    assert run(["replay", str(stepped), "--json"]) in {0, 1}
    replayed = capsys.readouterr()
    assert "a defect" not in replayed.err
    assert clock_steps(Recording(short)) == []
    # The pass took as long as it did; a small step ahead is told from a pause by nothing.
    took_s = look(Recording(short)).seconds + (ahead_s if ahead_s == 2.5 else 0.0)
    assert look(Recording(stepped)).seconds == pytest.approx(took_s, abs=0.1)
    assert json.loads(replayed.out)["seconds"] == pytest.approx(took_s, abs=0.3)


def test_a_report_says_that_a_clock_was_set(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stepped = with_words(tmp_path / "stepped.mcap", short, [], 3600.5)
    capsys.readouterr()
    assert run(["report", str(stepped), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    (problem,) = told["problems"]
    assert re.fullmatch(r"a clock was set at 2026-10-02T14:05:\S+Z, by \+3600\.\d+ s", problem)
    assert told["link"]["rate_hz"] == pytest.approx(20.0, rel=0.01)


@pytest.mark.parametrize("ahead_s", [2.5, 40.0, -40.0])
@pytest.mark.parametrize("statuses", [10, 200])
def test_a_clock_that_was_set_and_set_back_was_set_twice(
    statuses: int, ahead_s: float, short: Path, tmp_path: Path
) -> None:
    recording, stepped, seen = Recording(short), tmp_path / "twice.mcap", 0
    with stepped.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        for entry in recording.entries():
            off_s = ahead_s if 100 <= seen < 100 + statuses else 0.0
            recorder.write(entry.topic, entry.utc_s + off_s, entry.data)
            seen += entry.topic == STATUS
        recorder.close()
    steps = [step.ahead_s for step in clock_steps(Recording(stepped))]
    assert steps == pytest.approx([ahead_s, -ahead_s], abs=0.002)


@pytest.mark.parametrize("kind", ["csv", "json", "pcapng", "mcap"])
def test_a_full_disk_leaves_no_half_of_an_export(
    kind: str, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, (before, most) = tmp_path / f"whole.{kind}", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, most))
    try:
        assert run(["recording", "export", str(short), str(out)]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, most))
    told = capsys.readouterr().err
    assert f"{out}: " in told
    assert "cannot be written: File too large" in told
    assert not out.exists()


def test_nothing_is_written_over_and_an_unknown_ending_is_told(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "there.csv"
    out.write_text("mine")
    assert run(["recording", "export", str(short), str(out)]) == 2
    assert out.read_text() == "mine"
    assert run(["recording", "export", str(short), str(tmp_path / "x.docx")]) == 2
    assert "unknown ending" in capsys.readouterr().err
    assert run(["recording", "export", str(short), str(tmp_path / "no" / "x.csv")]) == 2
    assert "there is no folder" in capsys.readouterr().err
