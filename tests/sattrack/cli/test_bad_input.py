"""What a user gets wrong: one clear line each, the right exit code, no traceback, nothing moved."""

from __future__ import annotations

import errno
import json
import os
import warnings
from typing import TYPE_CHECKING

import pytest
from rich.text import Text

from sattrack.cli import output
from sattrack.cli.main import cli, run
from sattrack.cli.output import show, table
from sattrack.mount.profiles import load_profile_file

if TYPE_CHECKING:
    from pathlib import Path

LINE_1 = "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992"
LINE_2 = "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318"
OTHERS_LINE_2 = "2 25545  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588319"
SITE = ("--site", "52.1541,4.4908,0")
CLOCK = ("--clock", "2026-10-02T13:00:00Z")
TAB = "\t"
VIRTUAL = ("--mount", "sim", "--virtual")


def written(folder: Path, *lines: str) -> str:
    path = folder / "given.tle"
    path.write_text("".join(f"{line}\n" for line in lines))
    return str(path)


def refused(capsys: pytest.CaptureFixture[str], code: int, *arguments: str) -> str:
    """Run a command line; return its first line on standard error."""
    assert run(list(arguments)) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    assert err.startswith("sattrack: ")
    return err


@pytest.mark.parametrize(
    ("lines", "says", "line_number", "column"),
    [
        ((LINE_1[:-1] + "3", LINE_2), "checksum is 3", 1, 69),
        ((LINE_1[:40], LINE_2), "cut off", 1, 41),
        ((LINE_2, LINE_1), "put line 1 first", 1, 1),
        ((LINE_1, OTHERS_LINE_2), "object 25545", 2, 3),
        ((LINE_1, LINE_2[:10] + "x" + LINE_2[11:-1] + "7"), "inclination", 2, 9),
        ((f"  {LINE_1}", f"  {LINE_2}"), "line 1 begins with 2 blanks: remove", 1, 1),
        ((LINE_1, f" {LINE_2}"), "line 2 begins with 1 blanks: remove them", 2, 1),
        ((LINE_1.replace(" ", "\t", 1), LINE_2), "line 1, column 2 is a tab", 1, 2),
        ((LINE_1, LINE_2.replace("  ", "\t", 1)), "line 2, column 8 is a tab", 2, 8),
        ((LINE_1, LINE_2[:10] + "x" + LINE_2[11:]), "inclination '5x.6312' is no decimal number", 2, 9),
        ((LINE_1 + LINE_2,), "two lines of a set stand on one", 1, 70),
        ((f"{LINE_1} {LINE_2}",), "two lines of a set stand on one", 1, 70),
    ],
    ids=[
        "checksum",
        "cut line",
        "swapped lines",
        "another's line 2",
        "letter in a number",
        "blanks before",
        "a blank before line 2",
        "tab",
        "tab in line 2",
        "letter that spoils the sum",
        "joined lines",
        "lines joined by a blank",
    ],
)
@pytest.mark.parametrize("command", ["track", "ephemeris"])
def test_a_bad_element_set_is_shown_with_a_mark_under_the_column(
    command: str,
    lines: tuple[str, str],
    says: str,
    line_number: int,
    column: int,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    source = written(tmp_path, *lines)
    rest = (*VIRTUAL, *CLOCK) if command == "track" else ("--from", CLOCK[1], "--to", CLOCK[1], "--step", "1")
    err = refused(capsys, 2, command, "25544", "--elements", source, *SITE, *rest)
    first, shown, mark = err.splitlines()[:3]
    assert f"given.tle:{line_number}: " in first
    assert says in first
    assert shown == f"    {lines[line_number - 1].replace(TAB, '?')[:100]}"
    assert mark.index("^") - 4 + 1 == column


@pytest.mark.parametrize("site", ["92,4,0", "52,999,0", "52", "fifty,4,0", "nan,4,0", "52,4,1e9"])
def test_a_site_out_of_range(site: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = written(tmp_path, LINE_1, LINE_2)
    err = refused(capsys, 2, "track", "25544", "--elements", source, "--site", site, *VIRTUAL, *CLOCK)
    assert "site" in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    "clock", ["yesterday", "2026-13-02T13:00:00Z", "2026-10-02T13:00:00Zx", "2026-10-02T13:00:00Zx0", "x10"]
)
def test_a_time_that_is_none(clock: str, capsys: pytest.CaptureFixture[str]) -> None:
    err = refused(capsys, 2, "track", "25544", *VIRTUAL, "--clock", clock)
    assert clock in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("mount", "says"),
    [
        ("", "no mount"),
        ("antenna://there", "write antenna://HOST:PORT"),
        ("serial://x", "write sim, xerxes://"),
        ("xerxes://", "no host"),
        ("xerxes://127.0.0.1:70000", "Port out of range"),
        ("xerxes://127.0.0.1:15001?listen=no", "listen=no is no port"),
        ("xerxes://[::1", "write xerxes://"),
        ("xerxes://a..b:1", "no such host"),
        ("xerxes://127.0.0.1:15001?listen=15001", "both ends"),
    ],
)
def test_a_mount_that_cannot_be_meant(
    mount: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = written(tmp_path, LINE_1, LINE_2)
    option = ("--mount", mount) if mount else ()
    err = refused(capsys, 2, "track", "25544", "--elements", source, *SITE, *option)
    assert says in err
    assert err.count("\n") == 1


def test_a_real_mount_follows_the_real_sky_in_real_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ("track", "25544", "--elements", written(tmp_path, LINE_1, LINE_2), *SITE)
    real = ("--mount", "xerxes://127.0.0.1:15001?listen=15002")
    assert "--clock" in refused(capsys, 2, *given, *real, *CLOCK)
    assert "--virtual" in refused(capsys, 2, *given, *real, "--virtual")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--bias-along", "nan"), "--bias-along"),
        (("--bias-cross", "inf"), "--bias-cross"),
        (("--bias-cross", "120"), "120"),
        (("--fov", "0"), "--fov 0: give"),
        (("--fov", "nan"), "--fov nan: give"),
        (("--min-alt", "95"), "95"),
        (("--min-alt", "-5"), "kept above 0°"),
        (("--stream",), "--virtual"),
    ],
)
def test_numbers_that_make_no_sense(
    arguments: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert says in refused(capsys, 2, "track", "25544", *VIRTUAL, *arguments)


def test_a_satellite_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert "99999" in refused(capsys, 2, "track", "99999", *VIRTUAL)


def test_a_satellite_that_does_not_rise_is_no_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = written(tmp_path, LINE_1, LINE_2)
    pole = ("--site", "89,0,0", "--min-alt", "80")
    err = refused(capsys, 1, "track", "25544", "--elements", source, *VIRTUAL, *CLOCK, *pole)
    assert "does not rise above 80°" in err


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[site]\nlatitude_deg = "north"\nlongitude_deg = 4\n', "sattrack.toml:2"),
        ("[site]\nlatitude_deg = 52\nlongitude_deg = 4\nhight_m = 3\n", "hight_m"),
        ("[site\n", "not a TOML file"),
        ("min_altitude_deg = true\n", "sattrack.toml:1"),
    ],
)
def test_settings_name_file_line_and_key(
    text: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = tmp_path / "sattrack.toml"
    settings.write_text(text)
    assert says in refused(capsys, 2, "track", "25544", *VIRTUAL, "--config", str(settings))


def test_elements_without_a_site_and_the_reverse(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no elements" in refused(capsys, 2, "track", "25544", *VIRTUAL, *SITE)
    source = written(tmp_path, LINE_1, LINE_2)
    assert "no site" in refused(capsys, 2, "track", "25544", *VIRTUAL, "--elements", source)


def test_debug_shows_where_it_came_from(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["track", "25544", *VIRTUAL, "--clock", "yesterday", "--debug"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("Traceback")
    assert err.splitlines()[-1].startswith("sattrack: --clock yesterday")


CLEAR = "\x1b[2J"
"""Clears a terminal that is shown it."""


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("passes", "ISS", "--config", "FILE"), 2),
        (("passes", "ISS", "--config", "FILE", "--debug"), 2),
        (("doctor", "--config", "FILE"), 1),
        (("passes", "ISS", "--config", f"none{CLEAR}.toml"), 2),
        (("passes", "ISS", f"--{CLEAR}"), 2),
        (("elements", "check", f"none{CLEAR}.tle"), 2),
        (("recording", "info", f"none{CLEAR}.mcap"), 2),
    ],
)
def test_what_was_wrong_commands_no_terminal(
    words: tuple[str, ...], code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text('[cameras]\n"\\u001b[2J" = 3\n')
    assert run([str(path) if word == "FILE" else word for word in words]) == code
    out, err = capsys.readouterr()
    assert "\x1b" not in out + err
    assert "?[2J" in out + err


def test_a_warning_commands_no_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def main(**_: object) -> None:
        warnings.warn(f"two lines\n{CLEAR}", UserWarning, stacklevel=1)

    monkeypatch.setattr(cli, "main", main)
    assert run([]) == 0
    assert capsys.readouterr().err == "sattrack: warning: two lines\n?[2J\n"


def test_own_colours_are_shown_and_those_of_texts_are_not(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setattr("click.utils.should_strip_ansi", lambda *_: False)
    show("\x1b[31mred", Text("go", style="bold green"), table("head", rows=[["\x1b[31mred"]]))
    assert capsys.readouterr().out == "?[31mred\n\x1b[1;32mgo\x1b[0m\n\x1b[1mhead   \x1b[0m\n?[31mred\n"


def test_faults_of_the_simulated_mount(capsys: pytest.CaptureFixture[str]) -> None:
    assert "silent:SECONDS" in refused(capsys, 2, "sim", "--faults", "explode")
    assert "99999" in refused(capsys, 2, "sim", "--port", "99999")


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ("clock_offset_s = nan", ":1: clock_offset_s is nan; "),
        ("clock_offset_s = inf", ":1: clock_offset_s is inf; "),
        ("[stands_at]\nlatitude_deg = nan\nlongitude_deg = 4.0", ":2: latitude_deg is nan; "),
        ("[stands_at]\nlatitude_deg = 52.0\nlongitude_deg = 400.0", ":3: longitude_deg is 400; "),
        ("[simulator]\nclock_offset_s = nan", ":2: clock_offset_s is nan; give a number"),
        ("[simulator]\nclock_drift_ppm = -1e9", ":2: clock_drift_ppm is -1e+09; "),
        ("[simulator.servo]\nbandwidth_hz = -1.0", ":2: bandwidth_hz is -1; "),
    ],
)
def test_a_number_that_no_profile_has_is_named_with_its_file(
    wrong: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(f"{wrong}\n")
    said = refused(capsys, 2, "mount", "status", "--mount", "sim", "--profile", str(file))
    assert said.startswith(f"sattrack: {file}{says}")


def test_a_profile_to_be_learnt_is_a_new_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    there = tmp_path / "there.toml"
    there.write_text("")
    said = refused(capsys, 2, "track", "25544", *VIRTUAL, "--learn-profile", str(there))
    assert "the file exists; give a new name" in said
    assert len(said.splitlines()) == 1
    assert there.read_text() == ""
    faster = ("--mount", "sim", "--clock", "2026-10-02T13:00:00Zx10", "--headless")
    said = refused(capsys, 2, "track", "25544", *faster, "--learn-profile", str(tmp_path / "new.toml"))
    assert "10 times real speed" in said


def test_a_profile_is_not_learnt_from_an_antenna(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    antenna = ("--mount", "antenna://127.0.0.1:1", "--headless")
    said = refused(capsys, 2, "track", "25544", *antenna, "--learn-profile", str(tmp_path / "new.toml"))
    assert said == "sattrack: --learn-profile does not work with an antenna's controller; omit it\n"


def test_a_virtual_pass_writes_what_it_learnt(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "learnt.toml"
    high = ("--clock", "2026-10-02T13:04:58Z", "--min-alt", "70")
    assert run(["track", "25544", *VIRTUAL, *high, "--json", "--learn-profile", str(target)]) == 0
    out, err = capsys.readouterr()
    learnt = json.loads(out)["summary"]["learnt"]
    told = [line for line in err.splitlines() if f"learnt, and written to {target}" in line]
    assert len(told) == 1
    assert load_profile_file(target).mount.ra_rate_gain == pytest.approx(learnt["ra_gain"], abs=1e-6)
    assert load_profile_file(target).mount.name == "learnt"


def test_a_profile_that_cannot_be_written_costs_no_summary_and_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(output, "replace_file", full)
    words = ("--clock", "2026-10-02T13:04:58Z", "--min-alt", "70", "--json")
    target = tmp_path / "new.toml"
    assert run(["track", "25544", *VIRTUAL, *words, "--learn-profile", str(target)]) == 1
    out, err = capsys.readouterr()
    summary = json.loads(out)["summary"]
    assert summary["ended_by"] == "set"
    why = "cannot be written: No space left on device; make room there, or write elsewhere"
    text, found, last = err.rpartition("sattrack: what was found is printed above: ")
    assert found
    assert last == f"{target}: {why}\n"
    # It can be saved as it stands there.
    target.write_text(text[text.index("# ") :], encoding="utf-8")
    gain = load_profile_file(target).mount.ra_rate_gain
    assert gain == pytest.approx(summary["learnt"]["ra_gain"], abs=1e-6)
