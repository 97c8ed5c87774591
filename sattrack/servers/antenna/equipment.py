"""The equipment of an antenna: its axes, its sensors, and its focuser, simulated or remote. No I/O.

"Ideal Field System Antenna Interface", section 6.0. Positions in mm; instants in nanoseconds of UTC. The
response to a command never waits for the focuser: it reports the last known position and its instant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

import msgspec

from sattrack.servers.antenna.protocol import NS, OMITTED, AntennaRequest, Checksum, Nak, second_of_day

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.servers.antenna.trajectory import AxisKind, AxisRange, AxisState, SiteSky


class AxisReport(NamedTuple):
    """One axis of a focuser: its commanded place (None in a sweep, or before a command) and its actual one.

    The actual place is None where it is not known; `epoch_ns` is the instant of it.
    """

    commanded_mm: float | None
    actual_mm: float | None
    epoch_ns: int
    moving: bool


class FocusReport(NamedTuple):
    """All axes of a focuser, the oldest instant of their places, and whether any of them moves."""

    axes: tuple[AxisReport, ...]
    epoch_ns: int
    moving: bool


class FocusAxis(Protocol):
    """One axis of a focuser. No method waits for a motion."""

    least_mm: float
    most_mm: float

    def move(self, to_mm: float, utc_ns: int) -> None:
        """Go to a place, at most to a limit."""

    def sweep(self, rate_mm_s: float, utc_ns: int) -> None:
        """Go from limit to limit and back, again and again at a uniform rate, up first."""

    def stop(self, utc_ns: int) -> None:
        """Stop."""

    def report(self, utc_ns: int) -> AxisReport:
        """Return its state as known at an instant."""


@dataclass(frozen=True, slots=True)
class Focuser:
    """A focuser of one to three axes."""

    axes: Sequence[FocusAxis]

    def report(self, utc_ns: int) -> FocusReport:
        """Return the state of all axes as known at an instant; an axis of unknown place counts as moving."""
        reports = tuple(axis.report(utc_ns) for axis in self.axes)
        known = [report for report in reports if report.actual_mm is not None]
        moving = len(known) < len(reports) or any(report.moving for report in known)
        return FocusReport(reports, min((report.epoch_ns for report in known), default=utc_ns), moving)

    def known(self, utc_ns: int) -> bool:
        """Return whether the places of all axes are known at an instant."""
        return all(axis.report(utc_ns).actual_mm is not None for axis in self.axes)

    def stop(self, utc_ns: int) -> None:
        """Stop all axes."""
        for axis in self.axes:
            axis.stop(utc_ns)


class Sensors(NamedTuple):
    """The readings of the antenna's sensors; None where there is none."""

    first_tilt_deg: float | None = None
    second_tilt_deg: float | None = None
    first_drive_a: float | None = None
    second_drive_a: float | None = None


class Feedback:
    """The state of the antenna as its controller reads it; this one knows nothing."""

    link_up = False
    on_trajectory = False
    """Whether the antenna is on its trajectory."""
    outside_limits = False
    """Whether the trajectory leads beyond the limits."""
    tripped: str | None = None
    """Name of the interlock that has stopped the antenna."""
    does_refraction = False
    sensors: Sensors | None = None
    first_deg: float | None = None
    """Where the first axis was heard last, turns counted; None where it was not, or has no turns."""

    def actual(self, utc_ns: int) -> AxisState | None:
        """Return the state of the axes at an instant; None where it is not known."""
        del utc_ns
        return None


@dataclass(frozen=True, slots=True)
class Antenna:
    """The configuration of an antenna. Positions are those of its axes, degrees."""

    sky: SiteSky
    axes: AxisKind
    range: AxisRange
    stow: tuple[float, float] | None = None
    service: tuple[float, float] | None = None
    focuser: Focuser | None = None
    refraction: Literal["auto", "on", "off"] = "auto"
    """Whether satellites' directions are refracted; auto: where the mount does not do it."""
    check: Checksum = Checksum.SUM


MOVE_RATE_MM_S = 2.0
LEAST_MM, MOST_MM = -50.0, 50.0
OLDEST_NS = 3 * NS
"""An older position is not used."""


def swept_mm(from_mm: float, rate_mm_s: float, seconds: float, least_mm: float, most_mm: float) -> float:
    """Return the position in a sweep that began at a place and went up first."""
    # As on a loop: up from the least to the most and down again.
    span = most_mm - least_mm
    gone = (from_mm - least_mm + rate_mm_s * seconds) % (2.0 * span)
    return least_mm + min(gone, 2.0 * span - gone)


@dataclass(slots=True)
class SimulatedFocusAxis:
    """A simulated axis; see `FocusAxis`."""

    least_mm: float = LEAST_MM
    most_mm: float = MOST_MM
    _from_mm: float = 0.0
    _to_mm: float = 0.0
    _since_ns: int = 0
    _sweep_mm_s: float = 0.0

    def move(self, to_mm: float, utc_ns: int) -> None:
        """See FocusAxis."""
        self.stop(utc_ns)
        self._to_mm = max(self.least_mm, min(self.most_mm, to_mm))

    def sweep(self, rate_mm_s: float, utc_ns: int) -> None:
        """See FocusAxis."""
        self.stop(utc_ns)
        self._sweep_mm_s = rate_mm_s

    def stop(self, utc_ns: int) -> None:
        """See FocusAxis."""
        self._from_mm = self._to_mm = self._at(utc_ns)
        self._since_ns, self._sweep_mm_s = utc_ns, 0.0

    def report(self, utc_ns: int) -> AxisReport:
        """See FocusAxis."""
        place_mm = self._at(utc_ns)
        if self._sweep_mm_s:
            return AxisReport(None, place_mm, utc_ns, moving=True)
        return AxisReport(self._to_mm, place_mm, utc_ns, moving=place_mm != self._to_mm)

    def _at(self, utc_ns: int) -> float:
        seconds = max(0.0, (utc_ns - self._since_ns) / NS)
        if self._sweep_mm_s:
            return swept_mm(self._from_mm, self._sweep_mm_s, seconds, self.least_mm, self.most_mm)
        distance = self._to_mm - self._from_mm
        gone = MOVE_RATE_MM_S * seconds
        return self._to_mm if gone >= abs(distance) else self._from_mm + math.copysign(gone, distance)


class FocusOrder(msgspec.Struct, frozen=True):
    """An order to one axis: go to a place, sweep, or, with neither, stop. Serials count up from 1."""

    serial: int
    to_mm: float | None = None
    sweep_mm_s: float | None = None


class FocusAxisState(msgspec.Struct, frozen=True):
    """The state of one remote axis, with the serial of the last order that it has begun."""

    monotonic_s: float
    mm: float | None
    """None where it is not known."""
    moving: bool
    serial: int
    least_mm: float = 0.0
    most_mm: float = 0.0
    trouble: str = ""


@dataclass(slots=True)
class RemoteAxis:
    """An axis driven by another process; see `FocusAxis`. `orders` wait to be sent to it."""

    least_mm: float
    most_mm: float
    orders: list[FocusOrder] = field(default_factory=list)
    _serial: int = 0
    _commanded_mm: float | None = None
    _state: FocusAxisState | None = None
    _measured_ns: int = 0

    def move(self, to_mm: float, utc_ns: int) -> None:
        """See FocusAxis."""
        del utc_ns
        self._order(to_mm=max(self.least_mm, min(self.most_mm, to_mm)))

    def sweep(self, rate_mm_s: float, utc_ns: int) -> None:
        """See FocusAxis."""
        del utc_ns
        self._order(sweep_mm_s=rate_mm_s)

    def stop(self, utc_ns: int) -> None:
        """See FocusAxis."""
        del utc_ns
        self._order()

    def hear(self, state: FocusAxisState, at_ns: int) -> None:
        """Take its state, measured at an instant."""
        self._state, self._measured_ns = state, at_ns

    def report(self, utc_ns: int) -> AxisReport:
        """See FocusAxis; it moves until it has begun its last order."""
        state = self._state
        if state is None or utc_ns - self._measured_ns > OLDEST_NS:
            return AxisReport(self._commanded_mm, None, self._measured_ns, moving=True)
        moving = state.moving or state.serial != self._serial
        return AxisReport(self._commanded_mm, state.mm, self._measured_ns, moving)

    def _order(self, to_mm: float | None = None, sweep_mm_s: float | None = None) -> None:
        self._serial += 1
        self._commanded_mm = to_mm
        self.orders.append(FocusOrder(self._serial, to_mm, sweep_mm_s))


def handle_focus(focuser: Focuser | None, request: AntennaRequest, now_ns: int) -> str | Nak | None:
    """Carry out one command of the focus, where there is one."""
    if focuser is None:
        return Nak.NOT_AVAILABLE
    word = request.command.word
    if word == "FOCPS":
        return _position(focuser, now_ns)
    if word == "FOCSTOP":
        focuser.stop(now_ns)
        return None
    return _move(focuser, request, now_ns) if word == "FOCUS" else _sweep(focuser, request, now_ns)


def _move(focuser: Focuser, request: AntennaRequest, now_ns: int) -> Nak | None:
    places = [None if value is None else float(value) for value in request.values.values()]
    if any(place is not None for place in places[len(focuser.axes) :]):
        return Nak.NOT_AVAILABLE
    if not focuser.known(now_ns):
        return Nak.STATE
    moves = [(axis, mm) for axis, mm in zip(focuser.axes, places, strict=False) if mm is not None]
    if not all(axis.least_mm <= mm <= axis.most_mm for axis, mm in moves):
        return Nak.RANGE
    for axis, mm in moves:
        axis.move(mm, now_ns)
    return None


def _sweep(focuser: Focuser, request: AntennaRequest, now_ns: int) -> Nak | None:
    number = int(request.number("axis"))
    if number > len(focuser.axes):
        return Nak.NOT_AVAILABLE
    if not focuser.known(now_ns):
        return Nak.STATE
    focuser.axes[number - 1].sweep(request.number("rate"), now_ns)
    return None


def _position(focuser: Focuser, now_ns: int) -> str:
    report = focuser.report(now_ns)
    fields = ["FOCPS"]
    for axis in report.axes:
        fields += [OMITTED if mm is None else f"{mm:.4f}" for mm in (axis.commanded_mm, axis.actual_mm)]
    fields += [f"{second_of_day(report.epoch_ns):.6f}", "MOVING" if report.moving else "STOPPED"]
    return " ".join(fields)
