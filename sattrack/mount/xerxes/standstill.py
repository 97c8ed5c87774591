"""Whether a mount is at rest, by the positions that it reports. No I/O.

An axis is at rest where its positions say that it stands, or that it follows the sky: the hour angle
(sidereal time less right ascension, both as the mount reports them) turns within REST_RATE_DEG_S of
standstill or of the sidereal rate, the declination within REST_RATE_DEG_S of standstill. Both are judged as
axes and not on the sky: near a pole a fast axis moves the sky little; its right ascension is noisy there, and
rest is seen later.

A parabola is fitted to the positions of the last WINDOWS_S[0]. Its rate at the last position, and AHEAD_S
later, must keep within the bound with SURE standard errors, so that an axis that passes through zero is not
at rest. Where noise hides the answer, the window grows. A status with the clock and the place of the one
before is no position. The fields RightAscensionRate, DeclinationRate and Slewing can only make rest later,
and only until positions contradict them. A coordinate that repeats to the last bit may be that of an encoder
that hangs: it contradicts no field that was right before. Unless the axis' rate field was seen to be right in
motion, it shows rest only after HANGS_S, where the axis was moving just before. A clock that stands still
while positions change is replaced by arrivals.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import dataclass, field
from operator import mul
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from sattrack.mount.model import SIDEREAL_RATE_DEG_S, STATUS_LOST_S, StatusSample

if TYPE_CHECKING:
    from collections.abc import Sequence

REST_RATE_DEG_S = SIDEREAL_RATE_DEG_S * 0.5
"""An axis slower than this (0.0021 deg/s) against standstill, or against the sky, is at rest."""
WINDOWS_S = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Over how long positions are judged; the next one where noise leaves it open."""
LEAST_POSITIONS = 8
AHEAD_S = 0.25
SURELY_MOVES_DEG_S = 0.05
"""No axis that has moved so fast, on the mean of the shortest window, rests at its end."""
SURE = 4.0
JUDGED_DEG_S = 0.75 * REST_RATE_DEG_S
"""What is asked of the fitted rates, so that the true ones are within the bound."""
LEAST_NOISE_DEG = 1e-7
NOISE_GROWS = 1.5
"""A short window with so much more noise than a longer one has seen a motion begin, not noise."""
LEAST_SQUARES = 1e-6
"""Times that carry a parabola; those of a clock with too coarse steps do not."""
LEAST_SPAN_SHARE = 0.6
"""Positions that arrive in a burst span less time here than at the mount: they tell of the past."""
CLOCK_JUMP_S = 1.0
OLD_AFTER_S = 1.5
"""Positions older than this say nothing of the mount any more."""
CONTRADICTED_S = 3.0
"""A field that positions contradict for so long means something else."""
NO_NUMBER_S = 0.25
MOVES_DEG_S = 0.1
"""What an axis does at least where it contradicts a field that says rest, or another rate."""
RATE_SHARE = 0.3
CONFIRMED_STATUSES = 10
"""A field that agrees with positions in so many statuses means what it should."""
DENIED_STATUSES = 15
HANGS_S = 2.0
HANGS_FROM_DEG_S = 0.005
"""An axis that was slower before its encoder began to hang, and brakes, rests within a window."""
DENIED_LATELY_S = 10.0
JUMPS_DEG_S = 20.0
"""No axis is so fast: its coordinates have changed."""
HANGS_DEG = 1e-9
"""Hour angles that differ by less are the same, but for rounding."""
STILL_CLOCK_S, STILL_CLOCK_CHANGES = 2.5, 10
"""A clock that has not moved for so long, in so many statuses with new places, stands still."""
LEAST_STATUS_S = 0.03
"""Statuses that arrive in a burst are taken to be at least so far apart."""
STEADY_SHARE = 0.98
SETTLING_SHARE = 0.999
"""A servo that closes in on its rate from above loses less than the rest of this from status to status, and
what brakes loses more: 0.12 °/s² at 6 °/s."""
NOT_SLOWING_STATUSES = 3
"""So many statuses of a mount that moves on bring the stop anew; twice as many the next time, as a mount may
count its time to obey from the last one."""
MOST_PATIENCE = 320
TURNED_STATUSES = 2
MOST_TURNED_STOPS = 3
"""A mount that has taken to the sky after so many aborts does so by itself."""
RA_RATE, DEC_RATE, SLEWING = "RightAscensionRate", "DeclinationRate", "Slewing"


class Position(NamedTuple):
    """Where the axes were; both counted on through whole turns."""

    arrival_utc_s: float
    mount_s: float
    """Seconds of the mount's own clock."""
    hour_angle_deg: float
    dec_deg: float


class ParabolaFit(NamedTuple):
    """What a parabola through some positions of one axis says."""

    rate_deg_s: float
    """At the last position."""
    ahead_deg_s: float
    """AHEAD_S later."""
    error_deg_s: float
    """Standard error of the rate ahead, the larger one."""
    noise_deg: float


@dataclass(slots=True)
class Positions:
    """The last positions of one mount."""

    _kept: deque[Position] = field(default_factory=deque)
    _last: tuple[float, float, float, bool] | None = None
    _heard_utc_s: float = -math.inf
    """When the last status came, a position or not."""
    _judged: dict[float, ParabolaFit | None] = field(default_factory=dict)
    _recent: list[Position] | None = None
    """Those of the shortest window."""
    may_have_moved: bool = False
    """Whether the axes may have been moving before the first status."""
    _changed_utc_s: tuple[float, float] = (-math.inf, -math.inf)
    """When each axis was last elsewhere than in the status before."""
    _speeds_deg_s: tuple[float, float] = (0.0, 0.0)
    """How fast each axis was then, in the last two statuses, against standstill or the sky."""
    _ways_deg_s: tuple[float, float] = (0.0, 0.0)
    """How fast in the last of them."""
    _ticked_utc_s: float = -math.inf
    """When the mount's clock last moved."""
    _changes: int = 0
    """Statuses with new places since then."""

    def take(
        self, arrival_utc_s: float, sidereal_h: float, ra_deg: float, dec_deg: float, beyond_pole: bool
    ) -> None:
        """Take what a status tells of where the axes are."""
        self._judged.clear()
        place = (sidereal_h, ra_deg, dec_deg, beyond_pole)
        before, self._last = self._last, place
        self._see_changes(arrival_utc_s, place, before)
        still = self._clock_stands(arrival_utc_s)
        if before is not None and before[:3] == place[:3] and not still:
            return
        hour_angle_deg = sidereal_h * 15.0 - ra_deg
        if still:
            hour_angle_deg += (arrival_utc_s - self._ticked_utc_s) * SIDEREAL_RATE_DEG_S
        mount_s = 0.0
        if self._kept and before is not None:
            last = self._kept[-1]
            hours = math.remainder(sidereal_h - before[0], 24.0)
            passed_s = arrival_utc_s - last.arrival_utc_s if still else hours * 15.0 / SIDEREAL_RATE_DEG_S
            mount_s = last.mount_s + passed_s
            hour_angle_deg = last.hour_angle_deg + math.remainder(hour_angle_deg - last.hour_angle_deg, 360.0)
            gap_s = mount_s - last.mount_s - (arrival_utc_s - last.arrival_utc_s)
            if abs(gap_s) > CLOCK_JUMP_S or before[3] != place[3]:
                self._kept.clear()
        self._kept.append(Position(arrival_utc_s, mount_s, hour_angle_deg, dec_deg))
        self._forget_old(arrival_utc_s)
        self._recent = self._window(WINDOWS_S[0], -math.inf)

    def _forget_old(self, arrival_utc_s: float) -> None:
        """Keep the positions of the longest window; of a telescope that is slow, and not silent, enough."""
        kept, oldest_utc_s = self._kept, arrival_utc_s - WINDOWS_S[-1] - WINDOWS_S[0]
        silent = len(kept) > 1 and arrival_utc_s - kept[-2].arrival_utc_s > STATUS_LOST_S
        while kept[0].arrival_utc_s < oldest_utc_s and (
            silent or (len(kept) > LEAST_POSITIONS and kept[1].arrival_utc_s < oldest_utc_s)
        ):
            kept.popleft()

    def _see_changes(
        self,
        arrival_utc_s: float,
        place: tuple[float, float, float, bool],
        before: tuple[float, float, float, bool] | None,
    ) -> None:
        """Note which axes are elsewhere than before, and whether the clock moves."""
        heard_utc_s, self._heard_utc_s = self._heard_utc_s, arrival_utc_s
        if before is None:
            self._ticked_utc_s = arrival_utc_s
            if self.may_have_moved:
                self._changed_utc_s, self._speeds_deg_s = (arrival_utc_s, arrival_utc_s), (math.inf, math.inf)
            return
        seconds = max(arrival_utc_s - heard_utc_s, LEAST_STATUS_S)
        turned_deg = math.remainder((place[0] - before[0]) * 15.0 - place[1] + before[1], 360.0)
        dec_deg = place[2] - before[2]
        # A mount may report the encoder that hangs as a right ascension, or as an hour angle.
        same = before[1] == place[1] or abs(turned_deg) < HANGS_DEG, dec_deg == 0.0
        sky_deg = min(abs(turned_deg), abs(turned_deg - SIDEREAL_RATE_DEG_S * seconds))
        ways = sky_deg / seconds, abs(dec_deg) / seconds
        axes = zip(same, ways, self._ways_deg_s, self._speeds_deg_s, self._changed_utc_s, strict=True)
        ra, dec = (
            (utc_s, speed) if repeats else (arrival_utc_s, speed if way > JUMPS_DEG_S else max(way, last))
            for repeats, way, last, speed, utc_s in axes
        )
        self._changed_utc_s, self._speeds_deg_s = (ra[0], dec[0]), (ra[1], dec[1])
        self._ways_deg_s = min(ways[0], ra[1]), min(ways[1], dec[1])
        if before[0] != place[0]:
            self._ticked_utc_s, self._changes = arrival_utc_s, 0
        else:
            self._changes += before[1:3] != place[1:3]

    @property
    def may_hang(self) -> tuple[bool, bool]:
        """Whether each axis has been at one place to the last bit, though not for long, and moved before."""
        ra, dec = (
            0.5 * WINDOWS_S[0] < s < HANGS_S and speed > HANGS_FROM_DEG_S
            for s, speed in zip(self.repeats_s, self._speeds_deg_s, strict=True)
        )
        return ra, dec

    def _clock_stands(self, now_utc_s: float) -> bool:
        return self._changes >= STILL_CLOCK_CHANGES and now_utc_s - self._ticked_utc_s > STILL_CLOCK_S

    @property
    def repeats_s(self) -> tuple[float, float]:
        """For how long each axis has been at the same place to the last bit, seconds."""
        ra_utc_s, dec_utc_s = self._changed_utc_s
        return self._heard_utc_s - ra_utc_s, self._heard_utc_s - dec_utc_s

    def rates_deg_s(self) -> tuple[float, float] | None:
        """Return the mean rates of hour angle and declination over the shortest window; None without one."""
        kept = self._recent
        if kept is None:
            return None
        return _mean_rates_deg_s(kept[0], kept[-1])

    def last_rates_deg_s(self) -> tuple[float, float]:
        """Return the rates at the end of the shortest window, were the acceleration even; 0 without one."""
        kept = self._recent
        if kept is None:
            return 0.0, 0.0
        middle = kept[len(kept) // 2]
        early, late = _mean_rates_deg_s(kept[0], middle), _mean_rates_deg_s(middle, kept[-1])
        return 1.5 * late[0] - 0.5 * early[0], 1.5 * late[1] - 0.5 * early[1]

    def rest(self, since_utc_s: float = -math.inf) -> ParabolaFit | None:
        """Return how the hour angle turns at rest, None where the axes are not known to rest.

        Only positions that came after `since_utc_s` count.
        """
        if since_utc_s not in self._judged:
            self._judged[since_utc_s] = self._judge(since_utc_s)
        return self._judged[since_utc_s]

    def _judge(self, since_utc_s: float) -> ParabolaFit | None:
        if not self._kept or self._heard_utc_s - self._kept[-1].arrival_utc_s > OLD_AFTER_S:
            return None
        mean = self.rates_deg_s()
        if mean is not None and max(abs(rate) for rate in mean) > SURELY_MOVES_DEG_S:
            return None
        shortest: tuple[ParabolaFit, ParabolaFit] | None = None
        for span_s in WINDOWS_S:
            known = span_s == WINDOWS_S[0] and since_utc_s == -math.inf
            window = self._recent if known else self._window(span_s, since_utc_s)
            parabola = None if window is None else Parabola.over([one.mount_s for one in window])
            if window is None or parabola is None:
                continue
            fits = (
                parabola.fit([one.hour_angle_deg for one in window]),
                parabola.fit([one.dec_deg for one in window]),
            )
            shortest = shortest or fits
            if any(s.noise_deg > NOISE_GROWS * f.noise_deg for s, f in zip(shortest, fits, strict=True)):
                return None
            offs = (_off(fits[0], 0.5 * SIDEREAL_RATE_DEG_S), _off(fits[1], 0.0))
            bounds = (0.5 * SIDEREAL_RATE_DEG_S + JUDGED_DEG_S, JUDGED_DEG_S)
            margins = [SURE * fit.error_deg_s for fit in fits]
            if any(o - m > b for o, m, b in zip(offs, margins, bounds, strict=True)):
                return None
            if all(o + m < b for o, m, b in zip(offs, margins, bounds, strict=True)):
                return fits[0]
        return None

    def _window(self, span_s: float, since_utc_s: float) -> list[Position] | None:
        """Return the positions of the last `span_s`, None where they do not fill it.

        The longest span is as much longer as LEAST_POSITIONS of a slow telescope take.
        """
        if not self._kept:
            return None
        last = self._kept[-1]
        found: list[Position] = []
        for one in reversed(self._kept):
            if one.arrival_utc_s <= since_utc_s:
                return None
            found.append(one)
            enough = span_s < WINDOWS_S[-1] or len(found) >= LEAST_POSITIONS
            if enough and last.mount_s - one.mount_s >= span_s:
                break
        else:
            return None
        if len(found) < LEAST_POSITIONS:
            return None
        if last.arrival_utc_s - found[-1].arrival_utc_s < LEAST_SPAN_SHARE * span_s:
            return None
        found.reverse()
        return found


def _mean_rates_deg_s(first: Position, last: Position) -> tuple[float, float]:
    seconds = last.mount_s - first.mount_s
    if seconds <= 0.0:
        return 0.0, 0.0
    return (
        (last.hour_angle_deg - first.hour_angle_deg) / seconds,
        (last.dec_deg - first.dec_deg) / seconds,
    )


class Parabola(NamedTuple):
    """Orthogonal polynomials of first and second degree over some instants."""

    first: list[float]
    second: list[float]
    first_squares: float
    second_squares: float
    skew: float

    @classmethod
    def over(cls, times_s: Sequence[float]) -> Parabola | None:
        """Return those over instants; None where a coarse clock leaves too few of them."""
        count = len(times_s)
        mean_s = sum(times_s) / count
        first = [one - mean_s for one in times_s]
        squares = [one * one for one in first]
        total = sum(squares)
        skew = sum(map(mul, squares, first)) / total
        second = [square - skew * one - total / count for square, one in zip(squares, first, strict=True)]
        second_squares = sum(map(mul, second, second))
        if second_squares < LEAST_SQUARES:
            return None
        return cls(first, second, total, second_squares, skew)

    def fit(self, angles_deg: Sequence[float]) -> ParabolaFit:
        """Fit an axis' angles at those instants by least squares."""
        count = len(angles_deg)
        mean_deg = sum(angles_deg) / count
        x = [one - mean_deg for one in angles_deg]
        b1 = sum(map(mul, x, self.first)) / self.first_squares
        b2 = sum(map(mul, x, self.second)) / self.second_squares
        rows = zip(x, self.first, self.second, strict=True)
        left = sum([(a - b1 * b - b2 * c) ** 2 for a, b, c in rows])
        noise = max(LEAST_NOISE_DEG, math.sqrt(left / (count - 3)))
        end = 2.0 * self.first[-1] - self.skew
        ahead = end + 2.0 * AHEAD_S
        error = noise * math.sqrt(1.0 / self.first_squares + ahead * ahead / self.second_squares)
        return ParabolaFit(b1 + b2 * end, b1 + b2 * ahead, error, noise)


def _off(fit: ParabolaFit, middle_deg_s: float) -> float:
    return max(abs(fit.rate_deg_s - middle_deg_s), abs(fit.ahead_deg_s - middle_deg_s))


@dataclass(slots=True)
class Fields:
    """Which of the three fields that speak of motion mean what they should."""

    ignored: dict[str, str] = field(default_factory=dict)
    """Fields that are not used any more, and why."""
    _since_utc_s: dict[tuple[str, str], float] = field(default_factory=dict)
    """Since when positions have contradicted a field, by field and kind."""
    _agreed: Counter[tuple[str, bool]] = field(default_factory=Counter)
    """Statuses in which a field agreed with positions, by field and whether they moved."""
    _denied: Counter[str] = field(default_factory=Counter)
    """Statuses in which a rate was not that of moving positions."""
    _denied_utc_s: dict[str, float] = field(default_factory=dict)
    """When it was so last."""

    def see(
        self,
        sample: StatusSample,
        rests: bool,
        positions: Positions,
        move_axis: bool,
        aborted: bool,
        arrived: bool,
    ) -> None:
        """Compare a status' fields with positions; `move_axis` where Slewing may be true at rest.

        `aborted` after an abort was acknowledged: a rate that then goes on beside positions that repeat is
        that of no axis, or of one whose encoder hangs and that does not obey. `arrived` where it is at the
        goal of a slew: an axis whose encoder hung there was braking.
        """
        rates_deg_s, last_deg_s = positions.rates_deg_s(), positions.last_rates_deg_s()
        live = [repeats_s < WINDOWS_S[0] for repeats_s in positions.repeats_s]
        now_utc_s = sample.arrival_utc_s
        reported_deg_s = (sample.ra_drive_deg_s, sample.dec_drive_deg_s)
        for axis, (name, reported) in enumerate(zip((RA_RATE, DEC_RATE), reported_deg_s, strict=True)):
            if name in self.ignored:
                continue
            rate = 0.0 if rates_deg_s is None else abs(rates_deg_s[axis])
            slack = MOVES_DEG_S + RATE_SHARE * rate
            off = (
                rate > MOVES_DEG_S
                and min(abs(abs(reported) - one) for one in (rate, abs(last_deg_s[axis]))) > slack
            )
            self._agreed[name, True] += rate > MOVES_DEG_S and not off and math.isfinite(reported)
            self._denied[name] += off
            if off:
                self._denied_utc_s[name] = now_utc_s
            stands = rests and not _rate_rests(reported, axis == 0)
            unlike = self.doubtful(name) or (aborted and not self.confirmed(name))
            stands = stands and (live[axis] or unlike)
            self._hold(name, "is no number", not math.isfinite(reported), now_utc_s, NO_NUMBER_S)
            self._hold(name, "says motion while positions stand", stands, now_utc_s)
            self._hold(name, "is not the rate at which positions move", off, now_utc_s)
        if SLEWING in self.ignored:
            return
        fast = rates_deg_s is not None and max(abs(rate) for rate in rates_deg_s) > MOVES_DEG_S
        self._agreed[SLEWING, True] += fast and sample.slewing
        self._agreed[SLEWING, False] += rests and not sample.slewing
        stands = rests and sample.slewing and not move_axis
        rates_tell = self._rates_say_rest(sample) and not (self.doubtful(RA_RATE) or self.doubtful(DEC_RATE))
        stands = stands and (all(live) or arrived or not self.confirmed(SLEWING) or rates_tell)
        self._hold(SLEWING, "stays true while positions stand", stands, now_utc_s)
        self._hold(SLEWING, "stays false while positions move", fast and not sample.slewing, now_utc_s)

    def confirmed(self, name: str) -> bool:
        """Tell whether positions have shown that a field means what it should, and it is used."""
        kinds = (True, False) if name == SLEWING else (True,)
        enough = all(self._agreed[name, moved] >= CONFIRMED_STATUSES for moved in kinds)
        return enough and name not in self.ignored

    def trusted(self, name: str, now_utc_s: float) -> bool:
        """Tell whether a rate field was right in motion, and not wrong lately: it may lie in a stop alone."""
        lately = now_utc_s - self._denied_utc_s.get(name, -math.inf) < DENIED_LATELY_S
        return self.confirmed(name) and not lately

    def doubtful(self, name: str) -> bool:
        """Tell whether a rate field was wrong in motion more often than right; a sync jumps for less."""
        wrong = self._denied[name] > max(DENIED_STATUSES, self._agreed[name, True])
        return wrong or name in self.ignored

    def say_rest(self, sample: StatusSample) -> bool:
        """Tell whether those that are used say that the mount rests."""
        return self._rates_say_rest(sample) and (SLEWING in self.ignored or not sample.slewing)

    def _rates_say_rest(self, sample: StatusSample) -> bool:
        return (RA_RATE in self.ignored or _rate_rests(sample.ra_drive_deg_s, True)) and (
            DEC_RATE in self.ignored or _rate_rests(sample.dec_drive_deg_s, False)
        )

    def _hold(
        self, name: str, why: str, contradicts: bool, now_utc_s: float, longest_s: float = CONTRADICTED_S
    ) -> None:
        """Ignore a field once it has been contradicted for longer than that."""
        if not contradicts:
            if self._since_utc_s:
                self._since_utc_s.pop((name, why), None)
        elif now_utc_s - self._since_utc_s.setdefault((name, why), now_utc_s) > longest_s:
            self.ignored.setdefault(name, why)


def _rate_rests(rate_deg_s: float, sky: bool) -> bool:
    """Tell whether a drive rate is that of an axis at rest; `sky` where following it counts."""
    off = min(abs(rate_deg_s), abs(rate_deg_s - SIDEREAL_RATE_DEG_S)) if sky else abs(rate_deg_s)
    return off < REST_RATE_DEG_S


@dataclass(slots=True)
class Standstill:
    """Follows one mount from status to status; `asked` begins a new stop."""

    positions: Positions = field(default_factory=Positions)
    fields: Fields = field(default_factory=Fields)
    late_statuses: int = 0
    """How many more statuses than from other mounts show motion before an abort acts."""
    slowing: bool = False
    """Whether the last status showed it slower than the one before."""
    _sample: StatusSample | None = None
    """The last status, its fields as the mount sent them."""
    _patience: int = NOT_SLOWING_STATUSES
    _not_slowing: int = 0
    """Statuses in a row that show the mount moving, and no slower than before."""
    _speed_deg_s: float = 0.0
    _mean_deg_s: float = 0.0
    _stood: int = 0
    """Statuses in a row that showed the axes standing since the abort was acknowledged."""
    _turning: int = 0
    """Statuses since then that showed them following the sky."""
    _stops_turned: int = 0
    _since_utc_s: float = -math.inf
    """Positions that came later are those of a mount that has acknowledged the stop."""

    def asked(self) -> None:
        """Begin with a stop that was not asked for before."""
        self._stood = self._turning = self._stops_turned = 0
        self._patience = NOT_SLOWING_STATUSES + self.late_statuses

    def acknowledged(self, arrival_utc_s: float) -> None:
        """Count positions from a status on that acknowledges the stop."""
        self._since_utc_s = arrival_utc_s
        if self.late_statuses:
            # Sent again too soon, it would act later still.
            self._not_slowing = 0

    def clock_set(self, step_s: float) -> None:
        """Count the same positions from then on, by a clock that was set ahead by so much."""
        self._since_utc_s += step_s

    def see(
        self, sample: StatusSample, aborted: bool, move_axis: bool, arrived: bool = False
    ) -> StatusSample:
        """Take a status; return it with fields that mean nothing made good from positions.

        `aborted` tells whether an abort of the stop in force has been acknowledged, `move_axis` whether a
        MoveAxis may be in force, at any rate, `arrived` whether it is where a slew leads.
        """
        self._sample = sample
        self.positions.take(
            sample.arrival_utc_s, sample.sidereal_h, sample.ra_deg, sample.dec_deg, sample.beyond_pole
        )
        rates = self.positions.rates_deg_s()
        rests = self.positions.rest() is not None and not self._may_hang
        self.fields.see(sample, rests, self.positions, move_axis, aborted, arrived)
        believed = self._believed(sample, rests, rates or (0.0, 0.0))
        mean_deg_s = 0.0 if rates is None or rests else max(abs(rate) for rate in rates)
        # The mean of a window falls for a while after the axis has stopped.
        fast = mean_deg_s > MOVES_DEG_S and mean_deg_s > STEADY_SHARE * self._mean_deg_s
        self._mean_deg_s = mean_deg_s
        self._follow(believed, aborted, fast)
        return believed

    @property
    def at_rest(self) -> bool:
        """Whether the mount stands, or follows the sky, by positions, and no field that is used denies it."""
        return self.rests_since(-math.inf)

    @property
    def surely_moves(self) -> bool:
        """Whether the mean of the shortest window is that of no axis that comes to rest at its end."""
        return self._mean_deg_s > SURELY_MOVES_DEG_S

    @property
    def stands(self) -> bool:
        """Whether it stands, by the same: the sky is not followed."""
        rest = self.positions.rest()
        return rest is not None and abs(rest.rate_deg_s) < REST_RATE_DEG_S and self.at_rest

    @property
    def stopped(self) -> bool:
        """Whether the stop has come to rest, by positions that are newer than its acknowledgement."""
        return self.rests_since(self._since_utc_s) and not self.turned

    def rests_since(self, since_utc_s: float) -> bool:
        """Tell whether it rests by positions that came after an instant."""
        sample = self._sample
        if sample is None or not self.fields.say_rest(sample) or self._may_hang:
            return False
        return self.positions.rest(since_utc_s) is not None

    @property
    def _may_hang(self) -> bool:
        """Whether positions that repeat may be those of an encoder that hangs in mid-motion."""
        now_utc_s = -math.inf if self._sample is None else self._sample.arrival_utc_s
        hangs = zip((RA_RATE, DEC_RATE), self.positions.may_hang, strict=True)
        return any(may and not self.fields.trusted(name, now_utc_s) for name, may in hangs)

    @property
    def turned(self) -> bool:
        """Whether axes that stood have taken to the sky, not of their mount's own habit."""
        return self._turning >= TURNED_STATUSES and self._stops_turned < MOST_TURNED_STOPS

    @property
    def goes_again(self) -> bool:
        """Whether something set the mount going again: a late datagram, or another client.

        The mount ignores the counters of commands, so a MoveAxis that comes after the abort acts, and leaves
        the mount on the sky when it ends.
        """
        return self._not_slowing >= self._patience or self.turned

    def again(self, heard_utc_s: float) -> None:
        """Note that the stop goes out once more, the last status having come at `heard_utc_s`."""
        self._since_utc_s = heard_utc_s
        self._stops_turned += self.turned
        self._patience = min(2 * self._patience, MOST_PATIENCE)
        self._not_slowing = self._stood = self._turning = 0

    def _believed(self, sample: StatusSample, rests: bool, rates_deg_s: tuple[float, float]) -> StatusSample:
        ignored = self.fields.ignored
        ra, dec = sample.ra_drive_deg_s, sample.dec_drive_deg_s
        finite = math.isfinite(ra) and math.isfinite(dec)
        if not ignored and finite:
            return sample
        return msgspec.structs.replace(
            sample,
            ra_drive_deg_s=rates_deg_s[0] if RA_RATE in ignored or not math.isfinite(ra) else ra,
            dec_drive_deg_s=rates_deg_s[1] if DEC_RATE in ignored or not math.isfinite(dec) else dec,
            slewing=not rests if SLEWING in ignored else sample.slewing,
        )

    def _follow(self, sample: StatusSample, aborted: bool, fast: bool) -> None:
        speed = abs(sample.ra_drive_deg_s) + abs(sample.dec_drive_deg_s)
        # Rates made of positions are noisy: half of those of a steady motion are below the one before.
        self.slowing = speed < (STEADY_SHARE if self.fields.ignored else SETTLING_SHARE) * self._speed_deg_s
        self._speed_deg_s = speed
        self._not_slowing = self._not_slowing + 1 if (sample.slewing or fast) and not self.slowing else 0
        if not aborted or not self.fields.say_rest(sample):
            self._stood = self._turning = 0
        elif abs(sample.ra_drive_deg_s) < REST_RATE_DEG_S:
            self._stood, self._turning = self._stood + 1, 0
        elif self._stood:
            self._turning += 1
