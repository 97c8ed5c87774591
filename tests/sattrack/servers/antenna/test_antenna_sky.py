"""The reduction of sources and satellites against other libraries, and the signs of biases and offsets."""

from __future__ import annotations

import math

import erfa
import pytest
from antenna_setup import NOON_NS, SITE, exchange, make_controller

from sattrack.servers.antenna.controller import AntennaAction
from sattrack.servers.antenna.protocol import NS, encode
from sattrack.servers.antenna.trajectory import (
    AxisCorrections,
    AzEl,
    HaDec,
    RaDec,
    Reduction,
    SiteSky,
    SkyPath,
)
from tle.errors import DecayedError
from tle.instants import Utc

NOON_S = NOON_NS / NS
LINE_1 = "1 25544U 98067A   26275.01380287  .00003738  00000+0  76743-4 0  9992"
LINE_2 = "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 15.48707684588318"
# Over Leiden, the ISS of these elements is high in the south at this instant, and moves east.
CULMINATION_S = 3924.0


@pytest.fixture(scope="module")
def sky() -> SiteSky:
    return SiteSky(SITE)


def by_erfa(sky: SiteSky, mean: RaDec, utc_s: float) -> tuple[float, float, float, float]:
    """Return a star's apparent right ascension and declination, azimuth and altitude without air, degrees."""
    o = sky.earth.orientation(Utc(utc_s))
    star = [math.radians(x) for x in mean]
    date = (2440587.5, utc_s / 86400.0, o.dut1_s)
    site = [math.radians(SITE.longitude_deg), math.radians(SITE.latitude_deg), 0.0]
    rest = [math.radians(o.xp_arcsec / 3600.0), math.radians(o.yp_arcsec / 3600.0), 0.0, 0.0, 0.0, 0.5]
    star_data, origins = erfa.apco13(*date, *site, *rest)
    ra, dec = erfa.atciq(*star, 0.0, 0.0, 0.0, 0.0, star_data)
    az, zenith, *_ = erfa.atco13(*star, 0.0, 0.0, 0.0, 0.0, *date, *site, *rest)
    return tuple(math.degrees(x) for x in (ra - origins, dec, az, math.pi / 2.0 - zenith))


PLACES = [RaDec(83.633, 22.014), RaDec(187.7, 12.39), RaDec(350.85, 58.8), RaDec(10.0, -20.0)]


@pytest.mark.parametrize("mean", PLACES)
def test_mean_places_come_to_where_erfa_has_them(sky: SiteSky, mean: RaDec) -> None:
    ra, dec, az, alt = by_erfa(sky, mean, NOON_S)
    seen = sky.of_date(mean, NOON_S)
    # The Sun's bending of light, up to 0.03" for these places on that day, is left out.
    assert abs(math.remainder(seen.ra_deg - ra, 360.0)) * math.cos(math.radians(dec)) * 3600.0 < 0.04
    assert abs(seen.dec_deg - dec) * 3600.0 < 0.04
    there = sky.horizontal(HaDec(sky.sidereal_deg(NOON_S) - seen.ra_deg, seen.dec_deg), NOON_S)
    assert abs(math.remainder(there.az_deg - az, 360.0)) * math.cos(math.radians(alt)) * 3600.0 < 0.04
    assert abs(there.el_deg - alt) * 3600.0 < 0.04


@pytest.mark.parametrize(("az", "el"), [(10.0, 20.0), (200.0, 60.0), (359.0, 5.0), (90.0, 89.9)])
def test_horizontal_places_come_back_from_hour_angles(sky: SiteSky, az: float, el: float) -> None:
    back = sky.horizontal(sky.equatorial(AzEl(az, el), NOON_S), NOON_S)
    assert back == pytest.approx((az, el), abs=1e-6)


def test_a_plunged_elevation_points_at_the_other_azimuth(sky: SiteSky) -> None:
    plunged = sky.equatorial(AzEl(30.0, 100.0), NOON_S)
    plain = sky.equatorial(AzEl(210.0, 80.0), NOON_S)
    assert plunged == pytest.approx(plain, abs=1e-9)


def commanded(sent: list[str], at_s: float = 0.0) -> tuple[float, float]:
    controller = make_controller()
    for message in sent:
        assert b" ACK " in exchange(controller, encode(message), at_s)
    fields = exchange(controller, encode("PS"), at_s).split()
    return float(fields[1]), float(fields[2])


def test_a_source_of_date_stands_at_sidereal_time_less_its_right_ascension(sky: SiteSky) -> None:
    theta = math.degrees(
        erfa.gst06a(2440587.5, NOON_S / 86400.0 + dut1(sky) / 86400.0, 2440587.5, (NOON_S + 69.184) / 86400.0)
    )
    ha, dec = commanded(["RADEC DATE 200 20"])
    assert abs(math.remainder(ha - (theta + SITE.longitude_deg - 200.0), 360.0)) * 3600.0 < 0.01
    assert dec == 20.0


def dut1(sky: SiteSky) -> float:
    return sky.earth.orientation(Utc(NOON_S)).dut1_s


def test_offsets_add_to_the_coordinates_themselves(sky: SiteSky) -> None:
    plain = commanded(["RADEC DATE 200 20"])
    east = commanded(["OFFSET RADEC 0.5 0.25", "RADEC DATE 200 20"])
    assert east == pytest.approx((plain[0] - 0.5, plain[1] + 0.25), abs=2e-8)
    west = commanded(["OFFSET HADEC 0.5 0.25", "RADEC DATE 200 20"])
    assert west == pytest.approx((plain[0] + 0.5, plain[1] + 0.25), abs=2e-8)
    high = commanded(["OFFSET AZEL 0 0.5", "RADEC DATE 200 20"])
    above = sky.horizontal(HaDec(*high), NOON_S).el_deg - sky.horizontal(HaDec(*plain), NOON_S).el_deg
    assert above == pytest.approx(0.5, abs=1e-6)


def test_an_offset_moves_what_is_being_followed_too() -> None:
    after = commanded(["RADEC DATE 200 20", "OFFSET HADEC 0.5 0.25"])
    before = commanded(["OFFSET HADEC 0.5 0.25", "RADEC DATE 200 20"])
    assert after == pytest.approx(before, abs=2e-8)


def test_a_source_at_an_instant_is_a_fixed_direction() -> None:
    moving = commanded(["RADEC DATE 200 20"], 600.0)
    fixed = commanded(["FIXSKY DATE 200 20 43800"], 0.0)
    assert fixed == pytest.approx(moving, abs=2e-8)


def test_the_pointing_model_and_its_inverse_undo_each_other() -> None:
    model = AxisCorrections(0.1, -0.2, 0.05, 0.03, -0.02, 0.04)
    for place in (HaDec(0.0, 0.0), HaDec(75.0, 60.0), HaDec(-100.0, -20.0), HaDec(170.0, 80.0)):
        assert model.inverse(model.axes(place)) == pytest.approx(place, abs=1e-7)


@pytest.mark.parametrize(
    ("term", "place", "added"),
    [
        ("ih", HaDec(10.0, 20.0), (0.1, 0.0)),
        ("id", HaDec(10.0, 20.0), (0.0, 0.1)),
        ("ch", HaDec(10.0, 60.0), (0.2, 0.0)),
        ("np", HaDec(10.0, 45.0), (0.1, 0.0)),
        ("ma", HaDec(0.0, 45.0), (-0.1, 0.0)),
        ("ma", HaDec(90.0, 45.0), (0.0, 0.1)),
        ("me", HaDec(0.0, 45.0), (0.0, 0.1)),
        ("me", HaDec(90.0, 45.0), (0.1, 0.0)),
    ],
)
def test_each_term_of_the_model_does_what_its_formula_says(
    term: str, place: HaDec, added: tuple[float, float]
) -> None:
    assert AxisCorrections(**{term: 0.1}).correction(place) == pytest.approx(added, abs=1e-12)


def test_a_pointing_model_moves_what_is_followed_and_its_inverse_tells_where_the_axes_point(
    sky: SiteSky,
) -> None:
    """It stands at 30° and 40°: with index errors of 0.5° and -0.25° it looks at 29.5° and 40.25°."""
    plain = commanded(["RADEC DATE 200 20"])
    moved = commanded(["RADEC DATE 200 20", "POINTING 0.5 -0.25 0 0 0 0"])
    assert moved == pytest.approx((plain[0] + 0.5, plain[1] - 0.25), abs=2e-8)
    controller = make_controller()
    exchange(controller, encode("POINTING 0.5 -0.25 0 0 0 0"))
    told = [float(field) for field in exchange(controller, encode("SKY")).split()[1:6]]
    seen = sky.horizontal(HaDec(29.5, 40.25), NOON_S)
    assert told == pytest.approx([(sky.sidereal_deg(NOON_S) - 29.5) % 360.0, 40.25, *seen, 43200.0], abs=2e-8)


def test_without_a_model_the_axes_point_where_they_stand(sky: SiteSky) -> None:
    told = [float(field) for field in exchange(make_controller(), encode("SKY")).split()[1:3]]
    assert told == pytest.approx([(sky.sidereal_deg(NOON_S) - 30.0) % 360.0, 40.0], abs=2e-8)


ISS = [f"TLE 1 25544 {LINE_1}", f"TLE 2 25544 {LINE_2}"]


def test_a_positive_time_bias_leads() -> None:
    plain = commanded([*ISS, "SAT 25544"], CULMINATION_S)
    leads = commanded([*ISS, "SAT 25544", "SATOFF 2 0"], CULMINATION_S)
    later = commanded([*ISS, "SAT 25544"], CULMINATION_S + 2.0)
    # The satellite goes west to east: its hour angle falls. In two seconds the Earth carries the site 0.1°.
    assert leads[0] < plain[0] - 1.0
    assert leads[0] == pytest.approx(later[0], abs=0.15)


def test_a_positive_cross_bias_is_left_of_the_motion_seen_from_below(sky: SiteSky) -> None:
    """Moving east, seen from below, north is on the left."""
    plain = commanded([*ISS, "SAT 25544"], CULMINATION_S)
    left = commanded([*ISS, "SAT 25544", "SATOFF 0 1"], CULMINATION_S)
    assert left[1] - plain[1] > 0.5
    apart = math.hypot((left[0] - plain[0]) * math.cos(math.radians(plain[1])), left[1] - plain[1])
    assert apart == pytest.approx(1.0, abs=0.01)


def test_hold_stands_where_the_satellite_was_and_track_takes_it_up_again() -> None:
    controller = make_controller()
    for message in [*ISS, "SAT 25544", "SATOFF 1 0 HOLD"]:
        exchange(controller, encode(message), CULMINATION_S)
    then = exchange(controller, encode("PS"), CULMINATION_S).split()[1:3]
    held = exchange(controller, encode("PS"), CULMINATION_S + 30.0).split()[1:3]
    assert held == then == exchange(controller, encode("PS"), CULMINATION_S + 60.0).split()[1:3]
    exchange(controller, encode("SATOFF 1 0 TRACK"), CULMINATION_S + 60.0)
    moving = exchange(controller, encode("PS"), CULMINATION_S + 60.0).split()[1:3]
    assert moving != then


def test_a_hold_that_was_asked_for_before_holds_the_satellite_at_once() -> None:
    controller = make_controller()
    for message in [*ISS, "SATOFF 2 0 HOLD", "SAT 25544"]:
        assert b" ACK " in exchange(controller, encode(message), CULMINATION_S)
    told = [
        exchange(controller, encode("PS"), CULMINATION_S + later_s).split()[1:3] for later_s in (0.0, 30.0)
    ]
    assert told[0] == told[1]
    tracked = commanded([*ISS, "SATOFF 2 0", "SAT 25544"], CULMINATION_S)
    assert [float(text) for text in told[0]] == pytest.approx(tracked, abs=2e-8)


def test_elements_as_omm_values_are_the_same_satellite() -> None:
    values = {
        "OBJECT_NAME": "ISS (ZARYA)",
        "OBJECT_ID": "1998-067A",
        "EPOCH": "2026-10-02T00:19:52.567968",
        "MEAN_MOTION": "15.48707684",
        "ECCENTRICITY": ".0006946",
        "INCLINATION": "51.6312",
        "RA_OF_ASC_NODE": "131.4121",
        "ARG_OF_PERICENTER": "211.9293",
        "MEAN_ANOMALY": "148.1275",
        "EPHEMERIS_TYPE": "0",
        "CLASSIFICATION_TYPE": "U",
        "ELEMENT_SET_NO": "999",
        "REV_AT_EPOCH": "58831",
        "BSTAR": ".76743E-4",
        "MEAN_MOTION_DOT": ".3738E-4",
        "MEAN_MOTION_DDOT": "0",
    }
    sent = [f"OMM 25544 {keyword} {value}" for keyword, value in values.items()]
    by_lines = commanded([*ISS, "SAT 25544"], CULMINATION_S)
    assert commanded([*sent, "SAT 25544"], CULMINATION_S) == pytest.approx(by_lines, abs=1e-6)
    controller = make_controller()
    exchange(controller, encode(sent[2]))
    assert exchange(controller, encode("SAT 25544")).startswith(b"SAT NAK 15 ")
    assert exchange(controller, encode("OMM 25544 NORAD_CAT_ID 25545")).startswith(b"OMM NAK 12 ")
    assert exchange(controller, encode("OMM 25544 COLOUR red")).startswith(b"OMM NAK 5 ")


def test_a_satellite_that_has_decayed_is_refused_and_what_was_in_force_stays() -> None:
    first = "1 25544U 98067A   26275.01380287  .99999999  00000+0  99999-0 0  999"
    second = "2 25544  51.6312 131.4121 0006946 211.9293 148.1275 16.4870768458831"
    lines = [line + str(_checksum(line)) for line in (first, second)]
    controller = make_controller()
    exchange(controller, encode("TD 10 20"))
    for number, line in enumerate(lines, 1):
        assert b" ACK " in exchange(controller, encode(f"TLE {number} 25544 {line}"))
    days_later_s = 20.0 * 86400.0
    assert exchange(controller, encode("SAT 25544"), days_later_s).startswith(b"SAT NAK 14 ")
    assert exchange(controller, encode("PS")).split()[1] == b"10.00000000"


def _checksum(line: str) -> int:
    return sum(int(c) if c.isdigit() else c == "-" for c in line) % 10


class EndsAt:
    """A satellite by elements that end at an instant."""

    def __init__(self, end_s: float) -> None:
        self.end_s = end_s

    def place(self, utc_s: object, bias: object = None) -> RaDec:
        if getattr(utc_s, "unix_s", utc_s) > self.end_s:
            raise DecayedError("it has come down", 6)
        return RaDec(200.0, 20.0)


def test_a_satellite_whose_elements_end_on_the_way_leaves_no_trajectory() -> None:
    controller = make_controller()
    reduction = Reduction(controller.antenna.sky, "hadec")
    controller.path = SkyPath(EndsAt(NOON_S + 10.0), reduction, 0.0)
    controller.doing = AntennaAction.FOLLOWING
    assert b"SLEWING" in exchange(controller, encode("PS"), 5.0)
    assert b" ,, ,, 30" in exchange(controller, encode("PS"), 15.0)
    assert exchange(controller, encode("STATUS"), 16.0).split()[2] == b"IDLE"


def test_a_command_that_needs_elements_that_have_ended_is_refused() -> None:
    controller = make_controller()
    for message in [*ISS, "SAT 25544"]:
        exchange(controller, encode(message), CULMINATION_S)
    following = controller.path
    assert isinstance(following, SkyPath)
    following.target.propagator.at = EndsAt(0.0).place
    assert exchange(controller, encode("SATOFF 1 0"), CULMINATION_S).startswith(b"SATOFF NAK 14 ")
