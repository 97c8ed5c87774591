"""A German mount as ASCOM defines it, with two shafts in space of its own, slewed and watched by the gate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from msgspec.structs import replace

from sattrack.mount.alpaca.link import parse_alpaca
from sattrack.mount.model import (
    GERMAN_TRAVEL_DEG,
    SIDEREAL_RATE_DEG_S,
    Hold,
    Motion,
    MountProfile,
    MoveAxes,
    Seen,
    Slew,
    mean_sidereal_deg,
)
from sattrack.safety import Safety, SafetyLimits

LONGITUDE_DEG, T0, TURN_S = 8.0, 1_780_300_800.0, 0.1
USUAL = parse_alpaca("alpaca://192.0.2.9:11111/0").usual_profile()
ASCOM = replace(USUAL, pier_rule="ascom", dec_axis_limits_deg=GERMAN_TRAVEL_DEG)
FASTEST_DEG = 4.0 * TURN_S


@dataclass
class GermanMount:
    """A shaft across the polar axis, with the tube at one end and a weight at the other; degrees.

    `shaft_deg` is the hour angle to which the tube's end of the shaft points, `lean_deg` how far the tube
    leans from the elevated pole towards what is 90° west of that end; negative is east. ASCOM: a tube that
    looks east, from west of the pier, is pierWest. Slews end with the weight no higher than the tube, but a
    mount that `stays_deg` keeps its side for so far past the meridian. It joins the sky.
    """

    latitude_deg: float
    shaft_deg: float
    lean_deg: float
    stays_deg: float = 0.0

    @property
    def pole(self) -> float:
        return math.copysign(1.0, self.latitude_deg)

    @property
    def report(self) -> tuple[float, float, bool]:
        """Hour angle, declination, and whether SideOfPier is pierWest."""
        shaft, lean = math.radians(self.shaft_deg), math.radians(self.lean_deg)
        # Towards the meridian and towards the west, both on the equator.
        south, west = -math.sin(shaft) * math.sin(lean), math.cos(shaft) * math.sin(lean)
        dec = math.degrees(math.asin(self.pole * math.cos(lean)))
        return math.degrees(math.atan2(west, south)), dec, self.lean_deg < 0.0

    def side_for(self, hour_angle_deg: float) -> float:
        """1 for a slew that ends with the tube leaning west of its shaft's end, -1 for east."""
        side = math.copysign(1.0, self.lean_deg)
        if self.stays_deg and abs(hour_angle_deg - 90.0 * side) <= 90.0 + self.stays_deg:
            return side
        return 1.0 if abs(hour_angle_deg - 90.0) <= 90.0 else -1.0

    def turn(self, hour_angle_deg: float, dec_deg: float, side: float) -> bool:
        """Turn both for TURN_S; return whether it is there."""
        goal = hour_angle_deg - 90.0 * side, (90.0 - self.pole * dec_deg) * side
        shaft, lean = goal[0] - self.shaft_deg, goal[1] - self.lean_deg
        self.shaft_deg += max(-FASTEST_DEG, min(FASTEST_DEG, shaft))
        self.lean_deg += max(-FASTEST_DEG, min(FASTEST_DEG, lean))
        return max(abs(shaft), abs(lean)) <= FASTEST_DEG


def german(latitude_deg: float, hour_angle_deg: float, dec_deg: float, stays_deg: float = 0.0) -> GermanMount:
    """A mount that came to a direction from the side on which its slews end there."""
    side = math.copysign(1.0, hour_angle_deg)
    lean = 90.0 - math.copysign(1.0, latitude_deg) * dec_deg
    return GermanMount(latitude_deg, hour_angle_deg - 90.0 * side, lean * side, stays_deg)


def gate(profile: MountProfile, latitude_deg: float, holds: bool = False) -> Safety:
    return Safety(profile, SafetyLimits(optical=False), latitude_deg, LONGITUDE_DEG, holds=holds)


def seen(mount: GermanMount, utc_s: float, slewing: bool = False) -> Seen:
    hour_angle, dec, beyond = mount.report
    sidereal = mean_sidereal_deg(utc_s, LONGITUDE_DEG)
    return Seen(utc_s, sidereal, (sidereal - hour_angle) % 360.0, dec, beyond, slewing)


def slewed(mount: GermanMount, profile: MountProfile, to: tuple[float, float], holds: bool = False) -> Safety:
    """Ask the gate for a slew until it is over or stopped; the mount carries out what it lets through."""
    safety = gate(profile, mount.latitude_deg, holds)
    wish = Slew((mean_sidereal_deg(T0, LONGITUDE_DEG) - to[0]) % 360.0, to[1])
    motion: Motion = Hold()
    side, slewing = 0.0, False
    for k in range(3000):
        utc_s = T0 + k * TURN_S
        one = seen(mount, utc_s, slewing)
        safety.watch(one, motion)
        before, wanted = motion, wish if k > 10 else Hold()
        motion = safety.clear(wanted, one.sidereal_deg, one.ra_deg, one.dec_deg, 0.01, utc_s).motion
        # The first axis as the gate counts it turns with the shaft, wherever the tube looks.
        assert safety.first_axis_deg == pytest.approx(mount.shaft_deg + 90.0, abs=1e-6)
        if safety.tripped is not None:
            break
        if isinstance(motion, Slew):
            hour_angle = math.remainder(one.sidereal_deg - motion.ra_deg, 360.0)
            side = side if motion == before else mount.side_for(hour_angle)
            slewing = not mount.turn(hour_angle, motion.dec_deg, side)
            if motion == wish and not slewing:
                break
    return safety


@pytest.mark.parametrize("latitude_deg", [50.0, -35.0])
@pytest.mark.parametrize(
    ("start", "to"),
    [
        ((40.0, 50.0), (-40.0, 50.0)),
        ((-40.0, 50.0), (40.0, 50.0)),
        ((30.0, 50.0), (60.0, 20.0)),
        ((-30.0, 50.0), (-60.0, 20.0)),
        ((-20.0, -25.0), (20.0, -25.0)),
        ((10.0, 0.0), (-10.0, -20.0)),
        ((-1.0, 60.0), (1.0, 60.0)),
    ],
)
def test_a_german_mount_slews_to_either_side_of_the_meridian(
    latitude_deg: float, start: tuple[float, float], to: tuple[float, float]
) -> None:
    pole = math.copysign(1.0, latitude_deg)
    start, to = (start[0], pole * start[1]), (to[0], pole * to[1])
    mount = german(latitude_deg, *start)
    assert slewed(mount, ASCOM, to, holds=True).tripped is None
    hour_angle, dec, beyond = mount.report
    # It has joined the sky, which went on meanwhile.
    assert 0.0 <= hour_angle - to[0] < 300.0 * SIDEREAL_RATE_DEG_S
    assert dec == pytest.approx(to[1], abs=1e-6)
    assert beyond == (to[0] < 0.0)


@pytest.mark.parametrize("rule", ["never", "hour_angle"])
def test_who_drives_it_by_another_rule_is_told_which(rule: str) -> None:
    profile = replace(USUAL, pier_rule=rule)
    mount = german(50.0, 40.0, 50.0)
    safety = slewed(mount, profile, (-40.0, 50.0))
    assert safety.tripped == "obedience"
    assert 'set "ascom"' in str(safety.cause)
    assert abs(mount.shaft_deg + 50.0) < 5.0


def test_a_mount_that_stays_on_its_side_past_the_meridian_is_stopped_and_says_why() -> None:
    mount = german(50.0, -20.0, 60.0, stays_deg=10.0)
    safety = slewed(mount, ASCOM, (5.0, 60.0))
    assert safety.tripped == "obedience"
    assert "stay on its side" in str(safety.cause)
    assert mount.shaft_deg < 75.0
    assert slewed(german(50.0, -20.0, 60.0, stays_deg=10.0), ASCOM, (15.0, 60.0)).tripped is None


@pytest.mark.parametrize("latitude_deg", [50.0, -35.0])
@pytest.mark.parametrize(("shaft_deg", "lean"), [(95.0, -60.0), (-95.0, 60.0), (89.0, -60.0), (-89.0, 60.0)])
def test_a_session_knows_the_turn_of_a_mount_that_has_gone_past_the_meridian_on_its_side(
    latitude_deg: float, shaft_deg: float, lean: float
) -> None:
    safety = gate(ASCOM, latitude_deg)
    mount = GermanMount(latitude_deg, shaft_deg, lean)
    for k in range(3):
        safety.watch(seen(mount, T0 + k * TURN_S), Hold())
    assert safety.first_axis_deg == pytest.approx(shaft_deg + 90.0, abs=1e-6)
    west = MoveAxes(SIDEREAL_RATE_DEG_S - 1.0, 0.0)
    # Half a turn from where its weight hangs lowest, with half as much again of the rate.
    assert safety.turns_known_s(west) == pytest.approx((180.0 - shaft_deg) / 1.5, rel=1e-6)
