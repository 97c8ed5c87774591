"""The controller's console: what it shows of an antenna, what its keys say, and the program it runs on."""

from __future__ import annotations

import asyncio
import sys

import pytest
from antenna_setup import NOON_NS, SITE

pytest.importorskip("textual")

from textual._callback import invoke
from textual.widgets import Static

from sattrack.tui.console_app import AntennaApp, drawn
from sattrack.tui.feeds import AntennaProcess, Latest
from sattrack.tui.scene import Appearance
from sattrack.views.run import AntennaView, AxesView, ExchangeView, FocusView, RefusalView

VIEW = AntennaView(
    utc_s=NOON_NS / 1e9,
    door="127.0.0.1:7621",
    caller=True,
    axes="hadec",
    mount="sim",
    link_up=True,
    remote=True,
    doing="FOLLOWING",
    servo="TRACKING",
    outside_limits=False,
    tripped=None,
    commanded=AxesView(20.0, 40.0),
    actual=AxesView(20.0 + 1.5 / 3600.0, 40.0 - 2.25 / 3600.0),
    refused=1,
    exchanges=(
        ExchangeView(NOON_NS / 1e9, "TD 30 x", "TD NAK 5"),
        ExchangeView(NOON_NS / 1e9, "STOP", "STOP ACK"),
    ),
    refusals=(RefusalView(NOON_NS / 1e9, "TD 30 x", "a field is no number"),),
    focus=FocusView((1.25, None), moving=True),
)


def changed(**fields: object) -> AntennaView:
    return AntennaView(**{name: getattr(VIEW, name) for name in VIEW.__struct_fields__} | fields)


class FakeFeed:
    def __init__(self, view: AntennaView = VIEW) -> None:
        self.view = view
        self.told: list[str] = []

    def latest(self) -> Latest[AntennaView]:
        return Latest(self.view)

    def tell(self, word: str) -> None:
        self.told.append(word)


def press(feed: FakeFeed, *keys: str) -> tuple[AntennaApp, str]:
    async def run() -> tuple[AntennaApp, str]:
        app = AntennaApp(feed)
        async with app.run_test(size=(80, 24)) as pilot:
            shown = "\n".join(str(part.render()) for part in app.query(Static))
            await pilot.press(*keys)
            await pilot.pause()
        return app, shown

    return asyncio.run(run())


def test_keys_say_their_words() -> None:
    feed = FakeFeed()
    press(feed, "l", "r", "space", "x")
    assert feed.told == ["local", "remote", "stop", "reset"]


def test_the_screen_shows_the_antenna_and_the_last_lines() -> None:
    _, shown = press(FakeFeed())
    for words in (
        "REMOTE",
        "tracking",
        "hour angle",
        "20.000000°",
        "1.50″",
        "−2.25″",
        "TD 30 x  NAK 5",
        "STOP  ACK",
        "a field is no number",
        "1.2500",
        "moves",
        "1 refused",
    ):
        assert words in shown


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"remote": False}, "LOCAL"),
        ({"link_up": False}, "NOT HEARD"),
        ({"caller": False}, "not connected"),
        ({"tripped": "sun"}, "safety stopped the mount: sun"),
        ({"outside_limits": True}, "is beyond the limits"),
        ({"axes": "azel"}, "azimuth"),
        ({"commanded": None}, "commanded                  -"),
        ({"commanded": AxesView(20.0, 42.0)}, "−2.000625°"),
        ({"refusals": ()}, "none"),
        ({"focus": FocusView((None,), moving=False)}, "stands"),
    ],
)
def test_what_is_amiss_is_said_in_words(fields: dict[str, object], says: str) -> None:
    assert says in "\n".join(text.plain for text in drawn(changed(**fields)).values())


def test_a_service_that_hangs_is_said_in_words() -> None:
    class HungFeed(FakeFeed):
        def latest(self) -> Latest[AntennaView]:
            return Latest() if self.told else super().latest()

    seconds = [100.0]

    async def run() -> tuple[str, str]:
        feed = HungFeed()
        app = AntennaApp(feed, monotonic=lambda: seconds[0])
        async with app.run_test(size=(80, 24)):
            feed.told.append("hung")
            found = []
            for seconds[0] in (101.0, 107.0):
                app.look()
                found.append(str(app.query_one("#state", Static).render()))
        return found[0], found[1]

    fresh, old = asyncio.run(run())

    assert "NO NEWS" not in fresh
    assert "NO NEWS  from the service for 7 s: everything here is old" in old
    assert "use the mount's own stop" in old


def test_a_quit_leaves_and_an_interrupt_is_known_as_one() -> None:
    app, _ = press(FakeFeed(), "q")
    assert not app.interrupted
    app, _ = press(FakeFeed(), "ctrl+c")
    assert app.interrupted


def test_the_program_beneath_sends_views_takes_words_and_ends_with_its_input() -> None:
    site = f"{SITE.latitude_deg},{SITE.longitude_deg},0"
    command = [sys.executable, "-m", "sattrack", "serve", "antenna", "--mount", "sim", "--site", site]
    antenna = AntennaProcess([*command, "--port", "0", "--stream", "--control"])
    try:
        assert antenna.wait_first_view()
        antenna.tell("local")
        view = antenna.latest().view
        while view is None or view.remote:
            with antenna._changed:
                assert antenna._changed.wait(60.0)
            view = antenna.latest().view or view
        assert view.mount == "sim"
        assert view.servo == "IDLE"
        antenna.close_input()
        assert antenna.wait(60.0) == 0
    finally:
        antenna.end_by_force(1.0)
        told = antenna.close()
    assert "the controller is in local" in told


def colours_of(app: AntennaApp) -> set[str]:
    strips = app.screen._compositor.render_strips()
    styles = [segment.style for strip in strips for segment in strip if segment.style is not None]
    return {colour.name for style in styles for colour in (style.color, style.bgcolor) if colour is not None}


def test_the_red_theme_is_red_and_t_goes_on_to_the_next() -> None:
    async def run() -> None:
        app = AntennaApp(FakeFeed(changed(link_up=False)), Appearance("red"))
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.pause()
            assert {colour for colour in colours_of(app) if not colour.endswith("0000")} == set()
            await pilot.press("t")
            app.look()
            await pilot.pause()
            assert app.theme == "contrast"
            assert "#ff9c94" in colours_of(app), "what is bad is said in this theme's own colour"

    asyncio.run(run())


class LateApp(AntennaApp):
    """Takes so long to end, once its screens are gone, that its timers come once more."""

    async def _close_all(self) -> None:
        await super()._close_all()
        for timer in self._timers:
            await invoke(timer._callback)


def test_nothing_is_drawn_once_the_screens_are_taken_down() -> None:
    async def run() -> None:
        async with LateApp(FakeFeed()).run_test(size=(80, 24)) as pilot:
            await pilot.pause()

    asyncio.run(run())
