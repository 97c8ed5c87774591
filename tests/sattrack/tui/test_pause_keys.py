"""The keys that pause a pass, jog the mount meanwhile, and park it: what they say, and what they answer."""

from __future__ import annotations

import asyncio
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec
import pytest
from console_tui_builders import VIEW as MOUNT_VIEW
from test_other_screens import FakeHelpers, on_screen, text_of
from tui_builders import SKY, SUMMARY, UTC_S, VIEW, FakeFeed, HandClock, changed

from sattrack.mount.requests import Park
from sattrack.tui.app import TrackApp
from sattrack.tui.console_app import ConsoleApp
from sattrack.tui.feeds import Latest, News
from sattrack.tui.pages import LogBook
from sattrack.tui.run_keys import RestState
from sattrack.tui.scene import STEPS, Scene, headline
from sattrack.views.formatting import clock
from sattrack.views.messages import Go, Jog, Nudge, Pause, StopNow
from sattrack.views.run import STARTER, PauseView, SessionView, Watcher

if TYPE_CHECKING:
    from collections.abc import Iterator

    from textual.pilot import Pilot

    from sattrack.views.messages import ConsoleMessage, Message
    from sattrack.views.run import TrackView

HERE = SessionView(STARTER, (), 0, takes_others=True)
ELSEWHERE = SessionView(3, (Watcher(3, "anna"),), 1)
RESTING = changed(phase="paused", pause=PauseView(UTC_S - 5.0, at_rest=True, jogging=False))
WAITING = changed(phase="waiting", start_utc_s=UTC_S + 60.0)
STOPPING = changed(phase="stopping", ended_by="set")
PARKS = msgspec.structs.replace(SKY, can_park=True)
OVER = News(
    (changed(phase="stopping", ended_by="operator"),),
    summary=msgspec.structs.replace(SUMMARY, ended_by="operator"),
)
COMMAND = ["sattrack", "mount", "watch"]

CASES: list[tuple[TrackView, SessionView, tuple[str, ...], list[Message]]] = [
    (VIEW, HERE, ("2", "p"), [Pause()]),
    (WAITING, HERE, ("p",), [Pause()]),
    (VIEW, HERE, ("enter",), []),
    (VIEW, ELSEWHERE, ("p", "P", "3", "j", "up"), []),
    (STOPPING, HERE, ("p", "enter"), []),
    (RESTING, HERE, ("p",), [Go()]),
    (RESTING, ELSEWHERE, ("p", "enter", "3", "up"), []),
    (RESTING, HERE, ("3", "up", "down", "right", "space"), [
        Jog(dec_rate_deg_s=0.02), Jog(dec_rate_deg_s=-0.02), Jog(ra_rate_deg_s=-0.02), StopNow()]),
    (RESTING, HERE, ("3", "left"), [Jog(ra_rate_deg_s=0.02)]),
    (RESTING, HERE, ("3", "right_square_bracket", "up"), [Jog(dec_rate_deg_s=0.1)]),
    (RESTING, HERE, ("3", *5 * ("right_square_bracket",), "up"), [Jog(dec_rate_deg_s=4.0)]),
    (RESTING, HERE, ("3", "left_square_bracket", "up", "1", "right"), [
        Jog(dec_rate_deg_s=pytest.approx(0.00188, rel=0.01)), Nudge(along_s=0.1)]),
    (RESTING, HERE, ("3", "j", "enter"), [Go()]),
    (VIEW, HERE, ("3", "up", "j"), []),
    (VIEW, HERE, ("P", "x"), []),
    (VIEW, HERE, ("P", "y"), [StopNow()]),
    (WAITING, HERE, ("3", "P", "y"), [StopNow()]),
    (VIEW, HERE, ("P", "space"), [StopNow()]),
]  # fmt: skip


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """A terminal that can be given to another program; which were, with their arguments."""
    given: list[list[str]] = []

    @contextmanager
    def suspend(_: TrackApp) -> Iterator[None]:
        yield

    def run(command: list[str], **_: Any) -> None:
        given.append(command)

    monkeypatch.setattr("textual.drivers.headless_driver.HeadlessDriver.can_suspend", True)
    monkeypatch.setattr(TrackApp, "suspend", suspend)
    monkeypatch.setattr("sattrack.tui.run_keys.subprocess.run", run)
    return given


@pytest.mark.usefixtures("terminal")
def test_each_key_says_what_it_means() -> None:
    async def run() -> None:
        feed = FakeFeed()
        app = TrackApp(feed, monotonic=HandClock(), helpers=FakeHelpers(console=COMMAND))  # type: ignore[arg-type]
        async with app.run_test(size=(80, 24)) as pilot:
            for view, session, keys, messages in CASES:
                app._close_dialogs()
                app._rest, app._stop_sent_s, app._refused_s = RestState(), None, None
                feed.coming.append(News((view,), session=session, sky=PARKS))
                app.look()
                app.action_page("live")
                feed.sent.clear()
                await pilot.press(*keys)
                assert feed.sent == messages, (view.phase, session.controller, keys)

    asyncio.run(run())


HEADLINES = (
    (RESTING, "the mount is at rest; the pass lasts 4:17 more; p goes on"),
    (
        changed(RESTING, pause=PauseView(UTC_S, False, False)),
        "bringing the mount to rest; the pass lasts 4:17",
    ),
    (
        changed(RESTING, pause=PauseView(UTC_S, False, True)),
        "the mount is jogged; the pass lasts 4:17 more",
    ),
    (
        changed(RESTING, pause=PauseView(UTC_S, at_rest=False, jogging=False, going_on=True)),
        "going on as soon as the mount is at rest; the pass lasts 4:17 more",
    ),
    (
        changed(RESTING, start_utc_s=UTC_S + 75.0),
        "the mount is at rest; the pass begins in 1:15; p goes on",
    ),
)


def test_while_a_pass_is_waited_for_the_headline_says_what_limits_will_take_of_it() -> None:
    taken = msgspec.structs.replace(PARKS, lost_s=98.2, lost_to="hour_angle", lost_from_utc_s=UTC_S + 90.0)

    async def act(app: TrackApp, _: Pilot[None]) -> None:
        for view, told in ((WAITING, True), (changed(WAITING, phase="slewing"), True), (VIEW, False)):
            for sky in (taken, PARKS):
                app._feed.coming.append(News((view,), session=HERE, sky=sky))  # type: ignore[attr-defined]
                app.look()
                assert app.scene is not None
                words = f"; about 98 s lost from {clock(UTC_S + 90.0)} on: hour angle"
                assert (words in headline(app.scene).rest) is (told and sky is taken)

    on_screen(act)


def test_what_limits_will_take_is_said_by_the_names_of_the_mount_s_axes() -> None:
    taken = msgspec.structs.replace(
        PARKS, lost_s=98.2, lost_to="hour_angle", lost_from_utc_s=UTC_S + 90.0, mount_pole_deg=(90.0, 0.0)
    )
    scene = Scene(WAITING, STEPS[0], sky=taken)

    assert headline(scene).rest.endswith(": first axis")


def test_the_headline_says_what_the_mount_does_and_how_long_the_pass_still_is() -> None:
    async def act(app: TrackApp, _: Pilot[None]) -> None:
        for view, words in HEADLINES:
            app._feed.coming.append(News((view,), session=HERE))  # type: ignore[attr-defined]
            app.look()
            scene = app.scene
            assert scene is not None
            assert headline(scene).word == "PAUSED"
            assert headline(scene).rest.startswith(words)
            assert "p goes on" not in headline(replace(scene, session=ELSEWHERE)).rest

    on_screen(act)


def test_the_log_has_a_line_for_a_pause_and_for_who_asked() -> None:
    book = LogBook()
    book.take(VIEW)
    book.hear(msgspec.structs.replace(HERE, said="paused from where it was started"))
    book.take(RESTING)

    assert [one.text for one in book.lines][-2:] == [
        "paused from where it was started",
        "ISS (ZARYA): paused",
    ]


def answered(view: TrackView, *keys: str, **given: Any) -> str:
    """Return what the screen shows after some keys, and see that nothing was said to the run."""
    shown: list[str] = []

    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press(*keys)
        app.look()
        await pilot.pause()
        shown.append(text_of(app))

    news = News((view,), session=HERE, sky=given.pop("sky", PARKS))
    feed = on_screen(act, news, helpers=FakeHelpers(**given))
    assert feed.sent == []
    return shown[0]


def test_by_hand_is_only_while_paused_and_says_so() -> None:
    following = answered(VIEW, "3", "j")
    assert "by hand only while the pass is paused: p pauses it" in following
    assert "jog ↑N" not in following
    assert "by hand only while the pass is paused" in answered(VIEW, "3", "up")
    paused = answered(RESTING, "3", "j")
    assert "the arrows jog, [ ] choose how fast" in paused
    assert "jog ↑N ↓S ←E →W" in paused


@pytest.mark.usefixtures("terminal")
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"console": None}, "the simulated mount ends with its run: there is nothing to park"),
        ({"console": COMMAND, "sky": SKY}, "not parked: the mount's profile has no park position"),
    ],
)
def test_where_a_mount_cannot_be_parked_it_is_said_and_nothing_happens(
    changes: dict[str, Any], words: str
) -> None:
    assert words in answered(VIEW, "P", **changes)


def test_parking_is_refused_where_it_could_not_be_shown() -> None:
    assert "parking needs a terminal" in answered(VIEW, "P", console=COMMAND)


@pytest.mark.usefixtures("terminal")
def test_parking_is_asked_for_once_with_what_the_mount_does() -> None:
    shown = answered(VIEW, "P", console=COMMAND)
    for words in ("park?", "The run ends", "park position", "drives' power is cut", "y does it"):
        assert words in shown


def parked(terminal: list[list[str]], end: News, *keys: str) -> tuple[list[list[str]], str]:
    """Ask for parking, let the run end, and return which programs had the terminal, and the screen then."""
    shown: list[str] = []

    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("P", "y", *keys)
        app.look()
        assert terminal == [], "not before the run is over"
        app._feed.coming.append(end)  # type: ignore[attr-defined]
        app.look()
        app.look()
        await pilot.pause()
        shown.append(text_of(app))

    on_screen(act, News((VIEW,), session=HERE, sky=PARKS), helpers=FakeHelpers(console=COMMAND))
    return terminal, shown[0]


def test_once_the_run_is_over_the_console_parks_the_mount(terminal: list[list[str]]) -> None:
    assert parked(terminal, OVER)[0] == [[*COMMAND, "--park", "--theme", "night"]]


def test_a_stop_after_the_answer_takes_the_parking_back(terminal: list[list[str]]) -> None:
    assert parked(terminal, OVER, "space")[0] == []


@pytest.mark.parametrize(
    "how", [{"mount_stopped": False}, {"mount_stopped": None}, {"ended_by": "limit:sun"}]
)
def test_a_mount_that_was_not_seen_at_rest_is_not_parked(
    terminal: list[list[str]], how: dict[str, Any]
) -> None:
    assert OVER.summary is not None
    end = replace(OVER, summary=msgspec.structs.replace(OVER.summary, **how))
    given, shown = parked(terminal, end)
    assert given == []
    assert "not parked: the run did not end with the mount at rest" in shown


@pytest.mark.parametrize(
    ("how", "parks"), [({}, True), ({"ended_by": "limit:altitude"}, True), ({"mount_stopped": False}, False)]
)
def test_after_a_run_the_mount_is_parked_at_once_unless_its_stop_was_not_confirmed(
    terminal: list[list[str]], how: dict[str, Any], parks: bool
) -> None:
    assert OVER.summary is not None
    over = replace(OVER, session=HERE, sky=PARKS, summary=msgspec.structs.replace(OVER.summary, **how))

    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("t", "P")
        assert "The mount slews" in text_of(app)
        await pilot.press("y")
        app.look()

    feed = on_screen(act, over, helpers=FakeHelpers(console=COMMAND))
    given = [[*COMMAND, "--park", "--theme", "red"]] if parks else []
    assert terminal == given, "in the colours that this screen has"
    assert feed.sent == []


class Orders:
    """A console that remembers what it is told; its mount is not heard yet."""

    def __init__(self) -> None:
        self.told: list[ConsoleMessage] = []
        self.coming = [Latest(msgspec.structs.replace(MOUNT_VIEW, status=None))]

    def latest(self) -> Latest:
        return self.coming.pop(0) if self.coming else Latest()

    def tell(self, order: ConsoleMessage) -> bool:
        self.told.append(order)
        return True


@pytest.mark.parametrize(("key", "told"), [(None, [Park()]), ("space", ["Abort"])])
def test_the_console_parks_once_the_mount_is_heard_unless_it_was_stopped(
    key: str | None, told: list[Any]
) -> None:
    feed = Orders()

    async def run() -> None:
        app = ConsoleApp(feed, HandClock(), first=Park())
        async with app.run_test(size=(80, 24)) as pilot:
            assert feed.told == []
            if key is not None:
                await pilot.press(key)
            feed.coming.append(Latest(MOUNT_VIEW))
            for _ in range(3):
                app.look()

    asyncio.run(run())
    assert [one if one in told else type(one).__name__ for one in feed.told] == told
