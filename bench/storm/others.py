"""Mounts that are unlike those of the first storms: from seed OTHERS_FROM_SEED on each storm has one.

They flip, have axes that point anywhere, a pointing model, another period, a clock that their profile knows,
or are synced by somebody else; half of them have axes that are unlike each other. What looks through such a
tube is computed by `strangers`, which know nothing of this program.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, get_args

import msgspec
from axes_anywhere import STRANGERS, AxesDraw, Tube, known_geometry
from family import Draw
from random_passes import hour_angle_deg
from safety_draws import Judge, vector
from strangers.tilted_mount import NAMES, TiltedMount

from sattrack.mount.geometry import AxisFrame, AxisGeometry
from sattrack.mount.model import AxisLimits, MountProfile, PointingTerms, SitePlace
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    import random

    from family import Hardware
    from safety_draws import Vector

    from sattrack.runtime.facts import RunFacts

OTHERS_FROM_SEED = 600_000
What = Literal["flip", "geometry", "pointing", "period", "dated", "synced"]
PERIODS_S = (0.02, 0.1, 0.2)
LOOKS, FASTEST_DEG_S, STEEPEST_DEG = 30, 3.0, 78.0
"""How often a pass is looked at for what its axes must do; faster, or steeper, is a keyhole's matter."""
AWAY_DEG = 15.0
MOST_ERROR_ARCSEC = 900.0
"""Of each term of a pointing model."""
SYNCED_DEG = (0.005, 30.0)
"""How far a sync sets a mount off, at least and at most."""


@dataclass(frozen=True)
class Other:
    """What sets a storm's mount apart."""

    what: What
    axes: AxesDraw | None = None
    tilted: TiltedMount | None = None

    @property
    def beside_deg(self) -> float:
        """How far beside square axes without errors the tube looks at most."""
        square_deg = 0.0 if self.axes is None else self.axes.geometry.off_square_deg
        return square_deg + (0.0 if self.tilted is None else 6.0 * MOST_ERROR_ARCSEC / 3600.0)


class OtherJudge(Judge):
    """Judges axes by where a stranger's tube looks."""

    def __init__(self, facts: RunFacts, other: Other) -> None:
        super().__init__(facts)
        self._axes, self._tilted = other.axes, other.tilted
        self._tube = None if other.axes is None else Tube(other.axes)
        self._latitude = math.radians(facts.site.latitude_deg)

    def points(self, ha: float, dec: float) -> Vector:
        if self._tube is None or self._axes is None:
            return super().points(ha, dec)
        return vector(*self._tube.sky(*drives_deg(self._axes, (ha, dec))))

    def looks(self, ha: float, dec: float) -> Vector:
        if self._tilted is None:
            return super().looks(ha, dec)
        east, north, up = (float(part) for part in self._tilted.looks(ha, dec))
        sine, cosine = math.sin(self._latitude), math.cos(self._latitude)
        return cosine * up - sine * north, -east, sine * up + cosine * north


def drives_deg(axes: AxesDraw, angles_deg: tuple[float, float]) -> tuple[float, float]:
    """Return what drives count where the axes have these angles."""
    first, second = (
        zero + sense * angle
        for zero, sense, angle in zip(axes.zeros_deg, axes.senses, angles_deg, strict=True)
    )
    return first, second


def drawn_what(dice: random.Random, kind: str) -> tuple[What, str]:
    """Return what sets the mount apart, and of which kind it is."""
    what = dice.choice(get_args(What))
    if what in {"flip", "period"}:
        # The others never flip, and their loops' period is their own.
        return what, "own"
    return what, dice.choice(STRANGERS) if what == "geometry" else kind


def changed_hardware(hardware: Hardware, what: What) -> Hardware:
    # A mount whose first axis is no hour angle axis does not follow the sky by it.
    return replace(hardware, additive=False, tracking=False) if what == "geometry" else hardware


def changed(
    dice: random.Random, what: What, facts: RunFacts, hardware: Hardware, clock_s: float
) -> tuple[RunFacts, Other] | None:
    """Return the run with such a mount; None where that one could not follow this satellite."""
    profile, other = facts.profile, Other(what)
    if dice.random() < 0.5:
        profile = _unlike(dice, profile)
    match what:
        case "flip":
            profile = _flipping(dice, profile)
        case "geometry":
            axes = _drawn_axes(dice, facts, hardware)
            if axes is None:
                return None
            profile, other = _with_axes(profile, axes), replace(other, axes=axes)
        case "pointing":
            other = replace(other, tilted=_drawn_tilted(dice, facts.site.latitude_deg))
            profile = msgspec.structs.replace(profile, pointing=_terms(other.tilted))
        case "period":
            profile = msgspec.structs.replace(profile, period_s=dice.choice(PERIODS_S))
        case "dated":
            profile = msgspec.structs.replace(profile, clock_offset_s=clock_s)
    return msgspec.structs.replace(facts, profile=profile), other


def _unlike(dice: random.Random, profile: MountProfile) -> MountProfile:
    """Return a mount one of whose axes is slower, and accelerates less, than the other."""

    def slower(axis: AxisLimits) -> AxisLimits:
        return AxisLimits(
            max_rate_deg_s=dice.uniform(0.4, 1.0) * axis.max_rate_deg_s,
            max_acceleration_deg_s2=dice.uniform(0.3, 1.0) * axis.max_acceleration_deg_s2,
            slew_rate_deg_s=axis.slew_rate_deg_s,
        )

    if dice.random() < 0.5:
        return msgspec.structs.replace(profile, ra=slower(profile.ra))
    return msgspec.structs.replace(profile, dec=slower(profile.dec))


def _flipping(dice: random.Random, profile: MountProfile) -> MountProfile:
    return msgspec.structs.replace(
        profile,
        pier_rule=dice.choice(("hour_angle", "ascom")),
        hour_angle_limit_deg=dice.choice((190.0, 200.0, 250.0)),
        dec_axis_limits_deg=dice.choice(((-190.0, 190.0), (-260.0, 260.0))),
    )


def _drawn_axes(dice: random.Random, facts: RunFacts, hardware: Hardware) -> AxesDraw | None:
    """Return axes that point anywhere and can follow this satellite."""
    site = facts.site.place()
    drawn = Draw(0, False, facts.target, site, facts.started_utc_s, 0.0, (0.0, 0.0), hardware)
    for _ in range(20):
        geometry = AxisGeometry(
            dice.uniform(0.0, 360.0),
            math.degrees(math.asin(dice.uniform(-1.0, 1.0))),
            90.0 + dice.choice((0.0, dice.uniform(-2.0, 2.0))),
            dice.choice((0.0, dice.uniform(-1.0, 1.0))),
            reports=dice.choice(("sky", "axes")),
        )
        senses = (dice.choice((1, -1)), dice.choice((1, -1)))
        zeros = (dice.uniform(-30.0, 30.0), dice.uniform(-5.0, 5.0))
        path = _angles(facts, geometry)
        rates = max(abs(rate) for one in path for rate in one[2:])
        steep = max(abs(one[1]) for one in path)
        if rates < FASTEST_DEG_S and steep < STEEPEST_DEG and max(abs(one[0]) for one in path) < 160.0:
            return AxesDraw(drawn, geometry, senses, zeros)
    return None


def _angles(facts: RunFacts, geometry: AxisGeometry) -> list[tuple[float, float, float, float]]:
    """Return angles and rates of axes that follow the satellite, from the begin of the run to its end."""
    site = facts.site.place()
    propagator, frame = Propagator(facts.target, site), AxisFrame(geometry, site.latitude_deg)
    lasts_s = facts.plan.end_utc_s - facts.started_utc_s
    found = []
    for k in range(LOOKS + 1):
        seen = propagator.at(Utc(facts.started_utc_s + k * lasts_s / LOOKS))
        place = (float(seen.ha_deg), float(seen.dec_deg))
        rates = (float(seen.ha_rate_deg_s), float(seen.dec_rate_deg_s))
        first, second, first_rate, second_rate = frame.angles(*place, *rates)
        found.append((float(first), float(second), float(first_rate), float(second_rate)))
    return found


def _with_axes(profile: MountProfile, axes: AxesDraw) -> MountProfile:
    site = axes.drawn.site
    profile = msgspec.structs.replace(
        profile,
        additive=False,
        # A commanded rate turns the angle that the drives count by their own sign.
        ra_rate_sign=profile.ra_rate_sign * axes.senses[0],
        dec_rate_sign=profile.dec_rate_sign * axes.senses[1],
        hour_angle_limit_deg=max(170.0, profile.hour_angle_limit_deg),
        dec_axis_limits_deg=(-190.0, 190.0),
        stands_at=SitePlace(site.latitude_deg, site.longitude_deg),
    )
    return profile.with_geometry(known_geometry(axes))


def _drawn_tilted(dice: random.Random, latitude_deg: float) -> TiltedMount:
    errors = [dice.uniform(-1.0, 1.0) * MOST_ERROR_ARCSEC for _ in range(6)]
    return TiltedMount(latitude_deg, *errors)


def _terms(mount: TiltedMount) -> PointingTerms:
    """Return what must be added to what such a mount reports, by TPOINT's names."""
    each = {name: (-getattr(mount, error), 1.0) for name, error in NAMES.items()}
    return PointingTerms("2024-01-01T00:00:00Z", mount.latitude_deg, each, 1.0, 30, signs="tpoint")


def target_deg(facts: RunFacts, other: Other | None) -> tuple[float, float]:
    """Return the angles of the axes where the pass begins; hour angle and declination without a geometry."""
    at_s = facts.plan.start_utc_s
    if other is not None and other.axes is not None:
        share = (at_s - facts.started_utc_s) / (facts.plan.end_utc_s - facts.started_utc_s)
        first, second, *_ = _angles(facts, other.axes.geometry)[round(share * LOOKS)]
        return first, second
    propagator = Propagator(facts.target, facts.site.place())
    return hour_angle_deg(propagator, at_s), float(propagator.at(Utc(at_s)).dec_deg)


def drawn_near(dice: random.Random, facts: RunFacts, target_deg: tuple[float, float]) -> tuple[float, float]:
    """Return angles of axes that look to near the target, on either side where the mount flips."""
    ha, dec = (angle + dice.uniform(-AWAY_DEG, AWAY_DEG) for angle in target_deg)
    rule = facts.profile.pier_rule
    if rule == "never":
        return ha, dec
    beyond = ha > 0.0 if rule == "hour_angle" else ha < 0.0
    if dice.random() < 0.3:
        beyond = not beyond
    pole = 180.0 if facts.site.latitude_deg >= 0.0 else -180.0
    if not beyond:
        return ha, dec
    # Where nobody has noted turns of the cables, a session takes the first axis for being within this turn.
    middle = facts.profile.first_axis_middle_deg
    return middle + math.remainder(ha + 180.0 - middle, 360.0), pole - dec
