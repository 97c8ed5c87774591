from __future__ import annotations

import json
import os
import signal
import sys
from typing import TYPE_CHECKING

import msgspec
import pytest
from tui_builders import SKY, SUMMARY, VIEW

from sattrack.core.errors import SattrackError
from sattrack.runtime.mounts import Owner
from sattrack.tui import feeds
from sattrack.tui.feeds import ConsoleProcess, FeederProcess, HelperOptions, MountLook
from sattrack.tui.launch import _leaving, fly_with_tui
from sattrack.views.messages import ClearBias, Nudge, StopNow

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.tui.feeds import Feed

VIEW_LINE = msgspec.json.encode(VIEW).decode()
SUMMARY_LINE = json.dumps({"summary": msgspec.to_builtins(SUMMARY)})
PATIENCE_S = 60.0
PREAMBLE = """\
import sys, os, signal
def say(text): print(text, flush=True)
def tell(text): print(text, file=sys.stderr, flush=True)
"""


@pytest.fixture
def feeder_command(tmp_path: Path):
    """Return what makes a command of a few lines of Python that stand in for a feeder."""

    def make(body: str) -> list[str]:
        script = tmp_path / "feeder.py"
        script.write_text(f"{PREAMBLE}VIEW = {VIEW_LINE!r}\nSUMMARY = {SUMMARY_LINE!r}\n{body}")
        return [sys.executable, str(script)]

    return make


OBEDIENT = """
say(VIEW)
for line in sys.stdin:
    tell('got ' + line.strip())
say(SUMMARY)
"""


def no_screen(feed: Feed) -> bool:
    """Stand in for a screen that is left at once."""
    return False


def test_a_feeder_that_dies_at_once_shows_no_screen(
    feeder_command, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = []
    command = feeder_command("tell('sattrack: no site: give --site'); sys.exit(2)")

    assert fly_with_tui(command, show=lambda feed: bool(shown.append(feed))) == 2
    assert shown == []
    assert capsys.readouterr() == ("", "sattrack: no site: give --site\n")


def test_leaving_stops_the_mount_and_tells_the_summary(
    feeder_command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fly_with_tui(feeder_command(OBEDIENT), show=no_screen) == 0
    out, err = capsys.readouterr()
    assert 'got {"type":"stop"}' in err
    assert out.startswith("ISS (ZARYA) (25544) with sim: ended by set\n")
    assert "reported error 0.020″ RMS, 0.300″ peak" in out
    assert "bias +0.100 s along, +0.0000° across" in out


def test_messages_arrive_in_order_and_the_exit_code_is_the_feeders(
    feeder_command, capsys: pytest.CaptureFixture[str]
) -> None:
    def show(feed: Feed) -> bool:
        assert feed.news().views == (VIEW,)
        for message in (Nudge(along_s=0.1), ClearBias()):
            assert feed.send(message)
        return False

    assert fly_with_tui(feeder_command(OBEDIENT + "sys.exit(4)"), show=show) == 4
    told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("got")]
    assert told == [
        'got {"type":"nudge","along_s":0.1,"cross_deg":0.0}',
        'got {"type":"clear_bias"}',
        'got {"type":"stop"}',
    ]


@pytest.mark.parametrize("failure", [RuntimeError("drawing"), SattrackError("the screen broke")])
def test_a_broken_screen_stops_the_mount(
    feeder_command, capsys: pytest.CaptureFixture[str], failure: Exception
) -> None:
    def show(feed: Feed) -> bool:
        raise failure

    with pytest.raises(type(failure)):
        fly_with_tui(feeder_command(OBEDIENT), show=show)
    assert '"stop"' in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_the_screen_as_its_key_does_and_is_nothing_that_a_screen_may_swallow(
    number: signal.Signals,
) -> None:
    before = signal.getsignal(number)
    asked = []
    with _leaving(lambda: asked.append(number)):
        signal.raise_signal(number)
    assert asked == [number]
    assert signal.getsignal(number) == before


def test_an_interrupt_while_the_feeder_starts_ends_it(
    feeder_command, capsys: pytest.CaptureFixture[str]
) -> None:
    def show(feed: Feed) -> bool:
        raise KeyboardInterrupt

    assert fly_with_tui(feeder_command(OBEDIENT), show=show) == 130
    assert '"stop"' in capsys.readouterr().err


@pytest.mark.parametrize(
    "hang",
    [
        "signal.pause()",
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\nsay(VIEW)\nwhile True: signal.pause()",
    ],
)
def test_a_feeder_that_hangs_is_ended_in_bounded_time(
    feeder_command, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, hang: str
) -> None:
    monkeypatch.setattr("sattrack.tui.launch.GRACE_S", 0.2)

    assert fly_with_tui(feeder_command(f"say(VIEW)\n{hang}"), show=no_screen, patience_s=0.2) == 1
    err = capsys.readouterr().err
    assert "stopping the mount" in err
    assert "STOP THE MOUNT BY HAND" in err
    assert "ended without a summary" in err


def test_a_feeder_killed_by_a_signal_has_its_shell_code(
    feeder_command, capsys: pytest.CaptureFixture[str]
) -> None:
    code = fly_with_tui(feeder_command("say(VIEW)\nos.kill(os.getpid(), signal.SIGKILL)"), show=no_screen)

    assert code == 137
    assert "ended without a summary" in capsys.readouterr().err


def test_lines_that_are_not_known_are_passed_over(feeder_command) -> None:
    feeder = FeederProcess(feeder_command("say('{}')\nsay('no json')\nsay(VIEW)\nsay(SUMMARY)"))
    assert feeder.wait_first_view()
    assert feeder.wait(30.0) == 0
    feeder.close()

    news = feeder.news()
    assert (news.views, news.ended, news.summary) == ((VIEW,), True, SUMMARY)


def test_what_is_told_of_the_pass_stays_known_and_is_no_view(feeder_command) -> None:
    line = msgspec.json.encode(SKY).decode()
    feeder = FeederProcess(feeder_command(f"say({line!r})\nsay(VIEW)\nsys.stdin.read()"))
    assert feeder.wait_first_view()
    first, second = feeder.news(), feeder.news()
    feeder.close_input()
    assert feeder.wait(30.0) == 0
    feeder.close()

    assert (first.views, first.sky) == ((VIEW,), SKY)
    assert (second.views, second.sky) == ((), SKY)


def test_a_stop_to_a_feeder_that_is_gone_does_no_harm(feeder_command) -> None:
    feeder = FeederProcess(feeder_command(""))
    assert not feeder.wait_first_view()
    assert feeder.wait(30.0) == 0

    assert not feeder.send(StopNow())
    assert not feeder.send(Nudge(along_s=1.0))
    feeder.close()


def test_a_feeder_that_reads_nothing_does_not_hold_the_screen_and_sees_the_end(
    feeder_command, tmp_path: Path
) -> None:
    gate = tmp_path / "gate"
    os.mkfifo(gate)
    feeder = FeederProcess(feeder_command(f"say(VIEW)\nopen({str(gate)!r}).read()\nsys.stdin.read()"))
    feeder.wait_first_view()
    while feeder.send(Nudge(along_s=0.1)):
        pass
    assert not feeder.send(StopNow()), "there is no room for it: the channel's end says it instead"
    gate.write_text("go on")

    assert feeder.wait(30.0) == 0
    feeder.close()


def test_a_ctrl_c_on_the_terminal_does_not_reach_the_feeder(feeder_command) -> None:
    feeder = FeederProcess(feeder_command(OBEDIENT))
    feeder.wait_first_view()
    assert os.getsid(feeder._process.pid) != os.getsid(0)
    feeder.close_input()
    assert feeder.wait(30.0) == 0
    feeder.close()


def test_a_look_at_the_mount_that_ends_at_once_says_why_and_waits(
    feeder_command, monkeypatch: pytest.MonkeyPatch
) -> None:
    me = Owner(os.getpid(), 0, "sattrack track", "", "127.0.0.1:5000", 5001)
    monkeypatch.setattr(feeds, "owners", lambda: [me])
    command = feeder_command(
        "tell('a note\\n' * 2000); tell('sattrack: no such profile: other.toml'); sys.exit(2)"
    )
    begun: list[ConsoleProcess] = []

    def start(_: list[str]) -> ConsoleProcess:
        begun.append(ConsoleProcess(command))
        return begun[-1]

    look = MountLook(HelperOptions(None, ()), start)
    for count in (1, 2):
        look.open(me.pid)
        assert look._thread is not None
        look._thread.join()
        assert begun[-1].wait(PATIENCE_S) == 2
        begun[-1]._reader.join(PATIENCE_S)
        assert not look.latest().ended
        assert look.trouble == "sattrack: no such profile: other.toml"
        look.open(me.pid)
        assert len(begun) == count
        monkeypatch.setattr(feeds, "LOOK_AGAIN_S", -1.0)
        assert look.latest().ended
        monkeypatch.setattr(feeds, "LOOK_AGAIN_S", 10.0)
        look.close()
