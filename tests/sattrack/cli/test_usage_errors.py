"""What is wrong with a command line, a settings file or an example's arguments is told in one line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from sattrack.cli.main import run

EXAMPLES = Path(__file__).parents[3] / "examples"
ELEMENTS = ("--elements", str(EXAMPLES / "iss_leiden.tle"), "--site", "52,4,0")


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["trakc"], "no such command 'trakc'; did you mean 'track'? see `sattrack --help`"),
        (["nothing-like-it"], "no such command 'nothing-like-it'; see `sattrack --help`"),
        (["mount", "slwe"], "no such command 'slwe'; did you mean 'slew'? see `sattrack mount --help`"),
        (
            ["serve", "rotctl"],
            "no such command 'rotctl'; did you mean 'rotctld'? see `sattrack serve --help`",
        ),
        (
            ["track", "ISS", "--monut", "sim"],
            "no such option --monut; did you mean '--mount'? see `sattrack track --help`",
        ),
        (
            ["passes", "--hours", "abc"],
            "invalid value for '--hours': 'abc' is not a number; see `sattrack passes --help`",
        ),
        (["ephemeris"], "missing argument 'TARGET'; see `sattrack ephemeris --help`"),
        (["stop", "extra"], "unexpected argument (extra); see `sattrack stop --help`"),
    ],
)
def test_a_wrong_command_line_is_told_in_one_line_with_what_was_meant(
    arguments: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(arguments) == 2
    assert capsys.readouterr() == ("", f"sattrack: {line}\n")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('elments = ["a"]\n', "1: unknown key 'elments'; did you mean 'elements'?"),
        (
            "[screen]\ntheme = 'red'\n[site]\nlatitude_deg = 1\nlongitud_deg = 2\n",
            "5: unknown key 'longitud_deg' in [site]; did you mean 'longitude_deg'?",
        ),
        ("[site]\nlatitude_deg = 'x'\nlongitude_deg = 2\n", "2: latitude_deg is 'x'; give a number"),
        ("[site]\nlatitude_deg = 1\n", "1: longitude_deg is missing in [site]"),
        ("[screen]\ntheme = 'rde'\n", "2: theme is 'rde'; did you mean 'red'?"),
        ("[site\n", "1:6: not a TOML file: Expected ']' at the end of a table declaration"),
    ],
)
def test_a_wrong_setting_is_told_with_file_line_table_and_the_nearest_key(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.toml"
    path.write_text(text)
    assert run(["passes", "--config", str(path)]) == 2
    assert capsys.readouterr() == ("", f"sattrack: {path}:{words}\n")


@pytest.mark.parametrize("name", ["ISSS", "ISS (ZARIA)", "zariya"])
def test_a_satellite_that_is_not_there_is_told_with_the_one_that_was_meant(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["passes", name, *ELEMENTS]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert err.endswith("; did you mean ISS (ZARYA) (25544)?\n")


@pytest.mark.parametrize("closed", ["<&-", ">&-", "<&- >&- 2>&-", ">/dev/full"])
def test_a_closed_or_full_stream_is_no_defect(closed: str, tmp_path: Path) -> None:
    command = f"{sys.executable} -m sattrack attach --run 1 {closed}"
    if closed == ">/dev/full":
        command = f"{sys.executable} -m sattrack --help {closed}"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False, timeout=60.0)
    assert done.returncode in {0, 1, 2}
    assert "defect" not in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("example", "words"),
    [
        (["follow_celestrak_group.py", "a", "b", "c", "d"], "unrecognized arguments: d"),
        (["alpaca_client.py", "127.0.0.1:1"], "nothing answers at 127.0.0.1:1: is `sattrack serve alpaca"),
        (["alpaca_client.py", "a", "b"], "unrecognized arguments: b"),
    ],
)
def test_an_example_tells_wrong_arguments_and_a_mount_that_is_not_there(
    example: list[str], words: str
) -> None:
    if example[0] == "alpaca_client.py":
        pytest.importorskip("alpaca")
    command = [sys.executable, str(EXAMPLES / example[0]), *example[1:]]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60.0)
    assert done.returncode != 0
    assert words in done.stderr
    assert "Traceback" not in done.stderr
