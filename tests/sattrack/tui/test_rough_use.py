"""Keys at random, terminals of any size, pastes, a mouse alone: the screen lives and says what keys meant."""

from __future__ import annotations

import asyncio
import random
from typing import TYPE_CHECKING, Any

import pytest
from test_other_screens import HERE, FakeHelpers, text_of
from textual.events import Paste
from tui_builders import SKY, UTC_S, VIEW, FakeFeed, HandClock, changed

from sattrack.tui.app import TrackApp
from sattrack.tui.feeds import News
from sattrack.views.messages import (
    Arm,
    ClearBias,
    Disarm,
    DropRemembered,
    Go,
    Jog,
    LeaveRunning,
    Nudge,
    OffsetBy,
    Pause,
    Search,
    StopNow,
    TakeControl,
    YieldControl,
)
from sattrack.views.run import SessionView

if TYPE_CHECKING:
    from collections.abc import Callable

    from textual.pilot import Pilot

KEYS = (
    *("left", "right", "up", "down", "shift+left", "shift+up", "left_square_bracket", "right_square_bracket"),
    *("f", "s", "w", "escape", "r", "0", "m", "u", "v", "t", "question_mark", "c", "n", "b", "a", "g", "j"),
    *("1", "2", "3", "4", "5", "enter", "pageup", "pagedown", "home", "end", "tab", "x", "y", "l", "f5", "q"),
    *("p", "P"),
)
MEANT: dict[type, set[str]] = {
    Nudge: {"left", "right", "up", "down", "u"},
    OffsetBy: {"left", "right", "up", "down", "shift+left", "shift+up", "r", "u"},
    ClearBias: {"0"},
    DropRemembered: {"m"},
    Search: {"s", "w", "escape"},
    TakeControl: {"c"},
    YieldControl: {"c"},
    Arm: {"enter", "n", "b", "a", "y"},
    Disarm: {"enter"},
    LeaveRunning: {"l"},
    StopNow: {"q"},
    Pause: {"p"},
    Go: {"p", "enter"},
    Jog: {"left", "right", "up", "down"},
}


def played(
    act: Callable[[TrackApp, Pilot[None], FakeFeed], Any], size: tuple[int, int] = (80, 24)
) -> FakeFeed:
    feed = FakeFeed([News((VIEW,), session=HERE, sky=SKY)])

    async def run() -> None:
        app = TrackApp(feed, monotonic=HandClock(), helpers=FakeHelpers())  # type: ignore[arg-type]
        async with app.run_test(size=size) as pilot:
            await act(app, pilot, feed)
            assert app.is_running

    asyncio.run(run())
    return feed


@pytest.mark.parametrize(
    ("seed", "seconds"), [(1, 25), *(pytest.param(seed, 60, marks=pytest.mark.soak) for seed in (1, 2))]
)
def test_a_minute_of_keys_at_random_says_nothing_that_no_key_meant(seed: int, seconds: int) -> None:
    draws = random.Random(seed)

    async def act(app: TrackApp, pilot: Pilot[None], feed: FakeFeed) -> None:
        for second in range(seconds):
            key = draws.choice(KEYS)
            feed.sent.clear()
            if key not in {"q", "s"} or len(app.screen_stack) == 1:
                # In the question, they would stop and leave as they are meant to.
                await pilot.press(key)
            assert all(key in MEANT[type(one)] for one in feed.sent), (key, feed.sent)
            app._leave_running = False
            phase = draws.choice(("waiting", "slewing", "tracking", "paused", "paused", "stopping"))
            session = SessionView(draws.choice((None, 0, 3)), (), draws.randrange(3))
            feed.coming.append(News((changed(utc_s=UTC_S + second, phase=phase),), session=session))
            app._monotonic.now_s += 1.0  # type: ignore[attr-defined]
            app.look()
            app.plot()
            assert text_of(app)
        feed.sent.clear()
        await pilot.press("space")
        assert feed.sent == [StopNow()]
        assert len(app.screen_stack) == 1

    played(act)


def test_any_size_of_terminal_is_lived_through_in_every_screen_and_nothing_is_lost() -> None:
    sizes = ((1, 1), (2, 3), (80, 24), (5, 60), (300, 4), (200, 60), (1, 1), (80, 24))

    async def act(app: TrackApp, pilot: Pilot[None], feed: FakeFeed) -> None:
        for page in ("2", "3", "4", "5", "1"):
            await pilot.press(page)
            for size in sizes if page == "1" else sizes[1:3]:
                await pilot.resize_terminal(*size)
                app.look()
                app.plot()
                await pilot.pause()
                assert len(text_of(app).splitlines()) == size[1]
        await pilot.press("1", "space")
        assert feed.sent == [StopNow()]
        await pilot.pause()
        text = text_of(app)
        assert "STOP SENT" in text
        assert "SPACE STOP" in text

    played(act)


def test_a_paste_of_a_thousand_characters_is_no_keys_in_any_screen_or_dialog() -> None:
    async def act(app: TrackApp, pilot: Pilot[None], feed: FakeFeed) -> None:
        for keys in (("1",), ("2",), ("3",), ("4",), ("5",), ("1", "question_mark"), ("escape", "q")):
            await pilot.press(*keys)
            app.post_message(Paste("q l s y 0[]\x1b[C " * 63))
            await pilot.pause()
        assert feed.sent == []

    played(act)


def test_a_mouse_alone_nudges_turns_to_every_screen_and_stops() -> None:
    async def touch(app: TrackApp, pilot: Pilot[None], words: str, at: int = 0) -> None:
        app.look()
        await pilot.pause()
        rows = text_of(app).splitlines()
        column = rows[-1].index(words) + at
        await pilot.click(offset=(column, len(rows) - 1))
        await pilot.pause()

    async def act(app: TrackApp, pilot: Pilot[None], feed: FakeFeed) -> None:
        await touch(app, pilot, "←→", 1)
        await touch(app, pilot, "←→", 0)
        await touch(app, pilot, "]")
        await touch(app, pilot, "↑↓", 1)
        assert feed.sent == [Nudge(along_s=0.1), Nudge(along_s=-0.1), Nudge(cross_deg=-0.05)]
        feed.sent.clear()
        await touch(app, pilot, "1-6 more")
        for page in ("tonight", "mount", "schedule", "log", "live"):
            await touch(app, pilot, page)
            assert app._screens.page == page
        await touch(app, pilot, "? help", 3)
        assert len(app.screen_stack) == 2
        await pilot.click(offset=(40, 12))
        await pilot.pause()
        assert len(app.screen_stack) == 1
        await touch(app, pilot, "SPACE STOP")
        assert feed.sent == [StopNow()]

    played(act)


def test_a_touch_stops_beneath_a_dialog_answers_it_and_beside_it_closes_it() -> None:
    at: dict[str, tuple[int, int]] = {}

    async def touch(pilot: Pilot[None], words: str) -> None:
        await pilot.click(offset=at[words])
        # One for the touch, one for the key that it stands for.
        await pilot.pause()
        await pilot.pause()

    async def act(app: TrackApp, pilot: Pilot[None], feed: FakeFeed) -> None:
        await pilot.resize_terminal(120, 40)
        await pilot.pause()
        last = len(text_of(app).splitlines()) - 1
        for words in ("SPACE STOP", "s spiral"):
            at[words] = (text_of(app).splitlines()[last].index(words), last)
        for key in ("question_mark", "q"):
            await pilot.press(key)
            assert len(app.screen_stack) == 2
            await touch(pilot, "s spiral")
            assert (len(app.screen_stack), feed.sent) == (1, []), "nothing but the stop goes through a dialog"
            await pilot.press(key)
            await touch(pilot, "SPACE STOP")
            assert (len(app.screen_stack), feed.sent) == (1, [StopNow()])
            feed.sent.clear()
        await pilot.press("q")
        rows = text_of(app).splitlines()
        row = next(n for n, text in enumerate(rows) if "leave it running" in text)
        await pilot.click(offset=(rows[row].index("leave it running"), row))
        await pilot.pause()
        assert feed.sent == [LeaveRunning()]

    played(act)


def test_a_run_that_is_lost_is_told_and_its_screen_can_still_be_left() -> None:
    async def act(app: TrackApp, pilot: Pilot[None], feed: FakeFeed) -> None:
        feed.coming.append(News((), True, session=SessionView(None, (), 1), you=1))
        app.look()
        await pilot.press("right", "space", "2", "enter", "1")
        await pilot.pause()
        assert feed.sent == []
        assert "RUN LOST" in text_of(app)
        assert "its guardian stops the mount" in text_of(app)

    played(act)
