"""What is wrong with a command line, a settings file or an example's arguments is told in one line."""

from __future__ import annotations

import errno
import os
import runpy
import shlex
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from sattrack.cli.main import cli, run

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
        (["track", "ISS", "--output", "x"], "no such option --output; see `sattrack track --help`"),
        (
            ["passes", "ISS", "--city", "Leiden"],
            "no such option --city: give --site LAT,LON,HEIGHT; `sattrack init --city NAME` writes it into "
            "settings; see `sattrack passes --help`",
        ),
    ],
)
def test_a_wrong_command_line_is_told_in_one_line_with_what_was_meant(
    arguments: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(arguments) == 2
    assert capsys.readouterr() == ("", f"sattrack: {line}\n")


@pytest.mark.parametrize(
    "arguments",
    [
        ("track", "ISS", "--mount", "sim", "--record", "a\udcff.mcap"),
        ("track", "ISS", "--mount", "sim", "--learn-profile=a\udcff.mcap"),
        ("elements", "show", "a\udcff.mcap", "--json"),
    ],
)
def test_a_name_that_is_not_utf_8_is_refused_before_anything_is_done(
    arguments: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run([*arguments, *ELEMENTS]) == 2
    out, err = capsys.readouterr()
    assert (out, list(tmp_path.iterdir())) == ("", [])
    assert "a?.mcap: this is no text in UTF-8; give the file or folder another name\n" in err
    assert err.count("\n") == 1


def test_a_folder_whose_name_is_not_utf_8_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def main(**_: object) -> None:
        "/data/a\udcff: 3 GB free".encode()

    monkeypatch.setattr(cli, "main", main)
    assert run(["doctor", "--json"]) == 2
    words = "/data/a?: this is no text in UTF-8; give the file or folder another name"
    assert capsys.readouterr().err == f"sattrack: {words}\n"


WRONG = """
demo --seconds 0                                | give 5 or more
demo --seconds soon                             | is not a number; see `sattrack demo --help`
demo extra                                      | unexpected argument (extra); see
demo --observations tcp:5                       | write udp:PORT or stdin
demo --bias-memory maybe                        | is not one of 'auto', 'on', 'nudge', 'off'
init --yes                                      | give --site LAT,LON,HEIGHT or --city NAME
init --yes --city Xyzzyville                    | name a larger one nearby, or give LAT,LON,HEIGHT
passes ab --site 52,4,0                         | 'ab' is too short a name for CelesTrak: give 3 letters
init --yes --city Leidn                         | did you mean Leiden, NL?
init --yes --city Newcastl                      | did you mean Newcastle
init --yes --site 91,0,0                        | latitude
init --yes --site 52,4,0 --city Leiden          | give one of them
init --yes --city Leiden --mount foo://x        | write
init --yes --city Leiden --zone Mars/Base       | Europe/Amsterdam
init --yes --city Leiden --elements none.tle    | none.tle
ephemeris                                       | missing argument 'TARGET'; see
ephemeris ISS {at} --step 0                     | give a positive number of seconds
ephemeris ISS {at} --from noon                  | write UTC as 2026-10-02T13:05:24.5Z
ephemeris ISS {at} --from 2026-10-02T13:00:00Z --to 2026-10-02T12:00:00Z | give the earlier first
ephemeris ISS {at} --format xml                 | is not one of 'table', 'csv', 'json'
ephemeris ISS {at} --place here                 | is not one of 'apparent', 'geometric', 'astrometric'
ephemeris ISS --elements {tle}                  | run `sattrack init`
ephemeris ISS                                   | no site: give --site LAT,LON,HEIGHT, or run `sattrack init`
passes Tiangong                                 | no site: give --site LAT,LON,HEIGHT, or run `sattrack init`
ephemeris ISS --site 52,4,0 --elements none.tle | check the name
ephemeris ISS {at} --refraction --pressure -5   | outside 0 to 1200 hPa
ephemeris ISS --site 52,4,0 --config none.toml  | none.toml
passes {at} --hours -1                          | give from above 0 to 8784 hours
passes {at} --min-alt 95                        | outside -90° to 90°
passes {at} --max-rate 0                        | give degrees a second above 0
passes {at} --magnitude 4                       | needs --magnitudes FILE
passes {at} --sort colour                       | is not one of 'rise',
passes {at} --horizon none.txt                  | check the name
passes {at} --json --format csv                 | give only one
passes {at} --name XYZ*                         | `sattrack elements show` lists the names
passes {at} --jsn                               | did you mean '--json'?
passes Zaria {at}                               | did you mean ISS (ZARYA) (25544)?
passes {at} --clock tomorrow                    | 2026
rehearse                                        | missing argument 'TARGET'; see
rehearse ISS {at} --pass 0                      | count from 1
rehearse ISS {at} --fov -1                      | above 0
rehearse ISS {at} --fov 400                     | above 0 to 180
rehearse ISS {at} --pass 99                     | give a number up to that
rehearse HST                                    | only the built-in pass of the ISS
rehearse Hubble {at}                            | which hold ISS (ZARYA) (25544)
track                                           | missing argument 'TARGET'; see
track ISS {at}                                  | --mount sim
track ISS {at} --mount foo                      | write sim, xerxes://
track ISS {at} --mount sim --virtual --fov 181  | above 0 to 180
serve antenna --mount sim --framing 8N1         | --framing needs --serial
serve lx200 --mount sim --baud 4800             | --baud needs --serial
elements get mine.tle --output mine.tle         | this command reads that file; give another name
elements get {tle} --config settings.toml --output settings.toml | this command reads that file
track ISS {at} --mount sim --virtual --min-alt 99 | 99
track ISS {at} --refraction maybe               | is not one of 'auto', 'on', 'off'
track ISS {at} --mount sim --virtual --bias-cross 120 | 120
attach --run 999999                             | needs a terminal; --json is for programs
attach --run first                              | is not a whole number
run                                             | missing argument 'FILE'; see
run none.toml                                   | none.toml: there is no such file; check the name
run {night} --plot x.png                        | --plot needs --dry-run
run {tle} --dry-run                             | this is not a TOML file, as a schedule must be
passes {at} --config {tle}                      | this is not a TOML file, as the settings must be
rehearse ISS {at} --profile settings.toml       | this is a settings file, not a mount's profile
rehearse 25h,12d {at}                           | is no direction: write RA,DEC as 83.6331,22.0145
ephemeris 99h,10 {at}                           | is no direction: write RA,DEC as 83.6331,22.0145
passes Pluton {at}                              | did you mean Pluto?
ephemeris Jupitr {at}                           | did you mean Jupiter?
serve web --host 300.1.1.1                      | --host 300.1.1.1: no IPv4 address of this machine: give 127
serve rotctld --mount sim --host ::1            | --host ::1: no IPv4 address of this machine: give 127.0
serve web --port {taken}                        | is not available: Address already in use; choose another
serve rotctld --mount sim --port {taken}        | Address already in use; choose another with --port
replay {pass} --set feeder.setling_s=1          | did you mean 'feeder.settling_s'? docs/recordings.md lists
attach --run 1 --json                           | without --run, `sattrack attach` lists
track ISS {at} --mount sim --virtual --clock 2026-10-02T13:00:00Z --to 2026-10-02T12:00Z | give a later --to
track ISS {at} --mount alpaca://127.0.0.1:1/0 --old-elements --headless | nothing listens there
track ISS {at} --mount eqmod://com3             | for `sattrack track` also antenna://HOST:PORT
passes ISS --elements {tle} --site 52.15N,4.4E,0m | south and west are negative, without letters
run {night} --seed 3 --mount sim                | --seed needs --virtual
replay                                          | missing argument 'FILES...'; see
replay none.mcap                                | check the name
replay {tle}                                    | not an MCAP file
replay {pass} --speed 0                         | give a factor from 0.01 to 1000
replay {pass} --stream --speed 1e-300           | give a factor from 0.01 to 1000
replay {pass} --part 7                          | it holds one recording; omit --part
replay {pass} --fov 2                           | --fov needs --tui
report none.mcap                                | check the name
report {pass} --tdm {tle}                       | give another name
recording exprot                                | did you mean 'export'?
recording info --prat 1 x                       | did you mean '--part'?
recording export {pass}                         | missing argument 'OUT'; see
recording export {pass} x.foo                   | give --format mcap|pcapng|
biases --drop 99                                | sattrack biases lists them
biases --drop newest                            | is not a whole number
biases --site garbage                           | 'garbage' is no site
biases --elements nofile                        | --elements nofile: there is no such file
elements check {tle} --clock garbage            | --clock garbage: 'garbage' is no time
stop --mount nothing                            | write sim, xerxes://
stop --al                                       | did you mean '--all'?
mount dance                                     | see `sattrack mount --help`
mount slew 25h 0d --mount sim                   | from 0h to below 24h
mount slew 14h15m --mount sim                   | missing argument 'DEC'; see
mount slew 10 95 --mount sim                    | from -90 to 90 degrees
mount sync ten 5 --mount sim                    | right ascension
mount move --mount sim --seconds 0              | give seconds, above 0 and 600 at most
mount move --mount sim --ra-rate 1              | missing option '--seconds'; see
mount pulse --mount sim                         | a pulse of 0 ms on both axes
mount fine-rate --mount sim --ra 9              | at most 0.1 °/s
mount status --mount sim --timeout 0            | give seconds, above 0
mount calibrate --mount sim --yes               | give --output FILE
mount watch --mount sim --control               | --control needs --stream
sim --port -1                                   | 0 takes a free one
sim --faults explode                            | write loss=3%
sim --profile none.toml                         | check the name
sim --telescope x.toml                          | it needs --alpaca
serve nexstar                                   | see `sattrack serve --help`
serve alpaca --mount sim --port 99999           | 0 takes a free one
serve alpaca --mount sim --allow everyone       | write 192.0.2.7 or 192.0.2.0/24
serve antenna --mount sim --axes xy             | is not one of 'hadec', 'azel'
serve antenna --mount sim --focus 9             | up to 3 axes
serve rotctld --mount sim --clients 0           | give 1 to 500
serve web --token short                         | give 16 or more
elements gte                                    | did you mean 'get'?
elements show Zaria --elements {tle}            | did you mean ISS (ZARYA) (25544)?
elements check                                  | elements
elements check none.tle                         | check the name
elements get {tle} --format yaml                | is not one of 'csv',
doctor --mnt sim                                | did you mean '--mount'?
passes ISS --site 52,4,0                          | `passes`, `track` and others take it by --elements FILE
passes Hubble --site 52,4,0                     | save http
passes '' {at}                                  | TARGET is empty: give a satellite's number
track 12:30:00 {at} --mount sim                 | '12:30:00' is one angle: a direction has two, RA,DEC
track {readme} {at} --mount sim                 | README.md is a file: give it with --elements
passes ISS {tle} {at}                           | iss_leiden.tle is a file: give it with --elements
passes ISS --elements {tle} --site 52,4,-5000   | height of -5000.0 is outside -500 to 8900 metres
init --yes --city Leiden --height 100000        | height of 100000.0 is outside -500 to 8900 metres
init --yes --city Leiden --elements stations    | write celestrak:stations
passes 25 544 {at}                              | no satellite '25'
ephemeris 'HIP 5' --site 52,4,0                 | set stars in sattrack.toml
ephemeris Vegga {at}                            | which hold ISS (ZARYA) (25544)
passes ISS --elements {tle} --site Leiden       | write LAT,LON,HEIGHT as 52.15,4.49,0
passes ISS --elements {tle} --site '52.1 4.4 0' | write LAT,LON,HEIGHT as 52.15,4.49,0
passes ISS --elements {tle} --site 52,1,4,9,0   | write LAT,LON,HEIGHT as 52.15,4.49,0
passes ISS --elements {tle} --site "52°9'N,4°29'E,0" | must be numbers, as 52.15,4.49,0
passes ISS --elements {tle} --site 4.49         | write LAT,LON,HEIGHT as 52.15,4.49,0
passes ISS --elements {tle} --site              | needs a value after it
passes {at} --from tonight                      | write UTC as 2026-10-02T13:05:24.5Z
passes {at} --from 02/10/2026                   | write UTC as 2026-10-02T13:05:24.5Z
passes {at} --from 2026-10-02T25:00:00Z         | hour must be in 0..23
passes {at} --hours 6h                          | '6h' is not a number
ephemeris ISS {at} --step 0.00001               | give a longer step
track ISS {at} --mount 192.0.2.7                | write sim, xerxes://
track ISS {at} --mount xerxes:192.0.2.7         | write xerxes://HOST:PORT?listen=PORT
track ISS {at} --mount xerxes://mount.invalid:1 | check the name, or give its IPv4 address
track ISS {at} --mount xerxes://[2001:db8::1]:1 | give its IPv4 address
mount status                                    | --mount sim is a simulated one for practice
mount status --mount simulator                  | write sim, xerxes://
passes ISS --site 52,4,0 --elements {readme}    | give a TLE, 3LE or OMM file
passes ISS --site 52,4,0 --elements empty.tle   | is empty
passes ISS --site 52,4,0 --elements celestrack:visual | write celestrak:GROUP
report {readme}                                 | not an MCAP file
replay tonight                                  | check the name and the folder
report                                          | missing argument 'FILES...'; see
report {pass} --output /nowhere/x.html          | there is no folder /nowhere; make it first
passes {at} --plot                              | needs a value after it
rehearse ISS {at} --plot /nowhere/p.png         | there is no folder /nowhere; make it first
rehearse ISS {at} --plot x.xyz                  | --plot x.xyz: its ending is unknown; give one of .png, .svg
ephemeris ISS {at} --plot /nowhere/p.png        | make it first
passes {at} --plot x.xyz                        | give one of .png, .svg
bias {tle} --observations x --plot x.docx       | give one of .png, .svg
bias {tle} --observations x --output /nowhere/x | make it first
run {night} --dry-run --plot /nowhere/p.png     | make it first
run {night} --dry-run --ics adir                | --ics adir: is a folder; give a file
run .                                           | is a folder; give a file
track ISS {at} --mount sim --record /nowhere/x  | make it first
track ISS {at} --mount sim --learn-profile adir | is a folder; give a file
demo --record adir                              | is a folder; give a file
report {pass} --output adir                     | is a folder; give a file
recording export {pass} /nowhere/x.csv          | make it first
network assign --stations x --passes x --out x --elements {tle} --plot x.gif | .html
init --yes --city Leiden --config adir          | is a folder; give a file
mount calibrate --mount sim --yes --output adir | is a folder; give a file
elements get {tle} --output adir                | is a folder; give a file
passes {at} --config adir                       | adir: cannot read the settings: Is a directory; give a file
report adir                                     | Is a directory; give a file
replay adir                                     | Is a directory; give a file
recording info adir                             | Is a directory; give a file
run adir                                        | is a folder; give a file
bias {tle} --observations adir                  | give a file
passes {at} --horizon adir                      | is a folder; give a file
rehearse ISS {at} --profile adir                | Is a directory; give a file
ephemeris Mars {at} --ephemeris adir            | is a folder; give a file
sim --telescope adir --alpaca                   | Is a directory; give a file
--mount sim track ISS                           | see `sattrack --help`
Track ISS                                       | did you mean 'track'?
track ISS -mount sim                            | did you mean '--mount'?
track 'ISS --mount sim'                         | --mount sim is a simulated one
track ISS —mount sim                            | options begin with --, two hyphens
help                                            | see `sattrack --help`
passes {at} --json --csv                        | give only one
passes {at} --profile x.toml                     | --profile is what passes are judged by: give --judged or
passes {at} --transits --profile x.toml          | --profile is of passes, and --transits lists none
passes {at} --transits --csv                    | as a table or as json, not as csv
passes {at} --transits --dark                   | --dark is of passes, and --transits lists none
passes {at} --transits --plot x.png             | --plot is of passes, and --transits lists none
passes {at} --transits --sort altitude          | --sort is of passes, and --transits lists none
ephemeris ISS {at} --json --format csv          | give only one of --json and --format csv
elements get {tle} --json --format tle          | give only one of --json and --format tle
elements get celestrak:stations                 | check the network, or save http
passes {site} --elements celestrak:stations     | /NORAD/elements/gp.php?GROUP=stations&FORMAT=csv as a file
passes {site} --elements https://celestrak.invalid/x | check the network, or save https://celestrak.invalid/x
passes ISS --site 52,4,0 --elements spacetrack:25544 | set SATTRACK_SPACETRACK_USER
init --yes --city Leiden --mount sim --config /nowhere/b.toml | make it first
report {pass} --output report.pdf               | its ending is unknown; give one of .html
run settings.toml                               | this is a settings file, not a schedule
rehearse ISS {at} --mount simm                  | did you mean 'sim'?
track ISS {at} --mount sim --serve alpaca:99999 | --serve alpaca, port 99999: ports run to 65535
serve alpaca lx200:{taken} --mount sim --port 0 | choose another with lx200:PORT
track ISS {at} --mount alpaca                   | --mount alpaca: no host; write alpaca://HOST:PORT/DEVICE
track ISS {at} --mount indi                     | --mount indi: no host; write indi://HOST:PORT/DEVICE
mount status --mount alpaca                     | `sattrack init --mount alpaca` finds out which answer
serve rotctld --mount indi                      | write indi://HOST:PORT/DEVICE
stop --mount alpaca:192.0.2.7/0                 | no host; write alpaca://HOST:PORT/DEVICE
track ISS {at} --mount ALPACA                   | did you mean 'alpaca'?
track ISS {at} --mount Sim                      | did you mean 'sim'?
mount status --mount simm                       | did you mean 'sim'?
track ISS {at} --mount sim --camera nocam.fits  | 'nocam.fits' is no camera, and there is no such file
"""
"""Command lines, and what to do in the answer of each."""


@pytest.mark.parametrize("case", WRONG.strip().splitlines(), ids=lambda case: case.partition("|")[0].strip())
def test_a_wrong_command_line_is_answered_in_one_line_with_what_to_do(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for variable in ("XDG_CONFIG_HOME", "XDG_STATE_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(variable, str(tmp_path))
    monkeypatch.chdir(tmp_path)
    line, _, advice = case.partition(" | ")
    places = {
        "at": " ".join(ELEMENTS),
        "tle": ELEMENTS[1],
        "night": f"{EXAMPLES}/night.toml",
        "site": "ISS --site 52,4,0",
    }
    places["pass"] = f"{EXAMPLES}/passes/clean.mcap"
    places["readme"] = f"{EXAMPLES.parent}/README.md"
    (tmp_path / "empty.tle").touch()
    (tmp_path / "settings.toml").write_text("elements = []\n[site]\nlatitude_deg = 1\nlongitude_deg = 2\n")
    (tmp_path / "mine.tle").write_bytes(Path(ELEMENTS[1]).read_bytes())
    (tmp_path / "adir").mkdir()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        places["taken"] = str(taken.getsockname()[1])
        assert run(shlex.split(line.format(**places))) in {1, 2, 4}
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("sattrack: ")
    assert advice.strip() in err
    assert "defect" not in err


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
        (
            "[mount]\nurl = 'sim'\nprofile = \"a\\u0000.toml\"\n",
            "3: profile has the character U+0000 in it; omit that",
        ),
        ("[screen]\ntheme = 'rde'\n", "2: theme is 'rde'; did you mean 'red'?"),
        ("[site\n", "1:6: not a TOML file: Expected ']' at the end of a table declaration"),
        ("site = 'Leiden'\n", "1: site is 'Leiden'; give a table, [site] and its keys below"),
        (
            "[site]\nlatitude_deg = 52,1\n",
            "2:18: not a TOML file: Expected newline or end of document after a statement; "
            "write a decimal point, not a comma",
        ),
        (
            "[site]\nlatitude_deg = 952.1\nlongitude_deg = 4.4\n",
            "2: latitude_deg: the site's latitude of 952.1 is outside -90 to 90 degrees north",
        ),
        ("elements = 'iss.tle'\n", "1: elements is 'iss.tle'; give a list in [ ]"),
        ("mount = 'sim'\n", "1: mount is 'sim'; give a table, [mount] and its keys below"),
        ("cameras.guide = 3\n", "1: guide is 3; give a table, [cameras.guide] and its keys below"),
        ("\n[camras.guide]\nfov_deg = 1\n", "2: unknown key 'camras'; did you mean 'cameras'?"),
        ("\nmuont.url = 'sim'\n", "2: unknown key 'muont'; did you mean 'mount'?"),
        ("zone = 'CEST'\n", "1: zone 'CEST' is no time zone: write it as Europe/Amsterdam, or UTC"),
        ("zone = +2\n", "1: zone is 2; give text in quotes"),
        (
            "min_altitude_deg = -20\n",
            "1: safety.floor_altitude_deg is 0, above min_altitude_deg, -20: nothing is followed below the "
            "floor; raise min_altitude_deg, or lower the floor",
        ),
        ("[screen]\n[screen]\n", "2: [screen] stands twice: merge them"),
        ("zone = 'UTC'\nzone = 'UTC'\n", "2: zone stands twice: keep one of them"),
        ('[site]\nlatitude_deg = "52\nheight_m = 1\n', "2: the quote is not closed on this line"),
        ("zone = 'UTC\nheight_m = 1\n", "1: the quote is not closed on this line"),
        ("elements = ['a',\n 'b',\n[site]\n", "1: [ is not closed: write ] after the last value"),
        ("elements = ['a'\n\nzone = 'UTC'\n", "1: [ is not closed: write ] after the last value"),
        ("elements = [\n iss.tle,\n]\n", "2:2: not a TOML file: Invalid value"),
        ("elements = [\n 'a'\n 'b']\n", "3:2: not a TOML file: Unclosed array"),
        ("elements = ['a', [\n", "1: [ is not closed: write ] after the last value"),
        (
            "[mount]\nprofile = 'm.toml'\nurl = 'alpaca'\n",
            "3: url in [mount] is alpaca: no host; write alpaca://HOST:PORT/DEVICE, as "
            "alpaca://192.0.2.9:11111/0; `sattrack init --mount alpaca` finds out which answer",
        ),
        (
            "[mount]\nurl = 'sin'\n",
            "2: url in [mount] is sin: write sim, xerxes://HOST:PORT?listen=PORT, alpaca://HOST:PORT/DEVICE "
            "or indi://HOST:PORT/DEVICE; for `sattrack track` also antenna://HOST:PORT or "
            "antenna:///dev/ttyUSB0; did you mean 'sim'?",
        ),
        ("[safety]\noptical = yes\n", "2:11: not a TOML file: Invalid value; write true or false"),
        (
            "min_altitude_deg = 100\n",
            "1: min_altitude_deg is 100; give degrees above the horizon, 90 at most",
        ),
        (
            "[site]\nlatitude_deg = 1\nlongitude_deg = 2\nheight_m = 100000\n",
            "4: height_m: the site's height of 100000.0 is outside -500 to 8900 metres: no ground on Earth "
            "lies outside",
        ),
        ("ISS (ZARYA)\n", " this is not a TOML file, as the settings must be"),
        (
            "[camera]\nscale = 2\n",
            "2: unknown key 'scale' in [camera]; there are fov_deg, "
            "scale_arcsec_px, rotation_deg, flipped, kind",
        ),
        (
            '[cameras.main]\nkind = "fine"\n[cameras.guide]\nfov_deg = 400\n',
            "4: fov_deg is 400; give the field's diameter, above 0 to 180°",
        ),
        (
            '[cameras.main]\nkind = "fine"\n[cameras.guide]\nscale = 2\n',
            "4: unknown key 'scale' in [cameras.guide]; there are fov_deg, "
            "scale_arcsec_px, rotation_deg, flipped, kind",
        ),
        ('[cameras.main]\nkind = "fin"\n', "2: kind is 'fin'; did you mean 'fine'?"),
        ("[site]\nlatitude_deg = 2026-10-02\n", "2: latitude_deg is '2026-10-02'; give a number"),
        ("zone = \n", "1:8: not a TOML file: Invalid value; write the value after ="),
        ("floor_altitude_deg = 10\n", "1: unknown key 'floor_altitude_deg'; it belongs under [safety]"),
        (
            "[safety]\noptical = true\nmin_altitude_deg = 15\n",
            "3: unknown key 'min_altitude_deg' in [safety]; it belongs to the top, above the first [ ]",
        ),
        ("fov_deg = 1\n", "1: unknown key 'fov_deg'; it belongs under [camera] or [cameras.NAME]"),
        (
            "[[pier_zones]]\nname = 'pier'\n",
            "1: unknown key 'pier_zones'; it belongs into the file that `profile` in [mount] names",
        ),
        (
            "[mount]\nurl = 'sim'\nwatchdog_s = 2.0\n",
            "3: unknown key 'watchdog_s' in [mount]; it belongs into the file that `profile` in [mount] "
            "names",
        ),
        (
            "[cameras.guide]\nname = 'a'\n",
            "2: unknown key 'name' in [cameras.guide]; there are fov_deg, "
            "scale_arcsec_px, rotation_deg, flipped, kind",
        ),
    ],
)
def test_a_wrong_setting_is_told_with_file_line_table_and_the_nearest_key(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.toml"
    path.write_text(text)
    assert run(["passes", "--config", str(path)]) == 2
    assert capsys.readouterr() == ("", f"sattrack: {path}:{words}\n")


@pytest.mark.parametrize(
    "value", ["52.15 N", "52°09'15\"", "52:09:15", "\N{MINUS SIGN}52.15", "52.15°", "052.15", "52.", "10 deg"]
)
def test_a_number_as_people_write_it_is_refused_with_how_to_write_it(
    value: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.toml"
    path.write_text(f"[site]\nlatitude_deg = {value}\n", encoding="utf-8")
    assert run(["passes", "--config", str(path)]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"sattrack: {path}:2:")
    assert err.endswith("; write one decimal number without a unit, as 52.15 or -4.5\n")


@pytest.mark.parametrize(
    ("encoding", "line"), [("latin-1", 2), ("cp1252", 2), ("utf-16", 1)], ids=["Latin-1", "Windows", "UTF-16"]
)
def test_settings_in_another_encoding_are_refused_with_the_line(
    encoding: str, line: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.toml"
    path.write_bytes("# a\n# Höhe\nzone = 'UTC'\n".encode(encoding))
    assert run(["passes", "--config", str(path)]) == 2
    why = f"line {line} is not UTF-8 text; save the file as UTF-8"
    assert capsys.readouterr() == ("", f"sattrack: {path}: cannot read the settings: {why}\n")


def test_a_folder_that_is_closed_to_the_user_is_told_with_what_to_do(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Root may read and write everywhere: the system's refusal is made here."""

    def exists(path: Path) -> bool:
        if path.suffix == ".html":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return path in Path.cwd().parents

    monkeypatch.setattr(Path, "exists", exists)
    assert run(["report", f"{EXAMPLES}/passes/clean.mcap", "--output", "/closed/x.html"]) in {1, 2}
    advice = "choose another folder, or change who may use this one"
    assert capsys.readouterr() == ("", f"sattrack: /closed/x.html: Permission denied; {advice}\n")


@pytest.mark.parametrize(
    ("line", "target", "says"),
    [
        ("elements = ['no']", "ISS", "2: elements: {folder}/no: cannot read elements: No such file"),
        ("elements = ['celestrak:a b']", "ISS", "2: elements: celestrak:a b: write celestrak:GROUP"),
        ("stars = 'no'", "HIP 5", "2: stars: {folder}/no: cannot read the star catalogue: No such file"),
        (
            "mount = {profile = 'no'}",
            "Moon",
            "2: profile: {folder}/no: cannot read the mount profile: No such",
        ),
    ],
)
def test_a_file_that_the_settings_name_is_missed_with_the_name_of_its_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], line: str, target: str, says: str
) -> None:
    path = tmp_path / "s.toml"
    path.write_text(f"zone = 'UTC'\n{line}\n")
    rehearse = ["rehearse", target, "--site", "52,4,0", "--mount", "sim", "--clock", "2026-10-02T12:50:00Z"]
    assert run([*rehearse, "--config", str(path)]) == 2
    assert capsys.readouterr().err.startswith(f"sattrack: {path}:{says.format(folder=tmp_path)}")


def test_a_start_that_is_past_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    high = ("--min-alt", "80", "--clock", "2026-10-02T13:05:20Z", "--from", "2026-10-01T00:00:00Z")
    assert run(["track", "ISS", *ELEMENTS, "--mount", "sim", "--virtual", *high]) in {0, 1}
    assert "--from 2026-10-01T00:00:00Z is past: the pass in progress now" in capsys.readouterr().err


def test_a_run_that_cannot_be_served_says_how_its_ports_are_chosen(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        practice = ("--mount", "sim", "--headless", "--old-elements", "--serve", f"alpaca:{port}")
        assert run(["track", "ISS", *ELEMENTS, *practice]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.endswith("Address already in use; choose another with --serve alpaca:PORT")


def test_a_schedule_that_is_not_there_is_told_with_a_file_of_its_kind_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("noline2.tle", "night.toml"):
        (tmp_path / name).touch()
    for given, hint in (
        ("nofile.toml", "; check the name and the folder"),
        ("nihgt.toml", "; did you mean 'night.toml'?"),
    ):
        assert run(["run", given]) == 2
        assert capsys.readouterr().err == f"sattrack: {given}: there is no such file{hint}\n"


@pytest.mark.parametrize("name", ["ISSS", "ISS (ZARIA)", "zariya"])
def test_a_satellite_that_is_not_there_is_told_with_the_one_that_was_meant(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["passes", name, *ELEMENTS]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert err.endswith("; did you mean ISS (ZARYA) (25544)?\n")


@pytest.mark.parametrize(
    "closed", ["<&-", pytest.param(">&-", marks=pytest.mark.soak), "<&- >&- 2>&-", ">/dev/full"]
)
def test_a_closed_or_full_stream_is_no_defect(closed: str, tmp_path: Path) -> None:
    command = f"{sys.executable} -m sattrack attach --run 1 {closed}"
    if closed == ">/dev/full":
        command = f"{sys.executable} -m sattrack --help {closed}"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False, timeout=300.0)
    assert done.returncode in {0, 1, 2}
    assert "defect" not in done.stderr
    assert "Traceback" not in done.stderr
    full = "sattrack: standard output: No space left on device; make room there, or write elsewhere\n"
    assert (done.stderr == full) == (closed == ">/dev/full")


@pytest.mark.parametrize(
    ("example", "words"),
    [
        (["follow_celestrak_group.py", "a", "b", "c", "d"], "unrecognized arguments: d"),
        (["alpaca_client.py", "127.0.0.1:1"], "nothing answers at 127.0.0.1:1: is `sattrack serve alpaca"),
        (["alpaca_client.py", "a", "b"], "unrecognized arguments: b"),
    ],
)
def test_an_example_tells_wrong_arguments_and_a_mount_that_is_not_there(
    example: list[str], words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if example[0] == "alpaca_client.py":
        pytest.importorskip("alpaca")
    monkeypatch.setattr(sys, "argv", example)
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(EXAMPLES / example[0]), run_name="__main__")
    assert ended.value.code
    # What a program exits with is printed where it is no number.
    assert words in capsys.readouterr().err + str(ended.value.code)
