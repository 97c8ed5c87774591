"""`sattrack attach`, as typed, beside a run that was started elsewhere."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from programs import ended, sattrack

from sattrack.cli.main import run as run_command
from sattrack.recording.format import COMMAND, OPERATOR, Recording
from sattrack.runtime.view_server import SUPPORTED
from sattrack.tui.attached import AttachedRun
from sattrack.tui.launch import sky_of_run
from sattrack.views.messages import LeaveRunning, Nudge, StopNow, TakeControl, encode_message

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sattrack.tui.feeds import News

ABORT = 73
"""Where a command has its flag to stop, by the protocol's table."""
pytestmark = pytest.mark.skipif(not SUPPORTED, reason="abstract names are Linux's")


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def seen(run: AttachedRun, so: Callable[[News], bool]) -> News:
    """Look until something is so."""
    while True:
        with run._changed:
            found = run._changed.wait_for(lambda: run._views or run._ended or run._session, 60.0)
        assert found
        news = run.news()
        if so(news):
            return news
        assert not news.ended, "the run ended before"
        with run._changed:
            run._changed.wait(1.0)


def test_a_run_started_elsewhere_is_seen_moved_by_whoever_took_control_and_stopped(tmp_path: Path) -> None:
    record = tmp_path / "run.mcap"
    with ended(sattrack("demo", "--headless", "--json", "--record", str(record))) as demo:
        assert demo.stderr is not None
        assert "link up" in next(line for line in demo.stderr if "link up" in line)
        run, other = (AttachedRun(demo.pid, name, sky_of_run) for name in ("anna", "ben"))
        watching = subprocess.Popen(
            [sys.executable, "-m", "sattrack", "attach", "--json", "--run", str(demo.pid)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert run.wait_first_view()
        first = seen(run, lambda news: news.sky is not None and news.session is not None)
        assert first.sky is not None
        assert first.sky.rises
        assert first.session is not None
        assert first.session.controller is None
        other.send(Nudge(along_s=5.0))
        run.send(TakeControl())
        taken = seen(run, lambda news: news.session is not None and news.session.controller is not None)
        assert taken.session is not None
        assert taken.session.name_of(taken.session.controller) == "anna"
        run.send(Nudge(along_s=0.25))
        moved = seen(run, lambda n: any(view.bias_along_goal_s for view in n.views))
        assert moved.views[-1].bias_along_goal_s == 0.25, "what ben said, without control, did nothing"
        assert watching.stdout is not None
        assert watching.stdout.readline().startswith('{"type":"session"')
        said_utc_s = moved.views[-1].utc_s
        other.send(StopNow())
        out, _ = demo.communicate(timeout=60)
        streamed = watching.stdout.read().splitlines()
        assert watching.wait(60) == 0
        watching.stdout.close()
    summary = json.loads(out)["summary"]
    assert summary["ended_by"] == "operator"
    assert summary["mount_stopped"] is True
    assert json.loads(streamed[-1])["summary"]["ended_by"] == "operator"
    assert {json.loads(line)["type"] for line in streamed[:-1]} == {"view", "session"}
    assert seen(run, lambda news: news.summary is not None).summary is not None
    run.close()
    other.close()
    after = datagrams_after(record, '"type":"stop"', said_utc_s)
    assert 0xFF in {datagram[ABORT] for datagram in after[:2]}, "a stop takes effect within two datagrams"


def datagrams_after(record: Path, words: str, from_utc_s: float) -> list[bytes]:
    """Return the datagrams that were sent after somebody's words, as they were recorded."""
    entries = [entry for entry in Recording(record).entries() if entry.utc_s >= from_utc_s]
    said = next(
        n for n, entry in enumerate(entries) if entry.topic == OPERATOR and words.encode() in entry.data
    )
    return [entry.data for entry in entries[said:] if entry.topic == COMMAND]


def test_a_run_left_running_goes_on_without_whoever_started_it() -> None:
    with ended(sattrack("demo", "--stream", "--control", "--scene")) as demo:
        assert demo.stdout is not None
        assert demo.stdin is not None
        next(line for line in demo.stdout if '"phase":"slewing"' in line)
        demo.stdin.write(encode_message(LeaveRunning()).decode())
        demo.stdin.flush()
        said = next(line for line in demo.stdout if '"left_running":true' in line)
        assert json.loads(said)["controller"] is None
        demo.stdin.close()
        demo.stdout.close()
        run = AttachedRun(demo.pid, "anna")
        begun = seen(run, lambda news: bool(news.views)).views[-1].utc_s
        seen(run, lambda news: bool(news.views) and news.views[-1].utc_s > begun + 1.0)
        assert demo.poll() is None
        run.send(StopNow())
        assert seen(run, lambda news: news.summary is not None).summary is not None
        demo.wait(60)
        run.close()


def test_without_a_run_and_without_a_terminal_it_says_so_in_a_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for arguments, code, words in (
        (["--run", str(os.getpid()), "--json"], 1, "has no run to watch"),
        (["--run", str(os.getpid())], 2, "attach needs a terminal; --json is for programs"),
    ):
        assert run_command(["attach", *arguments]) == code
        out, err = capsys.readouterr()
        assert out == ""
        assert words in err
        assert err.count("\n") == 1
