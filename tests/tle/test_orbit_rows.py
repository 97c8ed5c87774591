"""Rows that are wrong, by motions that others compute: SGP4's library, an integrator of SciPy, real files."""

from __future__ import annotations

import gzip
import itertools
import random
from typing import TYPE_CHECKING, Literal

import erfa
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from sgp4.api import Satrec

from tle.earth import EarthOrientation
from tle.errors import EphemerisError
from tle.formats.ephemerides import parse_ephemerides

if TYPE_CHECKING:
    from pathlib import Path

    from tle.ephemeris import TableEphemeris

Array = NDArray[np.float64]
Kind = Literal["sign", "lost digit", "other digit", "two columns", "no point"]
KINDS: tuple[Kind, ...] = ("sign", "lost digit", "other digit", "two columns", "no point")
JULIAN_2020_05_27 = 2458996.5
UNIX_2020_05_27 = 1590537600.0
ELEMENTS = {
    "iss": (
        "1 25544U 98067A   20147.42921296  .00002182  00000-0  47000-4 0  9990",
        "2 25544  51.6444 103.7200 0001800 350.0000 110.0000 15.49400000228000",
    ),
    "transfer": (
        "1 40000U 14000A   20147.50000000  .00000100  00000-0  10000-3 0  9990",
        "2 40000  27.0000 103.7200 7200000 170.0000  10.0000  2.27000000022800",
    ),
    "stationary": (
        "1 41000U 15000A   20147.50000000  .00000010  00000-0  00000-0 0  9990",
        "2 41000   0.0500  80.0000 0002000  10.0000  10.0000  1.00270000022800",
    ),
}
HERMITE = "INTERPOLATION = HERMITE\nINTERPOLATION_DEGREE = 7\n"
EARTH_KM3_S2, EARTH_KM, J2 = 398600.4418, 6378.137, 1.0826e-3
MOON_KM3_S2, MOON_KM = 4902.8, 384_400.0


def head(first: str, last: str, frame: str, more: str = "") -> list[str]:
    return (
        "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2020-05-27T00:00:00\nORIGINATOR = US\nMETA_START\n"
        f"OBJECT_NAME = ONE\nOBJECT_ID = 2014-001A\nCENTER_NAME = EARTH\nREF_FRAME = {frame}\n"
        "TIME_SYSTEM = UTC\n"
        f"START_TIME = {first}\nSTOP_TIME = {last}\n{more}META_STOP"
    ).splitlines()


def stamps(seconds: NDArray[np.floating]) -> list[str]:
    start = np.datetime64("2020-05-27T00:00:00.000")
    return [str(start + np.timedelta64(round(1000.0 * s), "ms")) for s in seconds.tolist()]


def written(
    seconds: NDArray[np.floating], states: Array, frame: str, more: str = ""
) -> tuple[list[str], list[str]]:
    """Return an OEM as the lines of its head and those of its rows."""
    times = stamps(seconds)
    rows = [
        f"{time} {' '.join(f'{x:.6f}' for x in state[:3])} {' '.join(f'{x:.9f}' for x in state[3:])}"
        for time, state in zip(times, states.tolist(), strict=True)
    ]
    return head(times[0], times[-1], frame, more), rows


def whole(start: list[str], rows: list[str]) -> list[str]:
    return start + rows


def by_sgp4(satellite: Satrec, seconds: NDArray[np.floating]) -> Array:
    errors, places, velocities = satellite.sgp4_array(
        np.full(len(seconds), JULIAN_2020_05_27), seconds / 86400.0
    )
    assert not errors.any()
    return np.concatenate([places, velocities], axis=1)


def of_elements(name: str, step_s: float, count: int, more: str = "") -> tuple[list[str], list[str]]:
    seconds = step_s * np.arange(count)
    return written(seconds, by_sgp4(Satrec.twoline2rv(*ELEMENTS[name]), seconds), "TEME", more)


def falling(state: Array, seconds: Array) -> Array:
    """Return the states of an object about the flattened Earth and below the Moon, shape (n, 6)."""

    def pulled(t: float, y: Array) -> Array:
        place, away = y[:3], float(np.linalg.norm(y[:3]))
        up = (place[2] / away) ** 2
        flat = 1.5 * J2 * EARTH_KM3_S2 * EARTH_KM**2 / away**5
        moon = MOON_KM * np.array(
            [np.cos(2.66e-6 * t), 0.92 * np.sin(2.66e-6 * t), 0.39 * np.sin(2.66e-6 * t)]
        )
        to_moon = moon - place
        pull = -EARTH_KM3_S2 * place / away**3 + flat * place * (5.0 * up - np.array([1.0, 1.0, 3.0]))
        pull += MOON_KM3_S2 * (to_moon / np.linalg.norm(to_moon) ** 3 - moon / MOON_KM**3)
        return np.concatenate([y[3:], pull])

    span = (float(seconds[0]), float(seconds[-1]))
    solved = solve_ivp(pulled, span, state, method="DOP853", rtol=1e-12, atol=1e-9, t_eval=seconds)
    states: Array = solved.y.T
    return states


def at_perigee(axis_km: float, eccentricity: float) -> Array:
    speed = np.sqrt(EARTH_KM3_S2 * (1.0 + eccentricity) / (axis_km * (1.0 - eccentricity)))
    return np.array([axis_km * (1.0 - eccentricity), 0.0, 0.0, 0.0, 0.8 * speed, 0.6 * speed])


def read(lines: list[str]) -> TableEphemeris:
    (one,) = parse_ephemerides(("\n".join(lines) + "\n").encode(), "a")
    return one


def wrecked(row: str, columns: list[int], kind: Kind, chance: random.Random) -> str:
    """Return a row in which one number is wrong by a kilometre, a kilometre a second or more."""
    words = row.split()
    column = chance.choice([k for k in columns if abs(float(words[k])) > 1.0])
    text = words[column]
    whole = text.partition(".")[0]
    at = chance.choice([k for k, c in enumerate(whole) if c.isdigit()])
    if kind == "sign":
        words[column] = text[1:] if text.startswith("-") else f"-{text}"
    elif kind == "lost digit":
        words[column] = text[:at] + ("" if len(whole.lstrip("-")) > 1 else "0") + text[at + 1 :]
    elif kind == "other digit":
        words[column] = text[:at] + str((int(text[at]) + chance.randint(1, 9)) % 10) + text[at + 1 :]
    elif kind == "two columns":
        other = column + 1 if column + 1 in columns and (column != 3) else column - 1
        words[column], words[other] = words[other], words[column]
    else:
        words[column] = text.replace(".", "")
    return " ".join(words)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("name", "step_s", "more"),
    [
        ("iss", 60.0, ""),
        ("iss", 240.0, ""),
        ("iss", 60.0, "INTERPOLATION = LAGRANGE\nINTERPOLATION_DEGREE = 9\n"),
        ("iss", 60.0, HERMITE),
        ("transfer", 120.0, ""),
        ("stationary", 900.0, ""),
    ],
)
def test_a_wrong_number_in_an_oem_is_refused_with_its_line(
    name: str, step_s: float, more: str, kind: Kind
) -> None:
    start, rows = of_elements(name, step_s, 120, more)
    read(start + rows)
    chance = random.Random(kind)
    for row in (0, 1, 118, 119, *(chance.randrange(2, 118) for _ in range(6))):
        bad = wrecked(rows[row], [1, 2, 3, 4, 5, 6], kind, chance)
        if bad == rows[row]:
            continue
        with pytest.raises(EphemerisError) as caught:
            read([*start, *rows[:row], bad, *rows[row + 1 :]])
        assert str(caught.value).startswith(f"a:{len(start) + row + 1}: the row"), bad


@pytest.mark.parametrize("kind", KINDS)
def test_a_wrong_number_in_a_cpf_is_refused_with_its_line(cases: Path, kind: Kind) -> None:
    lines = (cases / "ephemerides/ilrs/lageos1_cpf_180613_16401.hts").read_text().splitlines()
    places = [k for k, line in enumerate(lines) if line.startswith("10 ")]
    chance = random.Random(kind)
    for row in (places[0], places[1], places[-1], *(chance.choice(places) for _ in range(6))):
        metres = lines[row].split()
        # A kilometre and more: what is less is below the orbit's own irregularities.
        shifted = " ".join([*metres[:5], *(f"{float(x) / 1000.0:.6f}" for x in metres[5:])])
        bad = wrecked(shifted, [5, 6, 7], kind, chance).split()
        back = " ".join([*bad[:5], *(f"{float(x) * 1000.0:.3f}" for x in bad[5:])])
        with pytest.raises(EphemerisError) as caught:
            read([*lines[:row], back, *lines[row + 1 :]])
        assert str(caught.value).startswith(f"a:{row + 1}: the row of lageos1 at "), back


def test_of_an_sp3_the_satellite_with_a_wrong_number_is_not_read(cases: Path) -> None:
    lines = (cases / "ephemerides/sp3/three-hours.sp3").read_text().splitlines()
    row = [k for k, line in enumerate(lines) if line.startswith("PC01")][10]
    x = float(lines[row][4:18])
    bad = f"{lines[row][:4]}{-x:14.6f}{lines[row][18:]}"
    found = parse_ephemerides("\n".join([*lines[:row], bad, *lines[row + 1 :], ""]).encode(), "a")
    assert [one.name for one in found] == ["C02"]
    assert str(found[0].refused["C01"]).startswith(f"a:{row + 1}: the row of C01 at 2015-05-05T00:49:44")
    # A number that is none is in its own line, and not in the first one.
    with pytest.raises(EphemerisError, match=rf"^a:{row + 1}: a line P has not 3 numbers"):
        parse_ephemerides(
            "\n".join([*lines[:row], bad.replace(".", "x", 1), *lines[row + 1 :], ""]).encode(), "a"
        )


def test_what_others_compute_from_elements_is_read(cases: Path) -> None:
    # Their velocities are not quite the derivatives of their places: by metres a second in deep space.
    packed = (cases / "catalogues/spacetrack_full_20250901.tle.gz").read_bytes()
    sets = [
        (one, two)
        for one, two in itertools.pairwise(gzip.decompress(packed).decode().splitlines())
        if one.startswith("1 ") and two.startswith("2 ")
    ]
    high = [pair for pair in sets if float(pair[1][52:63]) < 6.4]
    highest = [pair for pair in sets if float(pair[1][52:63]) < 0.15]
    chance = random.Random(25)
    for step_s, some in ((60.0, sets), (240.0, sets), (60.0, high), (120.0, high), (300.0, highest)):
        for one, two in chance.sample(some, min(12, len(some))):
            satellite = Satrec.twoline2rv(one, two)
            # From the epoch on: the library's day is two numbers.
            seconds = step_s * np.arange(200.0)
            epoch_s = (satellite.jdsatepoch - JULIAN_2020_05_27 + satellite.jdsatepochF) * 86400.0
            states = by_sgp4(satellite, seconds + epoch_s)
            found = read(whole(*written(seconds, states, "TEME")))
            held = np.arange(20, 180) * step_s + 0.5 * step_s
            places = found.states(EarthOrientation.fixed(0.0)).at_many(
                np.array(UNIX_2020_05_27 + held, dtype=np.float64), 0.0
            )
            wanted = by_sgp4(satellite, held + epoch_s)[:, :3]
            missed = np.linalg.norm(np.array(places[:3]).T - wanted, axis=1)
            assert missed.max() < 0.05, (one, step_s)


@pytest.mark.parametrize(
    ("state", "step_s"),
    [
        (at_perigee(24_400.0, 0.73), 180.0),
        (at_perigee(26_560.0, 0.74), 60.0),
        (at_perigee(240_000.0, 0.55), 3600.0),
        (at_perigee(42_164.0, 0.0002), 3600.0),
        (at_perigee(6800.0, 0.001), 300.0),
        (at_perigee(6800.0, 0.001), 0.1),
    ],
)
def test_orbits_of_any_kind_are_read_and_no_row_of_them_is_called_wrong(state: Array, step_s: float) -> None:
    seconds = step_s * np.arange(150.0)
    assert len(read(whole(*written(seconds, falling(state, seconds), "GCRF"))).segments) == 1


@pytest.mark.parametrize("at_s", [1830.0, 1900.0])
def test_what_an_engine_did_between_two_rows_is_confined_to_them(at_s: float) -> None:
    # 5 m/s within one of the steps of 120 s; a polynomial across would carry that to the steps about it.
    seconds = 120.0 * np.arange(60.0)
    fine = np.arange(0.0, 7080.0, 7.0)

    def burnt(t: Array) -> Array:
        early, late = t[t <= at_s], t[t > at_s]
        quiet = falling(at_perigee(6800.0, 0.001), np.array([*early, at_s]))
        pushed = quiet[-1] + np.array([0.0, 0.0, 0.0, 0.003, 0.004, 0.0])
        return np.concatenate([quiet[:-1], falling(pushed, np.array([at_s, *late]))[1:]])

    one = read(whole(*written(seconds, burnt(seconds), "TEME")))
    assert len(one.segments) == 3
    assert len(one.spans) == 1
    places = np.array(one.states(EarthOrientation.fixed(0.0)).at_many(UNIX_2020_05_27 + fine, 0.0)[:3]).T
    missed = np.linalg.norm(places - burnt(fine)[:, :3], axis=1)
    inside = (fine > 1800.0) & (fine < 1920.0)
    assert missed[~inside].max() < 1e-3
    assert missed[inside].max() < 0.1


def test_a_file_in_metres_and_an_xml_in_metres_are_refused() -> None:
    seconds = 60.0 * np.arange(60.0)
    states = falling(at_perigee(6800.0, 0.001), seconds)
    start, rows = written(seconds, 1000.0 * states, "GCRF")
    with pytest.raises(EphemerisError, match=rf"^a:{len(start) + 1}: .* go at 7\d\d\d km/s .*units"):
        read(start + rows)
    xml = (
        '<oem version="2.0"><header/><body><segment><metadata/><data>\n<stateVector>'
        '<EPOCH>2020-05-27T00:00:00</EPOCH>\n<X units="m">6800000</X></stateVector></data></segment>'
        "</body></oem>"
    )
    with pytest.raises(EphemerisError, match=r"^a:3: X is in 'm': an OEM has km$"):
        read([xml])
    with pytest.raises(EphemerisError, match=r"^a:3: X_DOT is in 'm/s': an OEM has km/s$"):
        read([xml.replace('X units="m"', 'X_DOT units="m/s"')])


@pytest.mark.parametrize("step_s", [1.0, 60.0])
def test_velocities_against_the_turning_earth_are_none_of_inertial_places(step_s: float) -> None:
    seconds = step_s * np.arange(200.0)
    states = falling(at_perigee(6800.0, 0.001), seconds)
    states[:, 3:] -= np.cross([0.0, 0.0, 7.2921e-5], states[:, :3])
    with pytest.raises(EphemerisError, match=r"velocities that are \d\d\d m/s from those of"):
        read(whole(*written(seconds, states, "GCRF", HERMITE)))


def test_a_variance_below_nothing_is_refused() -> None:
    start, rows = of_elements("iss", 60.0, 30)
    covariance = ["COVARIANCE_START", f"EPOCH = {rows[0].split()[0]}", "-1e-4"]
    with pytest.raises(EphemerisError, match=rf"^a:{len(start) + 33}: a covariance's variance is negative"):
        read([*start, *rows, *covariance, "COVARIANCE_STOP"])


@pytest.mark.parametrize("count", [3, 4, 5, 6, 8])
def test_few_rows_state_the_error_of_what_is_interpolated_from_them(cases: Path, count: int) -> None:
    lines = (cases / "ephemerides/sp3/three-hours.sp3").read_text().splitlines(keepends=True)
    epochs = [k for k, line in enumerate(lines) if line.startswith("*")]
    whole = {one.name: one for one in parse_ephemerides("".join(lines).encode(), "a")}
    first = f"{lines[0][:32]}{count:7d}{lines[0][39:]}"
    some = [first, *lines[1 : epochs[0]], *lines[epochs[10] : epochs[10 + count]], "EOF\n"]
    earth = EarthOrientation.fixed(0.0)
    for one in parse_ephemerides("".join(some).encode(), "a"):
        (low, high) = (float(end.unix_s) for end in one.spans[0])
        at = np.linspace(low, high, 100)
        places = [np.array(each.states(earth).at_many(at, 0.0)[:3]) for each in (one, whole[one.name])]
        missed_km = float(np.linalg.norm(places[0] - places[1], axis=0).max())
        stated, usual = one.covariance(one.epoch), whole[one.name].covariance(one.epoch)
        assert stated is not None
        assert usual is not None
        assert missed_km < stated.sigma_km
        assert stated.sigma_km < 1.1 * usual.sigma_km or count < 8


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_of_few_rows_those_that_are_thrown_far_away_are_refused(count: int) -> None:
    start, rows = of_elements("stationary", 120.0, count)
    read(start + rows)
    for row in range(count):
        for column in range(1, 7):
            words = rows[row].split()
            words[column] = "1e9"
            with pytest.raises(EphemerisError):
                read([*start, *rows[:row], " ".join(words), *rows[row + 1 :]])


@pytest.mark.parametrize("late_s", [0.1, 1.0, -1.0])
@pytest.mark.parametrize("step_s", [10.0, 60.0, 180.0])
def test_rows_that_are_late_from_one_on_are_refused_with_its_line(step_s: float, late_s: float) -> None:
    seconds = step_s * np.arange(120.0)
    satellite = Satrec.twoline2rv(*ELEMENTS["iss"])
    states = by_sgp4(satellite, seconds + np.where(np.arange(120) < 70, 0.0, late_s))
    start, rows = written(seconds, states, "TEME")
    with pytest.raises(EphemerisError) as caught:
        read(start + rows)
    assert str(caught.value).startswith(f"a:{len(start) + 71}: the row of ONE at ")
    # The same without velocities, as a CPF has them.
    places = [
        f"10 0 58996 {second:.1f} 0 " + " ".join(f"{1000.0 * x:.3f}" for x in state[:3])
        for second, state in zip(seconds.tolist(), states.tolist(), strict=True)
    ]
    last = stamps(seconds[-1:])[0][:19].replace("-", " ").replace("T", " ").replace(":", " ")
    cpf = [
        "H1 CPF  2  XYZ 2020 05 27 00 148 1 one",
        f"H2 9806701 0 25544 2020 05 27 00 00 00 {last} {step_s:.0f} 1 1 1 0 0 1",
        *places,
        "99",
    ]
    with pytest.raises(EphemerisError, match=r"^a:73: the row of one at "):
        read(cpf)


def test_a_stationary_satellite_in_metres_is_refused_in_turning_axes_too() -> None:
    start, rows = of_elements("stationary", 900.0, 40)
    metres = [
        " ".join([row.split()[0], "42164000.0", "1000.0", f"{k}.0", "0.1", "0.1", "0.1"])
        for k, row in enumerate(rows)
    ]
    lines = [line.replace("TEME", "ITRF2020") for line in start]
    with pytest.raises(EphemerisError, match=r"go at 30\d\d km/s from here on: check their units"):
        read(lines + metres)
    with pytest.raises(EphemerisError, match=r"^a:8: REF_FRAME ITRF1800 is not known"):
        read([line.replace("TEME", "ITRF1800") for line in start] + rows)


def in_itrf(states: Array, seconds: Array) -> Array:
    """Return states against the Earth as ERFA has it turn, poles left alone, shape (n, 6)."""
    angle = erfa.era00(JULIAN_2020_05_27, seconds / 86400.0)
    c, s, turn = np.cos(angle), np.sin(angle), 7.292115e-5
    x, y, z, u, v, w = states.T
    east, north = x * c + y * s, y * c - x * s
    return np.stack([east, north, z, u * c + v * s + turn * north, v * c - u * s - turn * east, w], axis=1)


def laser(seconds: Array, places: Array) -> list[str]:
    """Return a CPF of places (km) against the Earth."""
    last = stamps(seconds[-1:])[0][:19].replace("-", " ").replace("T", " ").replace(":", " ")
    days = (58996 + seconds // 86400).astype(int)
    rows = [
        f"10 0 {day} {second:.1f} 0 " + " ".join(f"{1000.0 * x:.3f}" for x in place)
        for day, second, place in zip(
            days.tolist(), (seconds % 86400.0).tolist(), places.tolist(), strict=True
        )
    ]
    head = "H1 CPF  2  XYZ 2020 05 27 00 148 1 one\nH2 9806701 0 25544 2020 05 27 00 00 00"
    return [*f"{head} {last} {seconds[1] - seconds[0]:.0f} 1 1 0 0 0 1".splitlines(), *rows, "99"]


DISTANT = {
    "stationary": (at_perigee(42_164.0, 0.0002), 900.0),
    "navigation": (at_perigee(26_560.0, 0.01), 300.0),
    "eccentric": (at_perigee(90_000.0, 0.6), 900.0),
    "to the Moon": (at_perigee(240_000.0, 0.55), 3600.0),
    "beyond the Moon": (at_perigee(200_000.0, 0.9), 1800.0),
}


@pytest.mark.parametrize("late_s", [0.1, 1.0, -1.0])
@pytest.mark.parametrize("step_s", [300.0, 900.0])
def test_a_leap_second_that_was_forgotten_is_refused_with_its_line(step_s: float, late_s: float) -> None:
    """Places are right, and from a row on their times are wrong: one step is longer or shorter."""
    seconds = step_s * np.arange(120.0)
    places = in_itrf(falling(at_perigee(29_600.0, 0.001), seconds), seconds)[:, :3]
    assert read(laser(seconds, places))
    with pytest.raises(EphemerisError, match=r"^a:73: the row of one at .* a time is wrong from here on"):
        read(laser(seconds + np.where(np.arange(120) < 70, 0.0, late_s), places))


@pytest.mark.parametrize("scaled", [slice(0, 3), slice(0, 6), slice(1, 2)], ids=["places", "all", "y"])
@pytest.mark.parametrize("orbit", DISTANT)
def test_a_slipped_point_in_all_rows_of_a_distant_orbit_is_refused(orbit: str, scaled: slice) -> None:
    state, step_s = DISTANT[orbit]
    seconds = step_s * np.arange(100.0)
    states = falling(state, seconds)
    turning = in_itrf(states, seconds)
    assert read(laser(seconds, turning[:, :3])).frame.startswith("ITRF")
    for axes, frame in ((states, "GCRF"), (turning, "ITRF2020")):
        assert len(read(whole(*written(seconds, axes, frame))).segments) == 1
        axes[:, scaled] *= 10.0
        with pytest.raises(EphemerisError, match=r"^a:\d+: the rows? of ONE "):
            read(whole(*written(seconds, axes, frame)))
    with pytest.raises(EphemerisError, match=r"^a:\d+: the rows? of one "):
        read(laser(seconds, turning[:, :3]))


@pytest.mark.parametrize("step_s", [1.0, 60.0, 3600.0])
@pytest.mark.parametrize("frame", ["GCRF", "ITRF2020"])
def test_what_is_far_from_the_earth_is_read(frame: str, step_s: float) -> None:
    # By ERFA: the Moon, what goes round it 100 km high, what stays beyond the Earth as the Sun sees it, and
    # an asteroid that flies by at 30 km/s.
    seconds = step_s * np.arange(60.0)
    au_km = 149_597_870.7

    def seen(pv: NDArray[np.void]) -> Array:
        return np.concatenate([pv["p"], pv["v"] / 86400.0], axis=1) * au_km

    moon = seen(erfa.moon98(JULIAN_2020_05_27, seconds / 86400.0))
    rate = np.sqrt(MOON_KM3_S2 / 1837.0**3)
    c, s, nought = np.cos(rate * seconds), np.sin(rate * seconds), np.zeros(60)
    about = moon + 1837.0 * np.stack([c, s, nought, -rate * s, rate * c, nought], axis=1)
    beyond = 0.01 * seen(erfa.epv00(JULIAN_2020_05_27, seconds / 86400.0)[0])
    by = np.stack([30.0 * seconds - 3e5, nought + 1e5, nought, nought + 30.0, nought, nought], axis=1)
    for states in (moon, beyond, *((about, by) if step_s < 100.0 else ())):
        axes = states if frame == "GCRF" else in_itrf(states, seconds)
        assert len(read(whole(*written(seconds, axes, frame))).segments) == 1


def test_a_number_with_a_stroke_in_it_is_named_in_its_line() -> None:
    start, rows = of_elements("iss", 60.0, 20)
    bad = rows[11].replace(".", "_", 2).replace("_", ".", 1)
    with pytest.raises(EphemerisError, match=rf"^a:{len(start) + 12}: .*'.*_.*' is no number"):
        read([*start, *rows[:11], bad, *rows[12:]])


def test_an_ephemeris_of_the_operator_of_starlink_is_read_as_an_oem_of_the_same_rows() -> None:
    seconds = 60.0 * np.arange(30.0)
    start, rows = written(seconds, falling(at_perigee(6928.0, 0.0002), seconds), "EME2000")
    lines = [
        "created:2020-05-26 23:00:00 UTC",
        "ephemeris_start:2020-05-27 00:00:00 UTC ephemeris_stop:2020-05-27 00:29:00 UTC step_size:60",
        "ephemeris_source:blend",
        "UVW",
    ]
    for row in rows:
        clock, _, state = row.partition(" ")
        lines.append(f"2020148{clock[11:].replace(':', '')} {state}")
        lines += ["1e-4 0 4e-4 0 0 4e-4 0", "0 0 1e-9 0 0 0 0", "1e-9 0 0 0 0 0 1e-9"]
    source = "folder/MEME_44713_STARLINK-1007_1480000_Operational_1274572800_UNCLASSIFIED.txt"

    def given(text: list[str]) -> TableEphemeris:
        (one,) = parse_ephemerides(("\n".join(text) + "\n").encode(), source)
        return one

    one, other = given(lines), read(start + rows)
    assert (one.name, one.catalog_number, one.frame) == ("STARLINK-1007", 44713, "EME2000")
    assert one.epoch.isoformat("seconds") == "2020-05-26T23:00:00Z"
    assert np.array_equal(one.segments[0].place_km, other.segments[0].place_km)
    assert np.array_equal(one.segments[0].velocity_km_s, other.segments[0].velocity_km_s)
    assert one.spans == other.spans
    known = one.covariance(one.spans[0][0])
    assert known is not None
    assert (known.frame, known.sigma_km) == ("UVW", pytest.approx(0.03))
    with pytest.raises(EphemerisError, match=r"\.txt:117: '2020148002800\.000' begins no whole row"):
        given(lines[:118])
    with pytest.raises(EphemerisError, match=r"the rows end at .* the text is cut off"):
        given(lines[:100])
    bad = wrecked(lines[44], [1, 2, 3], "sign", random.Random(1))
    with pytest.raises(EphemerisError, match=r"\.txt:45: the row of STARLINK-1007 at 2020-05-27T00:10:00"):
        given([*lines[:44], bad, *lines[45:]])
