"""`sattrack doctor` as a user runs it."""

from __future__ import annotations

import json
import socket
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
from programs import free_port

from sattrack.cli.main import run
from sattrack.mount.model import Status
from sattrack.mount.xerxes.datagrams import encode_status
from tle.formats.tle import checksum

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

LINE_1 = "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992"
LINE_2 = "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318"
THAT_DAY = ("--clock", "2026-10-02T13:00:00Z")
SUBJECTS = ["settings", "site", "elements", "earth", "clock", "priority", "memory", "terminal", "extras"]


@pytest.fixture(autouse=True)
def _nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No settings file but the test's own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "none"))


@pytest.fixture
def elements(tmp_path: Path) -> str:
    path = tmp_path / "sky.tle"
    path.write_text(f"{LINE_1}\n{LINE_2}\n")
    return str(path)


def examined(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, dict[str, Any]]]:
    code = run(["doctor", "--json", *arguments])
    found = json.loads(capsys.readouterr().out)
    assert code == (1 if found["worst"] == "bad" else 0)
    checks = {check["subject"]: check for check in found["checks"]}
    assert list(checks) == [*SUBJECTS, "profile", "link", "disk"]
    return code, checks


@contextmanager
def mount_that_only_sends(listen_port: int) -> Iterator[socket.socket]:
    """A mount's socket that sends statuses to a port, evenly, whatever comes to it."""
    done = threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mount:
        mount.bind(("127.0.0.1", 0))
        mount.setblocking(False)

        def send() -> None:
            counter = 0
            while not done.wait(0.05):
                counter += 1
                status = Status(counter=counter, ra_h=1.0, sidereal_h=2.0)
                mount.sendto(encode_status(status), ("127.0.0.1", listen_port))

        thread = threading.Thread(target=send)
        thread.start()
        try:
            yield mount
        finally:
            done.set()
            thread.join()


def test_a_station_that_is_set_up_is_fine(
    elements: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sattrack.toml").write_text(
        f'elements = ["{elements}"]\n[site]\nlatitude_deg = 52.0\nlongitude_deg = 4.5\n'
    )
    code, checks = examined(capsys, *THAT_DAY)
    assert code == 0
    for subject in ("settings", "site", "elements", "profile", "link", "disk"):
        assert checks[subject]["state"] == "ok", checks[subject]
    assert checks["settings"]["what"] == "sattrack.toml is in force"
    assert "1 object, epoch 2026" in checks["elements"]["what"]


def test_of_several_sets_of_an_object_the_nearest_to_now_is_judged_as_it_is_the_one_used(
    elements: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    later = LINE_1.replace("26275.01380287", "26295.01380287")[:68]
    (tmp_path / "later.tle").write_text(f"{later}{checksum(later)}\n{LINE_2}\n")
    _, checks = examined(capsys, *THAT_DAY, "--elements", elements, "--elements", str(tmp_path / "later.tle"))
    assert "1 object, epoch 2026-10-02T00:19:53Z" in checks["elements"]["what"]
    assert checks["elements"]["state"] == "ok"


def test_wrong_settings_are_a_line_of_their_own_and_the_rest_is_examined_without_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sattrack.toml").write_text("[site]\nlatitude_deg = 52.0\nlongitude_deg = 'x'\n")
    code, checks = examined(capsys)
    assert code == 1
    assert checks["settings"]["state"] == "bad"
    assert checks["settings"]["what"].startswith("sattrack.toml:3: ")
    assert checks["site"]["state"] == "warn"


@pytest.mark.parametrize(
    ("arguments", "subject"),
    [
        (("--elements", "missing.tle"), "elements"),
        (("--site", "91,0,0"), "site"),
        (("--profile", "missing.toml"), "profile"),
        (("--mount", "alpaca://here:1/0"), "link"),
        (("--record-folder", "missing"), "disk"),
        (("--config", "missing.toml"), "settings"),
    ],
)
def test_what_is_wrong_is_bad_and_the_exit_code_says_so(
    arguments: tuple[str, str], subject: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, checks = examined(capsys, *arguments)
    assert code == 1
    assert [name for name, check in checks.items() if check["state"] == "bad"] == [subject]


def test_an_antennas_controller_is_no_error_of_the_settings(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """`track` takes it from there; nothing here can try it, and it needs no profile."""
    (tmp_path / "sattrack.toml").write_text('[mount]\nurl = "antenna://127.0.0.1:7621"\n')
    checks = examined(capsys, *THAT_DAY)[1]
    assert checks["link"]["state"] == checks["profile"]["state"] == "ok"
    assert "is tried by `sattrack track` alone" in checks["link"]["what"]


def test_a_file_is_no_folder_for_recordings(capsys: pytest.CaptureFixture[str], elements: str) -> None:
    disk = examined(capsys, *THAT_DAY, "--record-folder", elements)[1]["disk"]
    assert disk["state"] == "bad"
    assert disk["what"] == f"{elements}: no such folder"


def test_a_mount_is_listened_to_and_nothing_is_sent_to_it(capsys: pytest.CaptureFixture[str]) -> None:
    listen_port = free_port()
    with mount_that_only_sends(listen_port) as mount:
        port = mount.getsockname()[1]
        _, checks = examined(capsys, "--mount", f"xerxes://127.0.0.1:{port}?listen={listen_port}")
        with pytest.raises(BlockingIOError):
            mount.recv(2048)
    assert "a second" in checks["link"]["what"]
    assert "0 lost, 0 late, 0 rejected, 0 from other hosts" in checks["link"]["what"]
    assert checks["link"]["state"] != "bad"
    assert checks["profile"]["state"] == "warn"


def test_people_get_lines_with_what_to_do_below(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["doctor", "--record-folder", "missing"]) == 1
    out = capsys.readouterr().out
    lines = out.splitlines()
    assert lines[0].split() == ["ok", "settings", "no", "sattrack.toml:", *lines[0].split()[4:]]
    assert any(line.startswith("warn  site ") for line in lines)
    bad = next(number for number, line in enumerate(lines) if line.startswith("bad   disk "))
    assert lines[bad + 1].strip() == "→ give another with --record-folder"


@pytest.mark.parametrize(
    ("environ", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)]
)
def test_states_are_coloured_where_that_is_wanted(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    environ: dict[str, str],
    coloured: bool,
) -> None:
    def of_a_terminal(_: object, color: bool | None) -> bool:
        return color is False

    for name, value in {"NO_COLOR": "", "TERM": "xterm", **environ}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("click.utils.should_strip_ansi", of_a_terminal)
    assert run(["doctor"]) == 0
    assert ("\x1b[32mok" in capsys.readouterr().out) is coloured
