"""When a frame was exposed: headers and settings as capture programs write them, literal."""

from __future__ import annotations

import pytest

from sattrack.camera.frames import fits_exposure, name_exposure, text_exposure
from sattrack.core.errors import BadInputError
from tle.instants import Utc

MIDDLE = Utc.parse("2026-10-02T13:05:24.5Z")


@pytest.mark.parametrize(
    "header",
    [
        {"DATE-OBS": "2026-10-02T13:05:24.4", "EXPTIME": 0.2},
        {"DATE-BEG": "2026-10-02T13:05:24.400000", "EXPTIME": 0.2},
        {"DATE-AVG": "2026-10-02T13:05:24.5", "EXPTIME": 0.2},
        {"DATE-END": "2026-10-02T13:05:24.6", "EXPTIME": 0.2},
        {"DATE-OBS": "2026-10-02", "TIME-OBS": "13:05:24.4", "EXPTIME": 0.2},
        {"DATE-OBS": "2026-10-02T13:05:24.4000000", "EXPOSURE": "0.2", "TIMESYS": "UTC"},
        {"DATE-OBS": "2026-10-02T13:05:24.4", "DATE-AVG": "2026-10-02T13:05:24.5", "EXPTIME": 0.2},
        # MaxIm DL and others repeat the middle as DATE-OBS.
        {"DATE-AVG": "2026-10-02T13:05:24.5", "DATE-OBS": "2026-10-02T13:05:24.5", "EXPTIME": 0.2},
        # 61315 + 47124.4 / 86400
        {"MJD-OBS": 61315.545421296296, "EXPTIME": 0.2},
        {"MJD-AVG": 61315.545422453704, "EXPTIME": 0.2},
        # Others beside it are written to a second or so: cut off, or rounded.
        {"DATE-OBS": "2026-10-02T13:05:24", "DATE-AVG": "2026-10-02T13:05:24.5", "EXPTIME": 0.2},
        {"DATE-OBS": "2026-10-02T13:05:24.4", "DATE-END": "2026-10-02T13:05:24", "EXPTIME": 0.2},
        {"DATE-OBS": "2026-10-02T13:05:24.4", "MJD-OBS": 61315.54543, "EXPTIME": 0.2},
        {"DATE-OBS": "2026-10-02T13:05:24", "MJD-OBS": 61315.545421296296, "EXPTIME": 0.2},
    ],
)
def test_the_middle_of_the_exposure_is_found_in_a_header(header: dict[str, object]) -> None:
    found = fits_exposure(header, "a.fits")
    assert abs(float(found.utc - MIDDLE)) < 1e-4
    assert found.exposure_s == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ({"EXPTIME": 0.2}, "no DATE-OBS"),
        ({"DATE-OBS": "2026-10-02T13:05:24.4"}, "no EXPTIME"),
        (
            {"DATE-OBS": "2026-10-02", "EXPTIME": 0.2},
            "without a time of day: write UTC as 2026-10-02T13:05:24.5",
        ),
        (
            {"DATE-OBS": "02/10/26 13:00", "EXPTIME": 0.2},
            "DATE-OBS: '02/10/26 13:00' is no time: write UTC as 2026-10-02T13:05:24.5Z",
        ),
        ({"DATE-OBS": "02/10/26T13:05:24", "EXPTIME": 0.2}, "DATE-OBS"),
        ({"DATE-OBS": "2026-10-02T13:05:24", "EXPTIME": -1}, "EXPTIME"),
        ({"DATE-OBS": "2026-10-02T13:05:24", "EXPTIME": 0.2, "TIMESYS": "TAI"}, "TIMESYS is TAI"),
        (
            {"DATE-OBS": "2026-10-02T13:05:24", "DATE-AVG": "2026-10-02T13:05:27", "EXPTIME": 0.2},
            "contradict each other by 2.900 s",
        ),
        ({"DATE-OBS": "2026-10-02T13:05:24", "MJD-OBS": 61315.0, "EXPTIME": 0.2}, "contradict"),
        (
            {"DATE-OBS": "2026-10-02T13:05:24.4", "DATE-AVG": "2026-10-02T13:05:25.0", "EXPTIME": 0.2},
            "by 0.5",
        ),
        ({"MJD-OBS": "yesterday", "EXPTIME": 0.2}, "MJD-OBS"),
    ],
)
def test_a_header_that_does_not_date_its_frame_is_refused_by_name(
    header: dict[str, object], words: str
) -> None:
    with pytest.raises(BadInputError, match=words) as error:
        fits_exposure(header, "night/a.fits")
    assert str(error.value).startswith("night/a.fits: ")


@pytest.mark.parametrize("beside", [{}, {"TIME-OBS": "13:05:24.4"}, {"UT": "13:05:24.4"}])
def test_a_space_may_stand_between_date_and_time(beside: dict[str, object]) -> None:
    found = fits_exposure({"DATE-OBS": "2026-10-02 13:05:24.4", "EXPTIME": 0.2, **beside}, "a.fits")
    assert abs(float(found.utc - MIDDLE)) < 1e-4


def test_the_settings_beside_an_image_date_it() -> None:
    sharpcap = "[ZWO ASI290MM]\nExposure=200ms\nGain=150\nMidCapture=2026-10-02T13:05:24.5000000Z\n"
    firecapture = (
        "FireCapture v2.7  Settings\n----\nDate=021026\nStart=150524.400\nStart(UT)=130524.400\n"
        "Date_format=ddMMyy\nTime_format=HHmmss\nShutter=200.0ms\n"
    )
    for text in (sharpcap, firecapture, sharpcap.replace("\n", "\r\n")):
        found = text_exposure(text, "a.txt")
        assert found is not None
        assert abs(float(found.utc - MIDDLE)) < 1e-6
        assert found.exposure_s == pytest.approx(0.2)
    assert text_exposure("Gain=3\n", "a.txt") is None
    with pytest.raises(BadInputError, match="--exposure"):
        text_exposure("MidCapture=2026-10-02T13:05:24.5Z\n", "a.txt")


@pytest.mark.parametrize(
    ("written", "seconds"),
    [("850us", 850e-6), ("850\N{MICRO SIGN}s", 850e-6), ("0,5s", 0.5), ("0.5", 0.5), ("1,25ms", 0.00125)],
)
def test_an_exposure_is_read_in_its_unit(written: str, seconds: float) -> None:
    """Microseconds taken for seconds would move the middle by minutes."""
    found = text_exposure(f"Exposure={written}\nMidCapture=2026-10-02T13:05:24.5Z\n", "a.txt")
    assert found is not None
    assert found.exposure_s == pytest.approx(seconds)


@pytest.mark.parametrize("written", ["2min", "1.2.3s"])
def test_an_exposure_in_no_unit_that_is_known_is_refused_by_name(written: str) -> None:
    with pytest.raises(BadInputError, match=r"a\.txt: Exposure is"):
        text_exposure(f"Exposure={written}\nMidCapture=2026-10-02T13:05:24.5Z\n", "a.txt")


@pytest.mark.parametrize(
    "stem",
    ["cap_2026-10-02T13_05_24.400Z", "20261002_130524_400", "iss-2026-10-02-130524.4", "20261002T130524.4"],
)
def test_a_time_in_a_name_is_the_beginning(stem: str) -> None:
    found = name_exposure(stem, f"{stem}.png", 0.2)
    assert found is not None
    assert abs(float(found.utc - MIDDLE)) < 1e-6


def test_what_the_last_decimal_of_a_date_is_goes_with_it() -> None:
    """A date that is cut off at a second must not look like an exact one."""
    whole = name_exposure("20261002_130524", "a.png", 0.2)
    settings = text_exposure("MidCapture=2026-10-02T13:05:24.5Z\n", "a.txt", 0.2)
    header = fits_exposure({"DATE-OBS": "2026-10-02T13:05:24", "EXPTIME": 0.2}, "a.fits")
    assert whole is not None
    assert settings is not None
    assert (whole.decimal_s, settings.decimal_s, header.decimal_s) == (1.0, 0.1, 1.0)


@pytest.mark.parametrize("stem", ["iss-20261002-130524-0001", "20261002_130524_00017", "20261002_130524"])
def test_the_number_of_a_frame_in_its_name_is_no_fraction_of_a_second(stem: str) -> None:
    """By frame 0001 the date would be exact to a tenth of a millisecond."""
    found = name_exposure(stem, f"{stem}.png", 0.0)
    assert found == (Utc.parse("2026-10-02T13:05:24Z"), 0.0, 1.0)


def test_a_name_without_seconds_dates_nothing() -> None:
    assert name_exposure("2026-10-02-1305_4-Jup", "x.png", 0.2) is None
