"""The view_server as a process: whoever looks on, slowly, loudly or not at all, never holds up the feeder."""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import threading
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import msgspec
import pytest

from sattrack.control.engine_view import view_of
from sattrack.runtime import demo_pass, mounts
from sattrack.runtime import view_server as view_server_module
from sattrack.runtime.control_arbiter import ControlArbiter, Observers, SessionInbox
from sattrack.runtime.facts import RunRequest, prepare
from sattrack.runtime.view_server import (
    MOST_CLIENTS,
    REMEMBERED_S,
    SUPPORTED,
    RunViews,
    ViewServer,
    ViewServerLink,
    ViewServerTask,
    feeders,
    name_for,
)
from sattrack.tui.attached import PictureLook
from sattrack.views.messages import StopNow
from sattrack.views.picture import MOST_PICTURE_BYTES, MOST_SIDE, PICTURES_A_SECOND
from sattrack.views.run import TrackView

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.skipif(not SUPPORTED, reason="abstract names are Linux's")
PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def facts():
    request = RunRequest(
        satellite=demo_pass.NAME,
        mount_url="sim",
        elements=None,
        site=None,
        clock_option=demo_pass.BEFORE_PASS,
        min_alt_deg=10.0,
    )
    return prepare(request).facts


@pytest.fixture(scope="module")
def view(facts) -> TrackView:
    from sattrack.runtime.facts import build_engine

    return view_of(build_engine(facts), facts.started_utc_s)


@pytest.fixture
def view_server(facts) -> Iterator[ViewServerLink]:
    made = ViewServerLink(facts)
    yield made
    made.close()


class Seen:
    """A visitor to whom everything is said at once."""

    def __init__(self) -> None:
        self.number = 1
        self.out = bytearray()
        self.channel = self
        self.ended = False

    def send(self, lines: bytes) -> None:
        self.out += lines


class Visitor:
    """Somebody at the view server, with patience."""

    def __init__(self) -> None:
        self.door = socket.socket(socket.AF_UNIX)
        self.door.settimeout(PATIENCE_S)
        self.door.connect(name_for(os.getpid()))
        self._lines = self.door.makefile("rb")

    def say(self, *messages: dict[str, Any]) -> None:
        self.door.sendall(b"".join(json.dumps(each).encode() + b"\n" for each in messages))

    def next(self, kind: str) -> dict[str, Any]:
        for line in self._lines:
            told: dict[str, Any] = json.loads(line)
            if told.get("type") == kind or kind in told:
                return told
        raise AssertionError(f"no {kind} came before the end")

    def close(self) -> None:
        self._lines.close()
        self.door.close()


@contextlib.contextmanager
def visitors(count: int = 1) -> Iterator[list[Visitor]]:
    found = [Visitor() for _ in range(count)]
    yield found
    for each in found:
        each.close()


def heard_until(inbox: SessionInbox, done) -> list[Any]:
    """Let the inbox turn as the loop does, until something is so."""
    until_s = time.monotonic() + PATIENCE_S
    obeyed: list[Any] = []
    while not done(obeyed):
        assert time.monotonic() < until_s
        obeyed += inbox.messages()
        select.select([], [], [], 0.002)
    return obeyed


def test_whoever_comes_is_welcomed_with_what_was_shown_and_sees_what_is_shown(
    view_server: ViewServerLink, view: TrackView
) -> None:
    view_server.show(view)
    with visitors(2) as (first, second):
        for number, each in enumerate((first, second), start=1):
            welcome = each.next("welcome")
            assert welcome["you"] == number
            assert welcome["pid"] == os.getpid()
            assert each.next("elements")["elements"]["catalog_number"] == 25544
            assert each.next("view")["utc_s"] == view.utc_s
        view_server.show(msgspec.structs.replace(view, utc_s=view.utc_s + 1.0))
        while (shown := first.next("view"))["utc_s"] != view.utc_s + 1.0:
            assert shown["utc_s"] == view.utc_s
    assert os.getpid() in feeders()


def test_who_comes_late_learns_when_each_phase_and_warning_began(view: TrackView) -> None:
    clock = iter(float(second) for second in range(100_000))
    task = ViewServerTask(0, 0, 1, "sattrack track", "2026-03-01T00:00:00Z", "sim", "ISS")
    ends = socket.socketpair()
    with ends[0] as feeder, ends[1] as door, pytest.MonkeyPatch.context() as patch:
        patch.setattr("sattrack.runtime.view_server.time.monotonic", lambda: next(clock))
        view_server = ViewServer(task, feeder, door)
        for second in range(1000):
            seen = msgspec.structs.replace(
                view,
                utc_s=float(second),
                phase="tracking" if second >= 300 else "slewing",
                warnings=(f"the mount is {second}\u2033 off",) if 100 <= second < 200 else (),
            )
            view_server._remember(msgspec.json.encode(seen) + b"\n")
        visitor = Seen()
        view_server._welcome(visitor)  # type: ignore[arg-type]
    utc_s = [told["utc_s"] for told in map(json.loads, visitor.out.splitlines()) if "phase" in told]
    older = [each for each in utc_s if each < 1000.0 - REMEMBERED_S - 1.0]
    assert older == [0.0, 100.0, 200.0, 300.0]
    assert utc_s == sorted(utc_s)


def test_one_who_does_not_read_costs_nobody_anything(view_server: ViewServerLink, view: TrackView) -> None:
    with visitors(2) as (silent, reading):
        reading.next("welcome")
        longest_s = 0.0
        for number in range(600):
            shown = msgspec.structs.replace(view, utc_s=float(number))
            begun_s = time.monotonic()
            view_server.show(shown)
            longest_s = max(longest_s, time.monotonic() - begun_s)
            if number % 20 == 0:
                while reading.next("view")["utc_s"] < number:
                    pass
        assert longest_s < 2.0, "it waited for one who does not read"
        # A stop of one who has read nothing for so long is heard all the same.
        inbox = SessionInbox(ControlArbiter(True), None, view_server)
        silent.say({"type": "stop"})
        assert heard_until(inbox, bool) == [StopNow()]


def test_a_flood_of_words_is_bounded_and_a_stop_of_another_comes_through(view_server: ViewServerLink) -> None:
    arbiter = ControlArbiter(False)
    inbox = SessionInbox(arbiter, None, view_server)
    with visitors(2) as (loud, quiet):
        loud.say({"type": "take_control"})
        heard_until(inbox, lambda _: arbiter.controller is not None)
        loud.door.setblocking(False)
        nudge, sent = json.dumps({"type": "nudge", "along_s": 0.1}).encode() + b"\n", 0
        until_s = time.monotonic() + 0.5
        most = 0
        while time.monotonic() < until_s:
            with contextlib.suppress(BlockingIOError):
                sent += loud.door.send(nudge * 50)
            most = max(most, len(inbox.messages()))
        assert sent > 100 * len(nudge)
        assert most <= 20
        quiet.say({"type": "stop"})
        obeyed = heard_until(inbox, lambda heard: StopNow() in heard)
    assert len(obeyed) < 100


@pytest.mark.parametrize(
    "rubbish", [b"\xff\xfe\n", b"{}\n", b"[]\n", b'{"type":"fire"}\n', b"[" * 3000 + b"\n", b"\n" * 50]
)
def test_rubbish_moves_nothing_and_its_sender_is_still_heard(
    view_server: ViewServerLink, rubbish: bytes
) -> None:
    inbox = SessionInbox(ControlArbiter(True), None, view_server)
    with visitors(1) as (one,):
        one.door.sendall(rubbish)
        one.say({"type": "stop"})
        assert heard_until(inbox, bool) == [StopNow()]


def test_a_line_without_end_sends_its_writer_away(view_server: ViewServerLink, view: TrackView) -> None:
    with visitors(2) as (endless, other):
        endless.next("welcome")
        with contextlib.suppress(OSError):
            endless.door.sendall(b"x" * 100_000)
        with contextlib.suppress(OSError):
            while endless.door.recv(65536):
                pass
        view_server.show(view)
        other.next("view")


def test_there_is_room_for_so_many_and_the_next_is_told(view_server: ViewServerLink) -> None:
    arbiter = ControlArbiter(True)
    inbox = SessionInbox(arbiter, None, view_server)
    with visitors(MOST_CLIENTS) as crowd:
        heard_until(inbox, lambda _: arbiter.view().watching == MOST_CLIENTS)
        with visitors(1) as (late,):
            assert "no more room" in late.next("farewell")["why"]
        crowd[0].close()
        heard_until(inbox, lambda _: arbiter.view().watching == MOST_CLIENTS - 1)


def test_a_server_that_dies_takes_nothing_with_it(view_server: ViewServerLink, view: TrackView) -> None:
    inbox = SessionInbox(ControlArbiter(True), None, view_server)
    view_server.show(view)
    view_server._process.kill()
    view_server._process.wait()

    for _ in range(3):
        view_server.show(view)
        assert inbox.messages() == []
        assert not view_server.tell(ControlArbiter(True).view())


def test_it_ends_with_its_feeder_when_all_is_told(view_server: ViewServerLink, view: TrackView) -> None:
    with visitors(1) as (one,):
        view_server.show(view)
        one.next("view")
        view_server.close()
        assert one.door.recv(1) == b""
    assert view_server._process.poll() == 0


def test_an_observation_needs_no_control_and_waits_until_there_is_time(view_server: ViewServerLink) -> None:
    observers = Observers()
    arbiter = ControlArbiter(True)
    inbox = SessionInbox(arbiter, None, view_server, observers)
    offset = {"type": "offset", "utc": "2026-10-02T13:05:24.5Z", "dx_px": 3.0, "dy_px": -1.0, "sigma_px": 0.2}
    with visitors(1) as (camera,):
        camera.say({"type": "nudge", "along_s": 1.0})
        camera.say(offset)
        camera.say({"type": "stop"})
        # The nudge is of one without control; the stop comes first, and tells that all was read before long.
        assert heard_until(inbox, bool) == [StopNow()]
        seen = []
        heard_until(inbox, lambda _: seen.extend(observers.observations()) or bool(seen))
    assert [(one.dx_px, one.dy_px) for one in seen] == [(3.0, -1.0)]
    assert arbiter.controller == 0, "the starter is in control as before"


PICTURE = {
    "type": "picture",
    "camera": "guide",
    "utc": "2026-10-02T13:05:24Z",
    "exposure_s": 0.1,
    "width": 640,
    "height": 480,
    "columns": 2,
    "rows": 1,
    "pixels": "AP8=",
    "kind": "none",
}


@pytest.mark.parametrize("ended_by", [None, "operator"])
def test_a_stop_in_a_later_pass_goes_by_the_guardian_where_that_does_not_show(
    view_server: ViewServerLink, facts, view: TrackView, monkeypatch: pytest.MonkeyPatch, ended_by: str | None
) -> None:
    """The first pass of a run ends by itself; the second one hangs, or obeys."""
    asked = threading.Event()
    monkeypatch.setattr(view_server_module, "STOP_WITHIN_S", 0.5 if ended_by is None else 2.0)
    monkeypatch.setattr(mounts, "owners", lambda: [SimpleNamespace(pid=os.getpid())])
    monkeypatch.setattr(mounts, "ask_stop", lambda owner, waiting: asked.set())
    views = RunViews(os.getpid(), "a client")

    def sees(*wanted: str | None) -> None:
        until_s, seen = time.monotonic() + PATIENCE_S, list(wanted)
        while seen and time.monotonic() < until_s:
            views.look()
            select.select(views.readers(), [], [], 0.05)
            for one in views.news():
                if isinstance(one, TrackView) and seen and one.ended_by == seen[0]:
                    seen.pop(0)
        assert seen == []

    view_server.show(view)
    view_server.show(msgspec.structs.replace(view, ended_by="set"))
    sees(None, "set")
    view_server.begin(facts)
    view_server.show(view)
    sees(None)
    views.stop()
    if ended_by is not None:
        view_server.show(msgspec.structs.replace(view, ended_by=ended_by))
        sees(ended_by)
    assert asked.wait(PATIENCE_S if ended_by is None else 3.0) is (ended_by is None)


def test_pictures_go_to_those_who_ask_and_cameras_are_told_how_large(view_server) -> None:
    inbox = SessionInbox(ControlArbiter(False), None, view_server)
    with visitors(4) as (camera, onlooker, small, large):
        camera.say({"type": "hello", "name": "camera", "shows": True})
        assert camera.next("pictures_wanted") == {"type": "pictures_wanted", "side": 0}
        onlooker.say({"type": "hello", "name": "somebody"})
        small.say({"type": "hello", "name": "", "pictures": 100})
        assert camera.next("pictures_wanted")["side"] == 100
        large.say({"type": "hello", "name": "", "pictures": 9999})
        assert camera.next("pictures_wanted")["side"] == MOST_SIDE
        heard_until(inbox, lambda _: inbox._arbiter.view().watching == 2)
        assert sorted(one.name for one in inbox._arbiter.view().watchers) == ["camera", "somebody"]
        # Who did not say that it is a camera has no pictures to show.
        onlooker.say({**PICTURE, "camera": "false"})
        camera.say(PICTURE)
        assert small.next("picture") == large.next("picture") == PICTURE
        large.close()
        assert camera.next("pictures_wanted")["side"] == 100
        small.close()
        assert camera.next("pictures_wanted")["side"] == 0
        heard_until(inbox, lambda _: inbox._arbiter.view().watching == 2)
        view_server.show(msgspec.convert({"type": "view"}, dict))
        assert onlooker.next("view") == {"type": "view"}


def test_a_flood_of_pictures_reaches_nobody_and_one_that_is_too_large_ends_its_camera(view_server) -> None:
    with visitors(2) as (camera, screen):
        camera.say({"type": "hello", "name": "camera", "shows": True})
        screen.say({"type": "hello", "name": "", "pictures": 100})
        while camera.next("pictures_wanted")["side"] == 0:
            pass
        camera.say(*({**PICTURE, "snr": n} for n in range(200)))
        camera.say({**PICTURE, "pixels": "A" * MOST_PICTURE_BYTES})
        assert camera._lines.read() is not None
        screen.door.settimeout(0.5)
        found = []
        with contextlib.suppress(TimeoutError):
            while True:
                found.append(screen.next("picture")["snr"])
        assert found[0] == 0
        assert len(found) <= 2 * PICTURES_A_SECOND


def test_a_screen_gets_the_pictures_of_a_run_and_leaves_no_trace(view_server) -> None:
    look = PictureLook()
    with visitors() as (camera,):
        camera.say({"type": "hello", "name": "camera", "shows": True})
        look.open(os.getpid())
        while camera.next("pictures_wanted")["side"] == 0:
            pass
        camera.say({**PICTURE, "pixels": "AAAA"}, PICTURE)
        until_s = time.monotonic() + PATIENCE_S
        while not (found := look.take()):
            assert time.monotonic() < until_s
            select.select([], [], [], 0.01)
        assert found["guide"].pixels == b"\x00\xff"
        look.close()
        assert camera.next("pictures_wanted")["side"] == 0
