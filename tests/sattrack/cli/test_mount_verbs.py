"""The mount verbs as a user meets them: refusals before a socket, one-line errors, exit codes, real runs."""

from __future__ import annotations

import json
import re
import signal
import socket
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from programs import SITE, ended, free_port, sattrack, simulated_mount

from sattrack.cli.main import run
from sattrack.cli.mount import failure
from sattrack.control.procedures import Outcome, RequestRefused
from sattrack.mount.requests import TicketState

NOWHERE = "xerxes://127.0.0.1:9?listen=15999"


@pytest.fixture
def no_sockets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no link be opened, and no settings be found."""

    def refuse(*_: object) -> None:
        raise AssertionError("a link was opened")

    monkeypatch.setattr("sattrack.runtime.mounts.UdpLink", refuse)
    monkeypatch.setattr("sattrack.runtime.connection.start_embedded", refuse)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("slew", "24h", "10"), "right ascension '24h': it runs from 0h to below 24h"),
        (("slew", "24:00", "10"), "right ascension '24:00': it runs from 0h to below 24h"),
        (("slew", "-0.1", "10"), "right ascension '−0.1': it runs from 0 to below 360 degrees (24h)"),
        (("slew", "--json", "-5h30m", "1"), "right ascension '−5h30m': it runs from 0h to below 24h"),
        (("slew", "nan", "10"), "right ascension 'nan': write 5h30m, 5:30:00, 5.5h or degrees as 82.5"),
        (("sync", "5h", "91"), "declination '91': it runs from -90 to 90 degrees"),
        (("sync", "5h", "-90.5"), "declination '−90.5': it runs from -90 to 90 degrees"),
        (
            ("move", "--ra-rate", "inf", "--seconds", "1"),
            "rate in right ascension is inf °/s; the mount profile's limit is 6 °/s; nothing was sent",
        ),
        (
            ("move", "--dec-rate", "-6.5", "--seconds", "1"),
            "rate in declination is -6.5 °/s; the mount profile's limit is 6 °/s; nothing was sent",
        ),
        (
            ("move", "--seconds", "1"),
            "no axis to move: give a rate in right ascension, in declination, or both; nothing was sent",
        ),
        (
            ("move", "--ra-rate", "1", "--seconds", "nan"),
            "--seconds nan: give seconds, above 0 and 600 at most",
        ),
        (
            ("move", "--ra-rate", "1", "--seconds", "-1"),
            "--seconds -1: give seconds, above 0 and 600 at most",
        ),
        (
            ("pulse", "--ra", "2147483648"),
            "pulse in right ascension is 2147483648 ms; it must be a whole number of 32 bits; "
            "nothing was sent",
        ),
        (
            ("pulse", "--dec", "-2147483649"),
            "pulse in declination is -2147483649 ms; it must be a whole number of 32 bits; nothing was sent",
        ),
        (("pulse",), "a pulse of 0 ms on both axes guides nothing; nothing was sent"),
        (
            ("fine-rate", "--ra", "1"),
            "fine rate in right ascension is 1 °/s; at most 0.1 °/s; nothing was sent",
        ),
        (
            ("park",),
            "the mount profile has no park position, and parking cuts the drives' power: add `park` to it; "
            "nothing was sent",
        ),
        (("home", "--timeout", "0"), "--timeout 0: give seconds, above 0"),
        (("home", "--timeout", "inf"), "--timeout inf: give seconds, above 0"),
        (
            ("abort", "--clock", "2026-03-01T00:00:00Z"),
            "--clock is for simulated mounts only; a real mount follows the real sky",
        ),
        (("watch", "--control"), "--control needs --stream"),
        (
            ("watch", "--park", "--stream"),
            "--park needs the screen; `sattrack mount park` parks without one",
        ),
        (
            ("watch",),
            "watch needs a terminal; `sattrack mount status` shows one status, --stream is for programs",
        ),
    ],
)
def test_bad_input_is_refused_in_a_line_before_any_socket_is_opened(
    arguments: tuple[str, ...], words: str, no_sockets: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["mount", *arguments, "--mount", NOWHERE, *SITE]) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ("", f"sattrack: {words}\n")


BOTH_ENDS = "both ends would be {}; give another port with ?listen=PORT"
NO_MOUNT = "{} is the address of no mount; write that of its computer"


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("xerxes://127.0.0.1:15001?listen=15001", BOTH_ENDS.format("127.0.0.1:15001")),
        ("xerxes://localhost", BOTH_ENDS.format("127.0.0.1:15001")),
        ("xerxes://127.0.0.2:7?listen=7", BOTH_ENDS.format("127.0.0.2:7")),
        ("xerxes://0.0.0.0", NO_MOUNT.format("0.0.0.0")),
        ("xerxes://239.1.1.1", NO_MOUNT.format("239.1.1.1")),
        ("xerxes://255.255.255.255", NO_MOUNT.format("255.255.255.255")),
        ("xerxes://127.0.0.1:70000", "Port out of range 0-65535; write xerxes://HOST:PORT?listen=PORT"),
    ],
)
def test_an_address_that_is_no_mounts(
    url: str, words: str, no_sockets: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["mount", "abort", "--mount", url]) == 2
    assert capsys.readouterr().err == f"sattrack: --mount {url}: {words}\n"


def test_no_site_and_no_mount_are_told(no_sockets: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["mount", "slew", "5h", "10", "--mount", NOWHERE]) == 2
    assert capsys.readouterr().err == (
        "sattrack: no site: give --site LAT,LON,HEIGHT, or run `sattrack init`; "
        f"there is no sattrack.toml in {Path.cwd()}\n"
    )
    assert run(["mount", "status"]) == 2
    assert "no mount: give --mount" in capsys.readouterr().err


def test_help_imports_no_verb(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["mount", "--help"]) == 0
    out = capsys.readouterr().out
    for verb in (
        "status", "slew", "sync", "abort", "park", "home", "pulse", "move", "fine-rate", "watch", "calibrate",
    ):  # fmt: skip
        assert f"\n  {verb} " in out


@pytest.mark.parametrize(
    "verb",
    ["status", "slew", "sync", "abort", "park", "home", "pulse", "move", "fine-rate", "watch", "calibrate"],
)
def test_every_verb_has_help_and_the_options_that_it_uses(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["mount", verb, "--help"]) == 0
    out = capsys.readouterr().out
    for option in ("--mount", "--config", "--site", "--clock", "--debug"):
        assert option in out
    assert ("--json" in out) is (verb != "watch")


def test_a_mount_that_is_not_heard_ends_with_4_and_says_what_to_check(
    capsys: pytest.CaptureFixture[str],
) -> None:
    port, listen = free_port(), free_port()
    url = f"xerxes://127.0.0.1:{port}?listen={listen}"
    assert run(["mount", "status", "--mount", url, "--timeout", "0.3"]) == 4
    assert capsys.readouterr().err == (
        f"sattrack: no status from xerxes://127.0.0.1:{port} within 0.3 s; "
        f"nothing listens for UDP on 127.0.0.1:{port}\n"
    )
    assert run(["mount", "status", "--mount", url, "--timeout", "0.1", "--json"]) == 4
    told = document(capsys.readouterr().out)
    assert (told["state"], told["ended_by"], told["status"]) == ("failed", "link", None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as deaf:
        deaf.bind(("127.0.0.1", port))
        assert run(["mount", "status", "--mount", url, "--timeout", "0.1"]) == 4
    err = capsys.readouterr().err
    assert f"that 127.0.0.1:{port} is its address and UDP port" in err
    assert f"sends to this machine's address, port {listen}" in err


def test_what_comes_in_place_of_a_status_is_counted(capsys: pytest.CaptureFixture[str]) -> None:
    port, listen = free_port(), free_port()
    ended = threading.Event()

    def talk() -> None:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mount,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
        ):
            stranger.bind(("127.0.0.3", 0))
            while not ended.wait(0.02):
                mount.sendto(b"XERXESxx and no more", ("127.0.0.1", listen))
                stranger.sendto(b"x" * 160, ("127.0.0.1", listen))

    talker = threading.Thread(target=talk)
    talker.start()
    try:
        url = f"xerxes://127.0.0.1:{port}?listen={listen}"
        assert run(["mount", "status", "--mount", url, "--timeout", "2"]) == 4
    finally:
        ended.set()
        talker.join()
    err = capsys.readouterr().err
    assert re.search(r"\([1-9]\d* datagrams came that are no status, ", err)
    assert re.search(r"[1-9]\d* came from other hosts: 127\.0\.0\.3\)", err)


SENT = Outcome(TicketState.COMPLETE, True)
UNSURE = Outcome(TicketState.UNCONFIRMED, False, "no acknowledgement")
LATE = Outcome(TicketState.TIMED_OUT, False, "the mount did not acknowledge it")
LOW = Outcome(TicketState.FAILED, False, "too low", RequestRefused("too low", by_safety=True))
BUSY = Outcome(TicketState.FAILED, False, "it slews", RequestRefused("it slews"))
AT_REST, UNSEEN = "; the mount was stopped and seen at rest", "; THE MOUNT DID NOT CONFIRM THE STOP"
NOTHING = "; nothing was asked of the mount"


@pytest.mark.parametrize(
    ("ended_by", "outcome", "begun", "stopped", "code", "words"),
    [
        ("done", SENT, True, None, 0, ""),
        ("done", UNSURE, True, None, 0, ""),
        ("done", LATE, True, True, 1, f"park: the mount did not acknowledge it{AT_REST}"),
        ("done", LOW, True, True, 3, f"park: too low{AT_REST}"),
        ("refused", LOW, False, None, 3, f"park: too low{NOTHING}"),
        ("refused", BUSY, False, None, 1, f"park: it slews{NOTHING}"),
        ("limit:altitude", LOW, True, True, 3, f"park: too low{AT_REST}"),
        ("link", LATE, True, False, 4, f"park: the mount did not acknowledge it{UNSEEN}"),
        ("link", LATE, False, None, 4, f"park: the mount did not acknowledge it{NOTHING}"),
        ("operator", LATE, True, True, 130, f"park: the mount did not acknowledge it{AT_REST}"),
        ("operator", LATE, True, False, 130, f"park: the mount did not acknowledge it{UNSEEN}"),
        ("timeout", LATE, True, True, 1, f"park: the mount did not acknowledge it{AT_REST}"),
        ("restart", LATE, True, True, 1, f"park: the mount did not acknowledge it{AT_REST}"),
        ("error", LATE, True, True, 1, f"park: the mount did not acknowledge it{AT_REST}"),
    ],
)
def test_every_end_has_its_exit_code_and_says_whether_the_mount_rests(
    ended_by: str, outcome: Outcome, begun: bool, stopped: bool | None, code: int, words: str
) -> None:
    operation = SimpleNamespace(ended_by=ended_by, begun=begun, mount_stopped=stopped)
    error = failure(operation, outcome, "park", None)
    if code == 0:
        assert error is None
        return
    assert error is not None
    assert error.exit_code == code
    assert str(error).startswith(words)


def test_a_port_that_is_taken_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        assert run(["mount", "abort", "--mount", f"xerxes://127.0.0.1:9?listen={port}"]) == 1
    assert f"UDP port {port} is not available" in capsys.readouterr().err


def document(text: str) -> dict[str, Any]:
    read: dict[str, Any] = json.loads(text)
    return read


@pytest.mark.usefixtures("radio_dish")
def test_verbs_over_real_udp_one_after_the_other(capsys: pytest.CaptureFixture[str]) -> None:
    with simulated_mount() as mount:
        common = ("--mount", mount.url, *SITE)
        assert run(["mount", "status", *common, "--json"]) == 0
        view = document(capsys.readouterr().out)
        assert (view["request"], view["state"], view["reason"]) == ({"type": "status"}, "complete", None)
        assert view["status"]["ra_rate_dtics_s"] in (7788, 7789, 7790)
        assert view["readings"]["counter"] == "int64"
        assert view["link"]["state"] == "up"

        ra_deg = (view["status"]["ra_h"] * 15.0 + 5.0) % 360.0
        assert run(["mount", "slew", f"{ra_deg:.6f}", "-1:30", *common, "--json"]) == 0
        told = document(capsys.readouterr().out)
        assert told["request"] == {"type": "slew", "ra_deg": pytest.approx(ra_deg, abs=1e-5), "dec_deg": -1.5}
        assert (told["state"], told["acknowledged"], told["reason"]) == ("complete", True, None)
        assert told["status"]["dec_deg"] == pytest.approx(-1.5, abs=1e-3)

        assert run(["mount", "move", "--dec-rate", "1", "--seconds", "0.3", *common]) == 0
        out = capsys.readouterr().out
        assert out.startswith("move Dec +1 °/s for 0.3 s: complete, acknowledged\nRA ")
        assert "at rest or tracking" in out

        below_deg = (view["status"]["sidereal_h"] * 15.0 - 180.0) % 360.0
        assert run(["mount", "slew", f"{below_deg:.3f}", "0", *common]) == 3
        err = capsys.readouterr().err
        assert "altitude; the limit is 0°; nothing was asked of the mount\n" in err

        assert run(["mount", "abort", *common, "--json"]) == 0
        told = document(capsys.readouterr().out)
        assert (told["state"], told["mount_stopped"], told["ended_by"]) == ("complete", True, "done")
        assert told["status"]["ra_rate_dtics_s"] == pytest.approx(0, abs=100)
        mount.wait_until_moving(False)


@pytest.mark.usefixtures("radio_dish")
def test_signals_bring_the_mount_to_rest_and_end_with_130() -> None:
    with simulated_mount() as mount:
        arguments = ("move", "--ra-rate", "2", "--seconds", "60", "--mount", mount.url, *SITE, "--json")
        with ended(sattrack("mount", *arguments)) as process:
            mount.wait_until_moving(True)
            for number in (signal.SIGINT, signal.SIGINT, signal.SIGTERM):
                process.send_signal(number)
            out, err = process.communicate(timeout=30.0)
        assert process.returncode == 130
        told = document(out)
        assert (told["ended_by"], told["mount_stopped"]) == ("operator", True)
        assert "interrupted; the mount was stopped and seen at rest" in err
        mount.wait_until_moving(False)


@pytest.mark.usefixtures("radio_dish")
def test_a_console_whose_operator_is_gone_stops_the_jog() -> None:
    with simulated_mount() as mount:
        arguments = ("watch", "--stream", "--control", "--mount", mount.url, *SITE)
        with ended(sattrack("mount", *arguments)) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            for line in process.stdout:
                if json.loads(line)["link"]["state"] == "up":
                    break
            process.stdin.write('{"type":"jog","dec_rate_deg_s":1.0}\nno order\n')
            process.stdin.flush()
            mount.wait_until_moving(True)
            process.stdin.close()
            process.stdout.read()
            assert process.wait(30.0) == 0
            assert process.stderr is not None
            err = process.stderr.read()
        assert "the mount was stopped and seen at rest" in err
        assert "1 control lines were not valid orders" in err
        mount.wait_until_moving(False)
