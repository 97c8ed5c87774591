"""What kind of Alpaca telescope is simulated: how its driver reads the standard, and how well it does."""

from __future__ import annotations

from typing import Literal

import msgspec

LONGEST_S = 10.0
EquatorialSystem = Literal["jnow", "j2000"]
AlignmentMode = Literal["altaz", "polar", "german"]


class TelescopeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One simulated telescope. Degrees, seconds, hertz.

    `additive` where MoveAxis adds to tracking in place of replacing it; a sign of -1 turns an axis round;
    `latency_s` is what a request takes to the driver and back together, `jitter_s` how much either way of
    that each takes at random. `rates_deg_s` are AxisRates: pairs of the lowest and the highest.
    """

    latitude_deg: float = 52.1541
    longitude_deg: float = 4.4908
    height_m: float = 0.0
    hour_angle_deg: float = 50.0
    """Where it stands at first."""
    dec_deg: float = 15.0
    additive: bool = False
    ra_sign: Literal[-1, 1] = 1
    dec_sign: Literal[-1, 1] = 1
    ra_gain: float = 1.0
    dec_gain: float = 1.0
    system: EquatorialSystem = "jnow"
    alignment: AlignmentMode = "polar"
    """What its axes are; those of "altaz" turn in azimuth and altitude."""
    tells_alignment: bool = True
    """Whether its driver answers AlignmentMode."""
    rates_deg_s: tuple[tuple[float, float], ...] = ((0.0, 6.0),)
    acceleration_deg_s2: float = 10.0
    slew_rate_deg_s: float = 6.0
    servo_hz: float = 5.0
    """Frequency at which the critically damped servo follows its reference."""
    tracking: bool = True
    parked: bool = False
    refuses_connection: bool = False
    can_slew: bool = True
    can_sync: bool = True
    guide_rate_deg_s: float = 0.0
    """How much a guide pulse adds to an axis' rate; 0 where it has no guide pulses."""
    device_state: bool = True
    """Whether one request tells the whole state (Platform 7), or each property needs its own."""
    latency_s: float = 0.030
    jitter_s: float = 0.002
    held_up_share: float = 0.0
    """Share of the ways there, and of those back, that take `held_up_s` longer."""
    held_up_s: float = 0.1
    cache_s: float = 0.0
    """Places are those of the last turn of a loop with this period; 0 gives them as they are."""
    move_interval_s: float = 0.0
    """A MoveAxis that changes an axis' rate sooner after the last one is refused."""
    seed: int = 1

    def __post_init__(self) -> None:
        """Raise ValueError, naming the field, where a number cannot be one of a telescope."""
        above = {
            "ra_gain": self.ra_gain,
            "dec_gain": self.dec_gain,
            "acceleration_deg_s2": self.acceleration_deg_s2,
            "slew_rate_deg_s": self.slew_rate_deg_s,
            "servo_hz": self.servo_hz,
        }
        for name, value in above.items():
            if not value > 0.0:
                raise ValueError(f"{name} is {value:g}; it must be above 0")
        least = {
            "latency_s": self.latency_s,
            "jitter_s": self.jitter_s,
            "held_up_share": self.held_up_share,
            "held_up_s": self.held_up_s,
            "cache_s": self.cache_s,
            "move_interval_s": self.move_interval_s,
            "guide_rate_deg_s": self.guide_rate_deg_s,
        }
        for name, value in least.items():
            if not 0.0 <= value <= LONGEST_S:
                raise ValueError(f"{name} is {value:g}; it goes from 0 to {LONGEST_S:g}")
