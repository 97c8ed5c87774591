"""Between a session's datagrams and an Alpaca telescope, without I/O: commands and readings in, orders and
statuses out.

Rules:

1. Once a turn the newest datagram is read, and what it wants is ordered; that turn's status acknowledges.
2. A fall of a MoveAxis flag is a MoveAxis of 0, which gives tracking back, as the ASCOM standard has it.
3. A stop is AbortSlew and a MoveAxis of 0 on both axes, and is repeated until the telescope is seen at rest;
   then tracking is set as it was before anything was asked.
4. Where the session is silent for DEADMAN_S while something of its is in force, the telescope is stopped.
5. What the telescope refuses is not acknowledged, and asked for again as long as it is wanted.
6. A first axis that is to stand does so by the slowest rate, or without tracking where that is too fast.

Mounts are steered in the equinox of date; some drivers speak J2000. Between the two the axes are turned by
precession, nutation and frame bias (IAU 2006/2000A, ERFA), without aberration: the satellite's direction is
topocentric already, and what a driver adds on its own is the same within a field.

Instants are UTC as POSIX seconds (`_utc_s`), or of our monotonic clock (`_s`).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import erfa

from sattrack.core.angles import altitude_deg, azimuth_deg
from sattrack.mount.alpaca.device import (
    J2000_SYSTEM,
    DeviceFacts,
    DeviceState,
    SkyPlace,
    nearest_rate,
)
from sattrack.mount.model import DTICS_S_PER_DEG_S, SIDEREAL_RATE_DEG_S, Status, mean_sidereal_deg
from sattrack.mount.xerxes.datagrams import Command, DatagramError, decode_command, encode_status

NORTH, SOUTH, EAST, WEST = range(4)
"""Alpaca's GuideDirections."""
Lane = Literal["ra", "dec", "rest"]
AXIS_LANES: tuple[Lane, Lane] = ("ra", "dec")
REMEMBERED = 100
FEWEST = 10
LEAST_EXCESS_S = 0.003
EXCESSES = 2.0
MOST_IN_A_ROW = 3
"""A way that has become longer for good is believed after so many."""
ANEW_AFTER_S = 600.0
"""The equinox moves by 3 milliarcseconds in that time."""
MJD_ZERO = 2400000.5
MJD_OF_UNIX_EPOCH = 40587.0
TT_LESS_UTC_S = 69.184
DEADMAN_S = 1.0
STOP_AGAIN_S = 0.5
SAME_RATE_DEG_S = 1e-8
RATE_OVER_S = 0.35
"""The span over which the axes' rates are taken from places."""
MOVES_DEG_S = 0.5 * SIDEREAL_RATE_DEG_S
LONGEST_SHIFT_S = 0.5
OLD_PLACES_PROOF = 4
OLD_AT_MOST_S = 0.5
"""For how long a place that stays the same is taken for an old one: no driver keeps one for longer."""
GUIDED_LATELY_S = 1.0
"""For how long after a guide pulse the rates that places show are still its own."""
TRACKING_AGAIN_S = 1.0
MOST_TRACKING_TRIES = 5
OWN_CLOCK_DEG = 30.0 * SIDEREAL_RATE_DEG_S
"""A telescope whose sidereal time is farther from ours has another clock, or site: below that, its answer was
under way."""
ONE_SHOTS = ("abort", "slew", "sync", "pulse_guide")
HALT_NAMES = frozenset({"abortslew"})


class Order(NamedTuple):
    """Something to tell the telescope: a PUT of one member.

    On the lanes `ra` and `dec` a newer order takes the place of one that waits; on `rest` they queue up.
    """

    lane: Lane
    member: str
    fields: tuple[tuple[str, str], ...] = ()
    rate_deg_s: float = 0.0
    """Of a MoveAxis."""


def move_order(axis: int, rate_deg_s: float) -> Order:
    """Return the MoveAxis of one axis, 0 right ascension, 1 declination; degrees a second."""
    parameters = ("Axis", str(axis)), ("Rate", f"{rate_deg_s:.9f}")
    return Order(AXIS_LANES[axis], "moveaxis", parameters, rate_deg_s)


def tracking_order(on: bool) -> Order:
    """Return the order that puts tracking on or off."""
    return Order("rest", "tracking", (("Tracking", "true" if on else "false"),))


def pulse_orders(ra_ms: int, dec_ms: int) -> list[Order]:
    """Return the guide pulses of so many milliseconds; negative is east, and south."""
    orders = []
    for milliseconds, onward, back in ((ra_ms, WEST, EAST), (dec_ms, NORTH, SOUTH)):
        if milliseconds:
            direction = onward if milliseconds > 0 else back
            parameters = ("Direction", str(direction)), ("Duration", str(abs(milliseconds)))
            orders.append(Order("rest", "pulseguide", parameters))
    return orders


@dataclass(slots=True)
class Lateness:
    """Follows how long requests take, seconds."""

    _took: deque[float] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    _in_a_row: int = 0

    def is_late(self, took_s: float) -> bool:
        """Take one; return whether it took longer than the median by more than its lead over the fastest."""
        late = len(self._took) >= FEWEST and took_s > self._limit_s()
        self._took.append(took_s)
        self._in_a_row = self._in_a_row + 1 if late else 0
        return 0 < self._in_a_row <= MOST_IN_A_ROW

    def _limit_s(self) -> float:
        ordered = sorted(self._took)
        median = ordered[len(ordered) // 2]
        return median + max(LEAST_EXCESS_S, EXCESSES * (median - ordered[0]))


@dataclass(slots=True)
class Equinox:
    """Turns directions, degrees, at instants of UTC (POSIX seconds)."""

    _matrix: Any = None
    _made_utc_s: float = 0.0

    def of_date(self, ra_deg: float, dec_deg: float, utc_s: float) -> tuple[float, float]:
        """Return a J2000 direction in the equinox of date."""
        return self._turned(self._rotation(utc_s), ra_deg, dec_deg)

    def j2000(self, ra_deg: float, dec_deg: float, utc_s: float) -> tuple[float, float]:
        """Return a direction of date in J2000."""
        return self._turned(self._rotation(utc_s).T, ra_deg, dec_deg)

    def _rotation(self, utc_s: float) -> Any:
        if self._matrix is None or abs(utc_s - self._made_utc_s) > ANEW_AFTER_S:
            tt = (utc_s + TT_LESS_UTC_S) / 86400.0 + MJD_OF_UNIX_EPOCH
            self._matrix, self._made_utc_s = erfa.pnm06a(MJD_ZERO, tt), utc_s
        return self._matrix

    @staticmethod
    def _turned(matrix: Any, ra_deg: float, dec_deg: float) -> tuple[float, float]:
        ra, dec = math.radians(ra_deg), math.radians(dec_deg)
        unit = (math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec))
        x, y, z = (float(v) for v in matrix @ unit)
        return math.degrees(math.atan2(y, x)) % 360.0, math.degrees(math.atan2(z, math.hypot(x, y)))


class _Seen(NamedTuple):
    utc_s: float
    hour_angle_deg: float
    ra_deg: float
    dec_deg: float


@dataclass(slots=True)
class _Axis:
    """The last rate given to one axis; `commanded_deg_s` None where that is not known, after a refusal."""

    commanded_deg_s: float | None = 0.0
    refused: bool = False


@dataclass(slots=True)
class Bridge:
    """One telescope and one session; `longitude_deg` is that of the site whose sidereal time dates places.

    `latitude_deg` is that of the site, by which altitudes are computed where the telescope reports none.
    """

    facts: DeviceFacts
    longitude_deg: float
    latitude_deg: float | None = None
    words: str | None = None
    """What the telescope said when it last refused; None once it obeys."""
    counter: int = 0
    _mail: list[Command] = field(default_factory=list)
    _command: Command = field(default_factory=Command)
    _heard_s: float | None = None
    _axes: tuple[_Axis, _Axis] = field(default_factory=lambda: (_Axis(), _Axis()))
    _refused: set[str] = field(default_factory=set)
    """One-shots of the flags that stand that the telescope has refused."""
    _standing: DeviceState = field(default_factory=lambda: DeviceState(-math.inf))
    _guided_s: float = -math.inf
    """When it was last asked whether it guides, and did."""
    _trail: deque[_Seen] = field(default_factory=lambda: deque(maxlen=64))
    _rates_deg_s: tuple[float, float] = (SIDEREAL_RATE_DEG_S, 0.0)
    _last: SkyPlace | None = None
    _old_places: int = 0
    """Places that came again though an axis moved."""
    _oldest_s: float = 0.0
    _lateness: Lateness = field(default_factory=Lateness)
    _equinox: Equinox = field(default_factory=Equinox)
    _in_force: bool = False
    """Whether something of ours may have the telescope moving."""
    _stop_s: float | None = None
    """When the last stop was ordered; None unless one is being seen through."""
    _slew_ordered: bool = False
    _slew_answered_s: float = -math.inf
    _tracked_before: bool | None = None
    """Whether it tracked before anything was asked; None before that."""
    _tracking_tries: int = 0
    _tracking_asked: bool | None = None
    """What was last asked of its tracking; None for nothing yet."""
    _tracking_asked_s: float = -math.inf
    _clock_off_deg: float = 0.0
    """How far the telescope's own sidereal time is from ours; 0 where it is the same."""

    @property
    def doubt(self) -> str | None:
        """What is doubtful about the places that the telescope reports, as text; None for nothing."""
        if self._old_places < OLD_PLACES_PROOF:
            return None
        return (
            f"the driver reports places that are {1000.0 * self._oldest_s:.0f} ms old or more: the telescope "
            "is off by what it moves in that time, and the reported error does not show it"
        )

    @property
    def in_force(self) -> bool:
        """Whether something of ours may have the telescope moving, or a stop is not seen through."""
        return self._in_force or self._stop_s is not None

    def hear(self, data: bytes, now_s: float) -> None:
        """Take a datagram of the session; what is none is left alone."""
        try:
            command = decode_command(data)
        except DatagramError:
            return
        self._heard_s = now_s
        self._mail.append(command)

    def turn(self, now_s: float) -> list[Order]:
        """Read the mailbox; return the orders to the telescope that are due now."""
        orders: list[Order] = []
        for command in self._mail:
            orders += self._rising(command, now_s)
            self._command = command
        self._mail.clear()
        silent = self._heard_s is not None and now_s - self._heard_s > DEADMAN_S
        if silent and self._in_force and self._stop_s is None:
            # Nobody wants any of it any more.
            self._command = Command()
            orders += self._stop(now_s)
        if self._stop_s is not None:
            orders += self._see_stop_through(now_s)
        if self._stop_s is None or self._wants_move():
            orders += self._move(now_s)
        if self._stop_s is None and not self._goes():
            self._in_force = False
        return orders

    def answered(self, order: Order, refusal: str | None, now_s: float) -> None:
        """Take the telescope's answer to an order: None where it obeys, else its words."""
        if order.member == "slewtocoordinatesasync":
            self._slew_answered_s, self._slew_ordered = now_s, False
        name = {"slewtocoordinatesasync": "slew", "synctocoordinates": "sync", "pulseguide": "pulse_guide"}
        if refusal is None:
            self.words = None if order.member not in HALT_NAMES else self.words
            if order.member == "moveaxis":
                self._axes[AXIS_LANES.index(order.lane)].refused = False
            return
        if order.member not in HALT_NAMES:
            # A telescope that cannot abort, or need not, is stopped by its axes.
            self.words = f"the telescope refuses {order.member}: {refusal}"
        if order.member == "moveaxis":
            axis = self._axes[AXIS_LANES.index(order.lane)]
            axis.commanded_deg_s, axis.refused = None, True
        elif order.member in name:
            self._refused.add(name[order.member])

    def stand(self, standing: DeviceState) -> None:
        """Take how the telescope stands."""
        self._standing = standing
        if standing.pulse_guiding:
            self._guided_s = standing.began_s

    def see_clock(self, sidereal_h: Any, utc_s: float) -> None:
        """Take the sidereal time that the telescope tells at an instant; what is no time is left alone.

        By a clock that is wrong its directions are, too: statuses then carry that clock, for safety to judge.
        """
        if type(sidereal_h) not in (int, float) or not 0.0 <= sidereal_h <= 24.0:
            return
        off_deg = math.remainder(sidereal_h * 15.0 - mean_sidereal_deg(utc_s, self.longitude_deg), 360.0)
        if abs(off_deg - self._clock_off_deg) > OWN_CLOCK_DEG:
            self._clock_off_deg = off_deg if abs(off_deg) > OWN_CLOCK_DEG else 0.0

    def _sidereal_deg(self, utc_s: float) -> float:
        """Return local sidereal time at an instant, by the telescope's clock where that is another."""
        return (mean_sidereal_deg(utc_s, self.longitude_deg) + self._clock_off_deg) % 360.0

    @property
    def standing(self) -> DeviceState:
        """How the telescope stood last."""
        return self._standing

    def see(self, place: SkyPlace) -> bytes | None:
        """Take a place that was read in this turn; return the status to send.

        None where the request took so long that its instant is in doubt, and where the place is the last one
        though an axis moves: the driver reports an old one.
        """
        self.counter += 1
        if self._lateness.is_late(place.took_s):
            return None
        if self._last is not None and self._is_old(place):
            self._old_places += 1
            self._oldest_s = max(self._oldest_s, place.ra_utc_s - self._last.ra_utc_s)
            return None
        self._last = place
        seen = self._seen(place)
        self._take_rates(seen)
        return encode_status(self._status(seen))

    def _rising(self, command: Command, now_s: float) -> list[Order]:
        orders: list[Order] = []
        for flag in ONE_SHOTS:
            was, wanted = getattr(self._command, flag), getattr(command, flag)
            if not wanted:
                self._refused.discard(flag)
            elif not was:
                orders += self._launch(flag, command, now_s)
        return orders

    def _launch(self, flag: str, command: Command, now_s: float) -> list[Order]:
        can = {
            "slew": self.facts.can_slew,
            "sync": self.facts.can_sync,
            "pulse_guide": self.facts.can_pulse_guide,
        }
        if not can.get(flag, True):
            self.words = f"the telescope has no {flag.replace('_', ' ')}"
            self._refused.add(flag)
            return []
        if flag == "abort":
            return self._stop(now_s)
        if self.facts.objection() is not None:
            self._refused.add(flag)
            return []
        if flag == "pulse_guide":
            return pulse_orders(command.pulse_ra_ms, command.pulse_dec_ms)
        target = self._target(command)
        if flag == "sync":
            return [Order("rest", "synctocoordinates", target)]
        self._begin()
        self._slew_ordered = True
        return [*self._tracking_first(now_s), Order("rest", "slewtocoordinatesasync", target)]

    def _target(self, command: Command) -> tuple[tuple[str, str], ...]:
        ra_deg, dec_deg = command.target_ra_h * 15.0 % 360.0, command.target_dec_deg
        if self.facts.equatorial_system == J2000_SYSTEM and self._last is not None:
            ra_deg, dec_deg = self._equinox.j2000(ra_deg, dec_deg, self._last.ra_utc_s)
        # Rounded first: 24 h is no right ascension.
        hours = round(ra_deg / 15.0, 10) % 24.0
        return ("RightAscension", f"{hours:.10f}"), ("Declination", f"{dec_deg:.9f}")

    def _begin(self) -> None:
        """Something is about to be asked that moves the telescope."""
        self._in_force, self._stop_s = True, None
        if self._tracked_before is None:
            self._tracked_before = self._standing.tracking

    def _tracking_first(self, now_s: float) -> list[Order]:
        """Have tracking on before a motion, so that the same rate always means the same.

        Off, where it turns both axes: a MoveAxis of 0 is rest only there.
        """
        wanted, asked = not self.facts.follows_by_both, self._tracking_asked
        given_back = asked is not None and asked is not wanted
        if not self.facts.can_set_tracking or (self._standing.tracking is wanted and not given_back):
            return []
        if now_s - self._tracking_asked_s < TRACKING_AGAIN_S and not given_back:
            return []
        return self._ask_tracking(wanted, now_s)

    def _ask_tracking(self, on: bool, now_s: float) -> list[Order]:
        self._tracking_asked, self._tracking_asked_s = on, now_s
        return [tracking_order(on)]

    def _wants_move(self) -> bool:
        command = self._command
        moves = (command.move_ra or command.move_dec) and not command.abort
        return moves and self.facts.objection() is None

    def _move(self, now_s: float) -> list[Order]:
        command = self._command
        moves = self._wants_move()
        if moves and (not self._in_force or self._stop_s is not None):
            self._begin()
        stands = all(axis.commanded_deg_s == 0.0 for axis in self._axes)
        # During a MoveAxis some drivers report that tracking is off, and it says nothing.
        to_stand = moves and self._is_to_stand(command)
        if moves and stands and not to_stand and (first := self._tracking_first(now_s)):
            return first
        wishes = (
            command.move_ra_rate_deg_s if moves and command.move_ra else 0.0,
            command.move_dec_rate_deg_s if moves and command.move_dec else 0.0,
        )
        orders = self._stand(now_s) if to_stand and self._axes[0].commanded_deg_s == 0.0 else []
        for number, wish in enumerate(wishes):
            axis = self._axes[number]
            rate = nearest_rate(wish, self.facts.rates(number))
            if axis.commanded_deg_s is None or abs(rate - axis.commanded_deg_s) > SAME_RATE_DEG_S:
                orders.append(move_order(number, rate))
                axis.commanded_deg_s = rate
        return orders

    def _is_to_stand(self, command: Command) -> bool:
        """Whether the first axis is to stand, and the driver has no rate that is slow enough for it."""
        wish, spans = command.move_ra_rate_deg_s, self.facts.rates(0)
        slow = command.move_ra and 0.0 < abs(wish) < MOVES_DEG_S and nearest_rate(wish, spans) == 0.0
        return slow and self.facts.can_set_tracking and not self.facts.follows_by_both

    def _stand(self, now_s: float) -> list[Order]:
        """Take tracking off an axis whose MoveAxis has ended; a telescope that stood so is left so."""
        self._tracked_before = False
        turns = abs(self._rates_deg_s[0]) > MOVES_DEG_S
        again = turns and now_s - self._tracking_asked_s > TRACKING_AGAIN_S
        return self._ask_tracking(False, now_s) if self._tracking_asked is not False or again else []

    def _stop(self, now_s: float) -> list[Order]:
        self._stop_s = now_s
        self._slew_ordered = False
        for axis in self._axes:
            axis.commanded_deg_s = 0.0
        return [Order("rest", "abortslew"), move_order(0, 0.0), move_order(1, 0.0)]

    def _see_stop_through(self, now_s: float) -> list[Order]:
        assert self._stop_s is not None
        if now_s - self._stop_s < STOP_AGAIN_S:
            return []
        refused = any(axis.refused for axis in self._axes) and not self._standing.at_park
        if self._moving() or refused:
            return self._stop(now_s)
        if self._standing.began_s < self._stop_s:
            return []
        before, self._in_force = self._tracked_before, False
        differs = before is not None and before != self._standing.tracking
        if not differs or not self.facts.can_set_tracking or self._tracking_tries >= MOST_TRACKING_TRIES:
            self._stop_s = self._tracked_before = None
            self._tracking_tries = 0
            return []
        if now_s - self._tracking_asked_s < TRACKING_AGAIN_S:
            return []
        self._tracking_tries += 1
        return self._ask_tracking(before is True, now_s)

    def _moving(self) -> bool:
        """Whether the telescope moves otherwise than with the sky, by what it says or by its places."""
        hour_angle, dec = self._rates_deg_s
        off = min(abs(hour_angle), abs(hour_angle - SIDEREAL_RATE_DEG_S))
        return self._slews or max(off, abs(dec)) > MOVES_DEG_S

    @property
    def _slews(self) -> bool:
        return self._standing.slewing and not self._standing.at_park

    def _goes(self) -> bool:
        """Whether what was asked may still have the telescope moving."""
        commanded = any(axis.commanded_deg_s != 0.0 for axis in self._axes)
        # A parked telescope refuses every command, and stands.
        guided = self._standing.began_s - self._guided_s < GUIDED_LATELY_S
        moves = self._slews if guided else self._moving()
        return (commanded and not self._standing.at_park) or self._slew_awaited or moves

    @property
    def _slew_awaited(self) -> bool:
        """Whether a slew was ordered of which what the telescope says of itself knows nothing yet."""
        return self._slew_ordered or self._standing.began_s < self._slew_answered_s

    def _is_old(self, place: SkyPlace) -> bool:
        last = self._last
        if last is None or (place.ra_deg, place.dec_deg) != (last.ra_deg, last.dec_deg):
            return False
        commanded = any(abs(axis.commanded_deg_s or 0.0) > MOVES_DEG_S for axis in self._axes)
        hour_angle, dec = self._rates_deg_s
        moves = max(abs(SIDEREAL_RATE_DEG_S - hour_angle), abs(dec)) > MOVES_DEG_S
        return commanded and moves and place.ra_utc_s - last.ra_utc_s < OLD_AT_MOST_S

    def _seen(self, place: SkyPlace) -> _Seen:
        """Return a place for one instant, that of its right ascension, in the equinox of date."""
        shift_s = place.ra_utc_s - place.dec_utc_s
        dec_deg = place.dec_deg
        if abs(shift_s) < LONGEST_SHIFT_S:
            dec_deg += self._rates_deg_s[1] * shift_s
        ra_deg, dec_deg = place.ra_deg, max(-90.0, min(90.0, dec_deg))
        if self.facts.equatorial_system == J2000_SYSTEM:
            ra_deg, dec_deg = self._equinox.of_date(ra_deg, dec_deg, place.ra_utc_s)
        hour_angle_deg = math.remainder(self._sidereal_deg(place.ra_utc_s) - ra_deg, 360.0)
        return _Seen(place.ra_utc_s, hour_angle_deg, ra_deg, dec_deg)

    def _take_rates(self, seen: _Seen) -> None:
        self._trail.append(seen)
        while len(self._trail) > 2 and seen.utc_s - self._trail[1].utc_s >= RATE_OVER_S:
            self._trail.popleft()
        first = self._trail[0]
        seconds = seen.utc_s - first.utc_s
        if seconds > 0.0:
            self._rates_deg_s = (
                math.remainder(seen.hour_angle_deg - first.hour_angle_deg, 360.0) / seconds,
                (seen.dec_deg - first.dec_deg) / seconds,
            )

    def _status(self, seen: _Seen) -> Status:
        facts, standing, command = self.facts, self._standing, self._command
        hour_angle_rate, dec_rate = self._rates_deg_s
        latitude_deg = self.latitude_deg if facts.latitude_deg is None else facts.latitude_deg
        place = seen.hour_angle_deg, seen.dec_deg, latitude_deg or 0.0
        site = facts.latitude_deg, facts.longitude_deg
        # One that does not know its site tells 0 of both.
        north_deg, east_deg = (0.0, 0.0) if None in site else site
        primary, secondary = self._axes
        ra_guide_rate, dec_guide_rate = facts.guide_rates_deg_s or (0.0, 0.0)
        return Status(
            altitude_deg=altitude_deg(*place),
            azimuth_deg=azimuth_deg(*place),
            dec_deg=seen.dec_deg,
            dec_guide_rate_dtics_s=dec_guide_rate * DTICS_S_PER_DEG_S,
            dec_rate_dtics_s=(-dec_rate if standing.beyond_pole else dec_rate) * DTICS_S_PER_DEG_S,
            ra_guide_rate_dtics_s=ra_guide_rate * DTICS_S_PER_DEG_S,
            ra_h=seen.ra_deg / 15.0,
            ra_rate_dtics_s=hour_angle_rate * DTICS_S_PER_DEG_S,
            sidereal_h=self._sidereal_deg(seen.utc_s) / 15.0,
            site_height_m=facts.height_m,
            site_latitude_deg=north_deg,
            site_longitude_deg=east_deg,
            target_dec_deg=command.target_dec_deg,
            target_ra_h=command.target_ra_h,
            counter=self.counter,
            at_home=standing.at_home,
            at_park=standing.at_park,
            does_refraction=facts.does_refraction,
            pulse_guiding=standing.pulse_guiding,
            side_of_pier=standing.beyond_pole,
            slewing=self._goes(),
            tracking=standing.tracking,
            ack_move_ra=command.move_ra and not primary.refused,
            ack_move_dec=command.move_dec and not secondary.refused,
            ack_abort=command.abort,
            ack_sync=command.sync and "sync" not in self._refused,
            ack_pulse_guide=command.pulse_guide and "pulse_guide" not in self._refused,
            ack_slew=command.slew and "slew" not in self._refused,
        )
