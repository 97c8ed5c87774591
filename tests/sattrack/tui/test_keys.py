from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import pytest
from textual._xterm_parser import XTermParser
from textual.containers import VerticalScroll
from textual.events import Key
from tui_builders import SUMMARY, VIEW, FakeFeed, HandClock, changed, press

from sattrack.tui.app import LEAVE_WITHIN_S, TrackApp
from sattrack.tui.dialogs import HelpScreen
from sattrack.tui.feeds import News
from sattrack.tui.scene import FIRST_STEP, STEPS, OffsetKeys
from sattrack.views.messages import ClearBias, DropRemembered, Nudge, StopNow

if TYPE_CHECKING:
    from sattrack.views.messages import Message


FINER, COARSER, HELP = "left_square_bracket", "right_square_bracket", "question_mark"


TURNS: tuple[tuple[list[str], list[Message]], ...] = (
    (["right"], [Nudge(along_s=0.1)]),
    (["left"], [Nudge(along_s=-0.1)]),
    (["up"], [Nudge(cross_deg=0.01)]),
    (["down"], [Nudge(cross_deg=-0.01)]),
    (["right", "right", "up"], [Nudge(along_s=0.1), Nudge(along_s=0.1), Nudge(cross_deg=0.01)]),
    (["0"], [ClearBias()]),
    (["m"], [DropRemembered()]),
    (["a", "enter", "tab", "x", "f5", "home", "ctrl+p"], []),
    ([HELP], []),
    ([HELP, "right"], []),
    ([HELP, "q"], []),
    ([HELP, HELP, "right"], [Nudge(along_s=0.1)]),
    ([HELP, "right", "0"], []),
    (["q"], [StopNow()]),
    (["ctrl+c"], [StopNow()]),
    (["ctrl+q"], [StopNow()]),
    ([HELP, "ctrl+c"], [StopNow()]),
    (["space"], [StopNow()]),
    ([HELP, "space"], [StopNow()]),
    (["tab", "space"], [StopNow()]),
    (["space", "space"], [StopNow(), StopNow()]),
    ([FINER, "right"], [Nudge(along_s=0.05)]),
    ([FINER, FINER, "up"], [Nudge(cross_deg=0.001)]),
    ([FINER] * 9 + ["left"], [Nudge(along_s=-0.01)]),
    ([COARSER, FINER, "right"], [Nudge(along_s=0.1)]),
    ([COARSER, "down"], [Nudge(cross_deg=-0.05)]),
    ([COARSER] * 9 + ["right", "up"], [Nudge(along_s=1.0), Nudge(cross_deg=0.1)]),
)


def test_each_key_sends_exactly_its_messages(feed: FakeFeed, hand_clock: HandClock) -> None:
    async def run() -> None:
        app = TrackApp(feed, monotonic=hand_clock)
        async with app.run_test(size=(80, 24)) as pilot:
            for keys, messages in TURNS:
                app._close_dialogs()
                app._offsets, app._leaving_since_s, app._stop_sent_s = OffsetKeys(), None, None
                feed.sent.clear()
                await pilot.press(*keys)
                await pilot.pause()
                assert feed.sent == messages, keys

    asyncio.run(run())


def test_steps_begin_in_the_middle_and_grow() -> None:
    assert [s.along_s for s in STEPS] == sorted(s.along_s for s in STEPS)
    assert [s.cross_deg for s in STEPS] == sorted(s.cross_deg for s in STEPS)
    assert STEPS[FIRST_STEP] == (0.1, 0.01)


def test_a_stop_does_not_wait_behind_keys_that_were_typed_before_it_and_makes_them_void(
    feed: FakeFeed, hand_clock: HandClock
) -> None:
    async def run() -> None:
        app = TrackApp(feed, monotonic=hand_clock)
        async with app.run_test(size=(80, 24)) as pilot:
            for key in ("right", "up", "space", "left"):
                app.post_message(Key(key, " " if key == "space" else None))
            assert feed.sent == [StopNow()]
            await pilot.pause()
            assert feed.sent == [StopNow(), StopNow(), Nudge(along_s=-0.1)]
            await pilot.press("up", "space")
            assert feed.sent[3:] == [Nudge(cross_deg=0.01), StopNow()]

    asyncio.run(run())


@pytest.mark.parametrize("answer", ["\x1b[?62;4c", "\x1b_Gi=1;OK\x1b\\\x1b[?62;c", "\x1b[?6"])
def test_what_a_terminal_says_late_of_itself_is_no_keys(feed: FakeFeed, answer: str) -> None:
    """Textual hands on, key by key, what it does not know."""
    parser = XTermParser()
    keys = [event for event in (*parser.feed(answer), *parser.feed("")) if isinstance(event, Key)]
    assert any(key.key == HELP for key in keys)

    async def run() -> None:
        app = TrackApp(feed)
        async with app.run_test(size=(80, 24)) as pilot:
            for key in keys:
                app.post_message(key)
            app.post_message(Key("space", " "))
            await pilot.pause()
            assert (len(app.screen_stack), app.theme) == (1, "night")
            assert feed.sent[:1] == [StopNow()]
            # Nobody types as fast as that.
            for number, key in enumerate(keys):
                typed = Key(key.key, key.character)
                typed.time += 0.2 * number
                app.post_message(typed)
            await pilot.pause()
            assert isinstance(app.screen, HelpScreen)

    asyncio.run(run())


def test_help_is_one_screen_however_often_it_is_read(feed: FakeFeed) -> None:
    """Textual keeps the styles of every new one for good."""

    async def run() -> None:
        app = TrackApp(feed)
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.press(HELP)
            first = app.screen
            assert isinstance(first, HelpScreen)
            first.query_one(VerticalScroll).scroll_end(animate=False)
            await pilot.press("escape", HELP, HELP)
            assert not isinstance(app.screen, HelpScreen)
            await pilot.press(HELP)
            assert app.screen is first
            assert first.query_one(VerticalScroll).scroll_y == 0.0
            app.action_help()
            assert app.screen_stack.count(first) == 1

    asyncio.run(run())


def test_stop_shows_at_once_and_closes_what_lies_over_it(feed: FakeFeed, hand_clock: HandClock) -> None:
    async def run() -> None:
        app = TrackApp(feed, monotonic=hand_clock)
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.press("question_mark")
            assert isinstance(app.screen, HelpScreen)
            await pilot.press("space")
            await pilot.pause()
            assert not isinstance(app.screen, HelpScreen)
            assert app.scene is not None
            assert app.scene.stop_sent_s == 0.0
            assert app.is_running

    asyncio.run(run())


def test_quit_waits_for_the_feeder_and_then_leaves(feed: FakeFeed, hand_clock: HandClock) -> None:
    async def run() -> None:
        app = TrackApp(feed, monotonic=hand_clock)
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.press("q")
            app.look()
            assert not app._exit
            feed.coming.append(News((changed(phase="stopping", ended_by="operator"),), True, SUMMARY))
            app.look()
            assert app._exit

    asyncio.run(run())
    assert feed.sent == [StopNow()]


def test_quit_leaves_a_feeder_that_does_not_end(feed: FakeFeed, hand_clock: HandClock) -> None:
    async def run() -> None:
        app = TrackApp(feed, monotonic=hand_clock)
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.press("q")
            hand_clock.now_s += LEAVE_WITHIN_S + 0.1
            app.look()
            assert app._exit

    asyncio.run(run())


def test_quit_twice_leaves_at_once(feed: FakeFeed) -> None:
    assert press(feed, "q", "q")._exit
    assert feed.sent == [StopNow()]


def test_a_signal_leaves_like_the_key(feed: FakeFeed, hand_clock: HandClock) -> None:
    async def run() -> None:
        app = TrackApp(feed, monotonic=hand_clock)
        async with app.run_test(size=(80, 24)):
            app.ask_to_leave()
            app.look()
            assert not app._exit

    asyncio.run(run())
    assert feed.sent == [StopNow()]


@pytest.mark.parametrize(("stay", "left"), [(True, False), (False, True)])
def test_the_screen_of_an_ended_run_stays_where_it_is_to_be_read(
    feed: FakeFeed, hand_clock: HandClock, stay: bool, left: bool
) -> None:
    async def run() -> None:
        app = TrackApp(feed, stay, monotonic=hand_clock)
        async with app.run_test(size=(80, 24)) as pilot:
            feed.coming.append(News((VIEW,), True, SUMMARY))
            app.look()
            assert app._exit is left
            if not left:
                await pilot.press("right", "space", "q")
                assert app._exit

    asyncio.run(run())
    assert feed.sent == [], "nothing is sent to a run that has ended"


def test_a_paste_is_no_keys(feed: FakeFeed, hand_clock: HandClock) -> None:
    from textual.events import Paste

    async def run() -> None:
        app = TrackApp(feed, monotonic=hand_clock)
        async with app.run_test(size=(80, 24)) as pilot:
            app.post_message(Paste("q 0[]" * 200))
            await pilot.pause()
            assert app.is_running

    asyncio.run(run())
    assert feed.sent == []
