"""What a simulated mount is made of, beyond its `MountProfile`: clock, timer, drives, link and habits."""

from __future__ import annotations

import math
from typing import Any, Literal

import msgspec

from sattrack.core.errors import BadInputError, refused_key

TimerLaw = Literal["exact", "windows", "windows_rearmed"]
MOST_DRIFT_PPM = 10_000.0
MOST_DELAY_S = 5.0


def _check_positive(settings: object, *names: str) -> None:
    for name in names:
        value = getattr(settings, name)
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} is {value:g}; it must be above 0")


def _check_not_negative(settings: object, *names: str) -> None:
    for name in names:
        value = getattr(settings, name)
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"{name} is {value:g}; it must be 0 or more")


class ServoSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How both direct drives follow what is asked of them.

    `bandwidth_hz` and `damping` are those of the position loop. Forces are given as the drive current that
    balances them: `inertia_a_per_deg_s2` is the inertia over the torque constant, `friction_a` the Coulomb
    friction, `stiction_a` what it takes to break loose (0: the same), `ripple_a` the amplitude of the torque
    ripple, `ripple_per_turn` its periods in a turn of the axis. `friction_feedforward` is the share of the
    friction that the drive compensates without an error having to arise, `integral_hz` the corner of the
    servo's integral part, 0 for none. `current_limit_a` is the drive's own limit, none where it is left out.
    """

    bandwidth_hz: float = 5.0
    damping: float = 1.0
    integral_hz: float = 0.0
    inertia_a_per_deg_s2: float = 0.15
    friction_a: float = 0.5
    stiction_a: float = 0.0
    friction_feedforward: float = 1.0
    ripple_a: float = 0.0
    ripple_per_turn: int = 60
    current_limit_a: float | None = None

    def __post_init__(self) -> None:
        """Raise ValueError, naming the field, where a number cannot be one of a servo."""
        _check_positive(self, "bandwidth_hz", "damping", "inertia_a_per_deg_s2", "ripple_per_turn")
        _check_not_negative(
            self, "integral_hz", "friction_a", "stiction_a", "friction_feedforward", "ripple_a"
        )
        if self.current_limit_a is not None:
            _check_positive(self, "current_limit_a")
        if 0.0 < self.stiction_a < self.friction_a:
            raise ValueError(
                f"stiction_a is {self.stiction_a:g}, below friction_a, {self.friction_a:g}; "
                "it takes more to break loose than to keep moving"
            )


class SimulatorProfile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A simulated mount's own clock, timer, drives, link and habits, beyond its `MountProfile`.

    `clock_offset_s` is how far its clock is ahead of UTC as it starts (left out: what the mount's profile
    says), `clock_drift_ppm` how much that grows. `timer` is the law of its 50 ms loop (see `timer`), at a
    rate off by `timer_drift_ppm`. Delays are those of its link, one way each, uniform within the jitter;
    left out, they are the mount profile's own in virtual time, and none but the real ones over UDP.
    """

    clock_offset_s: float | None = None
    clock_drift_ppm: float = 0.0
    timer: TimerLaw = "exact"
    timer_drift_ppm: float = 0.0
    command_delay_s: float | None = None
    command_jitter_s: float = 0.0
    status_delay_s: float | None = None
    status_jitter_s: float = 0.0
    servo: ServoSettings = ServoSettings()
    slew_jerk_deg_s3: float = 100.0
    """Bound of the slews' jerk, so that they start and end smoothly; 0: none."""
    settling_arcsec: float = 0.0
    """How far the structure swings, and rings down, for each deg/s² that the axis accelerates."""
    settling_hz: float = 4.0
    settling_s: float = 0.4
    """Time in which the swing falls to 1/e."""
    encoder_noise_tics: float = 0.0
    """Half the width of the encoder's noise, uniform."""
    ra_encoder_zero_deg: float = 0.0
    dec_encoder_zero_deg: float = 0.0
    """What the encoders read where the axes stand at 0: how the mount was assembled."""
    flip: Literal["never", "hour_angle", "ascom"] = "never"
    """Which slews go beyond the pole: none, those that end in the west, or in the east as ASCOM has it."""
    hard_margin_deg: float = 10.0
    """How far past the profile's travel each axis stops in any case."""
    reports_home_and_park: bool = False
    """Whether AtHome and AtPark are reported; the paper's packing code has zeros there."""
    does_refraction: bool = False
    crashed_drives: Literal["stop", "hold"] = "stop"
    """What the drives do while the mount's program has crashed: brake, or go on at their last rates."""
    faults: str = ""
    """Faults on demand, as `sattrack sim --faults` takes them."""
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise ValueError, naming the field, where a number cannot be one of a mount."""
        _check_not_negative(
            self,
            "slew_jerk_deg_s3",
            "command_jitter_s",
            "status_jitter_s",
            "settling_arcsec",
            "encoder_noise_tics",
            "hard_margin_deg",
        )
        _check_positive(self, "settling_hz", "settling_s")
        for name in ("clock_offset_s", "ra_encoder_zero_deg", "dec_encoder_zero_deg"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise ValueError(f"{name} is {value:g}; it must be a number")
        for name in ("clock_drift_ppm", "timer_drift_ppm"):
            if not abs(getattr(self, name)) <= MOST_DRIFT_PPM:
                raise ValueError(f"{name} is {getattr(self, name):g}; give {MOST_DRIFT_PPM:g} ppm at most")
        for name in ("command_delay_s", "status_delay_s"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value < MOST_DELAY_S:
                raise ValueError(f"{name} is {value:g}; delays are 0 s or more, and below {MOST_DELAY_S:g} s")


def simulator_profile(table: dict[str, Any], where: str = "the mount profile") -> SimulatorProfile:
    """Return what a table `[simulator]` says; raises BadInputError, naming `where` and the key."""
    try:
        return msgspec.convert(table, SimulatorProfile)
    except msgspec.ValidationError as error:
        what, key = refused_key(error)
        raise BadInputError(f"{where}, [simulator]: {f'{key}: ' if key else ''}{what}") from error


class SimulatorPart(msgspec.Struct, frozen=True):
    """The part of a profile file that only a simulated mount needs."""

    simulator: SimulatorProfile = SimulatorProfile()
