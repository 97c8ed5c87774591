"""One direct-drive axis: a reference within the limits of motion, and the plant that follows it.

Everything is a function of the seconds that pass; degrees throughout.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sattrack.mount.simulator.plant import Plant, Swing
from sattrack.mount.simulator.reference import ANYWHERE, Reference

if TYPE_CHECKING:
    from sattrack.mount.model import AxisLimits
    from sattrack.mount.simulator.settings import SimulatorProfile

SAME = 1e-10
SETTLED_DEG = 1e-4


@dataclass(slots=True)
class Axis:
    """One axis with its drive; at the ends of `travel_deg` it stops whatever it is told."""

    limits: AxisLimits
    hardware: SimulatorProfile
    travel_deg: tuple[float, float] = ANYWHERE
    reference: Reference = field(init=False)
    plant: Plant = field(init=False)
    powered: bool = True
    _faultless: bool = field(init=False)
    _settled_deg: float = field(init=False)

    def __post_init__(self) -> None:
        """Build the drive, at rest at 0."""
        limits, hardware = self.limits, self.hardware
        self.reference = Reference(
            limits.max_acceleration_deg_s2, limits.slew_rate_deg_s, hardware.slew_jerk_deg_s3, self.travel_deg
        )
        swing = None
        if hardware.settling_arcsec:
            swing = Swing(hardware.settling_arcsec / 3600.0, hardware.settling_hz, hardware.settling_s)
        self.plant = Plant(hardware.servo, limits.max_acceleration_deg_s2, swing)
        self._faultless = self.plant.faultless
        # Friction leaves an error that the servo's stiffness alone cannot take away.
        self._settled_deg = SETTLED_DEG + 2.0 * self.plant.friction_error_deg

    @property
    def position_deg(self) -> float:
        """Where the axis, and with it the encoder, is."""
        return self.plant.position_deg

    @property
    def velocity_deg_s(self) -> float:
        """How fast it turns."""
        return self.plant.rate_deg_s

    @property
    def current_a(self) -> float:
        """The drive's current, amperes."""
        return self.plant.current_a

    @property
    def going(self) -> bool:
        """Whether a place that was asked for has not been reached, or the servo has not settled there."""
        behind_deg = self.reference.position_deg - self.plant.position_deg
        return self.reference.going or abs(behind_deg) > self._settled_deg

    @property
    def swing_deg(self) -> float:
        """How far what is mounted on the axis swings ahead of it."""
        return 0.0 if self.plant.swing is None else self.plant.swing.deflection_deg

    def place(self, position_deg: float, rate_deg_s: float) -> None:
        """Put the axis somewhere, already moving at a rate, with power: the state at power-up."""
        self.reference.place(position_deg, rate_deg_s)
        self.plant.place(position_deg, rate_deg_s)
        self.powered = True

    def run(self, rate_deg_s: float) -> None:
        """Ask for a rate, held until something else is asked."""
        self.reference.run(rate_deg_s)

    def go(self, goal_deg: float, goal_rate_deg_s: float) -> None:
        """Ask to join a point that is at `goal_deg` now and moves at `goal_rate_deg_s`."""
        self.reference.go(goal_deg, goal_rate_deg_s)

    def coast(self) -> None:
        """Cut the power: friction alone acts from then on."""
        self.powered = False

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        reference, plant = self.reference, self.plant
        if not self.powered:
            plant.coast(seconds)
            reference.place(plant.position_deg, plant.rate_deg_s)
        elif (
            self._faultless
            and abs(reference.position_deg - plant.position_deg) < SAME
            and abs(reference.rate_deg_s - plant.rate_deg_s) < SAME
        ):
            reference.step(seconds)
            plant.follow_exactly(reference)
        else:
            plant.follow(reference, seconds)
