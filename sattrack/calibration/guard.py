"""What a calibration run will move, what must hold meanwhile, and the one way by which commands leave.

The signs, gains and semantics that `sattrack.safety` works with are what the run is to find out, so nothing
here presumes them: whatever an axis does within the box was looked at beforehand in every direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from sattrack.core.angles import altitude_deg, separation_deg, wrap180
from sattrack.core.errors import UNHEARD
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, STATUS_LOST_S, mean_sidereal_deg
from sattrack.mount.xerxes.datagrams import Command, encode_command
from sattrack.mount.xerxes.session import says_the_same
from sattrack.safety import ROWS
from sattrack.safety.geometry import AxesState, Box
from sattrack.safety.limits import SUN_CONE_DEG
from tle.earth import EarthOrientation
from tle.instants import Utc
from tle.sun import sun_km

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sattrack.calibration.clocks import HeardStatus, StatusLog
    from sattrack.safety.bounds import Bounds
    from tle.site import Site


def sun_hour_angle_and_dec(utc_s: float, site: Site) -> tuple[float, float]:
    """Return the Sun's hour angle and declination of date at an instant, degrees, to a few arcseconds.

    Raises TimeRangeError where the Earth's orientation is not known.
    """
    earth, at = EarthOrientation.installed(), Utc(utc_s)
    x, y, z = (float(c) for c in earth.celestial_matrix(at) @ sun_km(at))
    right_ascension = math.degrees(math.atan2(y, x))
    sidereal = float(earth.local_apparent_sidereal_deg(at, site))
    hour_angle = wrap180(sidereal - right_ascension)
    return hour_angle, math.degrees(math.atan2(z, math.hypot(x, y)))


def true_clocks(utc_s: float, site: Site) -> dict[str, float]:
    """Return by how many seconds each kind of true sidereal clock is ahead of mean time with UT1 = UTC.

    A mount's clock may show mean or apparent sidereal time, and may know UT1 or take UTC for it. Raises
    TimeRangeError.
    """
    earth, at = EarthOrientation.installed(), Utc(utc_s)
    plain = mean_sidereal_deg(utc_s, site.longitude_deg)
    apparent = float(earth.local_apparent_sidereal_deg(at, site))
    equinoxes_deg = float(np.degrees(earth.rotation(utc_s)[2]))

    def ahead_s(sidereal_deg: float) -> float:
        return wrap180(sidereal_deg - plain) / SIDEREAL_RATE_DEG_S

    return {
        "mean, UT1 taken as UTC": 0.0,
        "mean, by UT1": ahead_s(apparent - equinoxes_deg),
        "apparent, by UT1": ahead_s(apparent),
    }


FIRST_RATE_DEG_S = 0.2
SECOND_RATE_DEG_S = 0.1
CENTRED_WITHIN_DEG = 0.25
"""How near to where it began an axis is brought back after that test."""
SEMANTICS_PART_S = 1.2
"""How long each part of the test for held or edge lasts: first rate, second rate, flag down."""
STEP_RATES_DEG_S = (0.10, 0.12, 0.10, 0.12, 0.10)
"""Rates one after another without a stop, whose steps are too small to meet the axis' limits."""
STEP_PART_S = 1.2
USUAL_STATUS_PERIOD_S = 0.1
"""Where statuses come more rarely, motions take longer and are slower by as much."""
SILENT_PERIODS = 10.0
LARGEST_GAIN = 1.5
"""An axis that goes faster than this times its command is stopped."""
REACTION_S = 0.45
"""What a round trip, a turn of the mount's loop and braking may add to each motion."""
LARGEST_DISPLACEMENT_DEG = 3.0
"""The run is stopped where an axis stands farther than this from where it began."""
BOX_DEG = 4.2
"""What is checked beforehand: the largest displacement and the way to stop from it."""
LARGEST_DURATION_S = 600.0


@dataclass(frozen=True, slots=True)
class Leg:
    """One steady motion of one axis."""

    rate_deg_s: float
    seconds: float


@dataclass(frozen=True, slots=True)
class Plan:
    """A run: how often the harmless flag is raised before and after, and each axis' motions.

    Motions come in pairs of opposite ones, so that an axis ends near where it began, and to both sides of
    that: torque ripple bends the rate over a stretch of one degree, and bends it back farther on. The fastest
    ones lead back to the middle.
    """

    toggles: int = 36
    most_toggles: int = 120
    """So often where delays scatter."""
    toggles_after: int = 12
    silent_after_s: float = 0.6
    """A mount that says nothing for so long has fallen silent."""
    steps: bool = True
    """Whether the rate of a motion is changed by small steps, too."""
    legs: tuple[Leg, ...] = (
        Leg(-0.8, 2.4),
        Leg(1.6, 0.9),
        Leg(0.8, 2.4),
        Leg(-1.6, 0.9),
        Leg(0.8, 2.4),
        Leg(-1.6, 0.9),
        Leg(-0.8, 2.4),
        Leg(1.6, 0.9),
        Leg(-0.4, 3.6),
        Leg(0.4, 3.6),
        Leg(0.4, 3.6),
        Leg(-0.4, 3.6),
        Leg(-0.2, 4.0),
        Leg(0.2, 4.0),
    )

    def suited(self, largest_deg_s: float | None, status_period_s: float) -> Plan:
        """Return the plan with motions no faster than an axis bears, and so long that enough is seen of each.

        Raises ValueError where the largest rate is below FIRST_RATE_DEG_S.
        """
        slower = max(1.0, status_period_s / USUAL_STATUS_PERIOD_S)
        part = 1.0 / slower
        if largest_deg_s is not None and part * self.fastest_deg_s > largest_deg_s:
            part = largest_deg_s / self.fastest_deg_s
        if largest_deg_s is not None and largest_deg_s < FIRST_RATE_DEG_S:
            raise ValueError(
                f"the mount's largest rate is {largest_deg_s:g} °/s: no satellite can be followed"
            )
        legs = tuple(Leg(part * leg.rate_deg_s, slower * leg.seconds) for leg in self.legs)
        silent_after_s = max(self.silent_after_s, SILENT_PERIODS * status_period_s)
        return replace(self, legs=legs, silent_after_s=silent_after_s)

    @property
    def fastest_deg_s(self) -> float:
        """The largest rate commanded."""
        return max(FIRST_RATE_DEG_S, *(abs(leg.rate_deg_s) for leg in self.legs))

    def largest_displacement_deg(self) -> float:
        """Return how far an axis of gain 1.1 comes from where it began, at most, by either semantics."""
        farthest = FIRST_RATE_DEG_S * (4.0 * SEMANTICS_PART_S + 2.0 * REACTION_S)
        at = CENTRED_WITHIN_DEG
        for leg in self.legs:
            at += leg.rate_deg_s * (leg.seconds + REACTION_S)
            farthest = max(farthest, abs(at))
        return 1.1 * farthest

    def expected_s(self) -> float:
        """Return about how long the run takes, for showing how far it has come."""
        motions = sum(leg.seconds + 1.6 for leg in self.legs) + 4.0 * SEMANTICS_PART_S + 6.0
        motions += 2.0 * (len(STEP_RATES_DEG_S) * STEP_PART_S + 1.6)
        return 4.0 + 0.36 * (self.toggles + self.toggles_after) + 2.0 * motions

    def words(self) -> list[str]:
        """Say to the operator what will happen."""
        return [
            f"each axis in turn goes up to {self.largest_displacement_deg():.1f}° to either side of where it "
            f"stands, at {self.fastest_deg_s:g} °/s at most, and ends near where it began "
            f"(beyond {LARGEST_DISPLACEMENT_DEG:g}° the run is stopped)",
            f"it takes about {self.expected_s() / 60.0:.1f} minutes; the mount is brought to rest first and "
            "left at rest",
        ]


FLOOR_ALTITUDE_DEG = 20.0
HIGHEST_DEC_DEG = 88.0
"""Nearer to a pole the reported right ascension turns by itself."""
SUN_MOVES_DEG = 2.5
"""How far the Sun comes in hour angle during the longest run."""
LARGEST_CLOCK_ERROR_S = 300.0
SITE_WITHIN_DEG = 0.1
SILENT_AFTER_S = 0.6
ASTRAY_PROOF = 3
LARGEST_JUMP_DEG = 0.3
STRANGE_RATE_DEG_S = 0.01
GRID = 8


class EndKind(StrEnum):
    """Why a run ended or was refused."""

    DONE = "done"
    REFUSED = "refused"
    LIMIT = "limit"
    DOUBT = "doubt"
    LINK = "link"
    OPERATOR = "operator"


class CalibrationEndedError(Exception):
    """The run cannot begin or go on; the message is for the operator."""

    def __init__(self, kind: EndKind, words: str) -> None:
        super().__init__(words)
        self.kind = kind
        self.words = words


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Where the mount stands and what is around it, degrees; the Sun by hour angle and declination."""

    latitude_deg: float
    longitude_deg: float
    sun_hour_angle_deg: float
    sun_dec_deg: float
    hour_angle_limit_deg: float
    floor_altitude_deg: float = FLOOR_ALTITUDE_DEG
    sun_cone_deg: float = SUN_CONE_DEG
    bounds: Bounds | None = None
    """The site's and the mount's own limits, at the beginning of the run."""
    first_axis_middle_deg: float = 0.0
    """The angle of the first axis within half a turn of which it is taken to be."""


class CalibrationGuard:
    """Watches one run."""

    def __init__(
        self, surroundings: Surroundings, fastest_deg_s: float, silent_after_s: float = SILENT_AFTER_S
    ) -> None:
        self._around = surroundings
        self._fastest_deg_s = fastest_deg_s
        self._silent_after_s = silent_after_s
        self._began: HeardStatus | None = None
        self._news_utc_s = 0.0
        """When a status came last that did not repeat the clock and the place of the one before."""
        self._before: HeardStatus | None = None
        self._answered = float("nan")
        self._astray = -1
        """Statuses without the right acknowledgements since they came; -1 before they have."""

    def clear(self, command: Command) -> bytes:
        """Return the datagram of a command: an abort, a bounded MoveAxis, or neither.

        Raises CalibrationEndedError for anything else.
        """
        rates = (command.move_ra_rate_deg_s, command.move_dec_rate_deg_s)
        bounded = all(math.isfinite(r) and abs(r) <= self._fastest_deg_s for r in rates)
        others = (
            command.find_home, command.park, command.pulse_guide, command.slew, command.sync, command.spare
        )  # fmt: skip
        moves = command.move_ra or command.move_dec
        if not bounded or any(others) or (moves and self._began is None):
            raise CalibrationEndedError(
                EndKind.DOUBT, f"calibration does not send {command}: a defect of sattrack"
            )
        return encode_command(command)

    def begin(self, log: StatusLog, now_utc_s: float) -> None:
        """Allow motion from where the mount stands, or raise CalibrationEndedError that says why not."""
        last = log.last
        if last is None:
            raise CalibrationEndedError(EndKind.LINK, f"no status from the mount; {UNHEARD}")
        self._refuse_state(last, log)
        self._refuse_place(last, now_utc_s)
        self._began = self._before = last
        self._news_utc_s = last.arrival_utc_s

    def _refuse_state(self, last: HeardStatus, log: StatusLog) -> None:
        status = last.status
        state = None
        acks = (status.ack_move_ra, status.ack_move_dec, status.ack_slew, status.ack_sync)
        if status.at_park:
            state = "it is parked: bring it up by its own console"
        elif any(acks) or status.ack_abort or status.ack_pulse_guide:
            state = "it acknowledges commands that are not ours: another program commands it, end that one"
        else:
            rate = _rates(log)
            along_ra = min(abs(rate[0]), abs(rate[0] - SIDEREAL_RATE_DEG_S))
            moves = max(along_ra, abs(rate[1])) > STRANGE_RATE_DEG_S
            # There are mounts whose Slewing is always up.
            if status.pulse_guiding or (status.slewing and moves):
                state = "it is slewing or guiding: end that first, by sattrack mount abort or its own console"
            elif moves:
                state = f"it moves by itself, {rate[0]:.3f} and {rate[1]:.3f} °/s: stop it first"
        if state is not None:
            raise CalibrationEndedError(EndKind.REFUSED, f"the mount is not ready: {state}")

    def _refuse_place(self, last: HeardStatus, now_utc_s: float) -> None:
        around, status = self._around, last.status
        true_deg = mean_sidereal_deg(now_utc_s, around.longitude_deg)
        off_s = wrap180(status.sidereal_h * 15.0 - true_deg) / SIDEREAL_RATE_DEG_S
        if abs(off_s) > LARGEST_CLOCK_ERROR_S:
            raise CalibrationEndedError(
                EndKind.REFUSED,
                f"the mount's sidereal time is {off_s:.0f} s from that of the site given: set the mount's "
                "clock, or check --site; otherwise the Sun's direction is unknown",
            )
        if status.site_deg is not None:
            latitude_deg, longitude_deg = status.site_deg
            apart = max(
                abs(latitude_deg - around.latitude_deg),
                abs(wrap180(longitude_deg - around.longitude_deg)),
            )
            if apart > SITE_WITHIN_DEG:
                raise CalibrationEndedError(
                    EndKind.REFUSED,
                    f"the mount believes it stands at {latitude_deg:.2f}, {longitude_deg:.2f}: "
                    "check --site and the mount's own settings",
                )
        self._refuse_box(last)

    def _refuse_box(self, last: HeardStatus) -> None:
        around = self._around
        places = list(_box(last.hour_angle_deg, last.dec_deg))
        lowest = min(altitude_deg(ha, dec, around.latitude_deg) for ha, dec in places)
        if lowest < around.floor_altitude_deg:
            raise CalibrationEndedError(
                EndKind.LIMIT,
                f"within {BOX_DEG:g}° of where the mount stands altitude falls to {lowest:.1f}°; at least "
                f"{around.floor_altitude_deg:g}° is needed: slew higher and start again",
            )
        if max(abs(dec) for _, dec in places) > HIGHEST_DEC_DEG:
            raise CalibrationEndedError(
                EndKind.LIMIT,
                f"the mount stands at declination {last.dec_deg:.1f}°, too near the pole to move by "
                f"{BOX_DEG:g}°: slew to {HIGHEST_DEC_DEG - BOX_DEG - 1.0:g}° or less and start again",
            )
        farthest = max(abs(ha) for ha, _ in places)
        if farthest > around.hour_angle_limit_deg:
            raise CalibrationEndedError(
                EndKind.LIMIT,
                f"the mount stands at hour angle {last.hour_angle_deg:.1f}°, within {farthest:.1f}° of the "
                f"limit of {around.hour_angle_limit_deg:g}°: slew back and start again",
            )
        self._refuse_limits(last)
        nearest = min(
            separation_deg(ha, dec, around.sun_hour_angle_deg + later, around.sun_dec_deg)
            for ha, dec in places
            for later in (0.0, SUN_MOVES_DEG)
        )
        if nearest < around.sun_cone_deg:
            raise CalibrationEndedError(
                EndKind.LIMIT,
                f"the Sun is {nearest:.1f}° from what the mount may point at; at least "
                f"{around.sun_cone_deg:g}° is needed: slew away from the Sun and start again",
            )

    def _refuse_limits(self, last: HeardStatus) -> None:
        if self._around.bounds is None:
            return
        axes = AxesState(self._around.latitude_deg, self._around.first_axis_middle_deg)
        place = axes.place(last.hour_angle_deg, last.dec_deg, last.status.side_of_pier)
        box = Box.between(place, place).grown(BOX_DEG, BOX_DEG, BOX_DEG, BOX_DEG)
        name = self._around.bounds.violated(box, {}, SUN_MOVES_DEG / SIDEREAL_RATE_DEG_S)
        if name is not None:
            raise CalibrationEndedError(
                EndKind.LIMIT,
                f"within {BOX_DEG:g}° of where the mount stands is its {name} limit ({ROWS[name].bound}): "
                "slew away and start again",
            )

    def watch(self, heard: HeardStatus, log: StatusLog) -> None:
        """Take a status of the run; raises CalibrationEndedError on any doubt."""
        began, before = self._began, self._before
        if began is None or before is None:
            return
        self._before = heard
        words = None
        status = heard.status
        if not says_the_same(status, before.status):
            self._news_utc_s = heard.arrival_utc_s
        moved = (heard.hour_angle_deg - before.hour_angle_deg, heard.dec_deg - before.dec_deg)
        seconds = max(0.02, heard.mount_s - before.mount_s)
        largest = LARGEST_GAIN * self._fastest_deg_s * seconds + 0.05
        if log.restarted:
            words = "the mount's program was started again"
        elif status.side_of_pier != began.status.side_of_pier:
            words = "the mount reports the other side of the pier"
        elif status.ack_slew or status.ack_sync or status.ack_pulse_guide:
            words = "the mount acknowledges a command that is not ours: another program commands it"
        elif max(abs(m) for m in moved) > max(largest, LARGEST_JUMP_DEG):
            words = f"the reported place jumped by {max(abs(m) for m in moved):.2f}°: was the mount synced?"
        elif (
            abs(heard.mount_s - before.mount_s - (heard.arrival_utc_s - before.arrival_utc_s))
            > SILENT_AFTER_S
        ):
            words = "the mount's clock was set during the run"
        if words is not None:
            raise CalibrationEndedError(EndKind.DOUBT, f"{words}; start again when that is over")
        self._watch_place(heard, began)

    def _watch_place(self, heard: HeardStatus, began: HeardStatus) -> None:
        off_ha = heard.hour_angle_deg - began.hour_angle_deg
        off_dec = heard.dec_deg - began.dec_deg
        for name, off in (("hour angle", off_ha), ("declination", off_dec)):
            if abs(off) > LARGEST_DISPLACEMENT_DEG:
                raise CalibrationEndedError(
                    EndKind.LIMIT,
                    f"the {name} axis came {abs(off):.1f}° from where it began; "
                    f"{LARGEST_DISPLACEMENT_DEG:g}° is the limit",
                )

    def watch_answer(self, heard: HeardStatus, said: Command, since_utc_s: float) -> None:
        """Raise CalibrationEndedError where acknowledgements come and go while we say the same."""
        if self._began is None:
            return
        if self._answered != since_utc_s:
            self._answered, self._astray = since_utc_s, -1
        status = heard.status
        moves_ra = said.move_ra and said.move_ra_rate_deg_s != 0.0
        moves_dec = said.move_dec and said.move_dec_rate_deg_s != 0.0
        wrong = (
            status.ack_abort != said.abort
            or (moves_ra and not status.ack_move_ra)
            or (moves_dec and not status.ack_move_dec)
            or (status.ack_move_ra and not said.move_ra)
            or (status.ack_move_dec and not said.move_dec)
        )
        if not wrong:
            self._astray = max(0, self._astray)
        elif self._astray >= 0:
            self._astray += 1
        if self._astray >= ASTRAY_PROOF:
            raise CalibrationEndedError(
                EndKind.DOUBT,
                "the mount's acknowledgements come and go while ours stay: another program commands it, "
                "or the network loses much; start again when that is over",
            )

    def watch_link(self, log: StatusLog, now_utc_s: float) -> None:
        """Raise CalibrationEndedError where the mount has fallen silent, or tells nothing new."""
        last = log.last
        if self._began is None or last is None:
            return
        if now_utc_s - last.arrival_utc_s > self._silent_after_s:
            raise CalibrationEndedError(
                EndKind.LINK, "the mount fell silent; stop commands are sent: look after it"
            )
        if now_utc_s - self._news_utc_s > STATUS_LOST_S:
            raise CalibrationEndedError(
                EndKind.LINK,
                "the mount said the same again and again while it moved; stop commands are sent: "
                "look after it",
            )


def _box(hour_angle_deg: float, dec_deg: float) -> Iterator[tuple[float, float]]:
    for i in range(GRID + 1):
        ha = hour_angle_deg - BOX_DEG + 2.0 * BOX_DEG * i / GRID
        for j in range(GRID + 1):
            yield ha, dec_deg + BOX_DEG * (2.0 * j / GRID - 1.0)


def _rates(log: StatusLog) -> tuple[float, float]:
    newest = log.heard[-20:]
    seconds = newest[-1].mount_s - newest[0].mount_s
    if seconds <= 0.0:
        return 0.0, 0.0
    return (
        (newest[-1].hour_angle_deg - newest[0].hour_angle_deg) / seconds,
        (newest[-1].dec_deg - newest[0].dec_deg) / seconds,
    )
