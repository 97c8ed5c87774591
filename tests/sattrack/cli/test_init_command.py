"""`sattrack init`, as it is typed: answers, options, wrong ones, and what the commands after it read."""

from __future__ import annotations

import contextlib
import io
import json
import socket
import subprocess
import sys
import threading
import tomllib
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import TYPE_CHECKING
from unittest.mock import Mock

import pytest
from element_server import element_server

from sattrack.cli import init
from sattrack.cli.init import _system_zone, find_cities, place_of
from sattrack.cli.main import run
from sattrack.core.errors import BadInputError
from sattrack.mount.alpaca.client import discover_telescopes
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

ISS = """ISS (ZARYA)
1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992
2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "iss.tle").write_text(ISS)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def typed(answers: str, *options: str) -> subprocess.CompletedProcess[str]:
    """Answer `init` in this process; what it writes goes to the current folder."""
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(io.StringIO()) as out,
        contextlib.redirect_stderr(io.StringIO()) as err,
    ):
        patch.setattr(sys, "stdin", io.StringIO(answers))
        code = run(["init", *options])
    return subprocess.CompletedProcess(options, code, out.getvalue(), err.getvalue())


def test_what_is_typed_is_written_and_the_commands_read_it(folder):
    done = subprocess.run(
        [sys.executable, "-m", "sattrack", "init"],
        cwd=folder,
        input="52.1541,4.4908,6\nEurope/Amsterdam\n\niss.tle\n",
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    settings = tomllib.loads((folder / "sattrack.toml").read_text())
    assert settings["site"] == {"latitude_deg": 52.1541, "longitude_deg": 4.4908, "height_m": 6.0}
    assert settings["mount"]["url"] == "sim"
    assert settings["elements"] == ["iss.tle"]
    assert settings["zone"] == "Europe/Amsterdam"
    assert "The coming 24 hours:" in done.stdout
    assert "ISS (ZARYA)" in done.stdout
    high = ("--clock", "2026-10-02T13:05:20Z", "--min-alt", "75")
    assert run(["track", "ISS", "--virtual", "--json", *high]) == 0


def test_a_wrong_answer_is_asked_again_and_says_what_was_wrong(folder):
    wrong = "Leidn\n91,0,0\nLeiden\nhigh\n3\nxerxes:here\nsim\nnone.tle\niss.tle\n"
    done = typed(wrong)
    assert done.returncode == 0, done.stderr
    for words in (
        "did you mean Leiden, NL?",
        "91",
        "'high' is no height",
        "xerxes:here",
        "none.tle: cannot read",
    ):
        assert words in done.stderr
    settings = tomllib.loads((folder / "sattrack.toml").read_text())
    # GeoNames has the middle of Leiden within a kilometre of the Burcht, 52.1588 N 4.4925 E.
    assert settings["site"]["latitude_deg"] == pytest.approx(52.1588, abs=0.01)
    assert settings["site"]["longitude_deg"] == pytest.approx(4.4925, abs=0.015)
    assert settings["site"]["height_m"] == 3.0
    assert settings["zone"] == "Europe/Amsterdam"
    assert "middle of the city" in done.stderr


def test_an_answer_that_never_comes_writes_nothing(folder):
    done = typed("52,4,0\n")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].endswith("`sattrack init --yes --site LAT,LON,HEIGHT` asks nothing")
    assert not (folder / "sattrack.toml").exists()
    done = typed("0\n", "--city", "Leiden", "--config", "my own.toml")
    again = "`sattrack init --yes --city Leiden --config 'my own.toml'` asks nothing"
    assert done.stderr.splitlines()[-1].endswith(again)


def test_a_search_that_finds_no_telescope_is_answered_at_once_and_asked_again(folder, monkeypatch):
    monkeypatch.setattr(init, "_found_mount", Mock(side_effect=[BadInputError("none answered"), "sim"]))
    answers = iter(["alpaca", "sim"])
    assert init._answered_mount(lambda *_: next(answers), "Mount") == "sim"


def test_elements_too_old_to_track_by_are_told_where_track_would_be_next(folder, capsys):
    words = ("--yes", "--site", "52.1541,4.4908,0", "--elements", "iss.tle", "--mount", "sim")
    assert run(["init", *words]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    renew = "`sattrack elements get 25544 --output new.csv`, then give --elements new.csv"
    assert last.startswith(
        f"Next: fetch new ones: {renew}. `sattrack track` follows with elements of 14 days"
    )


def test_options_alone_ask_nothing_and_json_has_the_passes(folder, capsys):
    words = ("--yes", "--site", "52.1541,4.4908,0", "--elements", "iss.tle", "--zone", "UTC", "--json")
    assert run(["init", *words, "--mount", "sim"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["site"] == [52.1541, 4.4908, 0.0]
    assert document["mount"] == "sim"
    assert all(row["catalog_number"] == 25544 for row in document["passes"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "no site: give --site LAT,LON,HEIGHT or --city NAME"),
        (("--site", "52,4,0", "--city", "Leiden"), "--site and --city: give one"),
        (("--site", "52,4,0", "--height", "3"), "--height goes with --city"),
        (("--city", "Paris, XX"), "there is no Paris in XX, but in "),
        (("--site", "52,4,0", "--zone", "Mars/Olympus"), "'Mars/Olympus' is no time zone"),
        (("--site", "52,4,0", "--mount", "usb"), "--mount usb: write sim"),
        (("--site", "52,4,0", "--elements", "none.tle"), "none.tle: cannot read elements"),
        (("--site", "52,4,0", "--elements", "celestrak:a b c"), "write celestrak:GROUP"),
        (("--site", "52,4,0", "--config", "no/such/file.toml"), "there is no folder"),
    ],
)
def test_bad_options_write_nothing_and_are_answered_in_one_line(folder, capsys, words, said):
    before = sorted(folder.iterdir())
    usual = () if "--elements" in words else ("--elements", "iss.tle")
    assert run(["init", "--yes", *usual, *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert sorted(folder.iterdir()) == before


def test_a_file_that_is_there_is_overwritten_only_with_force(folder, capsys):
    words = ["init", "--yes", "--site", "52,4,0", "--elements", "iss.tle"]
    (folder / "sattrack.toml").write_text("min_altitude_deg = 20\n")
    assert run(words) == 2
    assert "--force" in capsys.readouterr().err
    assert (folder / "sattrack.toml").read_text() == "min_altitude_deg = 20\n"
    assert run([*words, "--force"]) == 0
    assert "[site]" in (folder / "sattrack.toml").read_text()


def test_without_a_network_the_settings_are_written_all_the_same(folder, capsys):
    assert run(["init", "--yes", "--site", "52,4,0"]) == 0
    out, err = capsys.readouterr()
    assert "passes cannot be listed yet" in err
    assert "/NORAD/elements/gp.php?GROUP=stations&FORMAT=csv as a file on another computer" in err
    again = "sattrack init --force --yes --site 52.0,4.0,0.0 --zone "
    assert f"Next: `{again}" in out
    assert "--mount sim --elements FILE`" in out
    assert "rehearse" not in out
    assert tomllib.loads((folder / "sattrack.toml").read_text())["elements"] == ["celestrak:stations"]


def test_a_group_that_celestrak_has_not_is_refused_or_asked_for_again(folder, capsys, monkeypatch):
    with element_server() as server:
        monkeypatch.setenv("SATTRACK_CELESTRAK_URL", server.url)
        # What is fetched here is no other test's.
        monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        words = ["init", "--yes", "--site", "52,4,0", "--elements", "celestrak:nowhere"]
        assert run(words) == 2
        err = capsys.readouterr().err
        assert err.startswith("sattrack: celestrak:nowhere: 127.0.0.1 has none of that name")
        assert err.endswith(
            "give one of its groups, as celestrak:stations, celestrak:visual or "
            "celestrak:active; nothing is written\n"
        )
        assert not (folder / "sattrack.toml").exists()
        done = typed("52,4\n12\nUTC\nsim\ncelestrak:nowhere\ncelestrak:stations\n")
        assert done.returncode == 0, done.stderr
        assert "celestrak:nowhere: 127.0.0.1 has none of that name" in done.stderr
    settings = tomllib.loads((folder / "sattrack.toml").read_text())
    assert settings["elements"] == ["celestrak:stations"]
    assert settings["site"]["height_m"] == 12.0
    assert "the site is at 52.0000° north, 4.0000° east, 12 m above the ellipsoid" in done.stderr


def test_an_antenna_is_a_mount_too(folder, capsys):
    words = ["init", "--yes", "--site", "52,4,0", "--elements", "iss.tle"]
    assert run([*words, "--mount", "antenna://127.0.0.1:1"]) == 0
    assert "driven by `sattrack track`" in capsys.readouterr().err
    assert run(["doctor"]) in {0, 1}


def test_a_command_without_settings_names_init(folder, capsys):
    assert run(["passes"]) == 2
    assert "run `sattrack init`" in capsys.readouterr().err
    assert run(["passes", "--elements", "iss.tle"]) == 2
    assert "run `sattrack init`" in capsys.readouterr().err


def test_the_largest_city_of_a_name_is_meant_unless_a_country_is_named():
    assert [one.country for one in find_cities("Birmingham")] == ["GB"]
    assert [one.country for one in find_cities("birmingham, us")] == ["US"]
    assert find_cities("SAO PAULO")[0].zone == "America/Sao_Paulo"
    with pytest.raises(BadInputError, match="list of cities"):
        find_cities("Xyzzyville")


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("Wien", "Vienna"),
        ("praha", "Prague"),
        ("GOTEBORG", "Gothenburg"),
        ("New York", "New York City"),
        ("Frankfurt", "Frankfurt am Main"),
        ("Bombay", "Mumbai"),
        ("Lucerne, CH", "Luzern"),
    ],
)
def test_a_city_is_known_by_what_it_is_called_elsewhere(typed, meant):
    assert [one.name for one in find_cities(typed)] == [meant]


@pytest.mark.parametrize(
    ("tz", "zone"),
    [
        (None, "Europe/Amsterdam"),
        ("", "Europe/Amsterdam"),
        (":/etc/localtime", "Europe/Amsterdam"),
        (":Asia/Tokyo", "Asia/Tokyo"),
        ("Asia/Tokyo", "Asia/Tokyo"),
        ("/usr/share/zoneinfo/Asia/Tokyo", "Asia/Tokyo"),
        ("CET-1CEST,M3.5.0,M10.5.0/3", "UTC"),
    ],
)
def test_the_systems_time_zone_is_taken_however_tz_names_it(monkeypatch, tz, zone):
    links = {"/etc/localtime": "/usr/share/zoneinfo/Europe/Amsterdam"}
    monkeypatch.setattr("sattrack.cli.init.os.path.realpath", lambda path: links.get(path, path))
    monkeypatch.delenv("TZ", raising=False)
    if tz is not None:
        monkeypatch.setenv("TZ", tz)
    assert _system_zone() == zone


@pytest.mark.parametrize("typed", ["", " ", ",", ", FR"])
def test_an_empty_name_is_no_city(typed):
    with pytest.raises(BadInputError, match="is no city: give its name"):
        find_cities(typed)


def test_of_a_city_that_is_not_known_what_is_meant_is_told_with_its_country():
    with pytest.raises(BadInputError, match="did you mean Newcastle, AU or Newcastle"):
        find_cities("Newcastl")
    with pytest.raises(BadInputError, match="did you mean Leiden, NL"):
        find_cities("Leidn")


def test_a_city_that_has_a_number_in_its_name_is_no_site():
    city, site = place_of("6th of October City, EG")
    assert city is not None
    assert (city.country, site) == ("EG", None)
    assert place_of("52.15,4.49,6") == (None, Site(52.15, 4.49, 6.0))


def test_of_cities_of_one_name_and_size_the_place_is_named_or_asked_for(folder, capsys):
    assert run(["init", "--yes", "--city", "Springfield", "--elements", "iss.tle"]) == 0
    err = capsys.readouterr().err
    assert "Springfield, US, America/Chicago: 37.22° north, 93.30° west; 4 more are called so: --site" in err
    done = typed("Springfield\n9\n2\n0\nsim\niss.tle\n", "--force")
    assert done.returncode == 0, done.stderr
    assert "give a number from 1 to 5" in done.stderr
    settings = tomllib.loads((folder / "sattrack.toml").read_text())
    assert settings["site"]["longitude_deg"] == -72.59
    assert settings["zone"] == "America/New_York"


class Answers(BaseHTTPRequestHandler):
    """Answers as an Alpaca server of two devices does, one of them a telescope."""

    def do_GET(self) -> None:
        """Answer anything with the list of devices."""
        body = (
            b'{"Value": [{"DeviceName": "Dome", "DeviceType": "Dome", "DeviceNumber": 0, "UniqueID": "a"}, '
            b'{"DeviceName": "Mount", "DeviceType": "Telescope", "DeviceNumber": 2, "UniqueID": "b"}], '
            b'"ErrorNumber": 0, "ErrorMessage": ""}'
        )
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@contextmanager
def discoverable(*answers: bytes) -> Iterator[int]:
    """Answer each discovery question on a UDP port of loopback with all of some datagrams."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as door:
        door.bind(("127.0.0.1", 0))

        def serve() -> None:
            question, sender = door.recvfrom(1024)
            if question == b"alpacadiscovery1":
                for answer in answers:
                    door.sendto(answer, sender)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield door.getsockname()[1]


def test_discovery_finds_the_telescopes_and_bears_nonsense():
    server = HTTPServer(("127.0.0.1", 0), Answers)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        port = server.server_address[1]
        wrong = (
            b"\x00\xff",
            b"[]",
            b'{"AlpacaPort": "x"}',
            b'{"AlpacaPort": -1}',
            b'{"AlpacaPort": 70000000}',
        )
        answers = (*wrong, b'{"AlpacaPort": %d}' % port)
        with discoverable(*answers) as door:
            (found,) = discover_telescopes(within_s=0.5, port=door)
    finally:
        server.shutdown()
        server.server_close()
    assert found == ("Mount", f"alpaca://127.0.0.1:{port}/2")
