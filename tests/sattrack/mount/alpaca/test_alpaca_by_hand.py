"""An Alpaca telescope whose answers are written out by hand, as the ASCOM Alpaca API has them."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest

from sattrack.cli.main import run
from sattrack.cli.mount import _telescope
from sattrack.mount.alpaca.device import DeviceFacts

if TYPE_CHECKING:
    from collections.abc import Iterator

VALUES = {
    "connected": "true",
    "interfaceversion": "3",
    "name": '"Hand-made"',
    "canmoveaxis": "true",
    "axisrates": '[{"Maximum":3.0,"Minimum":0.0}]',
    "equatorialsystem": "1",
    "doesrefraction": "false",
    "sitelatitude": "52.0",
    "sitelongitude": "4.5",
    "siteelevation": "0.0",
    "cansettracking": "true",
    "canslewasync": "true",
    "cansync": "false",
    "canpulseguide": "false",
    "rightascension": "5.5",
    "declination": "20.0",
    "slewing": "false",
    "tracking": "true",
    "atpark": "false",
    "athome": "false",
    "sideofpier": "0",
}
ABSENT = (
    '{"ClientTransactionID":1,"ServerTransactionID":1,"ErrorNumber":1024,"ErrorMessage":"Not implemented"}'
)


@contextmanager
def telescope(**more: str) -> Iterator[tuple[str, list[str]]]:
    """Serve it; give its address, and what it was told."""
    values, told = {**VALUES, **more}, []

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            value = values.get(urlsplit(self.path).path.rpartition("/")[2])
            known = (
                f'{{"Value":{value},"ClientTransactionID":1,"ServerTransactionID":1,'
                '"ErrorNumber":0,"ErrorMessage":""}'
            )
            self.say(ABSENT if value is None else known)

        def do_PUT(self) -> None:
            told.append(self.path.rpartition("/")[2])
            self.rfile.read(int(self.headers["Content-Length"]))
            self.say('{"ClientTransactionID":1,"ServerTransactionID":1,"ErrorNumber":0,"ErrorMessage":""}')

        def say(self, body: str) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body.encode())

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    serving = threading.Thread(target=server.serve_forever, daemon=True)
    serving.start()
    try:
        yield f"alpaca://127.0.0.1:{server.server_port}/0", told
    finally:
        server.shutdown()
        server.server_close()
        serving.join()


COMMANDS = (
    ("mount", "status"),
    ("mount", "slew", "5h", "30", "--site", "52,4.5,0"),
    ("mount", "calibrate", "--yes", "--site", "52,4.5,0", "--out", "never.toml"),
    ("track", "25544", "--headless", "--site", "52,4.5,0"),
    ("serve", "rotctld", "--port", "0", "--site", "52,4.5,0"),
    *(
        pytest.param(command, marks=pytest.mark.soak)
        for command in (
            ("serve", "antenna", "--port", "0", "--site", "52,4.5,0"),
            ("serve", "alpaca", "--port", "0", "--no-discovery", "--site", "52,4.5,0"),
        )
    ),
)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: " ".join(command[:2]))
def test_an_alt_azimuth_telescope_is_refused_in_a_line(
    command: tuple[str, ...], capsys: pytest.CaptureFixture[str], elements: str
) -> None:
    more = ("--elements", elements, "--old-elements") if command[0] == "track" else ()
    # Its name commands no terminal.
    with telescope(alignmentmode="0", name='"Hand\\u001b[2J\\u009b1m\\u202emade"') as (url, told):
        assert run([*command, "--mount", url, *more]) == 1
    *_, last = capsys.readouterr().err.splitlines()
    name = "Hand?[2J?1m?made"
    assert last.startswith(f"sattrack: {url}: {name} is an alt-azimuth telescope (AlignmentMode 0)")
    assert told == []


@pytest.mark.parametrize("command", [("stop",), ("mount", "abort")], ids=lambda command: command[-1])
def test_a_stop_is_refused_no_telescope(command: tuple[str, ...]) -> None:
    # Its right ascension stands still, as that of a telescope does that follows the sky.
    with telescope(alignmentmode="0") as (url, told):
        assert run([*command, "--mount", url]) == 0
    assert "abortslew" in told
    assert "moveaxis" in told


@pytest.fixture
def elements(tmp_path_factory: pytest.TempPathFactory) -> str:
    from sattrack.runtime import demo_pass

    path = tmp_path_factory.mktemp("elements") / "iss.tle"
    path.write_text(f"{demo_pass.NAME}\n{demo_pass.LINE_1}\n{demo_pass.LINE_2}\n")
    return str(path)


@pytest.mark.parametrize(
    ("alignment", "told"),
    [
        ({"alignmentmode": "2"}, "alignment     German"),
        ({}, "alignment     not reported, taken as equatorial"),
        pytest.param(
            {"alignmentmode": '"what"'},
            "alignment     not reported, taken as equatorial",
            marks=pytest.mark.soak,
        ),
    ],
)
def test_status_tells_what_an_alpaca_telescope_has(
    alignment: dict[str, str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with telescope(**alignment) as (url, orders):
        assert run(["mount", "status", "--mount", url]) == 0
    text = capsys.readouterr().out
    assert told in text
    for words in ("RA            05h 30m 00.0s", "Dec           +20° 00′ 00″", "turns HA at   0 to 3 °/s"):
        assert words in text
    for xerxes in ("tics", "acknowledged", "UTC bytes", "current", "read as", "strangers", "counter"):
        assert xerxes not in text
    assert orders == []


def test_status_names_each_alignment_of_the_standard() -> None:
    told = [
        {line.name: line.value for line in _telescope(DeviceFacts(alignment_mode=mode)).lines}["alignment"]
        for mode in (1, 2, None)
    ]
    assert told == ["polar", "German", "not reported, taken as equatorial"]
