"""A calibration run in real time, over UDP."""

from __future__ import annotations

import math
import os
import sys
import termios
import time
import tty
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from sattrack.calibration.axes_in_space import AxesFinder
from sattrack.calibration.calibrator import Calibrator
from sattrack.calibration.guard import FLOOR_ALTITUDE_DEG, EndKind, Plan, Surroundings, sun_hour_angle_and_dec
from sattrack.core.angles import altitude_deg, separation_deg
from sattrack.core.errors import BadInputError, InterruptedRunError, SattrackError, error_type
from sattrack.mount.alpaca.link import AlpacaAddress
from sattrack.mount.profiles import ProfileFile, load_profile_file
from sattrack.mount.simulator.mount import StartPosition
from sattrack.pointing.fields import FieldSky, Solved
from sattrack.runtime import demo_pass
from sattrack.runtime.connection import Connection, owned, simulator_config, start_embedded
from sattrack.runtime.loop import RealtimeLoop
from sattrack.runtime.system import StopRequest, stopping
from sattrack.safety import SafetyLimits
from sattrack.safety.bounds import Bounds
from tle.refraction import Refraction

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from sattrack.calibration.calibrator import Ending
    from sattrack.core.clock import Clock
    from sattrack.mount.alpaca.device import DeviceFacts
    from sattrack.mount.model import MountProfile
    from sattrack.mount.xerxes.client import UdpLink
    from sattrack.pointing.fields import FieldCamera
    from sattrack.runtime.connection import EmbeddedMount
    from sattrack.runtime.mounts import MountAddress
    from tle.site import Site

SHOW_EVERY_S = 0.2
CLEAR_BY_DEG = 8.0
_KEY_BYTES = 64
_INPUT_FLAGS = 0


def surroundings(
    site: Site, profile: MountProfile, utc_s: float, limits: SafetyLimits | None = None
) -> Surroundings:
    """Return what the run must keep clear of at an instant; the floor is never below FLOOR_ALTITUDE_DEG.

    Raises TimeRangeError where the Earth's orientation is not known.
    """
    limits = SafetyLimits() if limits is None else limits
    sun_hour_angle_deg, sun_dec_deg = sun_hour_angle_and_dec(utc_s, site)
    bounds = Bounds(profile, limits, site.latitude_deg, site.longitude_deg)
    bounds.look(utc_s, 0.0)
    return Surroundings(
        latitude_deg=site.latitude_deg,
        longitude_deg=site.longitude_deg,
        sun_hour_angle_deg=sun_hour_angle_deg,
        sun_dec_deg=sun_dec_deg,
        hour_angle_limit_deg=profile.hour_angle_limit_deg,
        floor_altitude_deg=max(FLOOR_ALTITUDE_DEG, limits.floor_altitude_deg),
        bounds=bounds,
        first_axis_middle_deg=profile.first_axis_middle_deg,
    )


def start_practice_mount(
    around: Surroundings, site: Site, clock: Clock, sim_profile: Path | None
) -> EmbeddedMount:
    """Start a simulated mount that stands clear; `sim_profile` describes it, else it is the default one.

    Raises BadInputError for a bad profile, SattrackError where the mount does not come up.
    """
    described = ProfileFile() if sim_profile is None else load_profile_file(sim_profile)
    start = _clear_start(around)
    return start_embedded(simulator_config(described.mount, described.simulator, site, clock, start))


def _clear_start(around: Surroundings) -> StartPosition:
    """Return a place high and far from the Sun; where there is none, one that is refused with reasons."""
    place = demo_pass.START
    for hour_angle_deg in (50.0, -50.0, 20.0, -20.0):
        for nearer_equator_deg in (35.0, 15.0, -10.0):
            north = math.copysign(1.0, around.latitude_deg)
            place = StartPosition(hour_angle_deg, around.latitude_deg - north * nearer_equator_deg)
            high = altitude_deg(place.hour_angle_deg, place.dec_deg, around.latitude_deg)
            off_sun = separation_deg(
                place.hour_angle_deg, place.dec_deg, around.sun_hour_angle_deg, around.sun_dec_deg
            )
            if (
                high > around.floor_altitude_deg + CLEAR_BY_DEG
                and off_sun > around.sun_cone_deg + CLEAR_BY_DEG
            ):
                return place
    return place


def calibrate_live(
    around: Surroundings,
    address: MountAddress,
    clock: Clock,
    show: Callable[[str, float], None],
    plan: Plan | None = None,
    profile: MountProfile | None = None,
    owned_as: str | None = None,
) -> Calibrator:
    """Run a calibration to its end, and return it; `show` hears the phase and the part done.

    `owned_as` is the mount's name, that of its address where it is None.

    Any key on the terminal, and any signal that would end the process, brings the mount to rest and ends the
    run. Raises SattrackError where the port is not available.
    """
    if profile is not None and profile.geometry is not None:
        raise BadInputError(
            f"the profile {profile.name!r} has a geometry: rates of such a mount are not calibrated yet"
        )
    with ExitStack() as signals, ExitStack() as stack:
        link, guard = stack.enter_context(owned(address, profile, clock.speed, owned_as))
        stop = StopRequest()
        signals.enter_context(stopping(stop))
        keys = stack.enter_context(any_key())
        largest = link.largest_rates_deg_s
        try:
            period_s = (profile or address.usual_profile()).period_s
            plan = (plan or Plan()).suited(None if largest is None else min(largest), period_s)
        except ValueError as error:
            raise SattrackError(f"{address}: {error}") from error
        calibrator = Calibrator(around, clock.utc_s(time.monotonic()), plan)
        calibrator.largest_rates_deg_s = largest
        calibrator.alignment_mode = _alignment_mode(link)
        CalibrationLoop(Connection(link, clock, guard=guard), stop, calibrator, show, keys).run()
        ending = calibrator.ending
        if ending is not None and ending.kind is not EndKind.DONE and link.trouble is not None:
            calibrator.ending = replace(ending, words=f"{ending.words}; {link.trouble}")
    return calibrator


def find_axes_live(
    address: MountAddress,
    clock: Clock,
    show: Callable[[str, float], None],
    described: tuple[MountProfile, SafetyLimits, Site],
    owned_as: str | None = None,
    camera: FieldCamera | None = None,
) -> tuple[AxesFinder, int | None]:
    """Make the motions that tell how a mount's axes lie; return them, and a telescope's AlignmentMode.

    With `camera`, what it solves says where the tube points, else what the mount reports does.
    Interrupted as `calibrate_live`. Raises SattrackError where the port is not available, or the mount cannot
    be moved on.
    """
    profile, limits, site = described
    if isinstance(address, AlpacaAddress):
        address = address._replace(axes_known=True)
    with ExitStack() as signals, ExitStack() as stack:
        link, guard = stack.enter_context(owned(address, profile, clock.speed, owned_as))
        stop = StopRequest()
        signals.enter_context(stopping(stop))
        keys = stack.enter_context(any_key())
        place = (site.latitude_deg, site.longitude_deg)
        fastest = link.largest_rates_deg_s
        fields, now_utc_s = None, clock.utc_s(time.monotonic())
        if camera is not None:
            fields = camera, FieldSky(site, Refraction.standard(site.height_m))
            # The tables are loaded before the loop begins, which that would hold up.
            fields[1].seen(Solved(now_utc_s, 0.0, (0.0, 0.0)))
        finder = AxesFinder(profile, limits, place, now_utc_s, fastest, fields)
        FinderLoop(Connection(link, clock, guard=guard), stop, finder, show, keys).run()
        return finder, _alignment_mode(link)


def _alignment_mode(link: UdpLink) -> int | None:
    facts: DeviceFacts | None = getattr(link, "facts", None)
    return None if facts is None else facts.alignment_mode


@dataclass(slots=True)
class FinderLoop(RealtimeLoop):
    """Feeds the motions that tell how axes lie, to their end; `keys` as in `CalibrationLoop`."""

    reported = (SattrackError,)

    driver: AxesFinder
    show: Callable[[str, float], None]
    keys: int | None

    def readers(self) -> list[Any]:
        """See RealtimeLoop."""
        return [] if self.keys is None else [self.keys]

    def serve(self, ready: list[Any]) -> None:
        """Stop the mount at a key."""
        if self.keys is not None and self.keys in ready:
            if not os.read(self.keys, _KEY_BYTES):
                self.keys = None
            self.driver.end(InterruptedRunError("stopped by a key"))

    def interrupt(self, now_utc_s: float) -> None:
        """See RealtimeLoop."""
        del now_utc_s
        self.driver.end(InterruptedRunError("interrupted"))

    def fail(self, error: Exception, now_utc_s: float) -> None:
        """See RealtimeLoop."""
        del now_utc_s
        self.driver.end(SattrackError(str(error)))

    def report(self) -> None:
        """Show how far it has come."""
        if self.ticks % 4 == 0:
            self.show(self.driver.phase, self.driver.part_done)


@dataclass(slots=True)
class CalibrationLoop(RealtimeLoop):
    """Feeds one calibration to its end; `keys` is a descriptor that becomes readable at a key."""

    reported = (SattrackError,)

    driver: Calibrator
    show: Callable[[str, float], None]
    keys: int | None
    _shown_s: float = field(default=float("-inf"), init=False)

    def due_s(self) -> float:
        """Return when the calibrator wants the next datagram to leave, by the monotonic clock."""
        now_s, clock = time.monotonic(), self.connection.clock
        return now_s + (self.driver.due() - clock.utc_s(now_s)) / clock.speed

    def readers(self) -> list[Any]:
        """See RealtimeLoop."""
        return [] if self.keys is None else [self.keys]

    def serve(self, ready: list[Any]) -> None:
        """Stop the mount at a key."""
        if self.keys is None or self.keys not in ready:
            return
        # A terminal that is gone is read as an end: that is a reason to stop, too.
        if not os.read(self.keys, _KEY_BYTES):
            self.keys = None
        self.driver.stop("stopped by a key")

    def interrupt(self, now_utc_s: float) -> None:
        """See RealtimeLoop."""
        del now_utc_s
        self.driver.stop("interrupted")

    def fail(self, error: Exception, now_utc_s: float) -> None:
        """See RealtimeLoop."""
        del now_utc_s
        self.driver.fail(str(error))

    def sent(self, now_utc_s: float, datagram: bytes) -> None:
        """Let the run go on, with the instant at which the datagram left."""
        del now_utc_s, datagram
        self.driver.sent(self.connection.now_utc_s())

    def report(self) -> None:
        """Show how far the run has come."""
        now_s = time.monotonic()
        if now_s - self._shown_s >= SHOW_EVERY_S:
            self._shown_s = now_s
            self.show(self.driver.phase, self.driver.part_done)


def ending_error(ending: Ending) -> SattrackError | None:
    """Return the error that a run ended with, its class by the exit code; None where the run is done."""
    if ending.kind is EndKind.DONE and ending.at_rest:
        return None
    words = ending.words or "the run is done"
    if ending.at_rest:
        words += "; the mount was stopped and seen at rest"
    elif ending.at_rest is None:
        words += "; nothing was moved"
    else:
        words += "; the mount was NOT seen at rest: look after it, and stop it by its own console"
    return error_type(ending.kind)(words)


@contextmanager
def any_key() -> Iterator[int | None]:
    """Give the descriptor that becomes readable at a key, with the terminal set so that each counts."""
    if not sys.stdin.isatty():
        yield None
        return
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    attributes = termios.tcgetattr(descriptor)
    # With flow control, Ctrl-S would not be a key, and would hold up whoever writes to the terminal.
    attributes[_INPUT_FLAGS] &= ~termios.IXON
    termios.tcsetattr(descriptor, termios.TCSANOW, attributes)
    termios.tcflush(descriptor, termios.TCIFLUSH)
    try:
        yield descriptor
    finally:
        termios.tcflush(descriptor, termios.TCIFLUSH)
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
