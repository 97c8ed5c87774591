"""The mounts of a storm: `bench/strangers` and the package's own, and what befalls their programs."""

from __future__ import annotations

import importlib
import math
import random
from typing import TYPE_CHECKING, Any, NamedTuple

from axes_anywhere import Tube
from family import parameters_of, servo_of
from feeder_harness import Timer as WindowsTimer

from sattrack.mount.model import SIDEREAL_RATE_DEG_S
from sattrack.mount.simulator.installation import DRIVES
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.simulator.profile import SimulatorProfile
from storm.others import drives_deg

if TYPE_CHECKING:
    from axes_anywhere import AxesDraw

    from storm.draws import Storm

USUAL_PERIOD_S = 0.05
FREE_DEG = 300.0
"""The mounts' own limits: wider than any that is commanded, so that a violation shows."""


class Axes(NamedTuple):
    """Where the axes really are: degrees with turns counted, degrees a second, as of a turn of the loop."""

    utc_s: float
    hour_angle_deg: float
    dec_axis_deg: float
    hour_angle_rate_deg_s: float
    dec_rate_deg_s: float

    @property
    def speed_deg_s(self) -> float:
        """How fast the faster axis is, against standstill or the sky."""
        ha = self.hour_angle_rate_deg_s
        return max(min(abs(ha), abs(ha - SIDEREAL_RATE_DEG_S)), abs(self.dec_rate_deg_s))


class Stranger:
    """A mount of `bench/strangers`."""

    def __init__(self, storm: Storm) -> None:
        self._storm = storm
        self._module = importlib.import_module(f"strangers.{storm.hardware.kind}")
        self._switch_on(storm.begin_s, storm.stands, storm.seed)

    def _switch_on(self, utc_s: float, stands: tuple[float, float], seed: int) -> None:
        storm, hard = self._storm, self._storm.hardware
        drawn = parameters_of(hard) | {
            "latitude_deg": storm.facts.site.latitude_deg,
            "longitude_deg": storm.facts.site.longitude_deg,
            "start_utc_s": utc_s,
            "hour_angle_deg": stands[0],
            "dec_deg": stands[1],
            "seed": seed,
        }
        drawn |= {"tracking": hard.tracking} | storm.parameters
        self.mount: Any = self._module.Mount(self._module.Parameters(**drawn))

    @property
    def next_turn_s(self) -> float:
        return float(self.mount.next_turn_s)

    def hold_up(self, until_s: float) -> None:
        """Have the program stand still until an instant; the drives go on."""
        late_s = until_s - self.mount.next_turn_s
        if late_s > 0.0:
            self.mount.next_turn_s = until_s
            if hasattr(self.mount, "turn_s"):
                self.mount.turn_s += late_s

    def receive(self, data: bytes) -> None:
        self.mount.receive(data)

    def turn(self) -> bytes:
        return bytes(self.mount.turn())

    def truth(self) -> Axes:
        return Axes(*self.mount.truth()[:5])

    def crash(self, utc_s: float) -> None:
        """End the program; the drives brake with it."""
        del utc_s

    def restart(self, utc_s: float) -> None:
        truth = self.truth()
        self._switch_on(utc_s, (truth.hour_angle_deg, truth.dec_axis_deg), self._storm.seed + 1)

    def fail_drives(self, utc_s: float) -> None:
        raise NotImplementedError

    def step_clock(self, seconds: float) -> None:
        """Set its clock, which each of these mounts keeps in a place of its own."""
        if hasattr(self.mount, "lst_at_start"):
            self.mount.lst_at_start += SIDEREAL_RATE_DEG_S * seconds
            return
        parameters = self.mount.p if hasattr(self.mount, "p") else self.mount._p
        # The parameters are frozen, and a mount that is switched on anew would stand still.
        object.__setattr__(parameters, "clock_error_s", parameters.clock_error_s + seconds)


class Turned(Stranger):
    """One whose axes point anywhere, and whose drives count from anywhere."""

    def __init__(self, storm: Storm, axes: AxesDraw) -> None:
        self._axes, self._tube = axes, Tube(axes)
        super().__init__(storm)

    def _switch_on(self, utc_s: float, stands: tuple[float, float], seed: int) -> None:
        super()._switch_on(utc_s, drives_deg(self._axes, stands), seed)

    def turn(self) -> bytes:
        return self._tube.status(super().turn())

    def truth(self) -> Axes:
        one, (first, second) = super().truth(), self._axes.senses
        zeros = self._axes.zeros_deg
        return Axes(
            one.utc_s,
            first * (one.hour_angle_deg - zeros[0]),
            second * (one.dec_axis_deg - zeros[1]),
            first * one.hour_angle_rate_deg_s,
            second * one.dec_rate_deg_s,
        )


class Own:
    """The package's simulated mount."""

    def __init__(self, storm: Storm) -> None:
        from msgspec.structs import replace

        hard, site, rule = storm.hardware, storm.facts.site, storm.facts.profile.pier_rule
        settings = SimulatorProfile(
            clock_offset_s=0.0,
            encoder_noise_tics=0.5,
            servo=servo_of(hard),
            seed=storm.seed,
            hard_margin_deg=30.0,
            flip=rule,
            # A mount that flips is assembled so that its encoders tell all places it goes to from each other.
            ra_encoder_zero_deg=-90.0 if rule == "ascom" else 0.0,
            dec_encoder_zero_deg=0.0 if rule == "never" else math.copysign(90.0, -site.latitude_deg),
        )
        told = storm.facts.profile
        ra, dec = (
            replace(axis, max_acceleration_deg_s2=hard.acceleration_deg_s2)
            # An axis that is slower than the other accelerates as much less as its profile says.
            if axis.max_acceleration_deg_s2 == hard.told_acceleration_deg_s2
            else replace(axis, max_acceleration_deg_s2=1.25 * axis.max_acceleration_deg_s2)
            for axis in (told.ra, told.dec)
        )
        profile = replace(
            told,
            ra=ra,
            dec=dec,
            hour_angle_limit_deg=FREE_DEG,
            dec_axis_limits_deg=(-FREE_DEG, FREE_DEG),
        )
        place = SimulatedSite(site.latitude_deg, site.longitude_deg, 0.0)
        self.mount = SimulatedMount(profile, place, StartPosition(*storm.stands), settings)
        self._timer = WindowsTimer(storm.begin_s, random.Random(storm.seed))
        self._period_s = storm.facts.profile.period_s
        self._even = hard.timer == "even" or self._period_s != USUAL_PERIOD_S
        self.next_turn_s = storm.begin_s
        self._truth: Any = None

    def hold_up(self, until_s: float) -> None:
        self.next_turn_s = max(self.next_turn_s, until_s)

    def receive(self, data: bytes) -> None:
        self.mount.receive(data)

    def turn(self) -> bytes:
        status, self._truth = self.mount.tick(self.next_turn_s)
        self._schedule()
        return bytes(status)

    def _schedule(self) -> None:
        after_s = self.next_turn_s
        following_s = after_s + self._period_s
        while not self._even:
            following_s = self._timer.following()
            if following_s > after_s:
                break
        self.next_turn_s = following_s

    def truth(self) -> Axes:
        t = self._truth
        rate = SIDEREAL_RATE_DEG_S - t.ra_rate_deg_s
        return Axes(t.utc_s, t.hour_angle_axis_deg, t.dec_axis_deg, rate, t.dec_rate_deg_s)

    def crash(self, utc_s: float) -> None:
        self.mount.crash(utc_s)

    def restart(self, utc_s: float) -> None:
        self.mount.restart(utc_s)
        self.next_turn_s = max(self.next_turn_s, utc_s)

    def fail_drives(self, utc_s: float) -> None:
        self.mount.fail_drives(DRIVES["drive"], utc_s)

    def step_clock(self, seconds: float) -> None:
        self.mount.step_clock(seconds)


Mount = Stranger | Own


def mount_of(storm: Storm) -> Mount:
    axes = None if storm.other is None else storm.other.axes
    if axes is not None:
        return Turned(storm, axes)
    return Own(storm) if storm.hardware.kind == "own" else Stranger(storm)
