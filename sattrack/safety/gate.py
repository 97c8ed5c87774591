"""The gate through which every motion and every request goes.

Rates are those of the reported right ascension and declination, as in `mount.MoveAxes`; inside, they are
those of the axes, hour angle and declination.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sattrack.mount.model import (
    SIDEREAL_RATE_DEG_S,
    Cleared,
    Hold,
    Motion,
    MountProfile,
    MoveAxes,
    Seen,
    Slew,
    Stop,
)
from sattrack.mount.requests import Abort, ClearedRequest, FineRate, Request, objection
from sattrack.safety.bounds import CONES, ESCAPE_NEAR_DEG, INSIDE_MARGIN_DEG, Bounds
from sattrack.safety.geometry import AxesState, Box, Place, axis_rates, stance_at
from sattrack.safety.rate_limit import Ahead, Spot, nearest_rates, within
from sattrack.safety.requests import RequestChecks
from sattrack.safety.slews import SlewGate
from sattrack.safety.table import ROWS
from sattrack.safety.watch import (
    BACKWARD_S,
    FASTER,
    OLDEST_STATUS_S,
    Belief,
    PositionFilter,
    Watch,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.mount.model import Stance
    from sattrack.safety.limits import SafetyLimits
    from sattrack.safety.rate_limit import RateRanges
    from sattrack.safety.watch import Former

STEP_SHARE = 2.0
"""A mean rate over a ramp is reached by a command twice as large, so steps may be so much of a ramp."""
HAND_SHARE = 0.5
"""By hand, rates grow by so much of a ramp, as a stream's do: a servo that a step leaves behind catches up,
and goes on past where it is to stop. Half, as a drive may be half as able as its profile says."""
HELD_ANEW_S = 0.07
"""What is held keeps its rates for so long, while they keep inside, before better ones are looked for."""
OUTSIDE_PROOF = 3
"""Axes count as outside when so many clearances in a row find them there: one status may be wrong."""
SWINGS_DEG_S, SWINGS_FOR_S = 1.0, 3.0
"""Axes that move so unlike what they were sent swing, and are taken to do so for so long."""
HALF_TURN_DEG = 180.0
LEAST_KNOWN_S = 5.0
"""For so long a mount may always go on unheard: a run ends before that, and limits count on it."""
UNLIKE_DEG_S = 0.05
"""An axis that is faster by more than was sent has not obeyed yet."""
STANDS_DEG_S = 0.05
"""Axes past a limit that may not move as asked wait there up to this rate, and are stopped above it."""
LED_SHARES = (0.7, 0.5, 0.35, 0.25, 0.15, 0.08)
"""Shares of its rates by which a led slew is slower near a limit, so that a fault would not lead past it."""


@dataclass(slots=True)
class Outside:
    """Whether a stream of rates finds the axes past a limit."""

    count: int = 0
    """How many clearances in a row have found them there."""
    news: bool = True
    """Whether a status has come since they were last found outside or inside."""
    from_the_start: bool | None = None
    """Whether they were there as it began, and have been since; None before that."""


class Safety:
    """Clears motions; once an interlock has stopped the mount, only stops are cleared.

    `latitude_deg` and `longitude_deg` are the site's; without a longitude nobody knows where the Sun is, and
    nothing is moved unless `limits` say that there are no optics. With `holds`, a stream of rates that would
    pass a limit is cut down to what keeps inside, and slews go round what is in their way; without, as for
    what is moved by hand, such rates stop the mount and such slews are refused. With `escapes`, a mount of
    which nothing is asked while it points into the Sun is slewed out of it.
    """

    def __init__(
        self,
        profile: MountProfile,
        limits: SafetyLimits,
        latitude_deg: float,
        longitude_deg: float | None = None,
        holds: bool = False,
        escapes: bool = False,
    ) -> None:
        self._profile = profile
        self._limits = limits
        self._holds = holds
        self._bounds = Bounds(profile, limits, latitude_deg, longitude_deg)
        latitude_deg = self._bounds.horizon_latitude_deg
        self._watch = Watch(profile, limits.longest_fault_s, longitude_deg, limits.clock_tolerance_s)
        self._slews = SlewGate(profile, self._bounds, latitude_deg, detours=holds)
        self.tripped: str | None = None
        """Name of the interlock that stopped the mount."""
        self.holding: str | None = None
        """Name of the limit at which the stream of rates is held."""
        self.led: Slew | None = None
        """The slew that rates lead along, of a mount that is not left to slew by itself."""
        self.led_there = False
        """Whether they have led to its end."""
        self.clamping = False
        """Whether the last command's rates were cut to the axes' limits."""
        self._slewing = False
        self._outside = Outside()
        self._watched = False
        self._escapes = escapes
        self._escape: Slew | None = None
        self._streams = False
        """Whether a stream of rates has been cleared: a pass is under way."""
        self._sent: deque[tuple[float, float, float]] = deque()
        """What was cleared of late: when (UTC), and the rates of both axes."""
        self._by_hand: RateRanges = (REST, REST)
        """The least and the greatest rates of both axes since a motion by hand began."""
        self._held_since: tuple[float, Rates] | None = None
        """When the rates of what is held were found (UTC), and those."""
        self._rests_since_s: float | None = None
        """Since when the axes of a mount by edges are to rest at what they are held at (UTC)."""
        self._rests_from = REST
        """How fast they were at most when that began, either way."""
        self._near_since_s: float | None = None
        """Since when they have had a limit ahead all the same (UTC)."""
        self._swings: deque[tuple[float, float, float]] = deque()
        """When (UTC) both axes moved unlike any rates that may have been in force, and by how much."""
        self._spots: Sequence[Spot] = ()
        """Where the axes may be for which rates were last cleared."""
        self._newest_utc_s = -math.inf
        most_ha, most_dec = FASTER * profile.ra.fastest_deg_s, FASTER * profile.dec.fastest_deg_s
        self._plausible = ((-most_ha, most_ha), (-most_dec, most_dec))
        self._standing = AxesState(latitude_deg, profile.first_axis_middle_deg)
        self._doubt = PositionFilter(profile)
        self._ahead = Ahead(profile, limits, self._bounds)
        parts = (self._bounds, self._slews, self._watch, self._standing, self._ahead)
        self._asked = RequestChecks(profile, limits, latitude_deg, parts)

    @property
    def _leads(self) -> bool:
        """Whether slews are made by rates: how a mount that is not equatorial slews, nobody knows."""
        return self._profile.geometry is not None

    @property
    def cause(self) -> str | None:
        """What makes the mount disobey, as far as its motion tells it."""
        return self._watch.cause

    @property
    def longest_step_s(self) -> float:
        """How far apart statuses of the mount may be to tell how it moves, seconds."""
        return self._watch.longest_step_s

    @property
    def keeps_first(self) -> bool:
        """Whether a mount that is to take the latest rates goes on at the first, as it does by edges."""
        return self._watch.keeps_first

    @property
    def on_last_leg(self) -> bool:
        """Whether the slew that is cleared goes to where it was asked to, and not to a place on the way."""
        return self._slews.on_last_leg

    def watch(self, seen: Seen, commanded: Motion) -> None:
        """Take a status; `commanded` is the motion that was in force. Call once a status."""
        self._watched = True
        self._slewing = seen.slewing
        seconds = self._watch.seconds_to(seen)
        tripped = self._watch.see(seen, commanded)
        place = self._believed(seen, seconds)
        if tripped is None and self._slews.strays(place, seen):
            tripped = "obedience"
            self._watch.stray(self._slews.takes_other_side(place, seen.sidereal_deg))
        if tripped is not None and self.tripped is None and isinstance(commanded, MoveAxes | Slew):
            self._trip(tripped)

    def see_restart(self, commanded: Motion) -> None:
        """Take notice that the mount has begun anew; `commanded` is the motion that was in force."""
        if self.tripped is None and isinstance(commanded, MoveAxes):
            self._trip("restart")

    def _believed(self, seen: Seen, seconds: float) -> Place:
        """Return the place that a status reports, taken for the axes' own where it is believed."""
        reported = (seen.sidereal_deg - seen.ra_deg, seen.dec_deg, seen.beyond_pole)
        place = self._standing.place(*reported)
        belief = self._doubt.see(place, seconds, self._watch.moved)
        if belief is Belief.ANEW:
            self._standing.begin_anew()
            place = self._standing.place(*reported)
        elif belief is Belief.BORNE_OUT:
            # A slew that was judged from elsewhere is judged anew.
            self._slews.forget()
        if belief is not Belief.DOUBTED:
            # In doubt, neither the turns nor the side of the pier change.
            self._standing.take(place, seen.beyond_pole)
        self._outside.news = True
        return place

    def choose_turn(self, onward_deg: tuple[float, float] | None) -> None:
        """Take how far back and on the first axis turns from where it is led to, degrees."""
        self._slews.onward_deg = onward_deg if self._leads else None

    def turns_known_s(self, moving: MoveAxes) -> float:
        """Return for how long after its newest status a mount may go on so before its turns are not known.

        A status gives an axis' angle within a turn, and a session that begins takes the first axis to be
        within half a turn of its middle. A mount with a watchdog comes to rest unheard.
        """
        first_deg = self._standing.hour_angle_deg
        if first_deg is None or self._profile.watchdog_s is not None:
            return math.inf
        first, second = axis_rates(moving, self._standing.beyond_pole)
        off_deg = first_deg - self._profile.first_axis_middle_deg
        left_deg = HALF_TURN_DEG - math.copysign(off_deg, first * off_deg)
        if left_deg <= 0.0:
            left_deg = HALF_TURN_DEG
        known_s = min(left_deg / max(abs(first), 1e-9), HALF_TURN_DEG / max(abs(second), 1e-9))
        return max(LEAST_KNOWN_S, known_s / FASTER)

    @property
    def first_axis_deg(self) -> float | None:
        """The first axis' angle, turns counted; None before the first status, if nobody has told it."""
        return self._standing.hour_angle_deg

    def begin_at(self, first_axis_deg: float) -> None:
        """Take where a session before left the first axis, turns counted."""
        self._standing.begin_at(first_axis_deg)

    def expect_at(self, first_axis_deg: float) -> None:
        """Take where the first axis is, turns counted, if it has followed the sky since a session before."""
        self._standing.expect_at(first_axis_deg)

    def follow_on(self, former: Safety) -> None:
        """Take over how far the cables are wound from a former one, whose stop is over."""
        self._standing.follow_on(former._standing)

    def clear(
        self,
        motion: Motion,
        sidereal_deg: float,
        ra_deg: float,
        dec_deg: float,
        age_s: float = 0.0,
        utc_s: float | None = None,
    ) -> Cleared:
        """Return what may be sent of `motion`.

        `sidereal_deg` is the mount's local sidereal time, `ra_deg`, `dec_deg` where it was `age_s` ago;
        `utc_s` is the instant now, POSIX seconds, without which the Sun's place is not known.
        """
        self.clamping = self.led_there = False
        self.led = None
        if self.tripped is not None or isinstance(motion, Stop):
            self._escape = None
            self._let_go()
            return Cleared(Stop())
        if isinstance(motion, Hold):
            motion = self._while_idle(sidereal_deg, ra_deg, dec_deg, utc_s)
            if isinstance(motion, Hold):
                self._let_go()
                return Cleared(motion)
        else:
            self._escape = None
        unfit = self._unfit(motion, (sidereal_deg, ra_deg, dec_deg), age_s, utc_s)
        if unfit is not None:
            return self._trip(unfit)
        beyond_pole = self._standing.beyond_pole
        place = self._standing.place(sidereal_deg - ra_deg, dec_deg, beyond_pole)
        if self._standing.hour_angle_deg is None:
            self._standing.take(place, beyond_pole)
        former = self._doubt.former
        if isinstance(motion, Slew):
            # Should the axes be elsewhere after all, they stray from what the slew is judged by.
            start = place if former is None else former.place
            slews = self._slewing and self._slews.target is not None and not self._leads
            cleared = self._clear_slew(motion, sidereal_deg, (ra_deg, dec_deg), start, age_s)
            if isinstance(cleared, Slew) and not self._leads:
                return Cleared(cleared)
            if isinstance(cleared, Slew):
                self.led, self.led_there = cleared, self._slews.is_there((ra_deg, dec_deg))
                motion = self._slews.rates_from(place, sidereal_deg)
            elif slews or not (self._holds and self._streams):
                return self._trip(cleared)
            else:
                # A pass that goes on is held where it is, and takes up its target when that comes back.
                motion = MoveAxes(SIDEREAL_RATE_DEG_S, 0.0)
        return self._clear_move(motion, spots_of(place, former, age_s), utc_s)

    def _unfit(
        self, motion: MoveAxes | Slew, mount: tuple[float, float, float], age_s: float, utc_s: float | None
    ) -> str | None:
        """Return the row by which nothing at all may be moved; `mount` is what its status says."""
        if isinstance(motion, MoveAxes):
            one, other = motion.ra_rate_deg_s, motion.dec_rate_deg_s
        else:
            one, other = motion.ra_deg, motion.dec_deg
        isfinite = math.isfinite
        if not (isfinite(one) and isfinite(other) and isfinite(age_s) and all(map(isfinite, mount))):
            return "command"
        back = utc_s is not None and utc_s < self._newest_utc_s - BACKWARD_S
        if back or self._watch.clock_is_off:
            return "clock"
        if age_s > OLDEST_STATUS_S:
            return "status_age"
        if utc_s is not None and utc_s > self._newest_utc_s:
            self._newest_utc_s = utc_s
        return None if self._bounds.look(utc_s, self._watch.clock_gap_deg) else "sun"

    def _clear_slew(
        self, slew: Slew, sidereal_deg: float, reported: tuple[float, float], place: Place, age_s: float
    ) -> Slew | str:
        """Return the leg to slew now, from a place; or the limit that leaves no way."""
        self._sent.clear()
        self.holding = None
        braking = self._ahead.reach(Spot(place, age_s), self._in_force(age_s, None), REST)
        allowed = self._slews.clear(slew, sidereal_deg, reported, place, braking, self._slewing)
        if isinstance(allowed, Slew) and not self._slewing and self._slews.is_there(reported):
            # The mount tracks the sky where it has arrived.
            waits = Box.between(place, place).grown(0.0, SIDEREAL_RATE_DEG_S, 0.0, 0.0)
            allowed = self._bounds.violated(waits, {}, 0.0, INSIDE_MARGIN_DEG) or allowed
        return allowed

    def _while_idle(
        self, sidereal_deg: float, ra_deg: float, dec_deg: float, utc_s: float | None
    ) -> Hold | Slew:
        """Return what a mount does that nothing is asked of: out of the Sun, where it is ours to move."""
        known = self._escapes and not self._watch.clock_is_off
        if not (known and all(math.isfinite(x) for x in (sidereal_deg, ra_deg, dec_deg))):
            return Hold()
        sure = self._doubt.former is None
        if (
            self._escape is None
            and not self._slewing
            and sure
            and self._bounds.look(utc_s, self._watch.clock_gap_deg)
        ):
            place = self._standing.place(sidereal_deg - ra_deg, dec_deg, self._standing.beyond_pole)
            self._escape = self._slews.way_out(sidereal_deg, place)
        elif self._slews.target is None or self._slews.is_there((ra_deg, dec_deg)):
            # It is there, or where it stands was not where it was taken to be: then it is led out from there.
            self._escape = None
        return self._escape or Hold()

    def clear_request(
        self, request: Request, stance: Stance | None, utc_s: float | None = None
    ) -> ClearedRequest | str:
        """Return a request as it may be submitted, or in words why it may not be.

        `stance` is None where the mount has not been heard: then only an abort passes; `utc_s` is the instant
        now. The rates of a MoveAxis go on being judged by `clear`, once a period.
        """
        if isinstance(request, Abort):
            return ClearedRequest(request)
        refused = objection(request, self._profile)
        if refused is None and self._leads and isinstance(request, Slew):
            refused = "a mount with a geometry is led by rates, and not asked to slew by itself"
        if refused is None and stance is None:
            refused = "the mount has not been heard yet"
        if refused is None and self.tripped is not None:
            refused = (
                f"safety has stopped the mount ({ROWS[self.tripped].watches}): {ROWS[self.tripped].way_out}"
            )
        if refused is None and stance is not None:
            refused = self._asked.objection(request, stance, utc_s)
            former = self._doubt.former
            if refused is None and former is not None:
                # The axes may be where they were: one status alone proves nothing.
                refused = self._asked.objection(request, stance_at(stance, former.place), utc_s)
        return ClearedRequest(request) if refused is None else refused

    def path_to(self, request: Slew, stance: Stance, utc_s: float | None) -> tuple[Slew, ...] | str:
        """Return the slews that lead to a direction past what is in the way, or why there is no way."""
        return self._asked.path_to(request, stance, utc_s)

    def drift_objection(self, fine: FineRate, stance: Stance, utc_s: float | None) -> str | None:
        """Return the name of a limit that the mount drifts to under fine rates, tracking the sky; or None."""
        return self._asked.drift_objection(fine, stance, utc_s)

    def _clear_move(self, move: MoveAxes, spots: Sequence[Spot], utc_s: float | None) -> Cleared:
        """Clear rates for every spot where the axes may be; the first is the one that is reported."""
        if self.led is None and self._slews.target is not None:
            self._slews.forget()
        self._streams, self._spots = True, spots
        wish = axis_rates(move, self._standing.beyond_pole)
        clipped = self._clipped(wish)
        self.clamping = clipped != wish
        room = self._room(utc_s)
        wanted = within(clipped[0], room[0]), within(clipped[1], room[1])
        now = self._in_force(oldest_s(spots), utc_s)
        # By hand, it is what the rates grow to that must keep inside.
        judged = wanted if self._holds else self._as_fast_as_seen(clipped)
        name = self.holding = self._ahead.outlook(spots, now).limit(judged)
        if name is None:
            self._outside.count, self._outside.from_the_start = 0, False
            self._held_since = self._rests_since_s = self._near_since_s = None
        else:
            nears = [self._bounds.near(spot.place, self._ahead.horizon_s) for spot in spots]
            outlook = self._ahead.outlook(spots, now, nears)
            if not self._holds:
                inward = outlook.limit(judged)
                if inward is not None:
                    slower = None if self.led is None else self._slower(wanted, outlook.limit)
                    if slower is None:
                        return self._trip(inward)
                    wanted = slower
            else:
                kept = self._kept_inside((clipped, room), (spots, now), outlook.limit, utc_s)
                if isinstance(kept, str):
                    return self._trip(kept)
                wanted = kept
        if not self._holds:
            self._by_hand = _widened(self._by_hand, clipped)
        if utc_s is not None:
            self._sent.append((utc_s, *wanted))
        return Cleared(self._as_move(wanted, move, wish))

    def _slower(self, wanted: Rates, ahead: Callable[[Rates], str | None]) -> Rates | None:
        """Return the rates at which a led slew comes near a limit; None where no motion is clear of it."""
        for share in LED_SHARES:
            rates = share * wanted[0], share * wanted[1]
            if ahead(rates) is None:
                return rates
        return None

    def _kept_inside(
        self,
        wish: tuple[Rates, RateRanges],
        stand: tuple[Sequence[Spot], RateRanges],
        ahead: Callable[[Rates], str | None],
        utc_s: float | None,
    ) -> Rates | str:
        """Return the rates nearest to a wish that lead no farther out, or the limit that stops the mount."""
        outside = self._proven_outside(stand[0])
        in_cone = outside in CONES
        past_limit = None if in_cone else outside
        if past_limit is not None and not self._outside.from_the_start:
            return past_limit
        kept = None if in_cone else self._kept(ahead, utc_s)
        if kept is None:
            kept = self._held(wish, stand, ahead, in_cone)
            self._held_since = None if utc_s is None else (utc_s, kept)
        if past_limit is not None and kept == REST and max(map(abs, wish[0])) > STANDS_DEG_S:
            return past_limit
        return self._unheeded(kept, ahead, stand[0], utc_s) or kept

    def _proven_outside(self, spots: Sequence[Spot]) -> str | None:
        """Return the limit past which the axes have been found so often that they must be; or None."""
        place, found = spots[0].place, self._outside
        name = self._bounds.violated(Box.between(place, place), {}, 0.0, INSIDE_MARGIN_DEG)
        found.from_the_start = name is not None and found.from_the_start is not False
        if found.news or not self._watched:
            found.count = 0 if name is None or len(spots) > 1 else found.count + 1
            found.news = False
        return name if found.count >= OUTSIDE_PROOF else None

    def _kept(self, ahead: Callable[[Rates], str | None], utc_s: float | None) -> Rates | None:
        """Return the rates of what is held where they were found a moment ago and there is no limit ahead."""
        if self._held_since is None or utc_s is None:
            return None
        since_s, rates = self._held_since
        fresh = 0.0 <= utc_s - since_s < HELD_ANEW_S
        return rates if fresh and ahead(rates) is None else None

    def _unheeded(
        self,
        held: Rates,
        ahead: Callable[[Rates], str | None],
        spots: Sequence[Spot],
        utc_s: float | None,
    ) -> str | None:
        """Return the limit that is `ahead` of axes that are to rest, on a mount that does not heed its edges.

        What arrives out of its order can hide an edge, and rates that stay the same get no other one. Rest is
        asked for the longest fault too soon: only a mount that goes on comes so near, or is seen to move when
        it must have obeyed. The Sun and the Moon come near by themselves.
        """
        if utc_s is None or held != REST or self._profile.move_axis != "edge":
            self._rests_since_s = self._near_since_s = None
            return None
        if self._rests_since_s is None:
            self._rests_since_s, self._rests_from = utc_s, self._fastest()
        limit = ahead(REST)
        if limit is None or limit in CONES:
            self._near_since_s = None
        elif self._near_since_s is None:
            self._near_since_s = utc_s
        elif utc_s - self._near_since_s > self._ahead.latency_s:
            return limit
        seen_s = utc_s - oldest_s(spots) - self._rests_since_s - self._ahead.handshake_s
        limit = self._ahead.disobeying(spots, self._moving(), self._rests_from, seen_s)
        return None if limit in CONES else limit

    def _held(
        self,
        wish: tuple[Rates, tuple[Rates, Rates]],
        stand: tuple[Sequence[Spot], RateRanges],
        ahead: Callable[[Rates], str | None],
        inside: bool,
    ) -> Rates:
        """Return the rates nearest to a wish with no limit `ahead`, or what leads away from the Sun.

        A wish comes with the room that there is for the next command's rates, a stand with the rates that are
        in force. What moves by itself towards axes that stand, the Sun or the Moon, is given way to; and axes
        that are `inside` of its cone make for its edge, no matter what is wanted.
        """
        held, (spots, now) = REST, stand
        place = spots[0].place
        if not inside:
            cos_dec = math.cos(math.radians(place.dec_deg))
            held = nearest_rates(*wish, cos_dec, lambda rates: ahead(rates) is None)
        if held != REST:
            return held
        ways = self._bounds.away(place, self._ahead.horizon_s)
        if not ways:
            return REST
        nears = [self._bounds.near(spot.place, self._ahead.horizon_s, ESCAPE_NEAR_DEG) for spot in spots]
        limit = self._ahead.outlook(spots, now, nears).limit
        return next((away for away in ways if limit(away) is None), REST)

    def _as_move(self, rates: tuple[float, float], move: MoveAxes, wish: tuple[float, float]) -> MoveAxes:
        if rates == wish:
            return move
        sense = -1.0 if self._standing.beyond_pole else 1.0
        return MoveAxes(
            move.ra_rate_deg_s if rates[0] == wish[0] else SIDEREAL_RATE_DEG_S - rates[0],
            move.dec_rate_deg_s if rates[1] == wish[1] else sense * rates[1],
        )

    def _room(self, utc_s: float | None) -> tuple[Rates, Rates]:
        """Return the least and the greatest rates of each axis within a ramp of the last."""
        by_hand = not self._holds and self.led is None
        if utc_s is None or not (by_hand or (self._holds and self._sent)):
            return ANY_RATE, ANY_RATE
        profile = self._profile
        then_s, *before = self._sent[-1] if self._sent else (utc_s - profile.period_s, *REST)
        # By hand, rates may be cleared more than once a period.
        seconds = max(0.0 if by_hand else profile.period_s, utc_s - then_s)
        ha_step, dec_step = (
            (HAND_SHARE if by_hand else STEP_SHARE) * axis.max_acceleration_deg_s2 * seconds
            for axis in (profile.ra, profile.dec)
        )
        return _room_about(before[0], ha_step), _room_about(before[1], dec_step)

    def _clipped(self, wish: tuple[float, float]) -> tuple[float, float]:
        """Return rates within the axes' limits."""
        most_ha, most_dec = self._profile.ra.max_rate_deg_s, self._profile.dec.max_rate_deg_s
        return max(-most_ha, min(most_ha, wish[0])), max(-most_dec, min(most_dec, wish[1]))

    def _in_force(self, age_s: float, utc_s: float | None) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the least and the greatest rates of both axes that may have been in force of late."""
        ha, dec = self._moving()
        if utc_s is None:
            return (ha, dec), (ha, dec)
        sent = self._sent
        since_s = utc_s - age_s - self._ahead.latency_s
        # A rate is in force until the one after it is obeyed.
        while len(sent) > 1 and sent[1][0] < since_s:
            sent.popleft()
        if not sent:
            return (ha, dec), (ha, dec)
        has, decs = [rates[1] for rates in sent], [rates[2] for rates in sent]
        least, greatest = (min(has), min(decs)), (max(has), max(decs))
        if sent[0][0] > since_s:
            # What it was sent before, and may obey yet, is not known.
            least, greatest = _widened((least, greatest), (ha, dec))
        swing_ha, swing_dec = self._swing((ha, dec), (least, greatest), utc_s)
        return (
            (min(ha, least[0] - swing_ha), min(dec, least[1] - swing_dec)),
            (max(ha, greatest[0] + swing_ha), max(dec, greatest[1] + swing_dec)),
        )

    def _moving(self) -> Rates:
        """Return the rates of both axes as statuses show them."""
        ha, dec = axis_rates(self._doubt.moved, self._standing.beyond_pole)
        return within(ha, self._plausible[0]), within(dec, self._plausible[1])

    def _as_fast_as_seen(self, wanted: Rates) -> Rates:
        """Return rates by as much faster as either axis moves that way than by any it was sent by hand.

        A servo that a step of its rate has left behind catches up, and goes on past where it is to stop.
        """
        (ha, dec), (least, greatest) = self._moving(), self._by_hand
        return (
            _sped_up(wanted[0], ha, least[0], greatest[0]),
            _sped_up(wanted[1], dec, least[1], greatest[1]),
        )

    def _swing(self, moved: Rates, sent: RateRanges, utc_s: float) -> Rates:
        """Return by how much either axis has of late moved faster or slower than by what it was sent.

        A servo that has been led astray swings about where it is to rest, far and for long.
        """
        now = [max(0.0, low - rate, rate - high) for rate, low, high in zip(moved, *sent, strict=True)]
        if max(now) > SWINGS_DEG_S and self._holds and self._watched:
            self._swings.append((utc_s, now[0], now[1]))
        while self._swings and not 0.0 <= utc_s - self._swings[0][0] < SWINGS_FOR_S:
            self._swings.popleft()
        if not self._swings:
            return REST
        return max(ha for _, ha, _ in self._swings), max(dec for _, _, dec in self._swings)

    def handshakes_last(self, unanswered_s: float) -> None:
        """Judge rates from now on for a mount that leaves them unanswered: for so long the next may wait."""
        self._ahead.handshakes_last(unanswered_s)

    def in_time(self, cleared: Cleared, rates_wait_s: float, begun: Motion) -> Cleared:
        """Return what was cleared, or a stop where the rates that hold the mount at a limit do not reach it.

        For so long a mount that takes rates by edges has been given none since `begun`. When a handshake is
        overdue, or the axes are seen faster than `begun`, they must leave room, going on as they do, for a
        stop, which needs no handshake, and for the longest fault.
        """
        if self.holding is None or not rates_wait_s:
            return cleared
        limit = None
        if rates_wait_s > self._ahead.overdue_s:
            limit = self._ahead.going_on(self._spots, self._moving())
        elif isinstance(begun, MoveAxes) and self._faster_than(axis_rates(begun, self._standing.beyond_pole)):
            seen_s = rates_wait_s - oldest_s(self._spots)
            limit = self._ahead.disobeying(self._spots, self._moving(), self._fastest(), seen_s)
        return cleared if limit is None else self._trip(limit)

    def _faster_than(self, begun: Rates) -> bool:
        """Return whether either axis is seen to move faster than by rates, or the other way."""
        return any(
            not min(0.0, rate) - UNLIKE_DEG_S <= moved <= max(0.0, rate) + UNLIKE_DEG_S
            for moved, rate in zip(self._moving(), begun, strict=True)
        )

    def _fastest(self) -> Rates:
        """Return how fast each axis is seen to be, or may be by what it was sent of late, either way."""
        ha, dec = map(abs, self._moving())
        return (
            max([ha, *(abs(rates[1]) for rates in self._sent)]),
            max([dec, *(abs(rates[2]) for rates in self._sent)]),
        )

    def _let_go(self) -> None:
        self.holding = self._held_since = self._rests_since_s = self._near_since_s = None
        self._outside.count, self._outside.from_the_start = 0, None
        self._by_hand = REST, REST
        self._sent.clear()
        self._slews.forget()

    def _trip(self, name: str) -> Cleared:
        self.tripped = name
        self._let_go()
        return Cleared(Stop())


def spots_of(place: Place, former: Former | None, age_s: float) -> list[Spot]:
    """Return where the axes may be: the place that is reported, and the former one where that is in doubt."""
    spots = [Spot(place, age_s)]
    if former is not None:
        spots.append(Spot(former.place, age_s + former.older_s))
    return spots


def oldest_s(spots: Sequence[Spot]) -> float:
    """Return the age of the oldest status by which the axes may be somewhere, seconds."""
    return spots[0].age_s if len(spots) == 1 else max([spot.age_s for spot in spots])


Rates = tuple[float, float]
REST: Rates = (0.0, 0.0)
ANY_RATE: Rates = (-math.inf, math.inf)


def _room_about(before: float, step: float) -> Rates:
    """Return rates no more than a step faster either way; slowing down is never held back."""
    return min(before, 0.0) - step, max(before, 0.0) + step


def _widened(ranges: RateRanges, rates: Rates) -> RateRanges:
    """Return ranges of rates that hold other ones, too."""
    least, greatest = ranges
    return (
        (min(least[0], rates[0]), min(least[1], rates[1])),
        (max(greatest[0], rates[0]), max(greatest[1], rates[1])),
    )


def _sped_up(rate: float, moved: float, least: float, greatest: float) -> float:
    """Return a rate, faster by as much as what moved was faster, the same way, than all that was asked."""
    if rate > 0.0:
        return rate + max(0.0, moved - max(rate, greatest))
    return rate + min(0.0, moved - min(rate, least)) if rate < 0.0 else rate
