"""Keys and rows of what goes beyond nudges along the track: frames, searches, estimates."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import msgspec
from test_other_screens import text_of
from tui_builders import FakeFeed, HandClock, changed

from sattrack.tui.app import TrackApp
from sattrack.tui.feeds import News
from sattrack.views.messages import OffsetBy, Search
from sattrack.views.run import EstimateView, OffsetView, RememberedView, SearchView

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sattrack.views.messages import Message
    from sattrack.views.run import TrackView

SEARCHING = SearchView("spiral", 12.3, 0.1, 0.02)
ESTIMATE = EstimateView(3.0012, 0.0031, -0.0002, 0.00096, 12, 1, 0, 1790946270.0)
OFFSETS = (
    OffsetView("ra_cos_dec_deg", 0.02, 0.02, 0.0),
    OffsetView("camera_x_deg", 0.05, 0.0123, 0.0),
)


SIZES = ((80, 24), (120, 40))


def shown_at(*views: TrackView, sizes: tuple[tuple[int, int], ...] = SIZES) -> Iterator[tuple[str, ...]]:
    """Give what one screen shows of each view, in a terminal of each size."""

    async def drive() -> list[tuple[str, ...]]:
        feed, found = FakeFeed([News((views[0],))]), []
        app = TrackApp(feed, monotonic=HandClock())
        async with app.run_test(size=sizes[0]) as pilot:
            for size in sizes:
                await pilot.resize_terminal(*size)
                texts = []
                for view in views:
                    feed.coming.append(News((view,)))
                    app.look()
                    await pilot.pause()
                    texts.append(text_of(app))
                found.append(tuple(texts))
        return found

    return iter(asyncio.run(drive()))


def run(view: TrackView, *keys: str, size: tuple[int, int] = (80, 24)) -> tuple[list[Message], str]:
    feed = FakeFeed([News((view,))])

    async def drive() -> str:
        app = TrackApp(feed, monotonic=HandClock())
        async with app.run_test(size=size) as pilot:
            await pilot.press(*keys)
            await pilot.pause()
            return text_of(app)

    return feed.sent, asyncio.run(drive())


PRESSED = (
    ("r", [OffsetBy("along_s", "reset"), OffsetBy("cross_deg", "reset")]),
    ("f", []),
    ("right", [OffsetBy("ra_cos_dec_deg", "add", 0.01)]),
    ("down", [OffsetBy("dec_deg", "add", -0.01)]),
    ("right_square_bracket", []),
    ("right", [OffsetBy("ra_cos_dec_deg", "add", 0.05)]),
    ("left_square_bracket", []),
    ("f", []),
    ("left", [OffsetBy("ra_axis_deg", "add", -0.01)]),
    ("f", []),
    ("up", [OffsetBy("camera_y_deg", "add", 0.01)]),
    ("r", [OffsetBy("camera_x_deg", "reset"), OffsetBy("camera_y_deg", "reset")]),
    ("s", [Search("spiral", spacing_deg=0.1, speed_deg_s=0.05)]),
    ("w", [Search("sweep", reach_s=1.0, period_s=20.0)]),
    ("escape", []),
)


def test_each_key_sends_exactly_its_messages() -> None:
    sent, _ = run(changed(), *(key for key, _ in PRESSED))
    assert sent == [message for _, messages in PRESSED for message in messages]


def test_while_a_search_runs_its_keys_end_it() -> None:
    sent, _ = run(changed(search=SEARCHING), "s", "w", "escape")
    assert sent == [Search("stop"), Search("stop"), Search("cancel")]


def test_escape_closes_the_help_and_leaves_the_search_alone() -> None:
    assert run(changed(search=SEARCHING), "question_mark", "escape")[0] == []


def test_a_search_shows_with_the_keys_that_end_it() -> None:
    for (text,) in shown_at(changed(search=SEARCHING)):
        assert "spiral 12 s   s keep  Esc cancel" in text
        assert "…" not in text


def test_an_estimate_shows_with_its_sigmas_and_what_became_of_the_observations() -> None:
    for (text,) in shown_at(changed(estimate=ESTIMATE)):
        assert "12 of 13 seen ±0.0031 s ±0.0010°" in text
        assert "…" not in text


FRAMES = (
    ("f track", "also RA sky, cam x"),
    ("f sky", "+0.0200°", "also cam x"),
    ("f axes", "RA axis", "also RA sky, cam x"),
    ("f camera", "+0.0123°  asked +0.0500°", "also RA sky"),
)


def test_every_frame_fits_and_shows_its_own_offsets() -> None:
    async def drive() -> None:
        app = TrackApp(FakeFeed([News((changed(offsets=OFFSETS),))]), monotonic=HandClock())
        async with app.run_test(size=(120, 40)) as pilot:
            await pilot.press("left_square_bracket")
            for shown in FRAMES:
                await pilot.pause()
                text = text_of(app)
                assert "…" not in text
                for words in shown:
                    assert words in text
                await pilot.press("f")

    asyncio.run(drive())


def test_the_small_screen_shows_the_frame_that_the_arrows_move_in() -> None:
    _, text = run(changed(offsets=OFFSETS), "f", "f", "f")
    assert "…" not in text
    for words in ("cam x    +0.0123°  asked +0.0500°", "← less  → more by 0.01°", "↑ more  ↓ less by 0.01°"):
        assert words in text


def test_rejections_are_told_where_there_is_no_estimate() -> None:
    none = EstimateView(None, None, None, None, 0, 3, 2, None)
    assert "0 of 5 seen" in run(changed(estimate=none), size=(120, 40))[1]


def test_a_remembered_bias_shows_its_age_and_the_key_that_drops_it() -> None:
    known = RememberedView("observations", 1790946271.4 - 5760.0, 0.8, 0.028, -0.5, 0.02, None, 14, 1)
    views = (changed(remembered=known), changed(remembered=msgspec.structs.replace(known, state="dropped")))
    for kept, dropped in shown_at(*views):
        assert "1.6 h old ±0.028 s   m drop" in kept
        assert "m drop" not in dropped


def test_what_changes_gradually_says_by_how_much_a_second() -> None:
    gradual = (OffsetView("along_s", 1.0, 0.4, 0.02), OffsetView("cross_deg", -0.5, -0.1, -0.00125))
    for (text,) in shown_at(changed(offsets=gradual)):
        assert "+0.050 s  by +0.02000/s" in text
        assert "−0.0100°  by −0.00125/s" in text
        assert "asked" not in text
