from __future__ import annotations

import asyncio

import pytest
from console_tui_builders import GUIDE_DEG_S, VIEW, FakeConsole, console_view
from textual.events import Key
from tui_builders import HandClock, pressed

from sattrack.mount.model import Slew
from sattrack.mount.requests import Abort, FindHome, Park, Sync
from sattrack.tui.console_app import LAGGING_S, LEAVE_WITHIN_S, ConsoleApp
from sattrack.tui.dialogs import DirectionDialog
from sattrack.tui.feeds import Latest
from sattrack.views.messages import ConsoleMessage, Jog, Leave, Reset

RA = ("5", "h")
DEC = ("minus", "5")


def press(feed: FakeConsole, *keys: str) -> ConsoleApp:
    """Run the screen at 80 × 24, press keys, and return the app as it then stood."""
    return pressed(lambda: ConsoleApp(feed, monotonic=HandClock()), *keys)


def north(rate_deg_s: float) -> Jog:
    return Jog(dec_rate_deg_s=rate_deg_s)


def east(rate_deg_s: float) -> Jog:
    return Jog(ra_rate_deg_s=rate_deg_s)


ORDERS: list[tuple[list[str], list[ConsoleMessage]]] = [
    (["up", "up", "down", "left", "right"], [*[north(0.02)] * 2, north(-0.02), east(0.02), east(-0.02)]),
    (
        ["1", "up", "2", "up", "3", "up", "4", "up", "5", "left", "6", "right", "2"],
        [north(GUIDE_DEG_S), north(0.02), north(0.1), north(0.5), east(2.0), east(-4.0)],
    ),
    (["g", *RA, "enter", *DEC, "enter"], [Slew(75.0, -5.0)]),
    (["g", *RA, "tab", *DEC, "enter"], [Slew(75.0, -5.0)]),
    (["g", *RA, "enter", "5", "escape"], []),
    (["g", *RA, "enter", "9", "1", "enter"], []),
    (["g", "2", "4", "h", "enter", "5", "enter"], []),
    (["g", "enter", "enter", "q", "p", "r", "up", "left"], []),
    (["g", *RA, "space"], [Abort()]),
    (["s", *RA, "enter", *DEC, "enter", "y"], [Sync(75.0, -5.0)]),
    (["s", *RA, "enter", *DEC, "enter", "enter"], []),
    (["s", *RA, "enter", *DEC, "enter", "space"], [Abort()]),
    (["p", "y"], [Park()]),
    (["p", "n", "p", "enter", "p", "p", "p", "q", "p", "up"], []),
    (["p", "space"], [Abort()]),
    (["h", "r", "space", "space"], [FindHome(), Reset(), Abort(), Abort()]),
    (["question_mark", "up", "h", "space"], [Abort()]),
    (["question_mark", "question_mark", "h", "tab", "space"], [FindHome(), Abort()]),
    (["a", "enter", "x", "f5", "home", "ctrl+p", "7", "0"], []),
]


def test_each_key_gives_exactly_its_orders() -> None:
    async def run() -> None:
        feed = FakeConsole()
        app = ConsoleApp(feed, monotonic=HandClock())
        async with app.run_test(size=(80, 24)) as pilot:
            for keys, orders in ORDERS:
                await pilot.press(*keys)
                await pilot.pause()
                assert feed.told == orders, keys
                feed.told.clear()
                if len(app.screen_stack) > 1:
                    await pilot.press("escape")

    asyncio.run(run())


@pytest.mark.parametrize("keys", [["q"], ["ctrl+c"], ["ctrl+q"], ["p", "ctrl+c"], ["g", "ctrl+q"]])
def test_leaving_is_said_once_and_from_everywhere(keys: list[str]) -> None:
    feed = FakeConsole()
    press(feed, *keys)
    assert feed.told == [Leave()]


def test_a_stop_does_not_wait_behind_keys_that_were_typed_before_it_and_makes_them_void() -> None:
    async def run() -> None:
        feed = FakeConsole()
        app = ConsoleApp(feed, monotonic=HandClock())
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.press("g", *RA, "enter", *DEC)
            for key in ("enter", "h", "space"):
                app.post_message(Key(key, None))
            assert feed.told == [Abort()]
            await pilot.pause()
            assert feed.told == [Abort(), Abort()]
            await pilot.press("h")
            assert feed.told[2:] == [FindHome()]

    asyncio.run(run())


def test_a_stop_closes_what_lies_over_the_screen_and_shows_until_it_is_obeyed() -> None:
    async def run() -> None:
        feed = FakeConsole()
        app = ConsoleApp(feed, monotonic=HandClock())
        async with app.run_test(size=(80, 24)) as pilot:
            feed.coming.append(Latest(console_view(doing="slewing")))
            app.look()
            await pilot.press("g")
            assert isinstance(app.screen, DirectionDialog)
            await pilot.press("space")
            await pilot.pause()
            assert len(app.screen_stack) == 1
            assert app.scene is not None
            assert app.scene.stop_sent_s == 0.0
            feed.coming.append(Latest(console_view(doing="stopping")))
            app.look()
            assert app.scene.stop_sent_s is None

    asyncio.run(run())


def test_old_keys_of_a_screen_that_lagged_do_not_move_the_mount() -> None:
    async def run() -> None:
        feed, clock = FakeConsole(), HandClock()
        app = ConsoleApp(feed, monotonic=clock)
        async with app.run_test(size=(80, 24)):
            clock.now_s += LAGGING_S + 0.1
            app.action_jog(0, 1)
            assert feed.told == []
            app.look()
            app.action_jog(0, 1)
            assert feed.told == [Jog(dec_rate_deg_s=0.02)]

    asyncio.run(run())


def test_nothing_is_jogged_before_the_first_view() -> None:
    feed = FakeConsole(coming=[])
    press(feed, "up", "left")
    assert feed.told == []


def test_quit_waits_for_the_console_and_then_leaves() -> None:
    async def run() -> None:
        feed, clock = FakeConsole(), HandClock()
        app = ConsoleApp(feed, monotonic=clock)
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.press("q")
            app.look()
            assert not app._exit
            feed.coming.append(Latest(None, ended=True))
            app.look()
            assert app._exit

    asyncio.run(run())


def test_quit_leaves_a_console_that_does_not_end() -> None:
    async def run() -> None:
        feed, clock = FakeConsole(), HandClock()
        app = ConsoleApp(feed, monotonic=clock)
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.press("q")
            clock.now_s += LEAVE_WITHIN_S + 0.1
            app.look()
            assert app._exit

    asyncio.run(run())


def test_quit_twice_leaves_at_once() -> None:
    feed = FakeConsole()
    assert press(feed, "q", "q")._exit
    assert feed.told == [Leave()]


def test_a_console_that_has_ended_is_told_nothing_more() -> None:
    feed = FakeConsole([Latest(VIEW, ended=True)])
    assert press(feed, "up", "space", "q")._exit
    assert feed.told == []


def test_a_signal_leaves_like_the_key() -> None:
    async def run() -> None:
        feed = FakeConsole()
        app = ConsoleApp(feed, monotonic=HandClock())
        async with app.run_test(size=(80, 24)):
            app.ask_to_leave()
            app.look()
            assert feed.told == [Leave()]

    asyncio.run(run())


def test_a_paste_is_no_keys() -> None:
    from textual.events import Paste

    async def run() -> None:
        feed = FakeConsole()
        app = ConsoleApp(feed, monotonic=HandClock())
        async with app.run_test(size=(80, 24)) as pilot:
            app.post_message(Paste("q hpy 6" * 100))
            await pilot.pause()
            assert app.is_running
        assert feed.told == []

    asyncio.run(run())
