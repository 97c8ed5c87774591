"""Tables of az/alt, RA/Dec and latitude/longitude/height against skyfield, ERFA and closed forms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import erfa
import numpy as np
import pytest
from geometry import itrs_km, site_below
from tle_facts import ISS

from tle.bias import Bias
from tle.earth import EarthOrientation
from tle.ephemeris import Frame
from tle.errors import EphemerisError, EphemerisSpanError
from tle.formats.ephemerides import parse_ephemerides
from tle.formats.track_table import curve
from tle.instants import Utc
from tle.propagator import Propagator
from tle.site import Site

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from tle.ephemeris import TableEphemeris

    Array = NDArray[np.float64]

START = "2026-03-01T20:00:00Z"
START_S = float(Utc.parse(START).unix_s)
LEIDEN = Site(52.15, 4.49, 12.0)
ARCSEC = np.pi / 648000.0


def stamp(since_s: float) -> str:
    return Utc(START_S + since_s).isoformat("microseconds")


def read(text: str, t0: Utc | None = None, site: Site | None = LEIDEN) -> TableEphemeris:
    (one,) = parse_ephemerides(text.encode(), "track.csv", site, t0)
    return one


def table(columns: str, times: Array, path: Callable[[float], tuple[float, ...]], notes: str = "") -> str:
    rows = [",".join([stamp(t), *(f"{value:.12f}" for value in path(t))]) for t in times.tolist()]
    return "\n".join([notes + columns, *rows, ""])


def apart_arcsec(az: float, alt: float, wanted: tuple[float, float]) -> float:
    return float(erfa.seps(*np.radians([az, alt]), *np.radians(wanted)) / ARCSEC)


def rate(path: Callable[[float], float], t: float, step: float = 1.0 / 16.0) -> float:
    """Return the derivative of an angle by differences of fourth order, at steps that floats hold exactly."""
    near, far = ((path(t + s) - path(t - s) + 180.0) % 360.0 - 180.0 for s in (step, 2.0 * step))
    return (8.0 * near - far) / (12.0 * step)


def overhead(t: float) -> tuple[float, float]:
    """Return alt and az of something that flies straight at 7.5 km/s, 500 km up."""
    east, north = 7.5 * (t - 150.0), -400.0
    return float(np.degrees(np.arctan2(500.0, np.hypot(east, north)))), float(
        np.degrees(np.arctan2(east, north)) % 360.0
    )


def test_az_and_alt_are_met_between_rows_with_the_rates_of_the_path() -> None:
    one = read(table("utc,alt_deg,az_deg", np.arange(301.0), overhead))
    seen_by = Propagator(one, LEIDEN)
    for t in (0.5, 77.25, 149.625, 150.5, 222.75, 299.5):
        seen = seen_by.at(Utc(START_S + t))
        assert apart_arcsec(seen.az_deg, seen.alt_deg, overhead(t)[::-1]) < 0.01
        assert seen.alt_rate_deg_s == pytest.approx(rate(lambda s: overhead(s)[0], t), abs=1e-4 / 3600)
        assert seen.az_rate_deg_s == pytest.approx(rate(lambda s: overhead(s)[1], t), abs=1e-4 / 3600)
    assert not one.ranged


@pytest.mark.parametrize("t", [3.25, 149.625, 297.0])
@pytest.mark.parametrize("steps", ["even", "uneven"])
def test_rates_are_derivatives_of_the_places_given(t: float, steps: str) -> None:
    times = np.arange(0.0, 301.0, 5.0)
    if steps == "uneven":
        times = times + 2.0 * np.sin(times)
    seen_by = Propagator(read(table("utc,alt_deg,az_deg", times, overhead)), LEIDEN)
    now = seen_by.at(Utc(START_S + t))
    for name in ("alt", "az", "dec", "ra", "ha"):

        def path(s: float, field: str = f"{name}_deg") -> float:
            return float(getattr(seen_by.at(Utc(START_S + s)), field))

        assert getattr(now, f"{name}_rate_deg_s") == pytest.approx(rate(path, t), abs=1e-4 / 3600), name


def test_rates_of_a_long_table_are_those_of_its_polynomial_at_every_row() -> None:
    t = np.cumsum(1.0 + 0.5 * np.sin(np.arange(10_020.0)))
    x = t / 5000.0 - 1.0
    places = np.stack([x, x**2, 1.0 + x**3 - x**6], axis=1)
    rates = np.stack([np.ones_like(x), 2.0 * x, 3.0 * x**2 - 6.0 * x**5], axis=1) / 5000.0
    found = curve(0.0, t, places, Frame("GROUND", "WGS 84"), 1).velocity_km_s
    assert np.allclose(found, rates, rtol=0.0, atol=1e-12)


def test_rates_do_not_jump_at_rows_of_noise() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.01, 62)
    times = np.arange(0.0, 301.0, 5.0)
    seen_by = Propagator(
        read(table("utc,alt_deg,az_deg", times, lambda t: (30.0 + t / 10.0 + noise[int(t / 5)], 90.0))),
        LEIDEN,
    )
    for row in times[1:-1].tolist():
        before, after = (seen_by.at(Utc(START_S + row + s)).alt_rate_deg_s for s in (-1e-5, 1e-5))
        assert before == pytest.approx(after, abs=1e-6)


def aircraft(t: float) -> tuple[float, float, float]:
    return 52.3 - 1e-3 * t, 4.2 + 2e-3 * t + 1e-6 * t * t, 9000.0 + 5.0 * t


@pytest.fixture(scope="module")
def scale() -> Any:
    from skyfield.api import load

    at = EarthOrientation.installed().orientation(Utc(START_S))
    made = load.timescale(delta_t=69.184 - at.dut1_s)
    made.polar_motion_table = [0.0], [at.xp_arcsec], [at.yp_arcsec]
    return made


@pytest.mark.parametrize("relative", [False, True])
def test_an_aircraft_is_seen_where_skyfield_has_it(scale: Any, relative: bool) -> None:
    from skyfield.api import wgs84

    times = np.arange(0.0, 301.0, 10.0)
    text, t0 = table("utc,lat_deg,lon_deg,height_m", times, aircraft, "# name: G-ABCD\n"), None
    if relative:
        rows = "\n".join(",".join(map(str, (t, *aircraft(t)))) for t in times.tolist())
        text, t0 = f"# name: G-ABCD\nt_s,lat_deg,lon_deg,height_m\n{rows}", Utc(START_S)
    one = read(text, t0)
    assert (one.label, one.ranged) == ("G-ABCD", True)
    here = wgs84.latlon(LEIDEN.latitude_deg, LEIDEN.longitude_deg, LEIDEN.height_m)
    for t in (4.3, 151.9, 296.0):
        lat, lon, height = aircraft(t)
        moment = scale.tt_jd(2440587.5 + START_S / 86400.0, (t + 69.184) / 86400.0)
        alt, az, distance = (wgs84.latlon(lat, lon, height) - here).at(moment).altaz()
        seen = Propagator(one, LEIDEN, place="geometric").at(Utc(START_S + t))
        assert apart_arcsec(seen.az_deg, seen.alt_deg, (az.degrees, alt.degrees)) < 0.01
        assert seen.range_km == pytest.approx(distance.km, abs=1e-5)
        # Light time and aberration together are those of its motion against the Earth, 0.2 km/s.
        apparent = Propagator(one, LEIDEN).at(Utc(START_S + t))
        assert apart_arcsec(apparent.az_deg, apparent.alt_deg, (az.degrees, alt.degrees)) < 0.2


def test_a_time_bias_moves_what_flies_and_not_the_ground_below() -> None:
    one = read(table("utc,alt_deg,az_deg", np.arange(301.0), overhead))
    seen = Propagator(one, LEIDEN).at(Utc(START_S + 100.0), Bias(20.0))
    assert apart_arcsec(seen.az_deg, seen.alt_deg, overhead(120.0)[::-1]) < 0.01


@pytest.mark.parametrize(
    ("step", "unit", "count"), [(1.0, 10.0, 40), (600.0, 3000.0, 40), (100.0, 3000.0, 400)]
)
def test_places_among_the_stars_are_seen_where_erfa_has_them(step: float, unit: float, count: int) -> None:
    def path(t: float) -> tuple[float, float]:
        return 80.0 + t / unit, 20.0 + t / unit / 2.0

    times = step * np.arange(float(count))
    one = read(table("utc,ra_deg,dec_deg", times, path))
    mas = ARCSEC / 1000.0
    for t in (1.5 * step, 20.25 * step, 38.1 * step, (count - 1.9) * step):
        at = EarthOrientation.installed().orientation(Utc(START_S + t))
        ra, dec = np.radians(path(t))
        day = (START_S + t) // 86400.0
        utc = 2440587.5 + day, (START_S + t - 86400.0 * day) / 86400.0
        place = *np.radians([LEIDEN.longitude_deg, LEIDEN.latitude_deg]), LEIDEN.height_m
        poles = at.xp_arcsec * ARCSEC, at.yp_arcsec * ARCSEC
        air = 0.0, 0.0, 0.0, 0.5
        az, zenith, *_ = erfa.atco13(ra, dec, 0.0 * mas, 0.0, 0.0, 0.0, *utc, at.dut1_s, *place, *poles, *air)
        seen = Propagator(one, LEIDEN).at(Utc(START_S + t))
        assert apart_arcsec(seen.az_deg, seen.alt_deg, (np.degrees(az), 90.0 - np.degrees(zenith))) < 0.01


MIDDLE = Utc.parse("2026-03-01T20:05:00Z")
BELOW = site_below(ISS, MIDDLE)
ASIDE = Site(BELOW.latitude_deg + 0.33, BELOW.longitude_deg)
AT = EarthOrientation.installed().orientation(MIDDLE)
POLE = AT.xp_arcsec * ARCSEC, AT.yp_arcsec * ARCSEC


def julian(t: float, ahead_s: float = 0.0) -> tuple[float, float]:
    day = START_S // 86400.0
    return 2440587.5 + day, (START_S - 86400.0 * day + t + ahead_s) / 86400.0


def iss_itrs(t: float) -> Array:
    """Return the direction of the ISS from the site, by SGP4 and ERFA alone."""
    there = (
        itrs_km(ISS, Utc(START_S + t))
        - np.array(erfa.gd2gc(1, *np.radians([ASIDE.longitude_deg, ASIDE.latitude_deg]), 0.0)) / 1000.0
    )
    direction: Array = there / np.linalg.norm(there)
    return direction


def iss(t: float) -> tuple[float, float]:
    """Return its altitude and azimuth, without air."""
    c, s = np.cos(np.radians(ASIDE.longitude_deg)), np.sin(np.radians(ASIDE.longitude_deg))
    x, y, z = iss_itrs(t)
    x, east = c * x + s * y, c * y - s * x
    c, s = np.cos(np.radians(ASIDE.latitude_deg)), np.sin(np.radians(ASIDE.latitude_deg))
    north, up = c * z - s * x, c * x + s * z
    return float(np.degrees(np.arctan2(up, np.hypot(east, north)))), float(
        np.degrees(np.arctan2(east, north)) % 360.0
    )


def iss_icrs(t: float) -> tuple[float, float]:
    alt, az = np.radians(iss(t))
    place = *np.radians([ASIDE.longitude_deg, ASIDE.latitude_deg]), 0.0
    air = 0.0, 0.0, 0.0, 0.5
    found = erfa.atoc13("A", az, np.pi / 2.0 - alt, *julian(t), AT.dut1_s, *place, *POLE, *air)
    ra, dec = np.degrees(found)
    return float(ra % 360.0), float(dec)


def iss_of_date(t: float) -> tuple[float, float]:
    sidereal = erfa.gst06a(*julian(t, AT.dut1_s), *julian(t, 69.184))
    tirs = erfa.pom00(*POLE, 0.0).T @ iss_itrs(t)
    longitude, dec = np.degrees(erfa.c2s(tirs))
    return float((longitude + np.degrees(sidereal)) % 360.0), float(dec)


@pytest.mark.parametrize("step", [1.0, 5.0])
@pytest.mark.parametrize(
    ("path", "notes"), [(iss_icrs, ""), (iss_of_date, "# frame: of_date\n")], ids=["icrs", "of date"]
)
def test_a_pass_among_the_stars_is_met_as_well_as_in_azimuth_and_altitude(
    step: float, path: Callable[[float], tuple[float, float]], notes: str
) -> None:
    times = np.arange(200.0, 401.0, step)
    middles = times[:-1] + step / 2.0
    stars = Propagator(read(table("utc,ra_deg,dec_deg", times, path, notes), site=ASIDE), ASIDE)
    horizon = Propagator(read(table("utc,alt_deg,az_deg", times, iss), site=ASIDE), ASIDE)
    worst = []
    for seen_by in (stars, horizon):
        seen = [seen_by.at(Utc(START_S + t)) for t in middles.tolist()]
        worst.append(
            max(
                apart_arcsec(one.az_deg, one.alt_deg, iss(t)[::-1])
                for one, t in zip(seen, middles.tolist(), strict=True)
            )
        )
    assert max(iss(t)[0] for t in middles.tolist()) == pytest.approx(85.0, abs=0.5)
    assert worst[0] < 0.01
    assert worst[0] < 1.5 * worst[1]
    for t in (207.5, 297.5, 302.5, 387.5):
        now = stars.at(Utc(START_S + t))
        for name in ("alt", "az", "dec", "ra"):

            def angle(s: float, field: str = f"{name}_deg") -> float:
                return float(getattr(stars.at(Utc(START_S + s)), field))

            assert getattr(now, f"{name}_rate_deg_s") == pytest.approx(
                rate(angle, t, 1.0 / 64.0), abs=1e-4 / 3600
            ), name


@pytest.mark.parametrize("rows", ["one missing", "uneven"])
def test_a_missing_row_and_uneven_ones_are_bridged_as_well_as_their_steps_allow(rows: str) -> None:
    times = np.arange(200.0, 401.0, 2.5)
    if rows == "one missing":
        times = np.delete(times, 40)
    else:
        times = times + np.random.default_rng(7).choice([-0.5, 0.0, 0.5], len(times))
    middles = (times[:-1] + times[1:]) / 2.0
    seen_by = Propagator(read(table("utc,alt_deg,az_deg", times, iss), site=ASIDE), ASIDE)
    for t in middles.tolist():
        seen = seen_by.at(Utc(START_S + t))
        assert apart_arcsec(seen.az_deg, seen.alt_deg, iss(t)[::-1]) < 0.01


def test_rows_a_minute_apart_but_for_rounding_are_even() -> None:
    times = 0.1 + 60.0 * np.arange(9.0)
    assert np.diff(times).max() > 60.0 > np.diff(times).min()
    rows = "\n".join(f"{t!r},{80.0 + t / 100.0},45" for t in times.tolist())
    one = read(f"t_s,ra_deg,dec_deg\n{rows}\n", Utc(START_S))
    assert "degree 7" in one.provenance


def test_of_date_is_the_right_ascension_that_comes_back() -> None:
    one = read(
        table(
            "utc,ra_deg,dec_deg",
            np.arange(0.0, 7200.0, 600.0),
            lambda t: (t / 100.0, 45.0),
            "# frame: of_date\n",
        )
    )
    seen = Propagator(one, LEIDEN).at(Utc(START_S + 3333.0))
    assert (seen.ra_deg, seen.dec_deg) == pytest.approx((33.33, 45.0), abs=0.005 / 3600)


def test_gaps_and_ends_are_told() -> None:
    times = np.concatenate([np.arange(0.0, 60.0), np.arange(200.0, 260.0)])
    one = read(table("utc,alt_deg,az_deg", times, overhead))
    assert [float(last.unix_s - first.unix_s) for first, last in one.spans] == [59.0, 59.0]
    with pytest.raises(EphemerisSpanError, match=r"a gap in track.csv from .*20:00:59.000Z to .*03:20.000Z"):
        Propagator(one, LEIDEN).at(Utc(START_S + 100.0))
    with pytest.raises(EphemerisSpanError, match="ask within that"):
        Propagator(one, LEIDEN).at(Utc(START_S + 261.0))
    whole = read(table("utc,alt_deg,az_deg", times, overhead, "# gap_s: 200\n"))
    assert len(whole.spans) == 1


@pytest.mark.parametrize("zone", ["", "+00:00", "+0000"])
def test_utc_may_be_written_as_a_zone(zone: str) -> None:
    text = table("utc,alt_deg,az_deg", np.arange(0.0, 30.0), overhead)
    one, other = (Propagator(read(each), LEIDEN) for each in (text, text.replace("Z,", f"{zone},")))
    at = Utc(START_S + 12.5)
    assert one.at(at).az_deg == other.at(at).az_deg


ROWS = f"{stamp(0)},10,20\n{stamp(1)},11,21\n"
PLAIN = ROWS.replace("Z,", "+00:00,")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("utc,alt_deg\n" + ROWS, r"track.csv:1: its columns are none of"),
        (f"utc,alt_deg,az_deg\n{ROWS}{stamp(1)},12,22\n", "track.csv:4: its time is not after"),
        (f"utc,alt_deg,az_deg\n{ROWS}{stamp(2)},12\n", "track.csv:4: a row has 1 numbers where 2"),
        (f"utc,alt_deg,az_deg\n{ROWS}{stamp(2)},91,22\n", "track.csv:4: alt_deg is 91: 90 is the most"),
        (f"utc,alt_deg,az_deg\n{ROWS}{stamp(2)},x,22\n", "track.csv:4: a row: 'x' is no number"),
        (f"utc,alt_deg,az_deg\n{ROWS}2026-02-30T00:00:00Z,1,22\n", "track.csv:4: .* is no time"),
        (f"utc,alt_deg,az_deg\n{PLAIN}{stamp(2)[:-1]}+01:00,12,22\n", "track.csv:4: .* is no time"),
        (f"utc,alt_deg,az_deg\n{stamp(0)},10,20\n", "track.csv:1: it has not two rows"),
        ("# gap_s: -1\nutc,alt_deg,az_deg\n" + ROWS, "track.csv:1: # gap_s: -1: give a number above 0"),
        ("# frame: b1950\nutc,ra_deg,dec_deg\n" + ROWS, "track.csv:1: frame 'b1950' is not known"),
        ("t_s,alt_deg,az_deg\n0,1,2\n1,2,3\n", "its times count from T0: write # t0: UTC above"),
        ("# t0: soon\nt_s,alt_deg,az_deg\n0,1,2\n1,2,3\n", "track.csv:1: # t0: "),
    ],
)
def test_a_bad_table_is_refused_with_its_line(text: str, words: str) -> None:
    with pytest.raises(EphemerisError, match=words):
        read(text)


@pytest.mark.parametrize(
    ("columns", "row"),
    [
        ("utc,alt_deg,az_deg", f"{stamp(2)},12.25,22.50"),
        ("t_s,alt_deg,az_deg", "2.000,12.25,22.50"),
        ("utc,ra_deg,dec_deg,magnitude", f"{stamp(2)},12.25,22.50,-3.5"),
        ("utc,lat_deg,lon_deg,height_m", f"{stamp(2)}, 12.25, 22.50, 9000.5"),
    ],
)
def test_a_table_that_ends_within_a_row_is_refused_with_its_line(columns: str, row: str) -> None:
    t0 = Utc(START_S) if columns.startswith("t_s") else None
    rows = [row.replace(stamp(2), stamp(k)).replace("2.000", f"{k}.000") for k in range(3)]
    whole = "\n".join([columns, *rows])
    assert len(read(whole, t0).segments[0].since_s) == 3
    assert len(read(whole + "\n", t0).segments[0].since_s) == 3
    for cut in range(1, len(row)):
        with pytest.raises(EphemerisError, match=r"^track\.csv:4: "):
            read(whole[:-cut], t0)


def balloon(t: float) -> tuple[float, float, float]:
    """Return what rises at 5 m/s, bursts after 40 minutes and falls at 30 m/s, past the antimeridian."""
    height = 5.0 * t if t < 2400.0 else 12_000.0 - 30.0 * (t - 2400.0)
    return 52.2 + 1e-5 * t, 179.9 + 2e-4 * t - (360.0 if t > 500.0 else 0.0), height


def launch(t: float) -> tuple[float, float, float]:
    """Return what stands for a minute, then flies north at 3 g."""
    flown = 0.5 * 30.0 * max(t - 60.0, 0.0) ** 2
    return 5.2 + flown * 0.5 / 111_000.0, -52.8, 20.0 + 0.6 * flown


def across_north(t: float) -> tuple[float, float]:
    """Return alt and az of what goes through north, a degree a second."""
    return 60.0, (350.0 + t) % 360.0


PATHS: dict[str, tuple[str, Callable[[float], tuple[float, ...]], Array]] = {
    "balloon": ("utc,lat_deg,lon_deg,height_m", balloon, np.cumsum(1.0 + np.arange(150.0) % 30.0)),
    "launch": ("utc,lat_deg,lon_deg,height_m", launch, np.arange(0.0, 240.0, 2.0)),
    "across north": ("utc,alt_deg,az_deg", across_north, np.arange(40.0)),
    "overhead": ("utc,alt_deg,az_deg", overhead, np.arange(301.0)),
    "among the stars": ("utc,ra_deg,dec_deg", lambda t: ((359.0 + t / 60.0) % 360.0, 89.0), np.arange(90.0)),
}


@pytest.mark.parametrize(
    ("columns", "last", "whole"),
    [
        ("lat_deg,lon_deg,height_m", "{k},52.2,5.19,{height}", "11980"),
        ("alt_deg,az_deg", "{k},{alt:.3f},{az}", "149"),
        ("az_deg,alt_deg", "{k},{az:.3f},{down:g}", "55.25"),
    ],
)
def test_a_last_number_that_is_cut_off_is_refused_where_it_is_far_from_the_rows(
    columns: str, last: str, whole: str
) -> None:
    """Numbers of whole digits, and of as many decimals as each needs."""
    rows = [
        last.format(k=stamp(k), height=10990 + 10 * k, alt=20.0 + 0.1 * k, az=50 + k, down=80.0 - 0.25 * k)
        for k in range(100)
    ]
    text = "\n".join([f"utc,{columns}", *rows])
    assert text.endswith(whole)
    assert read(text)
    for cut in range(1, len(whole)):
        with pytest.raises(EphemerisError, match=r"^track\.csv:101: "):
            read(text[:-cut])


@pytest.mark.parametrize("name", PATHS)
def test_a_path_that_turns_bursts_or_begins_at_rest_is_read(name: str) -> None:
    columns, path, times = PATHS[name]
    assert len(read(table(columns, times, path)).segments[0].since_s) == len(times)


@pytest.mark.parametrize(
    ("name", "row", "column", "factor", "words"),
    [
        ("balloon", 7, 1, -1.0, r"this row is 100\d\d km from where"),
        ("balloon", 70, 1, 0.1, r"this row is 5\d\d\d km from where"),
        ("balloon", 70, 2, 0.1, r"this row is 77\d\d km from where"),
        ("balloon", 70, 3, 10.0, r"this row is 44\.\d km from where"),
        ("launch", 90, 1, -1.0, r"this row is 1\d\d\d km from where"),
        ("across north", 0, 1, -1.0, r"this row is 120° from the row 1 s before"),
        ("across north", 1, 1, -1.0, r"this row is 120° from where"),
        ("across north", 20, 2, 10.0, r"this row is 41\.4° from where"),
        ("across north", 39, 1, 0.1, r"this row is \d+(\.\d)?° from the row 1 s before"),
        ("overhead", 100, 2, 0.1, r"this row is \d+\.\d° from where"),
        ("among the stars", 50, 2, -1.0, r"this row is 178° from where"),
    ],
)
def test_a_row_that_the_others_contradict_is_refused_with_its_line(
    name: str, row: int, column: int, factor: float, words: str
) -> None:
    columns, path, times = PATHS[name]
    lines = table(columns, times, path).split("\n")
    # Of the two rows of a step at the beginning the first or the second is wrong.
    line = max(row, 1) + 1
    fields = lines[row + 1].split(",")
    fields[column] = f"{factor * float(fields[column]):.6f}"
    lines[row + 1] = ",".join(fields)
    with pytest.raises(EphemerisError, match=rf"^track\.csv:{line + 1}: {words}"):
        read("\n".join(lines))


def test_several_wrong_rows_together_are_refused_where_they_begin() -> None:
    lines = table("utc,alt_deg,az_deg", np.arange(40.0), across_north).split("\n")
    lines[21:25] = [line.replace(",60.0", ",-60.0") for line in lines[21:25]]
    with pytest.raises(EphemerisError, match=r"^track\.csv:22: this row is 120° from the row 1 s before"):
        read("\n".join(lines))


def test_places_that_are_rounded_to_a_kilometre_are_read() -> None:
    rounded = [f"{stamp(t)},{52.2 + 3e-4 * t:.2f},{4.6 + 1e-4 * t:.2f},9000" for t in range(200)]
    # As noise has it, a place falls back on the one before.
    rounded[20], rounded[21] = rounded[20].replace("52.21", "52.20"), rounded[21].replace("52.21", "52.20")
    read("\n".join(["utc,lat_deg,lon_deg,height_m", *rounded, ""]))


def test_a_table_in_quotes_is_read_as_one_without() -> None:
    plain = table("utc,alt_deg,az_deg", np.arange(4.0), lambda t: (20.0 + t, 100.0 + t))
    quoted = "\n".join(
        ",".join(f'"{word}"' for word in line.split(",")) if line else "" for line in plain.split("\n")
    )
    one, other = (read(text).segments[0] for text in (plain, quoted))
    assert np.array_equal(one.place_km, other.place_km)


def test_directions_want_a_site_and_absolute_times_no_t0() -> None:
    text = "utc,alt_deg,az_deg\n" + ROWS
    with pytest.raises(EphemerisError, match="directions hold for one site: give --site"):
        read(text, site=None)
    with pytest.raises(EphemerisError, match="its times are UTC"):
        read(text, t0=Utc(START_S))
