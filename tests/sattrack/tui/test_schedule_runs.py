"""One who looks on at a schedule's run is led over to its next one, or told that none comes."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

import msgspec
import pytest
from test_other_screens import HERE, on_screen, schedule_view, text_of
from tui_builders import SUMMARY, changed

from sattrack.runtime.view_server import SUPPORTED, name_for, started_by
from sattrack.schedule.night_folder import STATUS
from sattrack.schedule.night_stop import locked
from sattrack.tui.attached import AttachedRun
from sattrack.tui.feeds import News
from sattrack.views.messages import StopNow
from sattrack.views.run import SummaryLine, Welcome

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from textual.pilot import Pilot

    from sattrack.tui.app import TrackApp
    from sattrack.views.schedule import ScheduleView

pytestmark = pytest.mark.skipif(not SUPPORTED, reason="abstract names are Linux's")
WAIT = [sys.executable, "-c", "import sys; sys.stdin.read()"]


@contextmanager
def shown_run() -> Iterator[tuple[int, socket.socket]]:
    """Run a process that has a gallery's door, as far as anybody can see who comes to look."""
    with subprocess.Popen(WAIT, stdin=subprocess.PIPE) as process, socket.socket(socket.AF_UNIX) as door:
        door.bind(name_for(process.pid))
        door.listen()
        yield process.pid, door
        process.kill()


def shows(door: socket.socket, pid: int, *told: object) -> socket.socket:
    """Let in whoever comes, and tell."""
    visitor, _ = door.accept()
    assert b"hello" in visitor.recv(4096)
    for one in (Welcome(7, pid, "track", "2026-10-02T13:00:00Z", "sim", "ISS"), *told):
        visitor.sendall(msgspec.json.encode(one) + b"\n")
    return visitor


def written(folder: Path, view: ScheduleView) -> str:
    (folder / STATUS).write_bytes(msgspec.json.encode(view))
    return str(folder / "recordings" / "a.mcap")


def looked_at(pid: int, door: socket.socket, *told: object) -> tuple[AttachedRun, socket.socket]:
    """Look at a run that is shown; return that, and the other end."""
    found: list[socket.socket] = []
    server = threading.Thread(target=lambda: found.append(shows(door, pid, *told)))
    server.start()
    run = AttachedRun(pid, "anna")
    server.join()
    return run, found[0]


def test_the_next_run_of_a_schedule_is_seen_after_the_last_with_its_own_number(tmp_path: Path) -> None:
    with locked(tmp_path), shown_run() as (first, first_door), shown_run() as (second, second_door):
        assert started_by(first) == os.getpid()
        view = changed(recording=written(tmp_path, schedule_view()))
        run, visitor = looked_at(first, first_door, view, SummaryLine(SUMMARY))
        first_door.close()
        visitor.close()
        visitor = shows(second_door, second, changed(view, name="NEXT"))
        with run._changed:
            assert run._changed.wait_for(lambda: run._rewound and run._views, 30.0)
        news = run.news()
        assert (news.rewound, news.run, news.between, news.ended) == (True, second, False, False)
        assert [view.name for view in news.views] == ["NEXT"]
        assert run.summary is None
        run.close()
        visitor.close()


@pytest.mark.parametrize("state", ["ended", "stopped"])
def test_after_the_last_run_of_a_schedule_nothing_is_waited_for(tmp_path: Path, state: str) -> None:
    with shown_run() as (pid, door):
        view = changed(recording=written(tmp_path, schedule_view(state=state)))
        run, visitor = looked_at(pid, door, view, SummaryLine(SUMMARY))
        door.close()
        visitor.close()
        with run._changed:
            assert run._changed.wait_for(lambda: run._ended, 30.0)
        assert not run.news().between
        assert not run.send(StopNow())
        run.close()


def test_between_two_runs_it_is_said_what_comes_and_a_stop_is_said_and_shown() -> None:
    view = changed(recording="/night.run/recordings/a.mcap")

    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        app._screens._read = lambda _: schedule_view(state="waiting", doing="waiting for 201, SAT 201")
        app._feed.news = lambda: News(summary=SUMMARY, between=True)  # type: ignore[method-assign]
        app.look()
        await pilot.pause()
        assert "ENDED  the pass is over; waiting for 201, SAT 201, in 25:00" in text_of(app)
        await pilot.press("right", "p", "space")
        await pilot.pause()
        assert "STOP SENT  until the mount is at rest and the schedule has ended" in text_of(app)
        app._feed.news = lambda: News((view,), rewound=True)  # type: ignore[method-assign]
        app.look()
        await pilot.pause()
        assert "TRACKING" in text_of(app)

    feed = on_screen(act, News((view,), session=HERE))
    assert feed.sent == [StopNow()]
