"""From one pass to the next: actions after and before, the slews between and round obstacles, settling."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sattrack.mount.model import Slew, mean_sidereal_deg
from sattrack.safety.bounds import HOLD_MARGIN_DEG, Bounds
from sattrack.safety.regions import is_clear
from sattrack.safety.route import HANDSHAKE_S, RAMP, axes_of, direction_of, slew_s
from sattrack.safety.slews import SlewGate
from sattrack.schedule.schema import CommandAction, SlewAction, Star, find_star, hour_angle_and_dec_deg

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from sattrack.mount.model import AxisLimits, MountProfile
    from sattrack.safety.geometry import Box, Place
    from sattrack.safety.regions import Cone
    from sattrack.schedule.candidates import Situation
    from sattrack.schedule.schema import Action
    from tle.site import Site

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]


ROUNDING_S = 1e-6


class Errands(NamedTuple):
    """What a list of actions takes: where its first slew goes, its seconds, where the mount stands then.

    The way to the first place is not counted, that from each to the next is.
    """

    first: Place
    seconds: float
    last: Place


class Stand(NamedTuple):
    """What a pass needs around it: before its start, and from its end on; all but the slew between two."""

    before: Errands
    settle_s: float
    after: Errands


def place_of(action: SlewAction, utc_s: float, site: Site, profile: MountProfile) -> Place:
    """Return how the axes stand at an action's direction at an instant, by the profile's rule."""
    if action.alt_deg is not None and action.az_deg is not None:
        hour_angle, dec = _equatorial_deg(action.alt_deg, action.az_deg, site.latitude_deg)
    else:
        star = find_star(action.star) if action.star is not None else None
        if star is None:
            star = Star(float(action.ra_deg or 0.0), float(action.dec_deg or 0.0), 0.0, 0.0)
        hour_angle, dec = hour_angle_and_dec_deg(star, utc_s, site.longitude_deg)
    return axes_of(hour_angle, dec, profile, site.latitude_deg)


def slew_of(action: SlewAction, utc_s: float, site: Site, profile: MountProfile) -> Slew:
    """Return the slew to an action's direction at an instant; right ascension by mean sidereal time."""
    hour_angle_deg, dec_deg = direction_of(place_of(action, utc_s, site, profile))
    return Slew((mean_sidereal_deg(utc_s, site.longitude_deg) - hour_angle_deg) % 360.0, dec_deg)


def _equatorial_deg(alt_deg: float, az_deg: float, latitude_deg: float) -> tuple[float, float]:
    """Return hour angle and declination of an altitude and azimuth, degrees."""
    a, z, p = math.radians(alt_deg), math.radians(az_deg), math.radians(latitude_deg)
    up, north, east = math.sin(a), math.cos(a) * math.cos(z), math.cos(a) * math.sin(z)
    dec = math.asin(max(-1.0, min(1.0, math.sin(p) * up + math.cos(p) * north)))
    meridian = math.cos(p) * up - math.sin(p) * north
    return math.degrees(math.atan2(-east, meridian)), math.degrees(dec)


def errands_before(
    actions: Sequence[Action], start: Place, utc_s: float, site: Site, profile: MountProfile
) -> Errands:
    """Return what is done before a pass that starts at a place of the axes, the slew to it included."""
    places, seconds = _places(actions, utc_s, site, profile)
    return Errands((*places, start)[0], seconds + _ways_s([*places, start], profile), start)


def errands_after(
    actions: Sequence[Action], end: Place, utc_s: float, site: Site, profile: MountProfile
) -> Errands:
    """Return what is done after a pass that ends at a place of the axes, the slew from it included."""
    places, seconds = _places(actions, utc_s, site, profile)
    return Errands(end, seconds + _ways_s([end, *places], profile), (end, *places)[-1])


def _places(
    actions: Sequence[Action], utc_s: float, site: Site, profile: MountProfile
) -> tuple[list[Place], float]:
    """Return the places of slews, and the seconds of all that is waited for."""
    places, seconds = [], 0.0
    for action in actions:
        if isinstance(action, SlewAction):
            places.append(place_of(action, utc_s, site, profile))
            seconds += action.wait_s
        elif isinstance(action, CommandAction) and action.wait:
            seconds += action.timeout_s
    return places, seconds


def _ways_s(places: list[Place], profile: MountProfile) -> float:
    return sum(slew_s(one, other, profile) for one, other in pairwise(places))


@dataclass(frozen=True, slots=True)
class SlewTransitions:
    """The seconds between passes, for all pairs: columns of where each leaves the mount, and wants it."""

    leave: Array
    """Hour angle and declination axis after each pass and what follows it, shape (n, 2), degrees."""
    want: Array
    after_s: Array
    before_s: Array
    rates_deg_s: tuple[float, float]
    ramps_s: tuple[float, float]
    leave_deg: tuple[tuple[float, float], tuple[float, float]]
    """The least and the most of either axis in `leave`."""
    most_after_s: float
    extra_s: Mapping[int, tuple[Index, Array]] = field(default_factory=dict)
    """By the later pass, from which earlier ones a slew takes longer than straight, and by how much."""

    @classmethod
    def of(
        cls,
        stands: Sequence[Stand],
        profile: MountProfile,
        extra_s: Mapping[int, tuple[Index, Array]] | None = None,
    ) -> SlewTransitions:
        """Return those of some passes by a mount's axes."""
        axes = (profile.ra, profile.dec)
        leave = np.array([stand.after.last for stand in stands], dtype=np.float64).reshape(-1, 2)
        ranges = [
            (float(np.min(column, initial=math.inf)), float(np.max(column, initial=-math.inf)))
            for column in leave.T
        ]
        return cls(
            leave,
            np.array([stand.before.first for stand in stands], dtype=np.float64).reshape(-1, 2),
            np.array([stand.after.seconds for stand in stands], dtype=np.float64),
            np.array([stand.before.seconds + stand.settle_s for stand in stands], dtype=np.float64),
            (axes[0].slew_rate_deg_s, axes[1].slew_rate_deg_s),
            (_ramp_s(axes[0]), _ramp_s(axes[1])),
            (ranges[0], ranges[1]),
            max((stand.after.seconds for stand in stands), default=0.0),
            extra_s or {},
        )

    def seconds(self, before: Index, after: int) -> Array:
        """Return the seconds from the ends of some passes to the start of another."""
        total: Array = self.after_s[before] + self.slews_s(before, after) + self.before_s[after]
        return total

    def longest_s(self, after: Index) -> Array:
        """Return bounds on the seconds from the end of any pass to the start of each of some."""
        slews = np.zeros(len(after))
        for axis, ((low, high), rate, ramp) in enumerate(
            zip(self.leave_deg, self.rates_deg_s, self.ramps_s, strict=True)
        ):
            want = self.want[after, axis]
            slews = np.maximum(slews, np.maximum(high - want, want - low) / rate + ramp)
        longer = np.zeros(len(self.before_s))
        for k, (_, seconds) in self.extra_s.items():
            longer[k] = np.max(seconds, initial=0.0)
        bounds: Array = self.most_after_s + HANDSHAKE_S + slews + longer[after] + self.before_s[after]
        return bounds + ROUNDING_S

    def slews_s(self, before: Index, after: int) -> Array:
        """Return of those what the slew between takes.

        As `sattrack.safety.route.slew_s` reckons it, and what a way round takes longer where that is known.
        """
        gap = np.abs(self.leave[before] - self.want[after])
        slews: Array = HANDSHAKE_S + np.maximum(
            gap[:, 0] / self.rates_deg_s[0] + self.ramps_s[0],
            gap[:, 1] / self.rates_deg_s[1] + self.ramps_s[1],
        )
        if after in self.extra_s:
            longer = np.zeros(len(self.after_s))
            others, seconds = self.extra_s[after]
            longer[others] = seconds
            slews += longer[before]
        return slews


def _ramp_s(axis: AxisLimits) -> float:
    return 2.0 * RAMP * axis.slew_rate_deg_s / axis.max_acceleration_deg_s2


class _KnownBounds(Bounds):
    """The gate's bounds, which remember of single places what never moves: a night asks for the same ones."""

    def __init__(self, *of: Any) -> None:
        super().__init__(*of)
        self._known: dict[Box, tuple[str | None, float, float, float]] = {}
        self._sure: list[tuple[float, float, float, float]] = []

    def look(self, utc_s: float | None, clock_gap_deg: float) -> bool:
        """See Bounds."""
        found = super().look(utc_s, clock_gap_deg)
        self._sure = [_surely_outside(cone) for cone in self._cones]
        return found

    def violated(
        self, box: Box, margins: Mapping[str, float], seconds: float, margin_deg: float = HOLD_MARGIN_DEG
    ) -> str | None:
        """See Bounds."""
        single = box[0] == box[1] and box[2] == box[3]
        if not single or margins or seconds or margin_deg != HOLD_MARGIN_DEG:
            return super().violated(box, margins, seconds, margin_deg)
        known = self._known.get(box)
        if known is None:
            shut = (region.name for region in self._fixed if not is_clear(region, box, margin_deg))
            known = self._known[box] = (next(shut, None), *box.circle[:3])
        name, x, y, z = known
        if name is not None:
            return name
        for cone, (a, b, c, cosine) in zip(self._cones, self._sure, strict=True):
            if a * x + b * y + c * z > cosine and not is_clear(cone, box, margin_deg):
                return cone.name
        return None


SURE_DEG = 1.0


def _surely_outside(cone: Cone) -> tuple[float, float, float, float]:
    """Return a cone's axis as a unit vector, and the cosine of an angle from it that is surely outside."""
    ha, dec = math.radians(cone.body.hour_angle_deg), math.radians(cone.body.dec_deg)
    wide = math.cos(math.radians(min(180.0, cone.cone_deg + HOLD_MARGIN_DEG + SURE_DEG)))
    return math.cos(dec) * math.cos(ha), math.cos(dec) * math.sin(ha), math.sin(dec), wide


class LedSlews:
    """Slews at a site with a mount as its gate would lead them."""

    def __init__(self, situation: Situation) -> None:
        """Build the gate of a situation's mount, limits and site."""
        site, profile = situation.site, situation.profile
        self._site, self._profile = site, profile
        self._bounds = _KnownBounds(profile, situation.limits, site.latitude_deg, site.longitude_deg)
        self._gate = SlewGate(profile, self._bounds, site.latitude_deg, detours=True)

    def extra_s(self, leave: Place, want: Place, utc_s: float) -> float:
        """Return the seconds more than straight from one place of the axes to another at an instant.

        Infinity where the gate knows no clear way.
        """
        self._bounds.look(utc_s, 0.0)
        sidereal_deg = mean_sidereal_deg(utc_s, self._site.longitude_deg)
        hour_angle, dec = direction_of(want)
        legs = self._gate.route(
            Slew((sidereal_deg - hour_angle) % 360.0, dec), sidereal_deg, leave, waits=True
        )
        if isinstance(legs, str):
            return math.inf
        if len(legs) == 1:
            return 0.0
        total, at = 0.0, leave
        for leg in legs:
            there = axes_of(sidereal_deg - leg.ra_deg, leg.dec_deg, self._profile, self._site.latitude_deg)
            total += slew_s(at, there, self._profile)
            at = there
        return max(0.0, total - slew_s(leave, want, self._profile))
