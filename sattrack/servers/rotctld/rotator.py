"""The mount as a rotator: the commanding client, the last command, and the path. No I/O, no clock.

Every client may command, and the last command counts; positions of two clients never make one track. Where
only one may command at a time, the others are refused until it disconnects, stops the mount, or has been
silent for a while.

A satellite program sends the satellite's position about once a second, to a hundredth of a degree. Three or
more positions, each continuing those before, make a *track*: a parabola through the last ones by least
squares, in Cartesian coordinates so that neither the zenith nor north is special, is followed until the next
position comes. Where a new one bends the path, the difference decays over a second or more, without a step in
position or rate. The mount stands at any other position. A track whose client falls silent ends soon.
Instants are arguments, UTC as POSIX seconds.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from sattrack.servers.antenna.led_mount import RATE_STEP_S, PathDriver, park_direction
from sattrack.servers.antenna.protocol import NS
from sattrack.servers.antenna.trajectory import AxisState, AzEl, HaDec, Path, Straight
from sattrack.servers.rotctld.reader import Code

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Vector = NDArray[np.float64]
    from sattrack.mount.model import AxesPosition, MountProfile
    from sattrack.safety import SafetyLimits
    from sattrack.servers.antenna.equipment import Feedback
    from sattrack.servers.antenna.trajectory import SiteSky

MOST_POINTS = 7
"""Positions that are fitted: at one a second, more miss bends of the path, fewer pass more rounding."""
FEWEST_POINTS = 3
"""Positions that make a track; with so few it is straight."""
MOST_GAP_S = 40.0
LEAST_GAP_S = 0.02
"""Of positions that come faster than this, the last counts."""
MOST_RATE_DEG_S = 6.0
NOISY_DEG, NOISY_S = 0.03, 12.0
"""Positions of so short a time that scatter more than this about a parabola are fitted by a straight line,
which follows them less; those of a longer time may be off it because the path bends more."""
STRAY_DEG = 0.1
STRAY_SHARE = 0.15
STRAY_S = 1.0
"""How far a position may be from the prediction: so much, and so much of a step; and along the path so much
earlier or later, as some programs send a satellite's future position, with a varying lead."""
COAST_S = 3.0
"""How long a track goes on after its client's last request."""
LEAST_HOLD_S, MOST_HOLD_S, HOLD_GAPS = 10.0, 30.0, 2.5
"""How long it goes on after the last position, while its client still asks where the mount is: so many of the
last interval between positions. Some clients send a position only where the mount is off."""
EASE_S = 1.0
"""How long a track takes to come to rest."""
RETURN_S = 4.0
"""How long it rests there; then the mount goes to the last position of a client that still asks."""
LEAST_BLEND_S, MOST_BLEND_S = 1.0, 3.0
BLEND_DEG_S2 = 0.5
"""A bend decays so slowly that this acceleration suffices, within those times."""
MOVE_RATE_DEG_S = 2.0
"""The rate of a move at speed 100."""
MOVE_MOST_S = 10.0
"""A move lasts so long after its command."""
MOST_SPEED = 100
SPEED_LEVELS = 4
COMMANDS_FOR_S = 10.0
"""A client that has been silent for so long commands no longer."""
MOVING_DEG_S = 0.01
"""An axis moves above this rate; sidereal rate is less than half of it."""
REMEMBERED_LINES = 20


def _unit(place: AzEl) -> Vector:
    az, el = math.radians(place.az_deg), math.radians(place.el_deg)
    return np.array([math.cos(el) * math.sin(az), math.cos(el) * math.cos(az), math.sin(el)])


def _place(v: Vector) -> AzEl:
    e, n, u = v.tolist()
    return AzEl(math.degrees(math.atan2(e, n)) % 360.0, math.degrees(math.atan2(u, math.hypot(e, n))))


def _apart_deg(a: Vector, b: Vector) -> float:
    return math.degrees(2.0 * math.asin(min(1.0, 0.5 * float(np.linalg.norm(a - b)))))


class _Curve(NamedTuple):
    """A parabola, and past `straight_s` its tangent; seconds since `since_s`."""

    since_s: float
    straight_s: float
    terms: Vector
    """Three rows: place, rate, half of the acceleration."""

    def at(self, utc_s: float) -> tuple[Vector, Vector]:
        """Return place and rate."""
        t = utc_s - self.since_s
        bent = min(t, self.straight_s)
        rate = self.terms[1] + 2.0 * bent * self.terms[2]
        place = self.terms[0] + bent * (self.terms[1] + bent * self.terms[2]) + (t - bent) * rate
        return place, rate


class _Point(NamedTuple):
    utc_s: float
    v: Vector


class SmoothedTrack:
    """The path that one client's positions make."""

    def __init__(self) -> None:
        self._points: deque[_Point] = deque(maxlen=MOST_POINTS)
        self._last = AzEl(0.0, 0.0)
        self._curve: _Curve | None = None
        self._bend: tuple[Vector, Vector] | None = None
        self._blend_s = LEAST_BLEND_S
        self._bent_s = 0.0
        self._heard_s = -math.inf
        self._gone = False

    @property
    def following(self) -> bool:
        """Whether the positions make a track."""
        return self._curve is not None

    def take(self, place: AzEl, utc_s: float) -> None:
        """Take a position."""
        v, points = _unit(place), self._points
        former = None if self._curve is None else self._in_force(utc_s)
        if points and utc_s - points[-1].utc_s < LEAST_GAP_S:
            points.pop()
        if points and not self._continues(v, utc_s):
            points.clear()
        points.append(_Point(utc_s, v))
        self._last, self._heard_s, self._gone = place, utc_s, False
        self._curve = self._fit() if len(points) >= FEWEST_POINTS else None
        self._bend, self._bent_s = None, utc_s
        if former is not None and self._curve is not None:
            there, rate = self._curve.at(utc_s)
            self._bend = off, _ = former[0] - there, former[1] - rate
            blend_s = math.sqrt(6.0 * math.degrees(float(np.linalg.norm(off))) / BLEND_DEG_S2)
            self._blend_s = max(LEAST_BLEND_S, min(MOST_BLEND_S, blend_s))

    def heard(self, utc_s: float) -> None:
        """Note a request of the client; after too long a silence that changes nothing."""
        if utc_s <= self._ends_s():
            self._heard_s = utc_s

    def hang_up(self) -> None:
        """Note that the client has disconnected."""
        self._gone = True

    def at(self, utc_ns: int) -> AxisState:
        """See trajectory.Path: azimuth, elevation and their rates."""
        utc_s = utc_ns / NS
        here, later = self._at(utc_s), self._at(utc_s + RATE_STEP_S)
        return AxisState(
            here.az_deg,
            here.el_deg,
            math.remainder(later.az_deg - here.az_deg, 360.0) / RATE_STEP_S,
            (later.el_deg - here.el_deg) / RATE_STEP_S,
        )

    def _at(self, utc_s: float) -> AzEl:
        if self._curve is None:
            return self._last
        ends_s = self._ends_s()
        holds = not self._gone and ends_s >= self._points[-1].utc_s + self._holds_s()
        if holds and utc_s >= ends_s + EASE_S + RETURN_S:
            return self._last
        return _place(self._in_force(utc_s)[0])

    def _ends_s(self) -> float:
        """Return when a track begins to come to rest, if nothing more comes."""
        if not self._points:
            return -math.inf
        return min(self._heard_s + COAST_S, self._points[-1].utc_s + self._holds_s())

    def _holds_s(self) -> float:
        if len(self._points) < FEWEST_POINTS:
            return LEAST_HOLD_S
        gap_s = self._points[-1].utc_s - self._points[-2].utc_s
        return max(LEAST_HOLD_S, min(MOST_HOLD_S, HOLD_GAPS * gap_s))

    def _in_force(self, utc_s: float) -> tuple[Vector, Vector]:
        """Return place and rate of a track, which slows down where it ends, and stands."""
        past_s = max(0.0, min(utc_s - self._ends_s(), EASE_S))
        place, rate = self._on_curve(min(utc_s, self._ends_s()) + past_s - past_s * past_s / (2.0 * EASE_S))
        return place, rate * (1.0 - past_s / EASE_S)

    def _on_curve(self, utc_s: float) -> tuple[Vector, Vector]:
        """Return place and rate of the path, with the rest of the last bend."""
        assert self._curve is not None
        place, rate = self._curve.at(utc_s)
        lasts_s = self._blend_s
        s = (utc_s - self._bent_s) / lasts_s
        if self._bend is None or not 0.0 <= s < 1.0:
            return place, rate
        off, off_rate = self._bend
        left, left_rate = 1.0 - s * s * (3.0 - 2.0 * s), 6.0 * s * (s - 1.0) / lasts_s
        gone, gone_rate = s * (1.0 - s) ** 2 * lasts_s, (1.0 - s) * (1.0 - 3.0 * s)
        return place + left * off + gone * off_rate, rate + left_rate * off + gone_rate * off_rate

    def _continues(self, v: Vector, utc_s: float) -> bool:
        """Return whether a position continues those before it."""
        last = self._points[-1]
        gap_s, step_deg = utc_s - last.utc_s, _apart_deg(last.v, v)
        if not 0.0 < gap_s <= MOST_GAP_S or step_deg > MOST_RATE_DEG_S * gap_s:
            return False
        if self._curve is not None:
            led, rate = self._curve.at(utc_s)
        elif len(self._points) > 1:
            before = self._points[-2]
            rate = (last.v - before.v) / (last.utc_s - before.utc_s)
            led = last.v + rate * gap_s
        else:
            return True
        off = v - led / np.linalg.norm(led)
        pace = float(np.linalg.norm(rate))
        along = float(off @ rate) / pace if pace > 0.0 else 0.0
        across = math.sqrt(max(0.0, float(off @ off) - along * along))
        stray = math.radians(STRAY_DEG + STRAY_SHARE * step_deg)
        return across <= stray and abs(along) <= stray + STRAY_S * pace

    def _fit(self) -> _Curve:
        last_s = self._points[-1].utc_s
        t = np.array([point.utc_s - last_s for point in self._points])
        places = np.stack([point.v for point in self._points])
        degree = 1 if len(t) <= FEWEST_POINTS else 2
        while True:
            powers = np.stack([t**power for power in range(degree + 1)], axis=1)
            solved = np.linalg.lstsq(powers, places, rcond=None)[0]
            scatter = math.sqrt(float(np.sum((powers @ solved - places) ** 2)) / max(1, len(t) - degree - 1))
            if degree == 1 or scatter <= math.radians(NOISY_DEG) or -t[0] > NOISY_S:
                break
            degree = 1
        terms = np.zeros((3, 3))
        terms[: degree + 1] = solved
        return _Curve(last_s, 2.0 * float(-t[0]) / (len(t) - 1), terms)


@dataclass(frozen=True, slots=True)
class Reach:
    """The positions that clients may send, degrees; an elevation past 90 is beyond the zenith."""

    min_az_deg: float = -180.0
    max_az_deg: float = 450.0
    min_el_deg: float = 0.0
    max_el_deg: float = 180.0

    def holds(self, az_deg: float, el_deg: float) -> bool:
        """Return whether a position is within; NaN is not."""
        return self.min_az_deg <= az_deg <= self.max_az_deg and self.min_el_deg <= el_deg <= self.max_el_deg


FULL_REACH = Reach()
Direction = Literal["up", "down", "left", "right"]


@dataclass(frozen=True, slots=True)
class Moving:
    """The path of a move: at a rate from a place, for a limited time and within the reach."""

    start: AzEl
    az_rate_deg_s: float
    el_rate_deg_s: float
    since_ns: int

    def at(self, utc_ns: int) -> AxisState:
        """See trajectory.Path."""
        seconds = max(0.0, min(MOVE_MOST_S, (utc_ns - self.since_ns) / NS))
        lowest, highest = min(0.0, self.start.el_deg), max(90.0, self.start.el_deg)
        el_deg = max(lowest, min(highest, self.start.el_deg + self.el_rate_deg_s * seconds))
        moves = 0.0 < seconds < MOVE_MOST_S
        return AxisState(
            self.start.az_deg + self.az_rate_deg_s * seconds,
            el_deg,
            self.az_rate_deg_s if moves else 0.0,
            self.el_rate_deg_s if moves and lowest < el_deg < highest else 0.0,
        )


@dataclass(slots=True)
class Rotator:
    """One mount for all clients, which are numbers; see `PathTarget`."""

    sky: SiteSky
    feedback: Feedback
    park: AxesPosition | None = None
    one_at_a_time: bool = False
    reach: Reach = FULL_REACH
    speed_level: int = 0
    path: Path | None = None
    reset_asked: bool = False
    stop_asked: bool = False
    """Whether a client has asked for a stop since this was set to False; without a path, others may move."""
    why_busy: Callable[[], str | None] = lambda: None
    """Tells why no client of this protocol may command the mount now, as text; None where they may."""
    commander: int | None = None
    log_lines: deque[str] = field(default_factory=lambda: deque(maxlen=REMEMBERED_LINES))
    """Whoever logs them removes them."""
    _heard_s: float = -math.inf
    _pointed_s: dict[int, float] = field(default_factory=dict)
    """When the last position of each client came, obeyed or refused, out of reach or not."""
    _stopped: set[int] = field(default_factory=set)
    """The clients that were sending positions when somebody else stopped the mount: a program that goes on
    sending them does not undo that."""
    _sent_az_deg: float | None = None
    _plunged: bool = False
    _shown: tuple[int, AzEl | None] | None = None

    def commanded(self, utc_ns: int) -> AxisState | None:
        """Return the commanded azimuth and elevation, None for rest."""
        return None if self.path is None else self.path.at(utc_ns)

    def point(self, client: int, az_deg: float, el_deg: float, now_s: float) -> Code:
        """Go to a position, or on along the track that it continues."""
        before_s, self._pointed_s[client] = self._pointed_s.get(client, -math.inf), now_s
        if now_s - before_s > COMMANDS_FOR_S:
            self._stopped.discard(client)
        if not self.reach.holds(az_deg, el_deg):
            return Code.INVALID
        objection = self._objection(client, now_s) or self._outlasts_stop(client)
        if objection is not None:
            return objection
        anew = not isinstance(self.path, SmoothedTrack) or self.commander != client
        self._take_over(client, now_s)
        if anew:
            self.path = SmoothedTrack()
        assert isinstance(self.path, SmoothedTrack)
        self.path.take(AzEl(az_deg, el_deg), now_s)
        self._sent_az_deg, self._plunged = az_deg, el_deg > 90.0
        return Code.OK

    def move(self, client: int, direction: Direction, speed: int, now_s: float) -> Code:
        """Move one way for a while; a speed below 0 is that of the level."""
        objection = self._objection(client, now_s)
        if objection is not None:
            return objection
        now_ns = round(now_s * NS)
        here = self.feedback.actual(now_ns)
        if here is None:
            return Code.IO
        self._take_over(client, now_s)
        if speed < 0:
            speed = MOST_SPEED * max(1, min(SPEED_LEVELS, self.speed_level)) // SPEED_LEVELS
        rate = MOVE_RATE_DEG_S * min(speed, MOST_SPEED) / MOST_SPEED
        rates = {"up": (0.0, rate), "down": (0.0, -rate), "left": (-rate, 0.0), "right": (rate, 0.0)}
        self.path = Moving(AzEl(here.first_deg, here.second_deg), *rates[direction], now_ns)
        self._plunged = False
        return Code.OK

    def go_to_park(self, client: int, now_s: float) -> Code:
        """Go to the profile's park position, and stand there with the power on."""
        if self.park is None:
            return Code.NOT_AVAILABLE
        objection = self._objection(client, now_s)
        if objection is not None:
            return objection
        self._take_over(client, now_s)
        there = self.sky.horizontal(HaDec(self.park.hour_angle_deg, self.park.dec_deg), now_s)
        self.path = Straight.standing(there.az_deg, there.el_deg, round(now_s * NS))
        self._plunged = False
        return Code.OK

    def stop(self, client: int | None = None) -> Code:
        """Bring the mount to rest; any client may. None: somebody else, not by this protocol."""
        self.stops_others(client)
        self.path, self.commander, self.stop_asked = None, None, True
        return Code.OK

    def stops_others(self, client: int | None = None) -> None:
        """Have a stop hold for every client that sends positions but this one; None: for every one."""
        self._stopped = self._pointed_s.keys() - {client}

    def reset(self, client: int | None = None) -> Code:
        """Bring the mount to rest, and make it ready again after safety has stopped it."""
        self.reset_asked = True
        return self.stop(client)

    def _outlasts_stop(self, client: int) -> Code | None:
        """Return why a position is refused that only goes on where another's stop has ended a track, or None.

        A client that stops the mount itself, connects anew or has been silent for a while has a person at it;
        and after another's new command there is nothing left of the stop.
        """
        if client not in self._stopped:
            return None
        self.log_lines.append(f"client {client} was refused: the mount was stopped while it sent positions")
        return Code.REJECTED

    def narrow(self, name: str, value_deg: float) -> Code:
        """Set one bound of the positions that are accepted, within the full reach."""
        full = getattr(FULL_REACH, name)
        if math.isnan(value_deg):
            return Code.INVALID
        within = max(full, value_deg) if name.startswith("min") else min(full, value_deg)
        self.reach = replace(self.reach, **{name: within})
        return Code.OK

    def heard(self, client: int, now_s: float) -> None:
        """Note a request of a client."""
        if client == self.commander:
            self._heard_s = now_s
            if isinstance(self.path, SmoothedTrack):
                self.path.heard(now_s)

    def hang_up(self, client: int) -> None:
        """Note that a client has disconnected: a slew goes on to its end, a track soon comes to rest."""
        self._pointed_s.pop(client, None)
        self._stopped.discard(client)
        if client == self.commander:
            self.commander = None
            if isinstance(self.path, SmoothedTrack):
                self.path.hang_up()

    def _objection(self, client: int, now_s: float) -> Code | None:
        """Return why a client may not command the mount now, or None."""
        if not self.feedback.link_up:
            return Code.IO
        if self.feedback.tripped is not None:
            return Code.REJECTED
        if (why := self.why_busy()) is not None:
            self.log_lines.append(f"client {client} was refused: {why}")
            return Code.REJECTED
        in_charge = self.commander not in {None, client} and now_s - self._heard_s <= COMMANDS_FOR_S
        if self.one_at_a_time and in_charge:
            self.log_lines.append(f"client {client} was refused: client {self.commander} commands")
            return Code.REJECTED
        return None

    def _take_over(self, client: int, now_s: float) -> None:
        if client != self.commander:
            self.log_lines.append(f"client {client} commands")
        self.commander, self._heard_s = client, now_s
        self._stopped.clear()

    def where(self, utc_ns: int) -> AzEl | None:
        """Return where the mount points, in the client's count of turns; None where it is not known.

        The azimuth is on the turn nearest to the last one sent, within the reach; the elevation is beyond the
        zenith where that was.
        """
        if self._shown is None or self._shown[0] != utc_ns:
            self._shown = utc_ns, self._counted(utc_ns)
        return self._shown[1]

    def _counted(self, utc_ns: int) -> AzEl | None:
        here = self.feedback.actual(utc_ns)
        if here is None:
            return None
        az_deg, el_deg = here.first_deg, here.second_deg
        if self._plunged:
            az_deg, el_deg = (az_deg + 180.0) % 360.0, 180.0 - el_deg
        if self._sent_az_deg is None:
            return AzEl(az_deg, el_deg)
        near_deg = self._sent_az_deg
        turns = [az_deg + turn for turn in (-360.0, 0.0, 360.0)]
        within = [az for az in turns if FULL_REACH.min_az_deg <= az <= FULL_REACH.max_az_deg]
        return AzEl(min(within, key=lambda az: abs(az - near_deg)), el_deg)

    def flags(self, utc_ns: int) -> tuple[str, ...] | None:
        """Return Hamlib's flags of the mount's motion; None where it is not known."""
        here = self.feedback.actual(utc_ns)
        if here is None:
            return None
        flags: list[str] = []
        for axis, rate, words in (
            ("MOVING_AZ", here.first_rate_deg_s, ("MOVING_LEFT", "MOVING_RIGHT")),
            ("MOVING_EL", here.second_rate_deg_s, ("MOVING_DOWN", "MOVING_UP")),
        ):
            if abs(rate) > MOVING_DEG_S:
                flags += [axis, words[rate > 0.0]]
        return ("MOVING", *flags) if flags else ()


class RotatorStation(PathDriver):
    """One mount behind one rotator, until `end` is called and the mount is seen at rest."""

    def __init__(
        self, sky: SiteSky, profile: MountProfile, limits: SafetyLimits, one_at_a_time: bool = False
    ) -> None:
        def why_busy() -> str | None:
            return None if self.stop is None else "the server is ending"

        self.rotator = Rotator(sky, self, park_direction(profile), one_at_a_time, why_busy=why_busy)
        super().__init__(self.rotator, sky, "azel", profile, limits)
