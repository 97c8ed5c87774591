from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from itertools import chain, product
from typing import TYPE_CHECKING

import msgspec
import pytest
from tui_builders import ERROR, SKY, SUMMARY, UTC_S, VIEW, FakeFeed, HandClock, changed

from sattrack.tui.app import TrackApp
from sattrack.tui.feeds import News
from sattrack.views.messages import StopNow
from sattrack.views.run import PauseView, TwoAxesView

if TYPE_CHECKING:
    from textual.pilot import Pilot

    from sattrack.views.run import TrackView

soak = pytest.mark.soak
SMALL, LARGE, HUGE = (80, 24), (120, 40), (200, 60)
PAUSES = 200


def rows_of(app: TrackApp) -> list[str]:
    """Return what stands on the screen, row by row."""
    return ["".join(segment.text for segment in strip) for strip in app.screen._compositor.render_strips()]


def drawn(
    *views: TrackView, size: tuple[int, int] = SMALL, keys: tuple[str, ...] = (), news: News | None = None
) -> list[str]:
    """Return the screen after some views, some keys, and at last some news."""

    async def run() -> list[str]:
        feed = FakeFeed([News(views or (VIEW,))])
        app = TrackApp(feed, monotonic=HandClock())
        async with app.run_test(size=size) as pilot:
            await pilot.press(*keys)
            if news is not None:
                feed.coming.append(news)
                app.look()
            app.plot()
            await pilot.pause()
            app.look()
            await pilot.pause()
            return rows_of(app)

    return asyncio.run(run())


def drawn_in_turn(*turns: TrackView | News, size: tuple[int, int] = SMALL) -> list[list[str]]:
    """Return the screen of one app after each of some views or news, one after another."""
    return drawn_at((size,), *turns)[0]


def drawn_at(sizes: tuple[tuple[int, int], ...], *turns: TrackView | News) -> list[list[list[str]]]:
    """Return the same of one app in a terminal that has one size after another."""

    async def run() -> list[list[list[str]]]:
        feed, shown = FakeFeed(), []
        app = TrackApp(feed, monotonic=HandClock())
        async with app.run_test(size=sizes[0]) as pilot:
            for size in sizes:
                await pilot.resize_terminal(*size)
                feed.coming.append(News(rewound=True))
                await settle(app, pilot)
                shown.append([])
                for turn in turns:
                    feed.coming.append(turn if isinstance(turn, News) else News((turn,)))
                    await settle(app, pilot)
                    shown[-1].append(rows_of(app))
        return shown

    return asyncio.run(run())


async def settle(app: TrackApp, pilot: Pilot[None]) -> None:
    """Take in what has come; the chart's width follows from the layout, and the layout from that."""
    for _ in range(2):
        app.look()
        app.plot()
        await pilot.pause()


def following(seconds: float, ra_arcsec: float = 0.3, every_s: float = 0.5) -> list[TrackView]:
    """Return views of a stretch of tracking with a steady error that ends at `UTC_S`."""
    count = int(seconds / every_s)
    return [
        changed(
            utc_s=UTC_S - back * every_s,
            error={"utc_s": UTC_S - back * every_s, "ra_arcsec": ra_arcsec, "dec_arcsec": -0.1},
        )
        for back in range(count, -1, -1)
    ]


def test_the_whole_small_screen() -> None:
    rows = drawn(*following(170.0))

    assert [row.rstrip() for row in rows[:8]] == [
        " ISS (ZARYA)  25544   mount sim                         2026-10-02 13:04:31 UTC",
        "  TRACKING  on the satellite: all is well",
        " error on the sky              mount − satellite      alt    45.3°",
        " ┏━┓ ╻ ╻╺━┓″                   along        +0.40″    az     261.4° W",
        " ┃ ┃ ┗━┫┏━┛                    across       −0.12″    range  612 km",
        " ┗━┛•  ╹┗━╸                    RA on sky    +0.30″    RA     14h 11m 36.0s",
        " RMS 10 s 0.44″  pass 0.51″    Dec          −0.10″    Dec    −43° 26′ 30″",
        " begun 2:32 ago    culmination in 0:53 at 81.3°    set in 4:17",
    ]
    assert rows[8].rstrip() == " error  ⠒⠒ RA on the sky   ⠒⠒ Dec   scale ±0.5″"
    assert [row.rstrip() for row in rows[-7:]] == [
        "       −3 min                  −2 min                 −1 min                 now",
        " link     up  20.0/s  age 0.03 s   lost 0   late 0   rejected 0",
        " rates    RA +1.235 of 6 °/s ██··········  Dec −0.081 of 6 °/s ▏···········",
        " along    +0.050 s  asked +0.100 s   ← behind  → ahead on track by 0.1 s",
        " across   −0.0100°  asked −0.0200°   ↑ left  ↓ right of motion by 0.01°",
        " elements of 2026-10-02 00:19, 12.8 h old   recording pass.mcap",
        " ←→ along  ↑↓ across  [ ] step  p pause  1-6 more  SPACE STOP   q leave  ? help",
    ]


def test_no_time_is_cut_where_a_pass_begins_hours_later() -> None:
    times = {6305.0: "14:49:36 in 1:45:05", 60305.0: "in 16:45 h", 360305.0: "in 4 d 4 h"}
    turns = drawn_in_turn(*(changed(start_utc_s=UTC_S + later_s) for later_s in times), size=LARGE)
    for rows, shown in zip(turns, times.values(), strict=True):
        assert any(f"{shown} │" in row for row in rows)


def test_every_figure_is_there_and_nothing_is_cut_off() -> None:
    phases = ("waiting", "slewing", "acquiring", "tracking", "stopping")
    sizes = (SMALL, LARGE, HUGE)
    shown = drawn_at(sizes, *(changed(phase=phase) for phase in phases))
    for (size, phase), rows in zip(product(sizes, phases), chain(*shown), strict=True):
        text = "\n".join(rows)

        assert len(rows) == size[1]
        assert all(len(row) == size[0] for row in rows)
        assert "…" not in text
        for figure in (
            *("ISS (ZARYA)", "25544", "mount sim", "2026-10-02 13:04:31 UTC"),
            *("45.3°", "261.4° W", "612 km", "14h 11m 36.0s", "−43° 26′ 30″"),
            *("+0.40″", "−0.12″", "+0.31″", "−0.28″", "0.44″", "0.51″"),
            *("2:32 ago", "in 0:53", "in 4:17", "at 81.3°"),
            *("up", "20.0/s", "0.03 s", "+1.235 of 6 °/s", "−0.081 of 6 °/s"),
            *("+0.050 s", "+0.100 s", "−0.0100°", "−0.0200°", "pass.mcap", "12.8 h old"),
            *("SPACE STOP", "q leave", "? help", "−3 min", "now"),
            *("← behind", "→ ahead", "↑ left", "↓ right", "0.1 s", "0.01°"),
        ):
            assert figure in text, (size, phase, figure)


def test_the_largest_figures_fit_the_small_screen() -> None:
    view = changed(
        name="METEOSAT-12 (MTG-I1) DEB",
        catalog_number=799500000,
        mount="xerxes://192.0.2.201:44444?listen=55555",
        error={
            "total_arcsec": 648000.0,
            "along_arcsec": -648000.0,
            "ra_arcsec": -98.7,
            "dec_arcsec": -3599.0,
        },
        rms_10s_arcsec=119.99,
        rms_pass_arcsec=119.99,
        start_utc_s=UTC_S + 86300.0,
        culminate_utc_s=UTC_S + 86350.0,
        end_utc_s=UTC_S + 86399.0,
        target_alt_deg=-89.9,
        range_km=384400.0,
        ra_rate_deg_s=-5.9999,
        dec_rate_deg_s=-5.9999,
        bias_along_s=-99.999,
        bias_along_goal_s=-99.999,
        bias_cross_deg=-12.3456,
        bias_cross_goal_deg=-12.3456,
        link={"lost": 98765, "late": 9876, "rejected": 98765, "age_s": 4.99},
    )
    rows = drawn(view)

    assert rows[0].startswith(" METEOSAT-12 (MTG-I1) DEB  799500000   mount xer")
    assert rows[0].rstrip().endswith("… 2026-10-02 13:04:31 UTC"), "only the mount's address gives way"
    assert [row for row in rows[1:] if "…" in row] == []
    for figure in ("−180.0°", "−98.7″", "−60.0′", "120″", "in 23:59:59", "−89.9° not up", "384400 km"):
        assert figure in "\n".join(rows), figure


def test_before_anything_is_heard_no_number_is_made_up() -> None:
    link = {"state": "silent", "age_s": None, "rate_hz": None, "received": 0}
    rows = drawn(
        changed(
            phase="waiting",
            start_utc_s=UTC_S + 65.0,
            error=None,
            mount_ra_deg=None,
            mount_dec_deg=None,
            rms_10s_arcsec=None,
            rms_pass_arcsec=None,
            recording=None,
            link=link,
        )
    )
    text = "\n".join(rows)

    assert rows[1].startswith("  WAITING  for the pass to begin in 1:05  ")
    assert rows[2].rstrip() == " ! the mount has not answered yet: is it on, and set to send here?"
    assert "rise in 1:05" in text
    assert "RMS 10 s –  pass –" in text
    assert "link     not heard yet  –  age –" in text
    assert "recording none" in text


def test_the_headline_says_how_things_are() -> None:
    headlines = [
        (changed(phase="slewing"), "SLEWING  to where the satellite will come by"),
        (
            changed(phase="slewing", ra_rate_reached_deg_s=-2.0, dec_rate_reached_deg_s=0.0),
            "SLEWING  to where the satellite will come by",
        ),
        (
            changed(phase="slewing", ra_rate_reached_deg_s=0.0042, dec_rate_reached_deg_s=0.0),
            "WAITING  until it can be followed",
        ),
        (changed(phase="acquiring"), "ACQUIRING  closing in on the satellite"),
        (changed(error={"total_arcsec": 12.3}), "TRACKING  off the satellite by 12.3″"),
        (changed(link={"state": "stale"}), "TRACKING  blind: no fresh status from the mount"),
        (
            changed(phase="stopping", ended_by="limit:altitude"),
            "STOPPING  safety's altitude limit was reached; bringing the mount to rest",
        ),
        (changed(phase="flipping"), "FLIPPING"),
    ]
    shown = drawn_in_turn(*(view for view, _ in headlines))
    assert [rows[1].strip() for rows in shown] == [headline for _, headline in headlines]


ENDS: tuple[tuple[dict[str, object], str, str], ...] = (
    ({}, "ENDED  the pass is over; the mount is at rest; q leaves", ""),
    ({"ended_by": "operator"}, "STOPPED  by the operator; the mount is at rest; q leaves", ""),
    (
        {"ended_by": "link", "mount_stopped": False, "message": "sim fell silent"},
        "NOT STOPPED  no stop was confirmed: stop the mount by hand",
        "! sim fell silent",
    ),
    (
        {"ended_by": "link", "mount_stopped": None},
        "STOPPED  the mount's link was lost; the mount was never heard; q leaves",
        "",
    ),
)


def test_an_ended_run_says_why() -> None:
    summaries = [msgspec.structs.replace(SUMMARY, **changes) for changes, _, _ in ENDS]
    ended = (News((changed(ended_by=one.ended_by),), True, one, rewound=True) for one in summaries)
    for rows, (_, headline, second) in zip(drawn_in_turn(*ended), ENDS, strict=True):
        assert rows[1].strip() == headline
        if second:
            assert rows[2].strip() == second


def test_a_feeder_that_ends_without_a_word_is_told() -> None:
    rows = drawn(news=News((), True))

    assert rows[1].strip() == "RUN LOST  it ended unexpectedly: stop the mount by hand"


def test_warnings_come_forward_with_what_to_do() -> None:
    words = ("no fresh status from the mount: following by prediction", "something new")
    rows = drawn(changed(warnings=words, elements_age_s=5.0 * 86400.0))

    assert [row.strip() for row in rows[2:6]] == [
        f"! {words[0]}: check the mount's",
        "power and cable; SPACE stops",
        "! something new",
        "! elements are 5.0 days old: expect the satellite early or late: ← → nudge",
    ]
    assert rows[6].startswith(" error on the sky"), "the rest moves down and stays whole"
    assert rows[-1].startswith(" ←→ along")


def test_an_ephemeris_of_the_future_is_ahead_and_elements_alone_are_warned_of_either_way() -> None:
    days = 56.5 * 86400.0
    sources = (None, "SGP4, elements of 2026-10-02T00:00:00Z", "CPF 2 by HTS")
    ahead = drawn_in_turn(*(changed(source=one, elements_age_s=-days) for one in sources), size=HUGE)
    for rows in ahead:
        text = "\n".join(rows)
        assert "56.5 days ahead" in text
        assert "ahead old" not in text
    assert [
        "! elements are 56.5 days ahead: see that this machine's clock is right" in "".join(rows)
        for rows in ahead
    ] == [True, True, False]
    old = drawn_in_turn(*(changed(source=one, elements_age_s=days) for one in sources))
    warned = [any("expect the satellite early or late" in row for row in rows) for rows in old]
    assert warned == [True, True, False]
    assert not any("clock is right" in "".join(rows) for rows in old)


CPF = "CPF 2 by HTS of 2018-06-13T12h, Lagrange, degree 13"
LASER_FILE = "lageos1_cpf_180613_16401.hts"
SOURCES: tuple[tuple[dict[str, object], tuple[str, ...]], ...] = (
    (
        {"source": CPF, "source_file": LASER_FILE, "elements_age_s": 51480.0},
        (LASER_FILE, "14.3 h old", "error not stated"),
    ),
    (
        {"source": CPF, "source_file": LASER_FILE, "elements_age_s": -56.5 * 86400.0, "t0_utc_s": None},
        (LASER_FILE, "56.5 days ahead", "stated"),
    ),
    (
        {"source": "SP3-d by GFZ", "source_file": "gbm18432.sp3", "expected_error_m": 0.0254},
        ("gbm18432.sp3", "12.8 h old", "error 0.0254 m"),
    ),
    (
        {"source": "table of alt_deg", "source_file": "launch.csv", "t0_utc_s": UTC_S - 12.0},
        ("launch.csv", "T+12 s", "error not stated"),
    ),
    # Of a recording that does not name the file yet.
    ({"source": "CPF 2 by HTS", "expected_error_m": 3420.0}, ("CPF 2 by HTS", "12.8 h old", "error 3.42 km")),
    ({"source": "JPL's DE421", "elements_age_s": None, "expected_error_m": None}, ("JPL's DE421",)),
)


@pytest.mark.parametrize(
    "size",
    [
        SMALL,
        (119, 40),
        LARGE,
        *(pytest.param(size, marks=soak) for size in ((100, 30), (110, 40), (200, 50))),
    ],
)
def test_the_source_its_age_and_its_error_are_whole_at_every_size(size: tuple[int, int]) -> None:
    turns = (News((changed(**changes),), sky=SKY, rewound=True) for changes, _ in SOURCES)
    for rows, (_, shown) in zip(drawn_in_turn(*turns, size=size), SOURCES, strict=True):
        text = "\n".join(rows)
        assert len(rows) == size[1]
        assert "…" not in text
        for figure in (*shown, "in 0:53", "81.3°", "pass.mcap", "±400″"):
            assert figure in text, (size, figure)


def test_of_a_long_name_the_middle_gives_way_and_neither_age_nor_error() -> None:
    name = f"lageos1_cpf_180613_16401{'_v02' * 12}.hts"
    for (rows,) in drawn_at((SMALL, LARGE), changed(source=CPF, source_file=name)):
        text = "\n".join(rows)
        assert "lageos1_cpf_" in text
        assert "v02.hts" in text
        assert text.count("…") == 1
        for figure in ("12.8 h old", "error not stated", "pass.mcap"):
            assert figure in text


def test_the_panel_of_the_pass_has_the_elements_error_where_there_is_room() -> None:
    view = changed(source="SGP4, elements of 2026-10-02T00:00:00Z", expected_error_m=2312.0)
    figures = {(200, 50): "12.8 h old, error 2.31 km", LARGE: "12.8 h, ±2.31 km"}
    for figure, (rows,) in zip(figures.values(), drawn_at(tuple(figures), view), strict=True):
        assert any(figure in row for row in rows)


def test_of_elements_the_file_is_named_where_there_is_room() -> None:
    view = changed(source="SGP4, elements of 2026-10-02T00:00:00Z", source_file="stations.tle")
    (wide,), (small,) = drawn_at(((200, 50), SMALL), view)
    assert any("stations.tle" in row for row in wide)
    assert any("12.8 h" in row for row in wide)
    assert any("12.8 h" in row for row in small)


def test_of_elements_the_instant_is_named_where_there_is_room() -> None:
    age_s = UTC_S - datetime(2026, 9, 30, 21, 30, tzinfo=UTC).timestamp()
    for error_m, error in ((2312.0, ", error 2.31 km"), (None, "")):
        view = changed(source="SGP4", elements_age_s=age_s, expected_error_m=error_m)
        figure = f"of 2026-09-30 21:30, 39.6 h old{error}"
        *shown, large = ("\n".join(rows) for (rows,) in drawn_at((SMALL, (100, 30), (200, 50), LARGE), view))
        for text in shown:
            assert figure in text
            assert "pass.mcap" in text
        assert "of 2026" not in large


def test_silence_of_the_feeder_and_an_unheard_stop_are_told() -> None:
    clock = HandClock()

    async def run() -> list[str]:
        app = TrackApp(FakeFeed([News((VIEW,))]), monotonic=clock)
        async with app.run_test(size=SMALL) as pilot:
            await pilot.press("space")
            await pilot.pause()
            first = rows_of(app)
            clock.now_s += 3.0
            app.look()
            await pilot.pause()
            return [first[1], *rows_of(app)[1:3]]

    first, headline, caution = asyncio.run(run())
    assert first.strip() == "STOP SENT  not confirmed yet"
    assert headline.strip() == "NO NEWS  from the run for 3 s: figures below are old"
    assert caution.strip() == "! the run does not answer: press SPACE, then use the mount's own stop"


def test_a_stop_that_is_not_obeyed_is_told() -> None:
    clock = HandClock()

    async def run() -> str:
        feed = FakeFeed([News((VIEW,))])
        app = TrackApp(feed, monotonic=clock)
        async with app.run_test(size=SMALL) as pilot:
            await pilot.press("space")
            clock.now_s += 3.0
            feed.coming.append(News((VIEW,)))
            app.look()
            await pilot.pause()
            return rows_of(app)[2]

    assert asyncio.run(run()).strip() == "! the stop was not obeyed: use the mount's own stop"


def test_the_help_shows_every_key_whole() -> None:
    async def run() -> list[str]:
        app, shown = TrackApp(FakeFeed([News((VIEW,))]), monotonic=HandClock()), []
        async with app.run_test(size=SMALL) as pilot:
            await pilot.press("question_mark")
            for size in (SMALL, LARGE):
                await pilot.resize_terminal(*size)
                await pilot.pause()
                shown.append("\n".join(rows_of(app)))
        return shown

    keys = (
        "SPACE",
        "p  ",
        "P  ",
        "Ctrl-C",
        "1 to 6",
        "← →",
        "↑ ↓",
        "[ ]",
        "r  0",
        "?  Esc  q close this help",
    )
    for text, key in product(asyncio.run(run()), keys):
        assert key in text


def test_the_plot_has_its_scale_and_both_lines() -> None:
    rows = drawn(*following(170.0, ra_arcsec=0.8), size=LARGE)
    text = "\n".join(rows)

    for label in ("+1″", "+0.5″", "−0.5″", "−1″", "−3 min", "−2 min", "−1 min", "scale ±1″"):
        assert label in text
    lines = [row for row in rows if sum("⠁" <= cell <= "⣿" for cell in row) > 90]
    assert len(lines) >= 2


def test_what_lies_beyond_the_scale_is_told() -> None:
    approach = changed(
        phase="acquiring", utc_s=UTC_S - 100.0, error={"utc_s": UTC_S - 100.0, "ra_arcsec": 80.0}
    )
    early = [changed(utc_s=v.utc_s, error=v.error) for v in following(90.0, ra_arcsec=0.02)]

    async def run() -> tuple[str, str]:
        feed = FakeFeed([News((approach,))])
        app = TrackApp(feed, monotonic=HandClock())
        async with app.run_test(size=SMALL) as pilot:
            app.plot()
            await pilot.pause()
            first = rows_of(app)[8]
            for view in early:
                feed.coming.append(News((view,)))
                app.look()
                app.plot()
            await pilot.pause()
            return first, rows_of(app)[8]

    first, last = asyncio.run(run())
    assert first.rstrip().endswith("scale ±100″")
    assert last.rstrip().endswith("scale ±0.2″   some beyond the scale")


def test_without_colour_the_lines_differ_in_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    text = "\n".join(drawn(*following(170.0)))

    assert "▀▀ RA on the sky   ⠒⠒ Dec" in text
    assert any(block in text for block in "▘▝▖▗▀▄▌▐▛▜▙▟")


def test_with_sixteen_colours_the_lines_differ_in_shape_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("textual.app.App.is_headless", False)
    systems = ("standard", "256", "truecolor", None)

    async def run() -> list[str]:
        app, shown = TrackApp(FakeFeed([News(tuple(following(170.0)))]), monotonic=HandClock()), []
        async with app.run_test(size=SMALL) as pilot:
            for system in systems:
                monkeypatch.setattr("rich.console.Console.color_system", system)
                app.plot()
                await pilot.pause()
                shown.append("\n".join(rows_of(app)))
        return shown

    for system, text in zip(systems, asyncio.run(run()), strict=True):
        shapes = system in {"standard", None}
        assert ("▀▀ RA on the sky" in text) is shapes
        assert ("⠒⠒ RA on the sky" in text) is not shapes


@pytest.mark.parametrize("size", [SMALL, LARGE, HUGE])
def test_the_starting_screen_is_laid_out_as_it_stays(size: tuple[int, int]) -> None:
    async def run() -> list[dict[str, object]]:
        feed = FakeFeed([])
        app = TrackApp(feed, monotonic=HandClock())
        async with app.run_test(size=size) as pilot:
            places = []
            for news in (News(), News((VIEW,), sky=SKY)):
                feed.coming.append(news)
                app.look()
                for _ in range(3):
                    app.plot()
                    await pilot.pause()
                shown = [each for each in app.query("#live, #live Panel, #sky, KeyBar") if each.display]
                places.append({f"{type(each).__name__}#{each.id}": each.region for each in shown})
            return places

    before, after = asyncio.run(run())
    assert before == after


def test_a_terminal_that_is_too_small_says_so_and_stops_the_mount() -> None:
    sizes = ((20, 5), (59, 30), (100, 11))

    async def run() -> None:
        feed = FakeFeed([News((VIEW,))])
        app = TrackApp(feed, monotonic=HandClock())
        async with app.run_test(size=sizes[0]) as pilot:
            for size in sizes:
                await pilot.resize_terminal(*size)
                feed.sent.clear()
                await pilot.press("space")
                await pilot.pause()
                rows = rows_of(app)
                assert [row.rstrip() for row in rows[:3]] == [
                    f"too small: {size[0]} × {size[1]}",
                    "80 × 24 is enough",
                    " SPACE STOP  q leave",
                ]
                assert not "".join(rows[3:]).strip()
                await pilot.click(offset=(4, 2))
                await pilot.click(offset=(4, 1))
                assert feed.sent == [StopNow(), StopNow()]
                await pilot.resize_terminal(80, 24)
                await pilot.pause()
                assert "too small" not in "".join(rows_of(app))

    asyncio.run(run())


async def resized(app: TrackApp, pilot: Pilot[None], size: tuple[int, int]) -> list[str]:
    """Return the screen at another size, as soon as it is drawn so: a busy machine takes long to be idle."""
    await pilot.resize_terminal(*size)
    app.look()
    for _ in range(PAUSES):
        await pilot.pause()
        rows = rows_of(app)
        if (len(rows[-1]), len(rows)) == size and " SPACE STOP " in "".join(rows):
            return rows
    pytest.fail(f"no stop at {size}: {rows}")


def test_the_stop_is_seen_whole_at_every_size_that_is_not_too_small() -> None:
    async def run() -> None:
        app = TrackApp(FakeFeed([News((VIEW,))]), monotonic=HandClock())
        async with app.run_test(size=LARGE) as pilot:
            for page in ("1", "2", "5"):
                await pilot.press(page)
                for size in ((60, 12), (70, 24), SMALL, (91, 17)):
                    rows = await resized(app, pilot, size)
                    assert " SPACE STOP " in rows[-1], (page, size)

    asyncio.run(run())


def test_any_size_is_survived() -> None:
    async def run() -> list[str]:
        app = TrackApp(FakeFeed([News((VIEW,))]), monotonic=HandClock())
        async with app.run_test(size=SMALL) as pilot:
            for size in ((1, 1), (200, 60), (20, 5), (81, 25), (3, 50), SMALL):
                await pilot.resize_terminal(*size)
                app.look()
                app.plot()
                await pilot.pause()
                assert len(rows_of(app)) == size[1]
            return await resized(app, pilot, SMALL)

    assert asyncio.run(run())[1].strip() == "TRACKING  on the satellite: all is well"


def test_markup_in_names_is_text() -> None:
    rows = drawn(changed(name="[b]X[/b]", recording="[red]a.mcap", error=ERROR))

    assert rows[0].startswith(" [b]X[/b]  25544")
    assert "recording [red]a.mcap" in "\n".join(rows)


def test_before_a_pass_the_headline_says_how_long_it_is_to_it() -> None:
    waiting = changed(phase="waiting", start_utc_s=UTC_S + 125.0)
    slewing = changed(waiting, phase="slewing", ra_rate_reached_deg_s=-10.0, dec_rate_reached_deg_s=2.5)
    first, rows = drawn_in_turn(waiting, slewing)

    assert first[1].strip() == "WAITING  for the pass to begin in 2:05"
    assert rows[1].strip() == "SLEWING  to where the satellite will come by in 2:05"
    assert " rates    RA −10.000 °/s  Dec +2.500 °/s" in [row.rstrip() for row in rows]


def test_what_is_over_is_not_shown_as_going_on() -> None:
    rows = drawn(*following(60.0), news=News((changed(ended_by="operator"),), True, SUMMARY))
    text = "\n".join(rows)

    assert rows[0].rstrip().endswith("as of 2026-10-02 13:04:31 UTC")
    assert " link     closed  age –   lost 0" in text
    assert rows[-1].startswith(" 1 live  2 tonight"), "no nudge is offered"


def test_a_plot_without_a_line_has_no_scale() -> None:
    rows = drawn(changed(phase="waiting", error=None))

    assert " error  ⠒⠒ RA on the sky   ⠒⠒ Dec   nothing followed yet" in [row.rstrip() for row in rows]


def test_a_window_in_time_neither_rises_nor_sets() -> None:
    window = msgspec.structs.replace(SKY, rises=False, sets=False)
    to_come = changed(phase="waiting", start_utc_s=UTC_S + 65.0)
    shown = drawn_in_turn(*(News((view,), sky=window) for view in (to_come, VIEW)))
    for rows, first in zip(shown, ("begin in 1:05", "begun 2:32 ago"), strict=True):
        text = "\n".join(rows)
        assert first in text
        assert "end in 4:17" in text
        assert "set in" not in text


def test_what_the_engine_warns_of_comes_with_what_to_do() -> None:
    warnings = {
        "the stop is not confirmed yet: it is being sent again and again": "use its own stop",
        "the mount's clock does not run as ours: samples are dated by arrival": "calibrate after the pass",
        "this side of the pier is not in the mount's profile: its rates may go the other way": "SPACE stops",
        "the mount was not where its commands lead: lost, and taken up where it is": "SPACE stops",
        "another program is sending commands to this mount: end it, or motions will mix": "SPACE stops",
    }
    shown = drawn_in_turn(*(changed(warnings=(said,)) for said in warnings), size=LARGE)
    for rows, (said, do) in zip(shown, warnings.items(), strict=True):
        text = " ".join(" ".join(rows).split())
        assert f"! {said}: " in text
        assert do in text


def test_a_fast_slew_fits_and_a_longer_delay_moves_nothing() -> None:
    slewing = changed(phase="slewing", ra_rate_reached_deg_s=-10.0, dec_rate_reached_deg_s=-10.0)
    delayed = [changed(link={"delay_ms": delay_ms}) for delay_ms in (0.1, 9.94, 12.3, 999.4)]
    for slewed, *shown in drawn_at((SMALL, LARGE, HUGE), slewing, *delayed):
        text = "\n".join(slewed)
        assert text.count("−10.000") == 2
        assert "…" not in text
        # The largest rate of a command says nothing of the mount's own slew.
        assert " of 6" not in text

        for rows, said in zip(shown, ("0.1 ms", "9.9 ms", "12 ms ", "999 ms"), strict=True):
            assert [row.replace("0.1 ms", said) for row in shown[0]] == rows


def test_a_mount_that_is_not_calibrated_is_called_so_and_pushes_nothing_out() -> None:
    url = "xerxes://192.168.100.120:15001?listen=15001"
    for plain, rows in drawn_at(
        (SMALL, LARGE), *(changed(mount=url, calibrated=is_) for is_ in (True, False))
    ):
        (number,) = (n for n, row in enumerate(rows) if "uncalibrated" in row)
        assert "TRACKING  on the satellite: all is well" in rows[number]
        assert rows[number].rstrip().endswith("uncalibrated")
        assert rows[number].replace("uncalibrated", " " * 12) == plain[number]
        assert rows[:number] + rows[number + 1 :] == plain[:number] + plain[number + 1 :]


def test_a_simulated_mount_and_an_older_recording_are_not_called_uncalibrated() -> None:
    simulated, older = changed(mount="sim", calibrated=False), changed(mount="x", calibrated=None)
    for rows in drawn_in_turn(simulated, older):
        assert not any("uncalibrated" in row for row in rows)


def test_a_long_headline_is_not_cut_for_it() -> None:
    paused = changed(
        mount="x",
        calibrated=False,
        phase="paused",
        pause=PauseView(UTC_S - 5.0, at_rest=False, jogging=False, going_on=True),
    )
    (row,) = (row for row in drawn(paused) if "PAUSED" in row)
    assert "going on as soon as the mount is at rest; the pass lasts 4:17 more" in row
    assert "uncal" not in row


def test_a_field_that_rotates_is_shown_with_its_rate() -> None:
    axes = TwoAxesView(40.0, 50.0, 0.3, -0.1, -123.4, 0.5123)
    for rotating, still in drawn_at((SMALL, LARGE), changed(axes=axes), VIEW):
        shown = "\n".join(rotating)
        assert "field  −123° +0.512°/s" in shown
        assert "ax 1 on sky" in shown
        assert "ax 1 on the sky   ⠒⠒ ax 2" in shown
        assert "RA on" not in shown
        assert "°/s" in shown
        assert not any("field  " in row and "°/s" in row for row in still)
