from __future__ import annotations

import msgspec
import pytest
from rich.cells import cell_len
from tui_builders import SUMMARY

from sattrack.tui.panels import fitted, rows_content
from sattrack.views import formatting
from sattrack.views.run import LearntView


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [(1.25, 2, "+1.25"), (-1.0, 1, "−1.0"), (0.0, 2, "+0.00"), (-0.001, 2, "+0.00"), (-0.006, 2, "−0.01")],
)
def test_signed(value: float, decimals: int, text: str) -> None:
    assert formatting.number(value, decimals, sign=True) == text


@pytest.mark.parametrize(
    ("arcsec", "text"),
    [
        (None, "–"),
        (0.0, "+0.00″"),
        (-0.004, "+0.00″"),
        (-0.014, "−0.01″"),
        (9.994, "+9.99″"),
        (9.996, "+10.0″"),
        (99.96, "+100″"),
        (-599.0, "−599″"),
        (600.0, "+10.0′"),
        (-7200.0, "−2.0°"),
    ],
)
def test_arcseconds_take_the_unit_that_fits(arcsec: float | None, text: str) -> None:
    assert formatting.arcsec(arcsec, sign=True) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "0:00"), (-7.9, "0:07"), (754.0, "12:34"), (3600.0, "1:00:00"), (187200.0, "2 d 4 h")],
)
def test_span(seconds: float, text: str) -> None:
    assert formatting.span(seconds) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (90.0, "2 min"),
        (45900.0, "12.8 h"),
        (432000.0, "5.0 days"),
        (-7200.0, "2.0 h ahead"),
        (99.94 * 86400.0, "99.9 days"),
        (99.96 * 86400.0, "100 days"),
        (-1571.3 * 86400.0, "1571 days ahead"),
    ],
)
def test_age(seconds: float, text: str) -> None:
    assert formatting.age(seconds) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(45900.0, "12.8 h old"), (0.0, "0 min old"), (-56.5 * 86400.0, "56.5 days ahead")]
)
def test_what_lies_ahead_is_not_called_old(seconds: float, text: str) -> None:
    assert formatting.old(seconds) == text


@pytest.mark.parametrize(
    ("metres", "text"),
    [(0.0254, "0.0254 m"), (17.32, "17.3 m"), (999.4, "999 m"), (999.6, "1 km"), (27.3e6, "27300 km")],
)
def test_a_length_has_the_unit_that_fits_and_no_exponent(metres: float, text: str) -> None:
    assert formatting.length(metres) == text


@pytest.mark.parametrize(
    ("degrees", "text"),
    [
        (0.0, "00h 00m 00.0s"),
        (359.9999999, "00h 00m 00.0s"),
        (-15.0, "23h 00m 00.0s"),
        (212.9, "14h 11m 36.0s"),
    ],
)
def test_right_ascension(degrees: float, text: str) -> None:
    assert formatting.right_ascension(degrees) == text
    assert formatting.hours(degrees / 15.0) == text


@pytest.mark.parametrize(
    ("degrees", "text"),
    [(0.0, "+00° 00′ 00″"), (-0.5, "−00° 30′ 00″"), (-0.00001, "+00° 00′ 00″"), (89.99999, "+90° 00′ 00″")],
)
def test_declination(degrees: float, text: str) -> None:
    assert formatting.degrees(degrees) == text


@pytest.mark.parametrize(
    ("degrees", "text"),
    [(0.0, "0.0° N"), (359.9, "359.9° N"), (359.96, "0.0° N"), (22.6, "22.6° NE"), (-90.0, "270.0° W")],
)
def test_azimuth(degrees: float, text: str) -> None:
    assert formatting.azimuth(degrees) == text


@pytest.mark.parametrize(
    ("days", "line"), [(4.2, "4 days old"), (-9.6, "10 days ahead"), (-2.9, None), (2.9, None)]
)
def test_a_summary_says_of_elements_that_they_are_far_off_either_way(days: float, line: str | None) -> None:
    told = [
        text.strip()
        for text in formatting.summary_lines(msgspec.structs.replace(SUMMARY, elements_age_days=days))
        if "elements" in text
    ]
    assert told == ([] if line is None else [f"against elements {line}"])


@pytest.mark.parametrize(("peak_arcsec", "text"), [(456000.0, "126.7°"), (36.04, "36.0″")])
def test_how_far_off_a_mount_was_is_an_angle_as_all_others_are(peak_arcsec: float, text: str) -> None:
    summary = msgspec.structs.replace(SUMMARY, rejoining_s=12.0, lost_peak_arcsec=peak_arcsec)

    line = f"  returning to the target 12.0 s, up to {text} off: not in the error"
    assert line in formatting.summary_lines(summary)


@pytest.mark.parametrize(
    ("share", "bar"), [(0.0, "····"), (0.01, "▏···"), (-0.5, "██··"), (1.0, "████"), (9.0, "████")]
)
def test_gauge(share: float, bar: str) -> None:
    assert formatting.gauge(share, 4) == bar


@pytest.mark.parametrize(
    ("share", "mark", "bar"),
    [
        (0.5, 0.5, "██┃·"),
        (0.5, 0.0, "┃█··"),
        (-0.25, 0.75, "█··┃"),
        (0.0, 1.0, "···┃"),
        (1.0, 9.0, "███┃"),
        (0.01, 0.5, "▏·┃·"),
    ],
)
def test_a_gauge_with_a_stroke_where_it_is_to_be(share: float, mark: float, bar: str) -> None:
    assert formatting.gauge(share, 4, mark) == bar


@pytest.mark.parametrize(
    ("text", "shown"),
    [("ISS", "ISS   "), ("SAT 01", "SAT 01"), ("SAT 101", "SAT 1…"), ("天宫一号", "天宫 …")],
)
def test_a_text_takes_just_the_cells_that_it_is_given(text: str, shown: str) -> None:
    assert fitted(text, 6) == shown
    assert cell_len(shown) == 6


def test_rows_are_text_and_command_no_terminal() -> None:
    content = rows_content([["ISS [/b]\x1b[2J", ("\x9b1m", "bold")], ["below"]])
    assert content.plain == "ISS [/b]?[2J?1m\nbelow"


def test_events_are_told_to_the_nearest_second_and_the_time_now_to_the_one_that_has_begun() -> None:
    event = "2026-10-02T13:08:48.6Z"
    assert formatting.iso_clock(event)[3:] == "08:49"
    assert formatting.clock(formatting.iso_unix_s(event))[3:] == "08:48"
    assert formatting.iso_clock(None) == formatting.NOTHING


def test_the_lag_of_an_axis_whose_rates_hardly_varied_is_not_told() -> None:
    """By a star's, a filter shows lags that are far below zero, and too surely."""
    learnt = LearntView(-0.5, 0.07, None, None, 0.05, 0.01, 1.02, 0.001, 0.02, 0.1, 0)
    assert formatting.learnt_line(learnt).startswith("lag RA not known, Dec 50±10 ms; gain RA not known, Dec")


@pytest.mark.parametrize(("delay_s", "told"), [(-0.0101, True), (-0.0099, False), (0.02, False)])
def test_a_delay_that_is_surely_below_zero_tells_of_wrong_dates(delay_s: float, told: bool) -> None:
    """A command cannot act before it is sent: by twice its sigma, the statuses' dates are early."""
    learnt = LearntView(
        0.0, 0.01, 1.0, 0.001, 0.0, 0.01, 1.0, 0.001, delay_s, 0.1, 0, command_delay_sigma_s=0.005
    )
    assert ("status_delay_s is too large" in formatting.learnt_line(learnt)) is told
