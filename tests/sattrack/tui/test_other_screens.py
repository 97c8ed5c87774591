"""Tonight, mount and log: their keys, their lists, and the stop in all of them, whatever lies on them."""

from __future__ import annotations

import asyncio
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import pytest
from console_tui_builders import VIEW as MOUNT_VIEW
from textual.events import MouseScrollUp
from tui_builders import SUMMARY, UTC_S, VIEW, FakeFeed, HandClock, changed

from sattrack.core.errors import SattrackError
from sattrack.tui.app import TrackApp
from sattrack.tui.feeds import Latest, News, PassRow, read_passes
from sattrack.tui.pages import MOST_LINES, LogBook, PassList
from sattrack.tui.scene import PAGES, Tone
from sattrack.views.messages import Arm, Disarm, StopNow
from sattrack.views.run import STARTER, Armed, LearntView, SessionView, Watcher
from sattrack.views.schedule import SchedulePassView, ScheduleView
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

    from textual.pilot import Pilot

    from sattrack.views.run import ConsoleView

HERE = SessionView(STARTER, (), 0, takes_others=True)
ELSEWHERE = SessionView(STARTER, (Watcher(4, "anna"),), 1)


def pass_row(number: int, minutes: float, alt_deg: float = 50.0, **changes: Any) -> PassRow:
    culminates = Utc(UTC_S + 60.0 * minutes)
    told: dict[str, Any] = {
        "name": f"SAT {number}",
        "catalog_number": number,
        "rise_utc": culminates.plus(-300.0).isoformat(),
        "culminate_utc": culminates.isoformat(),
        "set_utc": culminates.plus(300.0).isoformat(),
        "max_alt_deg": alt_deg,
        "rise_az_deg": 270.0,
        "set_az_deg": 90.0,
        "sunlit_from_utc": None,
        "sunlit_to_utc": None,
        "sun_alt_deg": -20.0,
        "feasible": True,
        "why_not": None,
        "magnitude": None,
        **changes,
    }
    return read_passes(json.dumps([told]).encode())[0]


ROWS = (
    pass_row(25544, 53.0 / 60.0, 81.0, name="ISS (ZARYA)"),
    pass_row(101, 20.0, sunlit_from_utc="2026-10-02T13:20:00Z", sunlit_to_utc="2026-10-02T13:25:00Z"),
    pass_row(102, 40.0, 20.0, feasible=False, why_not="too fast for the hour angle axis near the pole"),
    pass_row(103, 60.0),
)


@dataclass
class FakeSearch:
    rows: tuple[PassRow, ...] | None = ROWS
    begun_utc_s: float | None = None
    trouble: str = ""
    busy: bool = False
    begun: list[float] = field(default_factory=list)

    def begin(self, utc_s: float) -> None:
        self.begun.append(utc_s)
        self.begun_utc_s = utc_s

    def take(self) -> tuple[PassRow, ...] | None:
        rows, self.rows = self.rows, None
        return rows

    def close(self) -> None:
        self.busy = False


@dataclass
class FakeLook:
    opened: list[int] = field(default_factory=list)
    trouble: str = ""
    closed: int = 0
    view: ConsoleView = MOUNT_VIEW

    def open(self, pid: int) -> None:
        self.opened.append(pid)

    def latest(self) -> Latest:
        return Latest(self.view if self.opened else None)

    def close(self) -> None:
        self.closed += 1


@dataclass
class FakeHelpers:
    search: FakeSearch = field(default_factory=FakeSearch)
    look: FakeLook = field(default_factory=FakeLook)
    pid: int = 4321
    console: list[str] | None = None

    def close(self) -> None:
        self.look.close()


def on_screen(
    act: Callable[[TrackApp, Pilot[None]], Any],
    *news: News,
    size: tuple[int, int] = (80, 24),
    helpers: FakeHelpers | None = None,
) -> FakeFeed:
    """Run the screen, have something done with it, and return what it was told to say."""
    feed = FakeFeed(list(news) or [News((VIEW,), session=HERE)])

    async def run() -> None:
        app = TrackApp(feed, monotonic=HandClock(), helpers=helpers or FakeHelpers())  # type: ignore[arg-type]
        async with app.run_test(size=size) as pilot:
            await act(app, pilot)

    asyncio.run(run())
    return feed


def text_of(app: TrackApp) -> str:
    """Return what stands on the screen."""
    strips = app.screen._compositor.render_strips()
    return "\n".join("".join(segment.text for segment in strip) for strip in strips)


OVER = {"nothing": (), "help": ("question_mark",), "leave": ("q",), "next": ("1", "n")}


def test_space_stops_in_every_screen_and_over_everything_that_lies_on_it() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        sent = app._feed.sent  # type: ignore[attr-defined]
        for page in PAGES:
            for keys in OVER.values():
                sent.clear()
                await pilot.press(page, *keys, "space")
                assert sent == [StopNow()], (page, keys)
                assert len(app.screen_stack) == 1
                app._stop_sent_s = None

    on_screen(act)


def test_a_pass_that_goes_on_is_up_and_has_no_time_of_rising() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("2")
        rows = [row.rstrip() for row in text_of(app).splitlines() if "SAT 9" in row]
        assert rows == [" ▶ is up    13:05:31 13:10:31  50°  SAT 9                     go"]

    on_screen(act, helpers=FakeHelpers(FakeSearch((pass_row(9, 1.0, rise_utc=None),))))


def test_tonight_arms_takes_back_and_follows_what_is_pointed_at() -> None:
    one, two = ROWS[1], ROWS[2]

    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        sent = app._feed.sent  # type: ignore[attr-defined]
        await pilot.press("2", "down", "enter")
        assert sent == [Arm(101, one.culminate_utc_s, "SAT 101")]
        queue = (Armed(101, one.culminate_utc_s + 3.0, "SAT 101"),)
        app._feed.coming.append(News((VIEW,), session=SessionView(STARTER, (), 0, queue=queue)))  # type: ignore[attr-defined]
        app.look()
        await pilot.pause()
        assert "armed 1" in text_of(app)
        sent.clear()
        await pilot.press("enter", "down", "up", "up", "up", "left", "right", "0", "s", "w", "r", "m", "u")
        assert sent == [Disarm(101, one.culminate_utc_s)]
        sent.clear()
        await pilot.press("end", "home", "down", "down", "a", "x")
        assert sent == []
        await pilot.press("a", "y")
        assert sent == [Arm(102, two.culminate_utc_s, "SAT 102", now=True)]

    on_screen(act)


def test_before_a_satellite_is_left_it_is_said_for_which_pass_and_whether_that_can_be_followed() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        for keys, no_go in (("down", "a"), False), (("down", "a"), True):
            await pilot.press("2", *keys)
            text = " ".join(text_of(app).replace("│", " ").split())
            assert f"leave ISS (ZARYA) for SAT {101 + no_go}?" in text
            assert ("highest at 13:24:31 with 50°." in text) is not no_go
            says = "That pass is no-go: too fast for the hour angle axis near the pole. y does it"
            assert (says in text) is no_go
            await pilot.press("x")

    on_screen(act)


def test_next_and_before_go_by_the_list_and_ask() -> None:
    cases = ((["n", "y"], [101]), (["n", "n"], []), (["b", "y"], []), (["n", "escape"], []))

    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        sent = app._feed.sent  # type: ignore[attr-defined]
        for keys, numbers in cases:
            sent.clear()
            await pilot.press(*keys)
            assert [one.catalog_number for one in sent if isinstance(one, Arm)] == numbers, keys
            assert all(one.now for one in sent if isinstance(one, Arm))
            assert len(app.screen_stack) == 1

    on_screen(act)


def test_nothing_is_asked_while_a_satellite_is_waited_for_and_after_a_run() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("n")

    waiting = on_screen(act, News((changed(phase="waiting"),), session=HERE))
    over = on_screen(act, News((VIEW,), False, SUMMARY, session=HERE))

    assert [type(one) for one in waiting.sent] == [type(one) for one in over.sent] == [Arm]


def test_who_looks_on_arms_nothing() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("2", "down", "enter", "a", "n", "b")
        assert len(app.screen_stack) == 1

    assert on_screen(act, News((VIEW,), session=SessionView(7, (), 1))).sent == []


def test_after_a_run_a_stop_is_said_as_long_as_anybody_hears_and_another_pass_is_followed_at_once() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("2", "down", "enter", "space", "1", "right")

    sent = on_screen(act, News((VIEW,), False, SUMMARY, session=HERE)).sent

    assert sent == [Arm(101, ROWS[1].culminate_utc_s, "SAT 101", now=True), StopNow()]


def test_another_run_begins_with_nothing_of_the_one_before() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("space")
        assert app._ended
        app._feed.coming.append(News((), rewound=True, session=HERE))  # type: ignore[attr-defined]
        app._monotonic.now_s += 5.0  # type: ignore[attr-defined]
        app.look()
        await pilot.pause()
        assert "STARTING" in text_of(app)
        assert "silent" not in text_of(app)
        other = changed(name="SAT 101", catalog_number=101, phase="waiting", error=None)
        app._feed.coming.append(News((other,), rewound=True, session=HERE))  # type: ignore[attr-defined]
        app.look()
        assert app.scene is not None
        assert (app.scene.ended, app.scene.summary, app.scene.stop_sent_s) == (False, None, None)
        await pilot.press("space")

    assert on_screen(act, News((VIEW,), False, SUMMARY, session=HERE)).sent == [StopNow(), StopNow()]


def test_the_mouse_points_to_a_pass_and_scrolls() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("2")
        await pilot.click("#tonight", offset=(8, 4))
        assert app._screens.night.cursor == 2
        await pilot._post_mouse_events([MouseScrollUp], widget="#tonight")
        assert app._screens.night.cursor == 0

    on_screen(act)


def test_every_screen_says_what_it_has_to_and_cuts_nothing_off() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        for size in ((80, 24), (200, 60)):
            await pilot.resize_terminal(*size)
            shown = {}
            for key, page in PAGES.items():
                await pilot.press(key)
                app.look()
                await pilot.pause()
                shown[page] = text_of(app)
            for text in shown.values():
                assert "TRACKING" in text
                assert "SPACE STOP" in text
            for words in (
                "SAT 101",
                "SAT 103",
                "13:24:31",
                "NO-GO",
                "this one",
                "go",
                "Enter" if size[0] > 80 else "",
            ):
                assert words in shown["tonight"]
            for words in ("RA rate", "altitude", "side", "acknowledged", "as the run hears it"):
                assert words in shown["mount"]
            for words in ("ISS (ZARYA): tracking", "link up", "the newest"):
                assert words in shown["log"]

    on_screen(act)


def test_the_mount_screen_tells_what_was_learnt_of_it() -> None:
    learnt = LearntView(0.111, 0.009, 1.0203, 0.002, -0.004, 0.009, None, None, 0.02, 0.12, 0)

    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("3")
        app.look()
        await pilot.pause()
        assert "learnt: lag 111, −4 ms  gain 1.0203, ?  settling 0.12 s" in text_of(app)

    on_screen(act, News((changed(learnt=learnt),), session=HERE), size=(120, 40))


def test_the_mount_screen_has_the_run_s_word_on_the_mount_s_clock() -> None:
    here = msgspec.structs.replace(MOUNT_VIEW, clock_offset_s=9000.0)

    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("3")
        app.look()
        await pilot.pause()
        assert "its clock  +0.02 s = 0.3″" in text_of(app)

    run = changed(mount="xerxes://10.0.0.2:5000", link={"clock_offset_s": 0.02})
    helpers = FakeHelpers(look=FakeLook(view=here))
    on_screen(act, News((run,), session=ELSEWHERE, you=4), helpers=helpers)


def test_the_end_of_a_run_that_was_started_elsewhere_does_not_end_a_real_mount() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("3")
        app.look()
        await pilot.pause()
        text = text_of(app)
        assert "the run is over: `sattrack mount watch` operates the mount by hand" in text
        assert "simulated" not in text

    over = changed(mount="xerxes://10.0.0.2:5000", ended_by="operator")
    on_screen(act, News((over,), True, SUMMARY, session=ELSEWHERE, you=4))


def test_a_pass_of_elements_without_a_number_is_listed_and_is_not_armed() -> None:
    night = PassList()
    night.take((pass_row(7, 1.0, catalog_number=None, name="NEW OBJECT"), pass_row(8, 20.0)))

    assert night.count == 2
    assert night.arm((), now=True) is None
    assert "NEW OBJECT" in night.rows[0].name
    night.move(1)
    assert night.arm((), now=True) == Arm(8, night.rows[1].culminate_utc_s, "SAT 8", now=True)


def test_a_mount_is_looked_at_only_while_its_screen_is_wanted() -> None:
    helpers = FakeHelpers()

    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        assert helpers.look.opened == []
        await pilot.press("3")
        app.look()
        assert set(helpers.look.opened) == {4321}
        await pilot.press("1")
        app._monotonic.now_s += 31.0  # type: ignore[attr-defined]
        app.look()
        assert helpers.look.closed

    on_screen(act, helpers=helpers)


def test_the_search_begins_when_it_is_first_wanted_and_again_when_it_is_old() -> None:
    helpers = FakeHelpers(FakeSearch(rows=None))

    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        assert helpers.search.begun == []
        await pilot.press("2")
        app.look()
        assert helpers.search.begun == [UTC_S]
        app._feed.coming.append(News((changed(utc_s=UTC_S + 601.0),)))  # type: ignore[attr-defined]
        app.look()
        assert helpers.search.begun == [UTC_S, UTC_S + 601.0]
        await pilot.press("g")
        assert len(helpers.search.begun) == 3

    on_screen(act, helpers=helpers)


def test_filters_let_through_what_they_say_and_the_cursor_stays_on_its_pass() -> None:
    night = PassList()
    night.take(ROWS)
    night.move(3)
    shown = []
    for _ in range(4):
        shown.append((night.filter_label, [row.catalog_number for row in night.rows]))
        assert night.pointed is not None
        night.turn_filter()

    assert shown == [
        ("all", [25544, 101, 102, 103]),
        ("go", [25544, 101, 103]),
        ("above 30°", [25544, 101, 103]),
        ("sunlit by night", [101]),
    ]
    night.take(())
    assert night.pointed is None
    night.move(5)
    assert night.arm((), now=True) is None
    assert night.point_next_to(1, 25544, UTC_S) is None


def test_the_log_has_a_line_for_what_changed_and_not_for_what_stayed() -> None:
    book = LogBook()
    for second in range(5):
        book.take(changed(utc_s=UTC_S + second, warnings=(f"the mount's clock is {second} ms off",)))
    book.take(changed(utc_s=UTC_S + 5.0, link={"state": "stale"}))
    book.take(changed(utc_s=UTC_S + 6.0, phase="stopping", ended_by="limit:sun"))
    book.hear(SessionView(None, (), 0, said="anna took control"))
    book.hear(SessionView(None, (), 0, said="anna took control"))
    book.end(SUMMARY)

    assert [one.text for one in book.lines] == [
        "ISS (ZARYA): tracking, 0.42″ off",
        "link up",
        "the mount's clock is 0 ms off",
        "link stale",
        "ISS (ZARYA): stopping",
        "link up",
        "safety's sun limit was reached",
        "anna took control",
        "ISS (ZARYA): 400 s on target, error 0.02″ RMS; mount at rest",
    ]
    assert [one.text for one in book.shown("people")] == ["anna took control"]
    assert {one.tone for one in book.shown("warnings")} <= {Tone.NOTICE, Tone.BAD}


def test_a_log_that_was_scrolled_back_keeps_its_place() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        for number in range(100):
            app._screens.book.say(Tone.CALM, "run", f"line {number}")
        await pilot.press("5", "up", "up", "up")
        await pilot.pause()
        before = [row for row in text_of(app).splitlines() if "line" in row and "lines" not in row]
        app._screens.book.say(Tone.CALM, "run", "one more")
        app.look()
        await pilot.pause()
        text = text_of(app)
        assert [row for row in text.splitlines() if "line" in row and "lines" not in row] == before
        assert "4 later ones below" in text
        await pilot.press("end")
        await pilot.pause()
        assert "one more" in text_of(app)

    on_screen(act)


def test_the_log_is_bounded() -> None:
    book = LogBook()
    for number in range(MOST_LINES + 10):
        book.say(Tone.CALM, "run", str(number))

    assert len(book.lines) == MOST_LINES
    assert book.dropped == 10
    assert book.lines[-1].text == str(MOST_LINES + 9)


def schedule_view(**changes: Any) -> ScheduleView:
    def one(number: int, minutes: float, state: str, **more: Any) -> SchedulePassView:
        times = [Utc(UTC_S + 60.0 * minutes + ahead).isoformat() for ahead in (-300.0, 0.0, 300.0)]
        return SchedulePassView(number, f"SAT {number}", number, *times, 50.0, 1.0, state, **more)

    passes = (
        one(101, -90.0, "done", rms_arcsec=0.31),
        one(102, -30.0, "lost", cause="weather", words="clouds"),
        one(25544, 53.0 / 60.0, "in progress"),
        *(one(200 + number, 30.0 * number, "waiting") for number in range(1, 40)),
    )
    told: dict[str, Any] = {
        "utc_s": UTC_S,
        "schedule": "night.toml",
        "state": "following",
        "doing": "following ISS (ZARYA)",
        "mount": "moving",
        "night": 1,
        "from_utc": "2026-10-02T18:00:00Z",
        "to_utc": "2026-10-03T05:00:00Z",
        "passes": passes,
        "not_planned": 3,
        "current": 25544,
        "notes": ("SAT 102 was lost to clouds",),
        **changes,
    }
    return ScheduleView(**told)


@pytest.mark.parametrize("size", [(80, 24), (120, 40)])
def test_the_schedule_of_a_run_shows_what_was_what_is_and_what_comes(size: tuple[int, int]) -> None:
    asked: list[Path] = []

    def read(folder: Path) -> ScheduleView:
        asked.append(folder)
        return schedule_view()

    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        app._screens._read = read
        await pilot.press("4")
        app.look()
        await pilot.pause()
        text = text_of(app)
        for words in (
            "FOLLOWING",
            "night.toml",
            "1 of 42 done",
            "▶",
            "SAT 102 was lost to clouds",
            "in progress",
        ):
            assert words in text
        assert "SAT 101" not in text, "it begins one pass before the present one"
        await pilot.press("up")
        await pilot.pause()
        assert "0.31″" in text_of(app)

    on_screen(act, News((changed(recording="/night.run/recordings/a.mcap"),), session=HERE), size=size)
    assert asked == [Path("/night.run")], "and read no more often than every two seconds"


NOBODY: tuple[tuple[str, dict[str, Any], str], ...] = (
    ("ended", {}, "ENDED  the schedule is over"),
    ("stopped", {}, "STOPPED  its runner has ended; run it again to continue"),
    (
        "stopped",
        {"stopped_utc": "2026-10-02T20:00:00Z", "resume": "sattrack run n.toml --resume"},
        "STOPPED  by an operator; sattrack run n.toml --resume",
    ),
    ("following", {}, "FOLLOWING  its runner has ended"),
)


def test_a_schedule_that_nobody_runs_says_so_and_counts_nothing_down() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("4")
        for state, more, words in NOBODY:
            view = schedule_view(state=state, running=False, **more)
            app._screens._read, app._screens._read_s = lambda _, view=view: view, None
            app.look()
            await pilot.pause()
            assert words in text_of(app)
            assert "next in" not in text_of(app)

    on_screen(act, News((changed(recording="/night.run/recordings/a.mcap"),), session=HERE))


def test_a_schedule_whose_runner_says_nothing_more_is_shown_as_old() -> None:
    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        app._screens._read = lambda _: schedule_view(old=True, age_s=40.0)
        await pilot.press("4")
        app.look()
        await pilot.pause()
        assert "FOLLOWING  ISS (ZARYA)   NO NEWS for 0:40" in text_of(app)

    on_screen(act, News((changed(recording="/night.run/recordings/a.mcap"),), session=HERE))


def test_a_run_of_no_schedule_says_so_and_a_status_that_cannot_be_read_why() -> None:
    def read(folder: Path) -> ScheduleView:
        raise SattrackError(f"{folder}/status.json: no status to be read: strange")

    async def act(app: TrackApp, pilot: Pilot[None]) -> None:
        await pilot.press("4")
        await pilot.pause()
        assert "this run belongs to no schedule" in text_of(app)
        app._screens._read, app._screens._read_s = read, None
        app.look()
        await pilot.pause()
        assert "no status to be read: strange" in text_of(app)

    on_screen(act)
