"""What must hold before and while a mount is calibrated, and the one way by which commands leave.

The signs, gains and semantics that `sattrack.safety` works with are what the run is to find out, so nothing
here presumes them: whatever an axis does within the box was looked at beforehand in every direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from sattrack.calibration.plan import BOX_DEG, LARGEST_DISPLACEMENT_DEG, LARGEST_GAIN
from sattrack.core.angles import altitude_deg, separation_deg, wrap180
from sattrack.mount.model import SIDEREAL_RATE_DEG_S, STATUS_LOST_S, mean_sidereal_deg
from sattrack.mount.xerxes.datagrams import Command, encode_command
from sattrack.mount.xerxes.session import says_the_same
from sattrack.safety import ROWS
from sattrack.safety.geometry import Box

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sattrack.calibration.statuses import HeardStatus, StatusLog
    from sattrack.safety.bounds import Bounds

FLOOR_ALTITUDE_DEG = 20.0
SUN_CONE_DEG = 15.0
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
            raise CalibrationEndedError(
                EndKind.LINK, "no status from the mount; is it on, and set to send here?"
            )
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
                "clock, or check --site; where the Sun is cannot be told otherwise",
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
        ha, dec = last.hour_angle_deg, last.dec_deg
        if last.status.side_of_pier:
            ha, dec = ha + 180.0, math.copysign(180.0, self._around.latitude_deg) - dec
        box = Box(ha, ha, dec, dec).grown(BOX_DEG, BOX_DEG, BOX_DEG, BOX_DEG)
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
