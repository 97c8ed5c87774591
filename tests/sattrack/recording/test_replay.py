"""What is compared, how, and what a replay says of the first difference."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from typing import TYPE_CHECKING

import msgspec
import pytest

from sattrack.cli import replay as commands
from sattrack.cli.main import run
from sattrack.mount.xerxes.datagrams import Command, decode_command, encode_command
from sattrack.recording.format import (
    COMMAND,
    FAILURE,
    OPERATOR,
    VIEW,
    Environment,
    Recording,
    RunHeader,
    fingerprint,
    here,
)
from sattrack.recording.recorder import Recorder
from sattrack.recording.replay import (
    Choice,
    Difference,
    Figures,
    Replay,
    Tolerances,
    beyond_rounding,
    choose,
    differences,
    larger_than,
    replay,
    replay_lines,
    worse,
)
from sattrack.runtime.facts import build_engine, decode_facts, engine_of
from sattrack.runtime.flight import WhatIf, what_if

if TYPE_CHECKING:
    from collections import Counter
    from pathlib import Path

    from sattrack.control.engine import Engine

LIBRARIES = {"numpy": "2.0", "astropy-iers-data": "0.2026"}
THERE = Environment("x86_64", "Old 386", "3.11.1", LIBRARIES)


def header(**changes: object) -> RunHeader:
    made = RunHeader(3, "0.1.0", msgspec.Raw(b"{}"), "abcd", THERE)
    return msgspec.structs.replace(made, **changes)


def test_the_comparison_follows_from_code_processor_and_libraries() -> None:
    assert choose(header(), "abcd", THERE).mode == "bytes"
    other = msgspec.structs.replace(THERE, processor="New 486")
    chosen = choose(header(), "abcd", other)
    assert chosen == Choice("rounding", "the same code, elsewhere: processor New 486, recorded with Old 386")
    newer = msgspec.structs.replace(THERE, libraries=LIBRARIES | {"numpy": "3.0"})
    assert choose(header(), "abcd", newer).mode == "rounding"
    later = msgspec.structs.replace(THERE, libraries=LIBRARIES | {"astropy-iers-data": "0.2027"})
    assert choose(header(), "abcd", later).mode == "figures"
    changed = choose(header(), "ef01", THERE)
    assert changed == Choice("figures", "made by sattrack 0.1.0 with code abcd; this is code ef01")
    assert choose(header(environment=None, format_version=2), "abcd", THERE).mode == "figures"


def test_a_recording_made_here_now_is_compared_byte_for_byte(short: Path) -> None:
    made = Recording(short).header
    assert made.environment == here()
    assert made.fingerprint == fingerprint()


def test_differences_are_told_by_field_and_a_negative_zero_is_one() -> None:
    one = encode_command(Command(counter=7, move_ra_rate_deg_s=0.5, move_ra=True))
    other = encode_command(Command(counter=7, move_ra_rate_deg_s=0.5 + 1e-8, move_ra=True, abort=True))
    found = differences(one, other)
    assert [d.field for d in found] == ["abort", "move_ra_rate_deg_s"]
    assert differences(one, one) == []
    minus = differences(encode_command(Command()), encode_command(Command(move_dec_rate_deg_s=-0.0)))
    assert [d.field for d in minus] == ["move_dec_rate_deg_s"]
    assert differences(one, b"") == [Difference("length", 82, 0)]


@pytest.mark.parametrize(("off_deg_s", "beyond"), [(9e-10, False), (1.1e-9, True), (float("nan"), True)])
def test_rounding_lets_a_billionth_of_a_degree_a_second_pass(off_deg_s: float, beyond: bool) -> None:
    one = encode_command(Command(move_ra_rate_deg_s=0.0))
    other = encode_command(Command(move_ra_rate_deg_s=off_deg_s))
    assert beyond_rounding(differences(one, other)) is beyond
    assert beyond_rounding(differences(one, encode_command(Command(slew=True))))


def test_by_figures_rates_may_differ_a_little_and_what_is_asked_for_may_not() -> None:
    one = encode_command(Command(counter=1, move_ra=True, move_ra_rate_deg_s=0.5))
    assert not larger_than(
        differences(one, encode_command(Command(counter=9, move_ra=True, move_ra_rate_deg_s=0.51))), 0.02
    )
    assert larger_than(
        differences(one, encode_command(Command(counter=1, move_ra=True, move_ra_rate_deg_s=0.53))), 0.02
    )
    assert larger_than(differences(one, encode_command(Command(counter=1, move_ra_rate_deg_s=0.5))), 0.02)


def test_figures_may_get_better_and_a_little_worse() -> None:
    recorded = Figures(1.0, 4.0, 100, 50.0, "set")
    allowed = Tolerances(share=0.05, rms_arcsec=0.02, peak_arcsec=0.1)
    assert worse(recorded, Figures(0.2, 1.0, 100, 50.0, "set"), allowed) == []
    assert worse(recorded, Figures(1.04, 4.15, 100, 50.0, "set"), allowed) == []
    told = worse(recorded, Figures(1.06, 4.3, 100, 50.0, "link"), allowed)
    assert told == [
        "RMS 1.060″, recorded 1.000″",
        "peak 4.300″, recorded 4.000″",
        "ended by link, recorded set",
    ]
    assert worse(recorded, Figures(None, None, 0, 0.0, "set"), allowed) == [
        "RMS none, recorded 1.000″",
        "peak none, recorded 4.000″",
    ]


def biased(cross_deg: float) -> object:
    def build(spec: msgspec.Raw) -> Engine:
        return build_engine(msgspec.structs.replace(decode_facts(spec), bias_cross_deg=cross_deg))

    return build


def test_the_first_divergence_names_instant_input_expected_and_got(short: Path) -> None:
    result = replay(Recording(short), biased(0.001))  # type: ignore[arg-type]
    assert not result.agrees
    found = result.divergence
    assert found is not None
    expected, got = decode_command(found.recorded), decode_command(found.replayed)
    assert found.fields[0].field == "target_dec_deg"
    assert found.fields[0].expected == expected.target_dec_deg != got.target_dec_deg
    line = next(line for line in replay_lines(result) if line.startswith("first at"))
    assert line.startswith("first at 2026-10-02T13:05:15.")
    assert f"command {found.tick + 1}, after status " in line
    assert f"target_dec_deg expected {expected.target_dec_deg!r}, got {got.target_dec_deg!r}" in line


def again_with(tmp_path: Path, short: Path, changed: dict[int, bytes]) -> Replay:
    """Replay a copy of a recording in which some commands are other ones."""
    copy = tmp_path / "changed.mcap"
    recording = Recording(short)
    with copy.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        tick = 0
        for entry in recording.entries():
            data = entry.data
            if entry.topic == COMMAND:
                data = changed.get(tick, data)
                tick += 1
            recorder.write(entry.topic, entry.utc_s, data)
        recorder.close()
    return replay(Recording(copy), engine_of)


def test_what_differs_within_bounds_is_equivalent_and_says_by_how_much(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = Recording(short)
    for name, other_deg_s in (("near", 0.004), ("far", 0.5)):
        with (tmp_path / f"{name}.mcap").open("wb") as stream:
            header = msgspec.structs.replace(recording.header, fingerprint="another's")
            recorder = Recorder(stream, recording.header.spec, header)
            for number, entry in enumerate(recording.entries()):
                data = entry.data
                if entry.topic == COMMAND and 200 < number < 600:
                    command = decode_command(data)
                    turned = command.move_dec_rate_deg_s + other_deg_s
                    data = encode_command(msgspec.structs.replace(command, move_dec_rate_deg_s=turned))
                recorder.write(entry.topic, entry.utc_s, data)
            recorder.close()
    near, far = str(tmp_path / "near.mcap"), str(tmp_path / "far.mcap")
    assert run(["replay", near]) == 0
    told = capsys.readouterr().out
    assert re.match(r"equivalent, largest difference 0.004 °/s, in \d+ commands: ", told)
    assert "the same" not in told.splitlines()[0]
    assert run(["replay", str(short), near, "--json"]) == 0
    views = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [view["verdict"] for view in views] == ["same", "equivalent"]
    assert [view["agrees"] for view in views] == [True, True]
    assert run(["replay", near, far, str(short)]) == 1
    told = capsys.readouterr().out
    assert f"{far}: NOT THE SAME" in told
    assert "largest difference of a rate: 0.5 °/s" in told
    assert run(["replay", near, far, "--stream"]) == 2


def test_a_single_bit_in_one_command_is_found(short: Path, tmp_path: Path) -> None:
    commands = [entry.data for entry in Recording(short).entries() if entry.topic == COMMAND]
    bent = bytearray(commands[200])
    bent[40] ^= 1
    result = again_with(tmp_path, short, {200: bytes(bent)})
    assert (result.differing, result.agrees) == (1, False)
    assert result.divergence is not None
    assert result.divergence.tick == 200
    assert result.divergence.fields[0].field == "move_ra_rate_deg_s"
    assert 0.0 < result.largest_rate_deg_s < 1e-9


def test_what_breaks_in_todays_code_is_a_finding_and_not_an_end(short: Path) -> None:
    def build(spec: msgspec.Raw) -> Engine:
        engine = engine_of(spec)
        take = engine.tracker.take
        seen = []

        def breaks(sample: object) -> object:
            seen.append(sample)
            if len(seen) == 150:
                raise ZeroDivisionError("of today")
            return take(sample)  # type: ignore[arg-type]

        engine.tracker.take = breaks  # type: ignore[method-assign, assignment]
        return engine

    result = replay(Recording(short), build)
    assert result.broke == "ZeroDivisionError: of today"
    assert not result.agrees
    assert result.ticks > 300


def test_a_gap_ends_the_comparison_where_it_is(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = bytearray(short.read_bytes())
    mark = b"\x04\x00\x00\x00zstd"
    place = data.index(mark, len(data) // 2)
    data[place + 200] ^= 0xFF
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    result = replay(Recording(damaged), engine_of)
    assert result.stopped_utc_s is not None
    assert result.differing == 0
    assert result.agrees
    assert 50 < result.ticks < 300
    # A report has what came before it, and says so.
    assert run(["report", str(damaged)]) == 0
    assert "where messages are missing; what came after that is not used" in capsys.readouterr().out
    # So does the table of its errors.
    assert run(["recording", "export", str(damaged), str(tmp_path / "e.csv"), "--table", "error"]) == 0
    told = capsys.readouterr().err.splitlines()
    assert told[-1].startswith("sattrack: the table ends at ")
    assert told[-1].endswith(", where messages are missing; what came after that is not used")


def test_the_command_says_what_it_compared_and_exits_0(
    short: Path, held_in_short: Counter[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["replay", str(short)]) == 0
    told = capsys.readouterr().out
    counts = f"{held_in_short['command']} commands from {held_in_short['status']} statuses in 20 s of the run"
    assert told.startswith(f"the same, to the last byte: {counts}\n")
    assert "compared byte for byte: the same code, libraries and kind of processor" in told


def test_of_several_one_that_cannot_be_read_does_not_keep_the_others(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    empty = tmp_path / "empty.mcap"
    empty.touch()
    alike = replay(Recording(short), engine_of)
    monkeypatch.setattr("sattrack.cli.replay.replay", lambda *_, **__: alike)
    assert run(["replay", str(empty), str(short), "--json"]) == 2
    out, err = capsys.readouterr()
    assert [json.loads(line)["verdict"] for line in out.splitlines()] == ["same"]
    assert err == f"sattrack: {empty}: is empty: the run ended before anything was recorded\n"
    assert run(["report", str(empty), str(short), "--json"]) == 2
    out, err = capsys.readouterr()
    assert [one["recording"] for one in json.loads(out)] == [str(short)]
    assert err.startswith(f"sattrack: left out: {empty}: is empty")


def test_the_command_exits_1_where_outputs_differ(
    short: Path, held_in_short: Counter[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again_with(tmp_path, short, {300: bytes(82)})
    assert run(["replay", str(tmp_path / "changed.mcap"), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert not told["agrees"]
    assert (told["comparison"], told["divergence"]["tick"]) == ("bytes", 300)
    assert told["reasons"] == [f"1 of {held_in_short['command']} commands differ"]
    assert run(["replay", str(tmp_path / "changed.mcap")]) == 1
    assert capsys.readouterr().out.startswith("NOT THE SAME")


def test_a_run_that_was_failed_from_outside_comes_out_the_same(short: Path, tmp_path: Path) -> None:
    recording = Recording(short)
    live = build_engine(decode_facts(recording.header.spec))
    path = tmp_path / "failed.mcap"
    with path.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        for number, entry in enumerate(recording.entries()):
            if number == 500:
                recorder.failure(entry.utc_s, "the guardian is lost")
                live.fail("the guardian is lost")
            if entry.topic == COMMAND:
                recorder.command(entry.utc_s, live.tick(entry.utc_s))
            elif entry.topic == "status":
                recorder.status(entry.utc_s, entry.data)
                live.receive(entry.data, entry.utc_s)
        recorder.close()
    topics = [entry.topic for entry in Recording(path).entries()]
    assert FAILURE in topics
    result = replay(Recording(path), engine_of)
    assert result.differing == 0
    assert result.replayed.ended_by == "error"


def test_views_are_streamed_and_a_stop_ends_the_showing(short: Path, held_in_short: Counter[str]) -> None:
    command = [sys.executable, "-m", "sattrack", "replay", str(short), "--stream", "--control"]
    done = subprocess.run(
        [*command, "--speed", "1000"], input=b"", capture_output=True, check=True, timeout=60.0
    )
    whole = subprocess.run([*command[:-1], "--speed", "1000"], capture_output=True, check=True, timeout=300.0)
    lines = [json.loads(line) for line in whole.stdout.splitlines()]
    assert [line["type"] for line in lines[:-1]] == ["view"] * (len(lines) - 1)
    assert len(lines) == held_in_short["view"] + 1
    assert lines[-1]["summary"]["ended_by"] == "set"
    assert len(done.stdout.splitlines()) < len(lines)


def test_operators_words_are_inputs_too(short: Path, tmp_path: Path) -> None:
    recording = Recording(short)
    path = tmp_path / "nudged.mcap"
    with path.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec)
        for number, entry in enumerate(recording.entries()):
            recorder.write(*entry)
            if number == 400:
                recorder.write(OPERATOR, entry.utc_s, b'{"type":"nudge","along_s":1.5}')
        recorder.close()
    result = replay(Recording(path), engine_of)
    assert result.divergence is not None
    assert "nudge" in result.divergence.after or result.divergence.utc_s > 0.0
    assert result.differing > 50


@pytest.mark.parametrize("speed", ["0", "-1", "2000", "nan"])
def test_a_speed_that_is_none_is_refused(speed: str, short: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["replay", str(short), "--stream", "--speed", speed]) == 2
    assert "--speed" in capsys.readouterr().err
    assert run(["replay", str(short), "--speed", "3"]) == 2


def test_views_of_another_version_hinder_no_comparison(short: Path, tmp_path: Path) -> None:
    path, recording = tmp_path / "other.mcap", Recording(short)
    with path.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec, recording.header)
        for entry in recording.entries():
            recorder.write(
                *(entry._replace(data=b'{"rms_pass_arcsec":[1]}') if entry.topic == VIEW else entry)
            )
        recorder.close()
    result = replay(Recording(path), engine_of)
    assert (result.verdict, result.broke) == ("same", None)


def test_another_law_tells_what_it_would_have_done_and_judges_nothing(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["replay", str(short), "--set", "feeder.settling_s=0.5", "--json"]) == 0
    slower = json.loads(capsys.readouterr().out)
    assert slower["commands_differing"] > 100
    assert slower["simulated"]["delta_rms_arcsec"] > 0.0
    law = tmp_path / "law.toml"
    law.write_text("[feeder]\nsettling_s = 0.1\n")
    assert run(["replay", str(short), "--law", str(law), "--json"]) == 0
    same = json.loads(capsys.readouterr().out)
    assert same["commands_differing"] == 0
    assert same["simulated"]["delta_rms_arcsec"] == 0.0
    assert run(["replay", str(short), "--set", "filter.timing_s=1e-3"]) == 0
    told = capsys.readouterr().out
    assert "commands would have differed" in told
    assert "ΔRMS" in told


def test_a_law_that_never_comes_on_target_has_no_error_instead_of_none_at_all(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A law that settles in minutes follows no pass of 18 s; a message of a newer version hinders nothing."""
    found: list[WhatIf] = []
    monkeypatch.setattr(
        commands, "what_if", lambda *given: (found if found else found.append(what_if(*given)) or found)[0]
    )
    path, recording = tmp_path / "newer.mcap", Recording(short)
    with path.open("wb") as stream:
        recorder = Recorder(stream, recording.header.spec, recording.header)
        recorder.write(OPERATOR, next(recording.entries()).utc_s, b'{"type":"of_a_newer_version"}')
        recorder.close()
    assert run(["replay", str(path), "--set", "feeder.settling_s=300", "--json"]) == 0
    simulated = json.loads(capsys.readouterr().out)["simulated"]
    assert 0.0 < simulated["rms_arcsec"] < 0.1
    for name in ("rms_with_law_arcsec", "peak_with_law_arcsec", "delta_rms_arcsec"):
        assert simulated[name] is None
    assert run(["replay", str(path), "--set", "feeder.settling_s=300"]) == 0
    told = capsys.readouterr().out
    assert "this law:         never on target" in told
    assert "ΔRMS" not in told


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("feeder.x=1", "give KEY=N"),
        ("filter.timing_s=nan", "--set: filter.timing_s is nan"),
        ("filter.position_deg=-1", "--set: filter.position_deg is -1"),
        ("filter.rate_fades_s=0", "--set: filter.rate_fades_s is 0: give one above 0"),
        ("settling_s=1", "did you mean 'feeder.settling_s'?"),
        ("feeder.setling_s=1", "did you mean 'feeder.settling_s'? docs/recordings.md lists the keys"),
        ("feeder.settling_s", "did you mean 'feeder.settling_s'?"),
        ("feeder.settling_s=fast", "'fast' is no number"),
        ("feeder.braking_share=1.5", "--set: feeder.braking_share is 1.5; it must be above 0, and 1 at most"),
    ],
)
def test_a_law_that_is_none_is_told_by_its_key(
    setting: str, words: str, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["replay", str(short), "--set", setting]) == 2
    assert words in capsys.readouterr().err
    law = tmp_path / "law.toml"
    law.write_text("[feeder]\nhurry = 1\n")
    assert run(["replay", str(short), "--law", str(law)]) == 2
    assert "law.toml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("late = -1", "late is -1: give one above 0"),
        ("latee = 1", "unknown key 'latee' in [filter]; did you mean 'late'?"),
        ("hurry = 1", "unknown key 'hurry' in [filter]; there are position_deg, timing_s"),
    ],
)
def test_what_is_wrong_in_the_file_of_a_law_is_told_with_its_line_whatever_is_set(
    line: str, words: str, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    law = tmp_path / "law.toml"
    law.write_text(f"[filter]\nturn = 0.1\n{line}\n")
    assert run(["replay", str(short), "--law", str(law), "--set", "feeder.settling_s=0.2"]) == 2
    assert f"{law}:3: {words}" in capsys.readouterr().err
