"""What statuses show of a mount that does not do what it is commanded: obedience, clocks, drive currents.

Rates are those of the reported right ascension and declination.

Axes do not jump, but a bit of a datagram may: the position filter tells which reported places to believe.
Pure.
"""

from __future__ import annotations

import math
from collections import deque
from enum import StrEnum
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from sattrack.mount.model import (
    LONGEST_STEP_S,
    LONGEST_STEPS,
    SIDEREAL_RATE_DEG_S,
    STATUS_LOST_S,
    Hold,
    Motion,
    MoveAxes,
    Seen,
    mean_sidereal_deg,
)

if TYPE_CHECKING:
    from sattrack.mount.model import MountProfile
    from sattrack.safety.geometry import Place

DISOBEDIENT_DEG_S = 0.5
DISOBEDIENT_FOR_S = 1.0
RUNAWAY_DEG_S = 1.0
"""A mount that moves faster than twice its command, and this, for so long, does not obey either."""
WINDOW_S = 3.0
LOOSE_DEG_S = 0.1
LOOSE_SHARE = 0.5
"""How far the mean over the window may be off what was commanded, and by what share of its largest rate."""
LOOK_EVERY = 8
"""Statuses from one look at the window to the next."""
STEP_DEG_S = 40.0
"""Faster than any axis: a sync, a clock that was set, or the pole."""
OVERLOADED_FOR_S = 0.5
STEPS = 5
"""The middle one of so many steps from status to status is the usual one."""
BACKWARD_S = 0.5
CLOCK_PROOF = 3
"""A clock that was well counts as set when so many statuses in a row say so: a bit of one may turn over."""
LEAST_ASKED_DEG_S = 0.02
"""Slower commands, in the mean, say nothing of what an axis makes of them."""
TURNED, STILL, LIKE_SHARE = -0.5, 0.1, 0.05
"""Motion over commanded motion of an axis that turns the other way, or stands; how far off a gain may be."""
STEADY_DEG_S, STEADY_SHARE, VARIED_DEG_S = 0.002, 0.02, 0.05
"""How little a rate that is kept changes, and how far apart the commanded ones must be meanwhile."""
KEPT_FOR_S = 2.5
ANSWERED_S = 0.75
"""Time in which even a soft and late mount has begun to answer a command."""
AT_LIMIT_SHARE = 0.9
FIRST = 8
"""Commands at the beginning of a stream of which a mount that takes edges takes one."""
KEEPS_FIRST = (
    "the axes go on at the rates that the mount took first, not those commanded: move_axis is edge, and "
    "the profile says held, or the drives are off"
)
SEE_TO_DRIVE = "see to drive, brake and clutch"
NAMES, FIELDS = ("the first axis", "the second axis"), ("ra_rate_sign", "dec_rate_sign")
ELSEWHERE = (
    "the axes do not lie as the geometry in the profile says, which is another mount's: give this mount's "
    "profile, or calibrate it"
)
PERHAPS_ELSEWHERE = (
    "the axes do not move as commanded: the geometry in the profile may be another mount's; check that, the "
    "signs and the drives"
)
OTHER_SIDE = (
    "the mount takes the other side of its pier than pier_rule in the profile has it: for a German mount "
    'behind ASCOM or INDI set "ascom"'
)
OTHER_SIDE_KEPT = (
    "the mount takes the other side of its pier than pier_rule in the profile has it: it may stay on its "
    "side for some way past the meridian"
)
RA_AND_DEC = 3
OLDEST_STATUS_S = STATUS_LOST_S
"""Age of the last status from which on the mount is not moved any more."""


class Watch:
    """Follows the statuses of one mount; `see` names the row that they trip."""

    def __init__(
        self, profile: MountProfile, longest_fault_s: float, longitude_deg: float | None, tolerance_s: float
    ) -> None:
        self._profile = profile
        self._fault_s = longest_fault_s
        self._longitude_deg = longitude_deg
        self._tolerance_s = tolerance_s
        self._before: Seen | None = None
        self._ticked: Seen | None = None
        """The first status with the newest time of the mount's clock."""
        self._then: Motion = Hold()
        """What was in force when that came."""
        self._steps: deque[float] = deque(maxlen=STEPS)
        """Seconds between the last statuses, by the mount's clock."""
        self._disobeyed_s = 0.0
        self._overloaded_s = 0.0
        self._window: deque[tuple[float, float, float]] = deque()
        self._window_s = 0.0
        self._turn = 0
        self._was_off = False
        """Whether the means were outside when last looked at."""
        self._commanded: deque[tuple[float, float, float]] = deque()
        """Seconds each, and rates, of what was in force, the newest last."""
        self._commanded_s = 0.0
        self._first: list[tuple[float, float]] = []
        """The first rates of the stream that is in force."""
        self._axes = None if profile.geometry is None else AxesWatch()
        self.cause: str | None = None
        """What makes the mount disobey, as far as its motion tells it."""
        self.moved = MoveAxes(0.0, 0.0)
        """The rates of the reported place between the last two statuses."""
        self._clock_off = 0
        """Statuses in a row whose clock was too far from ours."""
        self._clock_known = False
        self.clock_gap_deg = 0.0
        self.clock_is_off = False
        """Whether the mount's clock is too far from ours to tell how it stands to the Sun."""
        """How far the mount's sidereal clock is from ours."""

    def seconds_to(self, seen: Seen) -> float:
        """Return how long after the last status this one came, by our clock, else by the mount's."""
        before = self._before
        if before is None:
            return 0.0
        if seen.utc_s is not None and before.utc_s is not None:
            return seen.utc_s - before.utc_s
        return math.remainder(seen.sidereal_deg - before.sidereal_deg, 360.0) / SIDEREAL_RATE_DEG_S

    @property
    def longest_step_s(self) -> float:
        """Statuses farther apart tell no rate, and the time between them is not counted, seconds.

        Those of a mount that sends them seldom are always far apart.
        """
        known = len(self._steps) == STEPS
        usual_s = sorted(self._steps)[STEPS // 2] if known else self._profile.period_s
        return max(LONGEST_STEP_S, LONGEST_STEPS * usual_s)

    def see(self, seen: Seen, commanded: Motion) -> str | None:
        """Take a status; `commanded` is what is in force as it comes."""
        self._before = seen
        tripped = self._see_clock(seen)
        before, seconds = self._ticked, 0.0
        if before is not None:
            seconds = math.remainder(seen.sidereal_deg - before.sidereal_deg, 360.0) / SIDEREAL_RATE_DEG_S
            if seconds == 0.0:
                # The clocks of some mounts go in steps of up to a second.
                return tripped
        self._ticked = seen
        then, self._then = self._then, commanded
        if before is None:
            return tripped
        self._steps.append(seconds)
        if not 0.0 < seconds < self.longest_step_s:
            self._forget()
            return tripped
        self.moved = MoveAxes(
            math.remainder(seen.ra_deg - before.ra_deg, 360.0) / seconds,
            (seen.dec_deg - before.dec_deg) / seconds,
        )
        # In a long step, what is in force by now may have been given a moment ago.
        then = commanded if seconds < LONGEST_STEP_S else then
        return (
            tripped
            or self._see_current(seen, seconds)
            or self.see_motion(self.moved, commanded, seconds, then)
        )

    def see_motion(
        self, moved: MoveAxes, commanded: Motion, seconds: float, then: Motion | None = None
    ) -> str | None:
        """Take mean rates over some seconds; return "obedience" where the mount does not obey.

        `then` is what was in force as they began, where that may be something else. One step is no proof.
        """
        then = commanded if then is None else then
        if not (isinstance(commanded, MoveAxes) and isinstance(then, MoveAxes)):
            self._disobeyed_s = 0.0
            self._window.clear()
            self._commanded.clear()
            self._window_s = self._commanded_s = 0.0
            self._first.clear()
            if self._axes is not None:
                self._axes.forget()
            return None
        if len(self._first) < FIRST:
            self._first.append((commanded.ra_rate_deg_s, commanded.dec_rate_deg_s))
        disobeyed = _disobeyed(commanded, moved) and (then is commanded or _disobeyed(then, moved))
        self._disobeyed_s = self._disobeyed_s + min(seconds, DISOBEDIENT_FOR_S) if disobeyed else 0.0
        # The window is kept in either case: it tells the cause.
        strays = self._strays(moved, commanded, seconds)
        if self._axes is not None:
            self._axes.see(seconds, moved, commanded, self._before)
            strays = strays or self._axes.askew
        # A command that is lost is not disobeyed.
        if not strays and self._disobeyed_s <= DISOBEDIENT_FOR_S + self._fault_s:
            return None
        self.cause = self._likely_cause() or (None if self._axes is None else PERHAPS_ELSEWHERE)
        return "obedience"

    def _likely_cause(self) -> str | None:
        """Return why the mount does not obey, as its last seconds' motion tells; None where it does not."""
        beyond = "_beyond_pole" if self._before is not None and self._before.beyond_pole else ""
        commanded = list(self._commanded)[-len(self._window) :]
        if self.keeps_first:
            return KEEPS_FIRST
        if self._axes is not None:
            turned = self._axes.turned()
            if turned is None or (self._axes.askew and not any(turned)):
                return ELSEWHERE
            for name, field, is_turned in zip(NAMES, FIELDS, turned, strict=True):
                if is_turned:
                    return (
                        f"rates came out with the other sign in {name}: turn {field} in the profile, unless "
                        "its geometry is another mount's"
                    )
        still = 0
        for axis, name, field in ((1, "right ascension", "ra"), (2, "declination", "dec")):
            pairs = [(c[axis], m[axis] / m[0]) for c, m in zip(commanded, self._window, strict=True)]
            square = sum([c * c for c, _ in pairs])
            if square <= len(pairs) * LEAST_ASKED_DEG_S**2:
                continue
            ratio = sum([c * m for c, m in pairs]) / square
            if ratio < TURNED:
                sign = f"{field}_rate_sign{beyond}"
                return f"rates came out with the other sign in {name}: turn {sign} in the profile"
            still += axis if abs(ratio) < STILL else 0
        return self._still_text(still)

    def stray(self, takes_other_side: bool = False) -> None:
        """Note that the mount has left the way of its slew, perhaps to end on the other side of the pier."""
        if self._axes is not None:
            self.cause = self._likely_cause() or (ELSEWHERE if self._window else None)
        elif takes_other_side:
            known = self._profile.pier_rule == "ascom"
            self.cause = OTHER_SIDE_KEPT if known else OTHER_SIDE

    @property
    def keeps_first(self) -> bool:
        """Whether a mount that is to take the latest rates goes on at the first, as it does by edges."""
        if self._profile.move_axis != "held" or self._window_s < KEPT_FOR_S:
            return False
        steps = list(self._window)[-(len(self._window) * 2 // 3) :]
        commanded = list(self._commanded)[-len(steps) :]
        # What was commanded of late has not come out yet.
        late_s = 0.0
        for step in reversed(steps):
            late_s += step[0]
            commanded.pop()
            if late_s >= ANSWERED_S:
                break
        if not commanded:
            return False
        varied = max(_spread([step[axis] for step in commanded]) for axis in (1, 2))
        if varied < VARIED_DEG_S:
            return False
        rates = []
        for axis in (1, 2):
            seen = [step[axis] / step[0] for step in steps]
            rates.append(sum(seen) / len(seen))
            if _spread(seen) > STEADY_DEG_S + STEADY_SHARE * abs(rates[-1]):
                return False
        fast = abs(SIDEREAL_RATE_DEG_S - rates[0]), abs(rates[1])
        limits = (self._profile.ra.max_rate_deg_s, self._profile.dec.max_rate_deg_s)
        at_limits = all(rate > AT_LIMIT_SHARE * most for rate, most in zip(fast, limits, strict=True))
        if at_limits or abs(fast[0] - fast[1]) < STEADY_SHARE * fast[1]:
            # Both at one rate may as well be at a limit that the profile does not know.
            return False
        return any(
            all(abs(a - b) <= STEADY_DEG_S + LIKE_SHARE * abs(b) for a, b in zip(rates, first, strict=True))
            for first in self._first
        )

    def _still_text(self, still: int) -> str | None:
        if still == RA_AND_DEC and self._profile.move_axis == "held":
            return (
                "neither axis changes its rate as commanded: move_axis is edge, and the profile says held, "
                "or the drives are off"
            )
        names = {1: "right ascension does", 2: "declination does", RA_AND_DEC: "the axes do"}
        if still not in names:
            return None
        return f"{names[still]} not move as commanded: {SEE_TO_DRIVE}"

    def _strays(self, moved: MoveAxes, commanded: MoveAxes, seconds: float) -> bool:
        """Tell whether the means over the window are outside of everything that was commanded."""
        if abs(moved.ra_rate_deg_s) > STEP_DEG_S or abs(moved.dec_rate_deg_s) > STEP_DEG_S:
            # A sync or the pole says nothing of the drives.
            self._forget()
            return False
        self._window.append((seconds, moved.ra_rate_deg_s * seconds, moved.dec_rate_deg_s * seconds))
        self._commanded.append((seconds, commanded.ra_rate_deg_s, commanded.dec_rate_deg_s))
        self._window_s += seconds
        self._commanded_s += seconds
        while self._commanded_s - self._commanded[0][0] > WINDOW_S + self._fault_s:
            self._commanded_s -= self._commanded.popleft()[0]
        if self._window_s < WINDOW_S:
            self._was_off = False
            return False
        while self._window_s - self._window[0][0] >= WINDOW_S:
            self._window_s -= self._window.popleft()[0]
        self._turn = (self._turn + 1) % LOOK_EVERY
        slow, was_off = seconds >= LONGEST_STEP_S, self._was_off
        self._was_off = (self._turn == 0 or slow) and (self._off(1) or self._off(2))
        return self._was_off and (was_off or not slow)

    def _off(self, axis: int) -> bool:
        mean = sum([step[axis] for step in self._window]) / self._window_s
        rates = [step[axis] for step in self._commanded]
        low, high = min(rates), max(rates)
        loose = LOOSE_DEG_S + LOOSE_SHARE * max(abs(low), abs(high))
        return not low - loose <= mean <= high + loose

    def _see_current(self, seen: Seen, seconds: float) -> str | None:
        most_ra, most_dec = self._profile.ra.max_current_a, self._profile.dec.max_current_a
        over = (most_ra is not None and abs(seen.ra_current_a) > most_ra) or (
            most_dec is not None and abs(seen.dec_current_a) > most_dec
        )
        self._overloaded_s = self._overloaded_s + min(seconds, OVERLOADED_FOR_S) if over else 0.0
        return "current" if self._overloaded_s > OVERLOADED_FOR_S else None

    def _see_clock(self, seen: Seen) -> str | None:
        if seen.utc_s is None or self._longitude_deg is None:
            return None
        ours_deg = mean_sidereal_deg(seen.utc_s, self._longitude_deg)
        gap_deg = abs(math.remainder(seen.sidereal_deg - ours_deg, 360.0))
        off = gap_deg > self._tolerance_s * SIDEREAL_RATE_DEG_S
        self._clock_off = self._clock_off + 1 if off else 0
        if not off or self._clock_off >= CLOCK_PROOF or not self._clock_known:
            self.clock_gap_deg, self.clock_is_off = gap_deg, off
            self._clock_known = True
        return "clock" if self.clock_is_off else None

    def _forget(self) -> None:
        self._window.clear()
        self._commanded.clear()
        self._window_s = self._commanded_s = 0.0


def _spread(values: list[float]) -> float:
    """Return how far values vary, a tenth at either end left out."""
    ordered, edge = sorted(values), len(values) // 10
    return ordered[-1 - edge] - ordered[edge]


def _disobeyed(commanded: MoveAxes, moved: MoveAxes) -> bool:
    """Tell whether one of both axes does not follow its command."""
    return _disobeys(commanded.ra_rate_deg_s, moved.ra_rate_deg_s) or _disobeys(
        commanded.dec_rate_deg_s, moved.dec_rate_deg_s
    )


def _disobeys(commanded_deg_s: float, moved_deg_s: float) -> bool:
    """Tell whether one axis does not follow its command, or goes faster than that explains."""
    commanded, went = abs(commanded_deg_s), abs(moved_deg_s)
    stays = commanded > DISOBEDIENT_DEG_S and moved_deg_s * commanded_deg_s < 0.05 * commanded * commanded
    return stays or went > 2.0 * commanded + RUNAWAY_DEG_S


BLOCK_S, BLOCKS, FEWEST_BLOCKS = 0.4, 20, 6
JUMP_DEG_S = 0.25
"""A change of rates from block to block that a servo of any kind need not answer at once."""
LAGS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
"""By how many blocks motion may come after its command."""
GAINS = (0.4, 1.6)
UNEXPLAINED, EXPLAINED = 0.15, 0.4
"""Axes lie elsewhere where gains leave this share of the motion, squared, and a mixture of both commanded
rates leaves less than that share of what the gains do."""
NEAR_POLE_DEG = 80.0
"""Nearer to its pole than this, the first angle says little of the first axis' rate."""
TURNED_LEAVES = 0.3
"""Share of the motion, squared, that turned signs may leave."""
Pair = tuple[float, float]
Block = tuple[float, float, float, float]
"""How far both axes were to go, and went, degrees."""


class AxesWatch:
    """Tells of a mount with a geometry whether each commanded rate moves the angle that it should."""

    def __init__(self) -> None:
        self._blocks: deque[Block] = deque(maxlen=BLOCKS)
        self._open: Block = (0.0, 0.0, 0.0, 0.0)
        self._open_s = 0.0
        self.askew = False
        """Whether the axes lie otherwise than the profile says."""

    def forget(self) -> None:
        """Begin anew."""
        self._blocks.clear()
        self._open, self._open_s = (0.0, 0.0, 0.0, 0.0), 0.0

    def see(self, seconds: float, moved: MoveAxes, commanded: MoveAxes, at: Seen | None) -> None:
        """Take the rates commanded and seen over some seconds, of the reported angles."""
        if at is None or abs(at.dec_deg) > NEAR_POLE_DEG:
            self.forget()
            return
        rates = (
            SIDEREAL_RATE_DEG_S - commanded.ra_rate_deg_s,
            commanded.dec_rate_deg_s,
            SIDEREAL_RATE_DEG_S - moved.ra_rate_deg_s,
            moved.dec_rate_deg_s,
        )
        a, b, c, d = (sum_ + rate * seconds for sum_, rate in zip(self._open, rates, strict=True))
        self._open, self._open_s = (a, b, c, d), self._open_s + seconds
        if self._open_s < BLOCK_S:
            return
        self._blocks.append(self._open)
        self._open, self._open_s = (0.0, 0.0, 0.0, 0.0), 0.0
        if len(self._blocks) >= FEWEST_BLOCKS:
            self.askew = self._is_askew()

    def _is_askew(self) -> bool:
        most = math.ceil(max(LAGS))
        rows = self._rows(most, self._quiet(most))
        if not rows or len(rows[0][1]) < FEWEST_BLOCKS:
            return False
        size = sum([x * x + y * y for _, went in rows[:1] for x, y in went])
        by_gains = min([sum(_by_gain(asked, went, axis)[1] for axis in (0, 1)) for asked, went in rows])
        by_both = min([sum(_left_by_both(asked, went, axis) for axis in (0, 1)) for asked, went in rows])
        return by_gains > UNEXPLAINED * size and by_both < EXPLAINED * by_gains

    def _quiet(self, most: int) -> list[int]:
        """Return the blocks before which commands changed so little that any servo has answered them."""
        blocks = list(self._blocks)
        jumps = [
            max(abs(late[0] - soon[0]), abs(late[1] - soon[1])) > JUMP_DEG_S * BLOCK_S
            for soon, late in pairwise(blocks)
        ]
        return [k for k in range(most, len(blocks)) if not any(jumps[k - most : k])]

    def turned(self) -> tuple[bool, bool] | None:
        """Return of each axis whether its rate has the other sign; None where signs explain no motion.

        Also by the little that is known when a mount has just been stopped.
        """
        count = len(self._blocks)
        most = 1 if count < 2 * FEWEST_BLOCKS else math.ceil(max(LAGS))
        rows = self._rows(most, list(range(most, count)))
        best: tuple[float, tuple[bool, bool]] = (math.inf, (False, False))
        for asked, went in rows:
            fits = [
                min((_by_gain(asked, went, axis, sense)[1], sense) for sense in (1.0, -1.0))
                for axis in (0, 1)
            ]
            best = min(best, (fits[0][0] + fits[1][0], (fits[0][1] < 0.0, fits[1][1] < 0.0)))
        size = sum([x * x + y * y for _, went in rows[:1] for x, y in went])
        return best[1] if not rows or best[0] <= TURNED_LEAVES * size else None

    def _rows(self, most: int, which: list[int]) -> list[tuple[list[Pair], list[Pair]]]:
        """Return what was asked and what came of it, in blocks, by each lag; nothing without motion."""
        blocks = list(self._blocks)
        went: list[Pair] = [blocks[k][2:] for k in which]
        if sum([x * x + y * y for x, y in went]) <= len(went) * (2.0 * LEAST_ASKED_DEG_S * BLOCK_S) ** 2:
            return []
        found = []
        for lag in LAGS:
            whole, part = int(lag), lag % 1.0
            if lag > most:
                break
            asked: list[Pair] = []
            for k in which:
                late, later = blocks[k - whole], blocks[k - whole - (part > 0.0)]
                asked.append(
                    ((1.0 - part) * late[0] + part * later[0], (1.0 - part) * late[1] + part * later[1])
                )
            found.append((asked, went))
        return found


def _by_gain(asked: list[Pair], went: list[Pair], axis: int, sense: float = 1.0) -> tuple[float, float]:
    """Return the gain of one axis that explains its motion best, and the square of what it leaves."""
    pairs = [(sense * c[axis], m[axis]) for c, m in zip(asked, went, strict=True)]
    square = sum([c * c for c, _ in pairs])
    gain = sum([c * m for c, m in pairs]) / square if square else 1.0
    gain = max(GAINS[0], min(GAINS[1], gain))
    return gain, sum([(m - gain * c) ** 2 for c, m in pairs])


def _left_by_both(asked: list[Pair], went: list[Pair], axis: int) -> float:
    """Return the square of an axis' motion that a mixture of both commanded rates leaves."""
    aa = sum([a * a for a, _ in asked]) + 1e-12
    bb = sum([b * b for _, b in asked]) + 1e-12
    ab = sum([a * b for a, b in asked])
    am = sum([a * m[axis] for (a, _), m in zip(asked, went, strict=True)])
    bm = sum([b * m[axis] for (_, b), m in zip(asked, went, strict=True)])
    determinant = aa * bb - ab * ab
    one, other = (am * bb - bm * ab) / determinant, (bm * aa - am * ab) / determinant
    return sum([(m[axis] - one * a - other * b) ** 2 for (a, b), m in zip(asked, went, strict=True)])


PROOF = 3
"""So many statuses in a row that go together are believed, however far they are from those before: a sync."""
FASTER = 1.5
"""By what factor axes may be faster than their slews."""
LOOSE_DEG = 0.5


class Former(NamedTuple):
    """Where the axes were last believed to be, and how much older that is than the last status, seconds."""

    place: Place
    older_s: float


class Belief(StrEnum):
    """How the place in a status is treated."""

    GOES_ON = "goes on"
    DOUBTED = "doubted"
    BORNE_OUT = "borne out"
    """It is far from those before, but so many in a row are: the axes are there after all."""
    ANEW = "anew"
    """Nothing had borne out the very first one: this one takes its place."""


class PositionFilter:
    """Follows the places of one mount, status by status."""

    def __init__(self, profile: MountProfile) -> None:
        self._fastest = (FASTER * profile.ra.fastest_deg_s, FASTER * profile.dec.fastest_deg_s)
        self._believed: Place | None = None
        self._believed_s = 0.0
        """How long ago that was reported."""
        self._claimed: Place | None = None
        """What the last status in doubt reported."""
        self._claims = 0
        self._begun = False
        """Whether a second place has gone together with the first."""
        self.moved = MoveAxes(0.0, 0.0)
        """The rates of the reported place between the last two statuses that are believed."""
        self.former: Former | None = None
        """Where the axes were before the place reported last, which nothing has borne out; else None."""

    def see(self, place: Place, seconds: float, moved: MoveAxes) -> Belief:
        """Take a status' place, how long after the one before it came, and the rates between the two."""
        seconds = max(0.0, seconds)
        self._believed_s += seconds
        if self._believed is None:
            self._believe(place)
            return Belief.ANEW
        if self._near(self._believed, place, self._believed_s):
            if self._claimed is None:
                self.moved = moved
            self._begun = True
            self._believe(place)
            return Belief.GOES_ON
        if not self._begun:
            self._believe(place)
            return Belief.ANEW
        goes_on = self._claimed is not None and self._near(self._claimed, place, seconds)
        self._claims = self._claims + 1 if goes_on else 1
        self._claimed = place
        if self._claims >= PROOF:
            self.moved = moved
            self._believe(place)
            return Belief.BORNE_OUT
        self.former = Former(self._believed, self._believed_s)
        return Belief.DOUBTED

    def _near(self, one: Place, other: Place, seconds: float) -> bool:
        ha, dec = self._fastest
        return (
            abs(other[0] - one[0]) <= LOOSE_DEG + ha * seconds
            and abs(other[1] - one[1]) <= LOOSE_DEG + dec * seconds
        )

    def _believe(self, place: Place) -> None:
        self._believed, self._believed_s = place, 0.0
        self._claimed, self._claims, self.former = None, 0, None
