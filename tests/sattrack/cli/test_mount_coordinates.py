from __future__ import annotations

import pytest

from sattrack.core.errors import BadInputError
from sattrack.views.formatting import parse_dec, parse_ra


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("5h30m", 82.5),
        ("5:30:00", 82.5),
        ("05:30", 82.5),
        ("5.5h", 82.5),
        ("5h", 75.0),
        ("82.5", 82.5),
        ("82.5d", 82.5),
        ("82d30m", 82.5),
        ("82°30′", 82.5),
        ("5h30m36s", 82.65),
        ("5h 30m 36.0s", 82.65),
        ("0", 0.0),
        (".5h", 7.5),
        ("23:59:59", 359.99583333333334),
        ("+10", 10.0),
    ],
)
def test_right_ascensions(text: str, degrees: float) -> None:
    assert parse_ra(text) == pytest.approx(degrees, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("-12.5", -12.5),
        ("-12:30:00", -12.5),
        ("-12d30m", -12.5),
        ("−12°30′00″", -12.5),
        ("-0:30", -0.5),
        ("-0d0m36s", -0.01),
        ("+90", 90.0),
        ("-90:00:00", -90.0),
        ("45", 45.0),
    ],
)
def test_declinations(text: str, degrees: float) -> None:
    assert parse_dec(text) == pytest.approx(degrees, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("24h", "right ascension '24h': it runs from 0h to below 24h"),
        ("24:00:00", "right ascension '24:00:00': it runs from 0h to below 24h"),
        ("24.0h", "right ascension '24.0h': it runs from 0h to below 24h"),
        ("360", "right ascension '360': it runs from 0 to below 360 degrees (24h)"),
        ("-0.1", "right ascension '-0.1': it runs from 0 to below 360 degrees (24h)"),
        ("-0.1h", "right ascension '-0.1h': it runs from 0h to below 24h"),
        ("nan", "right ascension 'nan': write 5h30m, 5:30:00, 5.5h or degrees as 82.5"),
        ("inf", "right ascension 'inf': write 5h30m, 5:30:00, 5.5h or degrees as 82.5"),
        ("1e2", "right ascension '1e2': write 5h30m, 5:30:00, 5.5h or degrees as 82.5"),
        ("", "right ascension '': write 5h30m, 5:30:00, 5.5h or degrees as 82.5"),
        ("5:", "right ascension '5:': write 5h30m, 5:30:00, 5.5h or degrees as 82.5"),
        ("5 30 00", "right ascension '5 30 00': write 5h30m, 5:30:00, 5.5h or degrees as 82.5"),
        ("5h61m", "right ascension '5h61m': 61 minutes: must be below 60"),
        ("5h30m60s", "right ascension '5h30m60s': 60 seconds: must be below 60"),
        ("5.5h30m", "right ascension '5.5h30m': 5.5 must be a whole number, as minutes follow it"),
    ],
)
def test_what_is_no_right_ascension(text: str, words: str) -> None:
    with pytest.raises(BadInputError) as caught:
        parse_ra(text)
    assert str(caught.value) == words


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("91", "declination '91': it runs from -90 to 90 degrees"),
        ("-90:00:01", "declination '-90:00:01': it runs from -90 to 90 degrees"),
        ("5h30m", "declination '5h30m': it is in degrees, not hours; write -12.5, -12:30:00 or -12d30m"),
        ("nan", "declination 'nan': write -12.5, -12:30:00 or -12d30m"),
        ("--5", "declination '--5': write -12.5, -12:30:00 or -12d30m"),
    ],
)
def test_what_is_no_declination(text: str, words: str) -> None:
    with pytest.raises(BadInputError) as caught:
        parse_dec(text)
    assert str(caught.value) == words
