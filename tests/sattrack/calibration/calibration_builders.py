"""Runs against the mount in closed form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from calibration import Network, Timer, VirtualRun

from sattrack.calibration.calibrator import Calibrator
from sattrack.calibration.guard import Leg, Plan, Surroundings

if TYPE_CHECKING:
    from collections.abc import Callable

    from ramp_mount import RampMount

BEGIN = 1_790_000_000.0
CLEAR = Surroundings(
    latitude_deg=52.0,
    longitude_deg=4.5,
    sun_hour_angle_deg=170.0,
    sun_dec_deg=-20.0,
    hour_angle_limit_deg=180.0,
)
SHORT = Plan(toggles=6, most_toggles=6, toggles_after=1, steps=False, legs=(Leg(-0.5, 1.5), Leg(0.5, 1.5)))


@dataclass
class Ended:
    calibrator: Calibrator
    mount: RampMount
    run: VirtualRun
    seconds: float


def run(
    mount: RampMount,
    network: Network | None = None,
    timer: Timer | None = None,
    around: Surroundings = CLEAR,
    plan: Plan | None = None,
    seed: int = 1,
    watch: Callable[[float, Calibrator], None] | None = None,
    **changes: object,
) -> Ended:
    """Run a calibration to its end in virtual time."""
    mount.begin(BEGIN)
    calibrator = Calibrator(around, BEGIN, plan)
    virtual = VirtualRun(
        calibrator, mount, network or Network(), timer or Timer(), np.random.default_rng(seed), BEGIN, watch
    )
    virtual = replace(virtual, **changes)
    return Ended(calibrator, mount, virtual, virtual.run())
