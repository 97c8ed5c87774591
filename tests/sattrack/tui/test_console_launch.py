"""The console's screen and its process: how they part, whatever ends first."""

from __future__ import annotations

import os
import signal
import sys
from typing import TYPE_CHECKING

import msgspec
import pytest
from console_tui_builders import VIEW
from test_terminal import Terminal, on_terminal

from sattrack.core.errors import SattrackError
from sattrack.mount.requests import Abort
from sattrack.tui.feeds import ConsoleProcess
from sattrack.tui.launch import watch_with_tui
from sattrack.views.messages import Jog

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.tui.feeds import ConsoleFeed

VIEW_LINE = msgspec.json.encode(VIEW).decode()
OBEDIENT = """
say(VIEW)
for line in sys.stdin:
    tell('got ' + line.strip())
"""


@pytest.fixture
def console_command(tmp_path: Path):
    """Return what makes a command of a few lines of Python that stand in for a console."""

    def make(body: str) -> list[str]:
        script = tmp_path / "console.py"
        script.write_text(
            "import sys, os, signal\n"
            "def say(text): print(text, flush=True)\n"
            "def tell(text): print(text, file=sys.stderr, flush=True)\n"
            f"VIEW = {VIEW_LINE!r}\n{body}"
        )
        return [sys.executable, str(script)]

    return make


def no_screen(feed: ConsoleFeed) -> bool:
    """Stand in for a screen that is left at once."""
    return False


def test_a_console_that_dies_at_once_shows_no_screen_and_hands_on_its_words(
    console_command, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = []
    command = console_command("tell('sattrack: no site'); sys.exit(2)")
    assert watch_with_tui(command, show=lambda feed: bool(shown.append(feed))) == 2
    assert shown == []
    assert capsys.readouterr() == ("", "sattrack: no site\n")


def test_orders_arrive_in_order_and_leaving_is_the_last(
    console_command, capsys: pytest.CaptureFixture[str]
) -> None:
    def show(feed: ConsoleFeed) -> bool:
        assert feed.latest().view == VIEW
        assert feed.latest().view is None, "a view is news once"
        assert feed.tell(Jog(dec_rate_deg_s=0.1))
        assert feed.tell(Abort())
        return False

    assert watch_with_tui(console_command(OBEDIENT), show=show) == 0
    assert capsys.readouterr().err.splitlines() == [
        'got {"type":"jog","ra_rate_deg_s":null,"dec_rate_deg_s":0.1}',
        'got {"type":"abort"}',
        'got {"type":"leave"}',
    ]


@pytest.mark.parametrize("failure", [RuntimeError("drawing"), SattrackError("the screen broke")])
def test_a_broken_screen_makes_the_console_leave(
    console_command, capsys: pytest.CaptureFixture[str], failure: Exception
) -> None:
    def show(feed: ConsoleFeed) -> bool:
        raise failure

    with pytest.raises(type(failure)):
        watch_with_tui(console_command(OBEDIENT), show=show)
    assert '"leave"' in capsys.readouterr().err


def test_an_interrupted_screen_ends_with_130_after_the_console_has_left(
    console_command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert watch_with_tui(console_command(OBEDIENT), show=lambda feed: True) == 130
    assert '"leave"' in capsys.readouterr().err


def test_what_the_console_could_not_do_outweighs_an_interrupt(console_command) -> None:
    assert watch_with_tui(console_command(OBEDIENT + "sys.exit(1)"), show=lambda feed: True) == 1


def test_a_console_that_hangs_is_ended_in_bounded_time(
    console_command, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sattrack.tui.launch.GRACE_S", 0.2)
    body = "signal.signal(signal.SIGTERM, signal.SIG_IGN)\nsay(VIEW)\nwhile True: signal.pause()"
    assert watch_with_tui(console_command(body), show=no_screen, patience_s=0.2) == 1
    assert "STOP THE MOUNT BY HAND" in capsys.readouterr().err


def test_an_abort_that_finds_no_room_is_said_by_the_channels_end(console_command, tmp_path: Path) -> None:
    gate = tmp_path / "gate"
    os.mkfifo(gate)
    body = f"say(VIEW)\nopen({str(gate)!r}).read()\nsys.stdin.read()\ntell('end seen')"
    console = ConsoleProcess(console_command(body))
    console.wait_first_view()
    while console.tell(Abort()):
        pass
    gate.write_text("go on")
    assert console.wait(30.0) == 0
    assert console.close() == "end seen\n"


@pytest.fixture
def watched():
    with on_terminal("mount", "watch", "--mount", "sim") as terminal:
        yield terminal


def test_a_terminal_that_goes_away_during_a_jog_stops_the_mount(watched: Terminal) -> None:
    watched.wait_for(b"TRACKING", b"SPACE STOP")
    watched.type(b"5\x1b[D ")
    watched.wait_for(b"AT REST")
    watched.type(b"\x1b[A")
    watched.wait_for(b"JOGGING")
    watched.process.send_signal(signal.SIGHUP)
    code, drawn = watched.finish()
    assert code == 0
    assert "the mount was stopped and seen at rest" in drawn
