from __future__ import annotations

import asyncio
import re
import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING, Any

import pytest
from console_tui_builders import STATUS, VIEW, FakeConsole, console_view
from tui_builders import HandClock

from sattrack.mount.model import Readings
from sattrack.tui.console_app import ConsoleApp
from sattrack.tui.console_panels import ConsoleScene, headline
from sattrack.tui.feeds import Latest
from sattrack.views.formatting import (
    clock_text,
    degrees,
    hours,
    number,
    pointing_text,
    status_groups,
    status_text,
)
from sattrack.views.run import ConsoleView
from tools.screens import draw_console

if TYPE_CHECKING:
    from sattrack.views.run import ConsoleView

SMALL, LARGE, HUGE = (80, 24), (120, 40), (200, 60)


def drawn(
    view: ConsoleView = VIEW, size: tuple[int, int] = SMALL, keys: tuple[str, ...] = (), later_s: float = 0.0
) -> list[str]:
    """Return what stands on the screen, row by row, `later_s` after the view came."""

    async def run() -> list[str]:
        clock = HandClock()
        app = ConsoleApp(FakeConsole([Latest(view)]), monotonic=clock)
        async with app.run_test(size=size) as pilot:
            await pilot.press(*keys)
            clock.now_s += later_s
            app.look()
            await pilot.pause()
            strips = app.screen._compositor.render_strips()
            return ["".join(segment.text for segment in strip).rstrip() for strip in strips]

    return asyncio.run(run())


def test_the_whole_small_screen() -> None:
    assert drawn() == [
        " mount xerxes://192.0.2.7:15001   profile hill         2026-10-02 13:04:31 UTC",
        "  TRACKING  following the stars",
        " RA         05h 30m 00.0s      RA rate     +7789       slewing       no",
        " Dec        +12° 30′ 00″         in °/s    +0.0042     tracking      yes",
        " hour angle +02h 45m 00.0s     Dec rate    +0          pulse guiding no",
        " altitude   45.32°               in °/s    +0.0000     at home       no",
        " azimuth    261.44° W          RA current  1.23 A      at park       no",
        " pier side  beyond pole        Dec current −0.51 A     connected     yes",
        " sidereal   08h 15m 00.0s      RA guide    3500        refraction    no",
        " its clock  −0.35 s = 5.3″     Dec guide   3500        tracking rate 0 sidereal",
        " target RA  05h 30m 00.0s      RA drive    status 4 5  equatorial    0 JNow",
        " target Dec +12° 30′ 00″       Dec drive   status 6 7",
        " acknowledged ○ move ra  ○ move dec  ● slew  ○ sync  ○ pulse guide  ○ abort",
        " lat −24.6275°  lon −121.4042°  h 2635 m  counter 1720000  UTC 1 2 3  spare 9",
        " read as rates int64/int64   counter double   guide double/double",
        "         tracking the opposite of slewing   MoveAxis held, by the profile",
        " link    up  rate 20.00 /s  jitter 0.41 ms  age 0.03 s  sent 1234  heard 1233",
        "         lost 0  late 0  double 0  rejected 0  strangers 0",
        "         restarts 0  run twice 0  foreign acks 0",
        " 13:04:11 park: sent, unconfirmed (no acknowledgement)",
        " 13:03:31 slew to RA 05h 30m 00.0s Dec +12° 30′ 00″: complete",
        "",
        " jog ↑N ↓S ←E →W   1:0.0019  [2:0.02]  3:0.1   4:0.5   5:2   6:4  °/s",
        " g slew   s sync   p park   h home    SPACE STOP    q leave   ? help",
    ]


@pytest.mark.parametrize("size", [SMALL, LARGE, HUGE])
def test_every_field_of_the_status_stands_on_the_screen(size: tuple[int, int]) -> None:
    text = "\n".join(drawn(size=size))
    for value in (
        "05h 30m 00.0s", "+12° 30′ 00″", "+02h 45m 00.0s", "45.32°", "261.44° W", "beyond pole",
        "08h 15m 00.0s",
        "+7789", "1.23 A", "−0.51 A", "3500", "status 4 5", "status 6 7", "0 sidereal", "0 JNow", "−24.6275°",
        "−121.4042°", "2635 m", "1720000", "1 2 3", "int64", "double", "the opposite of slewing", "20.00 /s",
        "0.41 ms", "1234", "1233", "SPACE STOP",
    ):  # fmt: skip
        assert value in text, value
    for name in (
        "slewing", "tracking", "pulse guiding", "at home", "at park", "connected", "refraction",
        "move ra", "move dec", "sync", "abort", "lost", "late", "double", "rejected", "strangers",
        "restarts", "run twice", "foreign acks",
    ):  # fmt: skip
        assert name in text, name


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "TRACKING  following the stars"),
        ({"status": {"ra_rate_dtics_s": 0}}, "AT REST  the axes stand still"),
        ({"status": {"at_park": True}}, "PARKED  the drives have no power"),
        ({"doing": "slewing"}, "SLEWING  by order from here"),
        ({"doing": "slewing to the park position"}, "SLEWING  to the park position"),
        ({"doing": "stopping"}, "STOPPING  bringing the mount to rest"),
        ({"status": {"slewing": True}, "at_rest": False}, "MOVING  not by this console"),
        (
            {"doing": "jogging", "ra_rate_deg_s": -0.5, "at_rest": False},
            "JOGGING  RA −0.5000  Dec +0.0000 °/s against the stars",
        ),
        ({"tripped": "altitude"}, "LIMIT  stopped at the altitude limit; r lets it move again"),
        ({"link": {"state": "lost"}}, "LINK LOST  the mount is silent: everything below is old"),
        ({"link": {"state": "silent"}, "status": None}, "NOT HEARD  no status from the mount yet"),
    ],
)
def test_the_state_in_a_word(changes: dict[str, object], words: str) -> None:
    word, more, _ = headline(ConsoleScene(console_view(**changes)))
    assert f"{word}  {more}" == words


def test_a_console_that_is_silent_is_told_with_what_to_do() -> None:
    rows = drawn(later_s=3.0)
    assert rows[1] == "  NO NEWS  from the console for 3 s: everything below is old"
    assert rows[2] == " ! the console does not answer: press SPACE, then use the mount's own stop"


def test_what_was_not_done_and_what_is_wrong_stand_below_the_state() -> None:
    rows = drawn(console_view(refusal="the mount is slewing: stop that first", warnings=("one", "two")))
    assert rows[2:4] == [" ! not done: the mount is slewing: stop that first", " ! one"]
    assert rows[-1].endswith("q leave   ? help"), "warnings never push the keys off the screen"
    assert rows[-2].startswith(" jog")


def test_the_chosen_rate_is_marked_without_colour() -> None:
    assert "[5:2]" in drawn(keys=("5",))[-2]
    assert any("[5 2      °/s]" in row for row in drawn(keys=("5",), size=LARGE))


def test_a_tripped_limit_offers_the_reset() -> None:
    assert " r reset " in drawn(console_view(tripped="altitude"))[-1]


@pytest.mark.parametrize("size", [SMALL, LARGE])
def test_dialogs_say_what_is_wrong_and_keep_what_was_typed(size: tuple[int, int]) -> None:
    text = "\n".join(drawn(keys=("g", "5", "h", "enter", "9", "5", "enter"), size=size))
    assert "! declination '95': it runs from -90 to 90 degrees" in text
    assert "SPACE" in text
    assert re.search(r"│\s+5h\s", text)


def test_a_sync_is_asked_again_with_both_directions() -> None:
    keys = ("s", "8", "3", "enter", "1", "2", "enter")
    inside = [row.split("│")[1] for row in drawn(keys=keys) if row.count("│") == 2]
    text = " ".join(" ".join(inside).split())
    assert "sync?" in text
    assert "RA 05h 32m 00.0s Dec +12° 00′ 00″ for where it points now" in text
    assert "which it reports as RA 05h 30m 00.0s Dec +12° 30′ 00″" in text


def test_the_help_fits_the_small_screen() -> None:
    rows = drawn(keys=("question_mark",))
    text = "\n".join(rows)
    assert "SPACE     STOP" in text
    assert "close this help" in text


def test_a_mount_that_is_not_heard_shows_no_made_up_numbers() -> None:
    text = "\n".join(
        drawn(console_view(status=None, link={"state": "silent", "age_s": None, "rate_hz": None}))
    )
    assert "05h 30m" not in text.split("13:0")[0]
    assert "the mount has not answered yet: is it on, and set to send here?" in text


def test_numbers_that_the_mount_does_not_have_are_dashes() -> None:
    status = {"altitude_deg": None, "azimuth_deg": None, "target_ra_h": None, "target_dec_deg": None}
    rows = drawn(console_view(status=status, clock_offset_s=None, hour_angle_deg=None))
    assert rows[4].startswith(" hour angle –")
    assert rows[5].startswith(" altitude   –")


def test_the_picture_refers_to_nothing_elsewhere() -> None:
    svg = asyncio.run(draw_console(VIEW))
    namespace = "http://www.w3.org/2000/svg"
    assert ET.fromstring(svg).tag == f"{{{namespace}}}svg"
    assert set(re.findall(r"\w+://[^\s\"')<]+", svg)) - {"xerxes://192.0.2.7:15001"} == {namespace}


class TestWords:
    @pytest.mark.parametrize(
        ("text", "is_"),
        [
            (hours(5.5), "05h 30m 00.0s"),
            (hours(-0.00001, sign=True), "+00h 00m 00.0s"),
            (hours(-2.05, sign=True), "−02h 03m 00.0s"),
            (degrees(-0.5), "−00° 30′ 00″"),
            (degrees(None), "–"),
            (number(-0.0001, 2, "°", sign=True), "+0.00°"),
            (number(None, 2), "–"),
            (clock_text(0.35), "+0.35 s = 5.3″"),
            (clock_text(-60.0), "−60.00 s = 15.0′"),
            (clock_text(3600.0), "+3600.00 s = 15.0°"),
        ],
    )
    def test_quantities(self, text: str, is_: str) -> None:
        assert text == is_

    def test_the_text_of_a_status_has_every_field(self) -> None:
        text = status_text(VIEW)
        assert text.startswith("xerxes://192.0.2.7:15001  Fri 2 Oct 2026 13:04:31.400 UTC  profile hill\n")
        # Six flags acknowledge; every other field has a line, but for the two rates, which have two.
        lines = sum(len(group.lines) for group in status_groups(VIEW)[:5])
        assert lines == len(STATUS.__struct_fields__) - 2 - 2 + 2 + 2
        assert "  clock" not in text
        assert "  its clock     −0.35 s = 5.3″" in text

    @pytest.mark.parametrize(
        ("changes", "says"),
        [
            ({}, "at rest or tracking"),
            ({"at_rest": False}, "moving"),
            ({"at_rest": False, "status": {"at_park": True}}, "at park, as it reports"),
            ({"at_rest": False, "status": {"at_park": True, "slewing": True}}, "slewing"),
        ],
    )
    def test_a_line_says_what_the_mount_does(self, changes: dict[str, Any], says: str) -> None:
        assert pointing_text(console_view(**changes)).endswith(f"  {says}")

    def test_what_was_never_seen_is_said_to_be_so(self) -> None:
        text = status_text(console_view(readings=Readings()))
        assert "  RA rate       only zeros so far" in text
        assert "  tracking      not seen slewing" in text
