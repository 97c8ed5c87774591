"""The keys of control, of leaving, and of what can be taken back."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import pytest
from textual.widgets import Static
from tui_builders import SUMMARY, VIEW, FakeFeed, HandClock, changed, press

from sattrack.tui.app import TrackApp
from sattrack.tui.dialogs import LeaveDialog
from sattrack.tui.feeds import News
from sattrack.tui.scene import SHOWN_AFTER_S, OffsetKeys
from sattrack.views.messages import (
    ClearBias,
    LeaveRunning,
    Nudge,
    OffsetBy,
    StopNow,
    TakeControl,
    YieldControl,
)
from sattrack.views.run import STARTER, OffsetView, SessionView, Watcher

if TYPE_CHECKING:
    from sattrack.views.messages import Message

ANNA = 3
HERE = SessionView(STARTER, (), 0)
ELSEWHERE = SessionView(ANNA, (Watcher(ANNA, "anna"),), 1, said="anna took control")
OFFSETS = (OffsetView("along_s", 0.3, 0.3, 0.0), OffsetView("dec_deg", 0.02, 0.02, 0.0))


def told(session: SessionView | None, you: int = STARTER, **changes: object) -> FakeFeed:
    return FakeFeed([News((changed(VIEW, **changes),), session=session, you=you)])


CASES: list[tuple[SessionView | None, int, list[str], list[Message]]] = [
    (HERE, STARTER, ["right"], [Nudge(along_s=0.1)]),
    (HERE, STARTER, ["c"], [YieldControl()]),
    (ELSEWHERE, STARTER, ["c"], [TakeControl()]),
    (ELSEWHERE, STARTER, ["right", "up", "0", "s", "w", "escape", "r", "m", "u", "shift+left"], []),
    (ELSEWHERE, STARTER, ["space"], [StopNow()]),
    (ELSEWHERE, 4, ["right", "space"], [StopNow()]),
    (ELSEWHERE, ANNA, ["right"], [Nudge(along_s=0.1)]),
    (ELSEWHERE, ANNA, ["c"], [YieldControl()]),
    (None, STARTER, ["c"], []),
    (HERE, STARTER, ["q"], []),
    (HERE, STARTER, ["q", "x"], []),
    (HERE, STARTER, ["q", "escape", "right"], [Nudge(along_s=0.1)]),
    (HERE, STARTER, ["q", "right"], []),
    (HERE, STARTER, ["q", "s"], [StopNow()]),
    (HERE, STARTER, ["q", "q"], [StopNow()]),
    (HERE, STARTER, ["q", "l"], [LeaveRunning()]),
    (HERE, STARTER, ["q", "space"], [StopNow()]),
    (HERE, STARTER, ["q", "ctrl+c"], [StopNow()]),
    (HERE, STARTER, ["ctrl+c"], [StopNow()]),
    (HERE, STARTER, ["shift+right"], [OffsetBy("along_s", "gradual", 1.0, 20.0)]),
    (HERE, STARTER, ["shift+down"], [OffsetBy("cross_deg", "gradual", -0.1, 20.0)]),
    (HERE, STARTER, ["right", "u"], [Nudge(along_s=0.1), Nudge(along_s=-0.1)]),
    (HERE, STARTER, ["u"], []),
    (HERE, STARTER, ["up", "left", "u", "u", "u"], [
        Nudge(cross_deg=0.01), Nudge(along_s=-0.1), Nudge(along_s=0.1), Nudge(cross_deg=-0.01)]),
    (HERE, STARTER, ["f", "up", "u"], [
        OffsetBy("dec_deg", "add", 0.01), OffsetBy("dec_deg", "add", -0.01)]),
    (HERE, STARTER, ["shift+right", "u"], [
        OffsetBy("along_s", "gradual", 1.0, 20.0), OffsetBy("along_s", "set", 0.0)]),
    # What was said a moment ago counts, though no view shows it yet.
    (HERE, STARTER, ["right", "shift+right", "shift+right", "u", "shift+left"], [
        Nudge(along_s=0.1),
        OffsetBy("along_s", "gradual", 1.1, 20.0), OffsetBy("along_s", "gradual", 2.1, 20.0),
        OffsetBy("along_s", "set", 1.1), OffsetBy("along_s", "gradual", 1.1 - 1.0, 20.0)]),
    (HERE, STARTER, ["down", "shift+right", "shift+down"], [
        Nudge(cross_deg=-0.01), OffsetBy("along_s", "gradual", 1.0, 20.0),
        OffsetBy("cross_deg", "gradual", -0.11, 20.0)]),
]  # fmt: skip


def test_the_help_says_what_leaving_does_to_a_run_that_was_started_elsewhere() -> None:
    feed = told(ELSEWHERE, ANNA)

    async def run() -> str:
        app = TrackApp(feed, monotonic=HandClock())
        async with app.run_test() as pilot:
            await pilot.press("question_mark")
            text = str(app.screen.query_one(Static).content)
            await pilot.press("escape", "ctrl+c")
        return text

    text = asyncio.run(run())

    assert "q  Ctrl-C leave: the run continues; only SPACE stops the mount" in text
    assert "Ctrl-C: it does" not in text
    assert feed.sent == []


def test_each_key_says_what_one_may_say() -> None:
    async def run() -> None:
        feed = FakeFeed()
        app = TrackApp(feed, monotonic=HandClock())
        async with app.run_test(size=(80, 24)) as pilot:
            for session, you, keys, messages in CASES:
                app._close_dialogs()
                app._offsets, app._leaving_since_s, app._stop_sent_s = OffsetKeys(), None, None
                app._leave_running, app._session, app._you = False, None, STARTER
                feed.coming.append(News((VIEW,), session=session, you=you))
                app.look()
                feed.sent.clear()
                await pilot.press(*keys)
                assert feed.sent == messages, (session, you, keys)

    asyncio.run(run())


def test_a_gradual_nudge_goes_on_from_what_was_asked_for_and_undo_goes_back_there() -> None:
    feed = told(HERE, offsets=OFFSETS)
    press(feed, "shift+right", "u")

    assert feed.sent == [OffsetBy("along_s", "gradual", 1.3, 20.0), OffsetBy("along_s", "set", 0.3)]


def test_what_views_say_counts_once_they_can_show_what_was_asked_for() -> None:
    hand, later = OffsetKeys(), changed(utc_s=VIEW.utc_s + SHOWN_AFTER_S, offsets=OFFSETS)
    hand.nudge(1, 0, VIEW)
    assert hand.creep(1, 0, changed(offsets=OFFSETS)) == [OffsetBy("along_s", "gradual", 1.1, 20.0)]
    assert hand.creep(1, 0, later) == [OffsetBy("along_s", "gradual", 1.3, 20.0)]


def test_clearing_is_taken_back_offset_by_offset() -> None:
    feed = told(HERE, offsets=OFFSETS)
    press(feed, "0", "u")

    assert feed.sent == [ClearBias(), OffsetBy("along_s", "set", 0.3), OffsetBy("dec_deg", "set", 0.02)]


def test_a_frame_s_reset_is_taken_back_for_that_frame() -> None:
    feed = told(HERE, offsets=OFFSETS)
    press(feed, "f", "r", "u")

    assert feed.sent[-1:] == [OffsetBy("dec_deg", "set", 0.02)]


@pytest.mark.parametrize(("you", "leaves"), [(STARTER, False), (4, True)])
def test_leaving_asks_where_the_run_was_started_and_nowhere_else(you: int, leaves: bool) -> None:
    feed = told(HERE, you)
    app = press(feed, "q")

    assert app._exit is leaves
    assert feed.sent == []


def test_the_screen_goes_once_the_run_has_said_that_it_is_left_running(hand_clock: HandClock) -> None:
    feed = told(HERE)

    async def run() -> None:
        app = TrackApp(feed, monotonic=hand_clock)
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.press("q", "l")
            app.look()
            assert not app._exit
            feed.coming.append(News((VIEW,), session=SessionView(None, (), 0, left_running=True)))
            app.look()
            assert app._exit
            assert app.left_running

    asyncio.run(run())
    assert feed.sent == [LeaveRunning()]


def test_a_stop_after_leaving_was_asked_for_stays_to_see_it_through(hand_clock: HandClock) -> None:
    feed = told(HERE)

    async def run() -> None:
        app = TrackApp(feed, monotonic=hand_clock)
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.press("q", "l", "space")
            feed.coming.append(News((VIEW,), session=SessionView(None, (), 0, left_running=True)))
            app.look()
            assert not app._exit

    asyncio.run(run())
    assert feed.sent == [LeaveRunning(), StopNow()]


def test_the_question_does_not_come_for_a_run_that_has_ended() -> None:
    feed = FakeFeed([News((VIEW,), True, SUMMARY, session=HERE)])
    app = press(feed, "q")

    assert app._exit
    assert not isinstance(app.screen_stack[-1] if app.screen_stack else None, LeaveDialog)


NEEDING = {"1": ("behind", "ahead", "↑↓ across", "p pause"), "2": ("Enter arm",), "3": ("P park",)}
"""Keys of each page that need control."""


def test_who_looks_on_is_offered_control_and_no_key_that_needs_it() -> None:
    sizes = ((80, 24), (120, 40))

    async def pages(you: int) -> dict[tuple[int, str], str]:
        app, found = TrackApp(told(ELSEWHERE, you), monotonic=HandClock()), {}
        async with app.run_test(size=sizes[0]) as pilot:
            for size in sizes:
                await pilot.resize_terminal(*size)
                for page in NEEDING:
                    await pilot.press(page)
                    app.look()
                    await pilot.pause()
                    strips = app.screen._compositor.render_strips()
                    found[size[0], page] = "\n".join("".join(part.text for part in strip) for strip in strips)
        return found

    movers, watchers = asyncio.run(pages(ANNA)), asyncio.run(pages(STARTER))
    for (wide, page), mover in movers.items():
        watcher = watchers[wide, page]
        assert "arrows jog" not in watcher
        if page == "1" or wide > 80:
            for key in NEEDING[page]:
                assert key in mover
                assert key not in watcher
            assert "c take control" in watcher
        assert "SPACE STOP" in watcher


WHO = (
    (HERE, STARTER, False, ""),
    (ELSEWHERE, STARTER, True, "LOOKING ON  control: anna  c takes it  1 other"),
    (ELSEWHERE, ANNA, True, "IN CONTROL "),
    (SessionView(None, (Watcher(4, "ben"),), 1), 4, True, "LOOKING ON  control: nobody  c takes it"),
    (SessionView(ANNA, (), 2), ANNA, True, "IN CONTROL   1 other"),
    (SessionView(STARTER, (), 2), STARTER, True, "IN CONTROL   2 others"),
    (HERE, STARTER, False, ""),
)


def test_who_has_control_is_said_to_whoever_is_not_alone() -> None:
    from sattrack.tui.panels import SessionBar

    async def run() -> None:
        feed = FakeFeed()
        app = TrackApp(feed, monotonic=HandClock())
        async with app.run_test(size=(80, 24)) as pilot:
            bar = app.query_one(SessionBar)
            for session, you, shown, words in WHO:
                feed.coming.append(News((VIEW,), session=session, you=you))
                app.look()
                await pilot.pause()
                assert bar.display is shown
                if shown:
                    text = str(bar.render()).replace(" LOOKING ON ", "LOOKING ON ")
                    assert text.replace(" IN CONTROL ", "IN CONTROL ").startswith(words)

    asyncio.run(run())
