"""The equipment of an antenna: its axes, its sensors, and its focuser, simulated or remote. No I/O.

"Ideal Field System Antenna Interface", section 6.0. Positions in mm; instants in nanoseconds of UTC. The
response to a command never waits for the focuser: it reports the last known position and its instant.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

import msgspec

from sattrack.servers.antenna.protocol import NS, OMITTED, AntennaRequest, Checksum, Nak, second_of_day

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.servers.antenna.trajectory import AxisKind, AxisRange, AxisState, SiteSky


class AxisPlace(NamedTuple):
    """One axis: its commanded place (None in a sweep, or before a command), and its actual one, if known."""

    commanded_mm: float | None
    actual_mm: float | None


class FocusReport(NamedTuple):
    """All axes of a focuser, the instant of their places, and whether any of them moves."""

    axes: tuple[AxisPlace, ...]
    epoch_ns: int
    moving: bool


class Focuser(Protocol):
    """A focuser of one to three axes. No method waits for a motion."""

    @property
    def count(self) -> int:
        """Number of axes."""

    @property
    def reach_mm(self) -> Sequence[tuple[float, float]]:
        """The least and the greatest place of each axis."""

    def heard(self, utc_ns: int) -> bool:
        """Return whether all axes are reachable at an instant."""

    def move(self, places_mm: Sequence[float | None], utc_ns: int) -> None:
        """Send axes to places within their reach; None leaves an axis as it is."""

    def sweep(self, axis: int, rate_mm_s: float, utc_ns: int) -> None:
        """Send one axis, counted from 0, from limit to limit and back at a uniform rate, up first."""

    def stop(self, utc_ns: int) -> None:
        """Stop all axes."""

    def report(self, utc_ns: int) -> FocusReport:
        """Return the places of the axes as known at an instant."""


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
class FocusAxis:
    """One simulated axis: moves from a place to another, or to and fro between the limits."""

    _from_mm: float = 0.0
    _to_mm: float = 0.0
    _since_ns: int = 0
    _sweep_mm_s: float = 0.0

    def at(self, utc_ns: int) -> tuple[float, bool]:
        """Return its place at an instant, and whether it moves."""
        seconds = max(0.0, (utc_ns - self._since_ns) / NS)
        if self._sweep_mm_s:
            return swept_mm(self._from_mm, self._sweep_mm_s, seconds, LEAST_MM, MOST_MM), True
        distance = self._to_mm - self._from_mm
        gone = min(abs(distance), MOVE_RATE_MM_S * seconds)
        return self._from_mm + (gone if distance > 0.0 else -gone), gone < abs(distance)

    @property
    def commanded_mm(self) -> float | None:
        """The commanded place; None while it sweeps."""
        return None if self._sweep_mm_s else self._to_mm

    def move(self, to_mm: float, utc_ns: int) -> None:
        """Go to a place, at most to a limit."""
        self._begin(utc_ns)
        self._to_mm = max(LEAST_MM, min(MOST_MM, to_mm))

    def sweep(self, rate_mm_s: float, utc_ns: int) -> None:
        """Go from limit to limit and back, up first."""
        self._begin(utc_ns)
        self._sweep_mm_s = rate_mm_s

    def stop(self, utc_ns: int) -> None:
        """Stand where it is."""
        self._begin(utc_ns)
        self._to_mm = self._from_mm

    def _begin(self, utc_ns: int) -> None:
        self._from_mm, _ = self.at(utc_ns)
        self._since_ns, self._sweep_mm_s = utc_ns, 0.0


@dataclass(slots=True)
class SimulatedFocuser:
    """All axes of a simulated focuser; see `Focuser`."""

    axes: Sequence[FocusAxis] = field(default_factory=lambda: (FocusAxis(),))

    @property
    def count(self) -> int:
        """See Focuser."""
        return len(self.axes)

    @property
    def reach_mm(self) -> Sequence[tuple[float, float]]:
        """See Focuser."""
        return [(LEAST_MM, MOST_MM)] * self.count

    def heard(self, utc_ns: int) -> bool:
        """See Focuser."""
        del utc_ns
        return True

    def move(self, places_mm: Sequence[float | None], utc_ns: int) -> None:
        """See Focuser."""
        for axis, place_mm in zip(self.axes, places_mm, strict=False):
            if place_mm is not None:
                axis.move(place_mm, utc_ns)

    def sweep(self, axis: int, rate_mm_s: float, utc_ns: int) -> None:
        """See Focuser."""
        self.axes[axis].sweep(rate_mm_s, utc_ns)

    def stop(self, utc_ns: int) -> None:
        """See Focuser."""
        for axis in self.axes:
            axis.stop(utc_ns)

    def report(self, utc_ns: int) -> FocusReport:
        """See Focuser."""
        there = [axis.at(utc_ns) for axis in self.axes]
        places = tuple(
            AxisPlace(axis.commanded_mm, place_mm)
            for axis, (place_mm, _) in zip(self.axes, there, strict=True)
        )
        return FocusReport(places, utc_ns, any(moves for _, moves in there))


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
    """One axis driven by another process: `orders` wait to be sent to it."""

    least_mm: float
    most_mm: float
    orders: list[FocusOrder] = field(default_factory=list)
    _serial: int = 0
    _commanded_mm: float | None = None
    _state: FocusAxisState | None = None
    measured_ns: int = 0
    """When its state was measured."""

    def order(self, to_mm: float | None = None, sweep_mm_s: float | None = None) -> None:
        """Queue an order."""
        if to_mm is not None:
            to_mm = max(self.least_mm, min(self.most_mm, to_mm))
        self._serial += 1
        self._commanded_mm = to_mm
        self.orders.append(FocusOrder(self._serial, to_mm, sweep_mm_s))

    def hear(self, state: FocusAxisState, at_ns: int) -> None:
        """Take its state, measured at an instant."""
        self._state, self.measured_ns = state, at_ns

    def known(self, utc_ns: int) -> bool:
        """Return whether its place is known at an instant."""
        state = self._state
        return state is not None and state.mm is not None and utc_ns - self.measured_ns <= OLDEST_NS

    @property
    def moving(self) -> bool:
        """Whether it moves, or has not begun its last order yet."""
        state = self._state
        return state is None or state.moving or state.serial != self._serial

    def place(self, utc_ns: int) -> AxisPlace:
        """Return its commanded place, and its actual one as far as it is known."""
        known = self._state if self.known(utc_ns) else None
        return AxisPlace(self._commanded_mm, None if known is None else known.mm)


@dataclass(slots=True)
class RemoteFocuser:
    """All axes of a focuser driven by other processes; see `Focuser`."""

    axes: Sequence[RemoteAxis]

    @property
    def count(self) -> int:
        """See Focuser."""
        return len(self.axes)

    @property
    def reach_mm(self) -> Sequence[tuple[float, float]]:
        """See Focuser."""
        return [(axis.least_mm, axis.most_mm) for axis in self.axes]

    def heard(self, utc_ns: int) -> bool:
        """See Focuser."""
        return all(axis.known(utc_ns) for axis in self.axes)

    def move(self, places_mm: Sequence[float | None], utc_ns: int) -> None:
        """See Focuser."""
        del utc_ns
        for axis, place_mm in zip(self.axes, places_mm, strict=False):
            if place_mm is not None:
                axis.order(to_mm=place_mm)

    def sweep(self, axis: int, rate_mm_s: float, utc_ns: int) -> None:
        """See Focuser."""
        del utc_ns
        self.axes[axis].order(sweep_mm_s=rate_mm_s)

    def stop(self, utc_ns: int) -> None:
        """See Focuser."""
        del utc_ns
        for axis in self.axes:
            axis.order()

    def report(self, utc_ns: int) -> FocusReport:
        """See Focuser: the epoch is the oldest instant at which any of its axes was measured.

        An axis whose place is not known has not been seen to stand.
        """
        known = [axis for axis in self.axes if axis.known(utc_ns)]
        places = tuple(axis.place(utc_ns) for axis in self.axes)
        moving = len(known) < self.count or any(axis.moving for axis in known)
        return FocusReport(places, min((axis.measured_ns for axis in known), default=utc_ns), moving)


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
    if any(place is not None for place in places[focuser.count :]):
        return Nak.NOT_AVAILABLE
    if not focuser.heard(now_ns):
        return Nak.STATE
    for place, (least_mm, most_mm) in zip(places, focuser.reach_mm, strict=False):
        if place is not None and not least_mm <= place <= most_mm:
            return Nak.RANGE
    focuser.move(places[: focuser.count], now_ns)
    return None


def _sweep(focuser: Focuser, request: AntennaRequest, now_ns: int) -> Nak | None:
    axis = int(request.number("axis"))
    if axis > focuser.count:
        return Nak.NOT_AVAILABLE
    if not focuser.heard(now_ns):
        return Nak.STATE
    focuser.sweep(axis - 1, request.number("rate"), now_ns)
    return None


def _position(focuser: Focuser, now_ns: int) -> str:
    report = focuser.report(now_ns)
    fields = ["FOCPS"]
    for place in report.axes:
        fields += [OMITTED if mm is None else f"{mm:.4f}" for mm in place]
    fields += [f"{second_of_day(report.epoch_ns):.6f}", "MOVING" if report.moving else "STOPPED"]
    return " ".join(fields)
