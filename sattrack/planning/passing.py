"""The ways past the pole that a pass is followed by, for the plan of a run."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sattrack.planning.keyhole import find_keyholes
from sattrack.planning.path import axis_path

if TYPE_CHECKING:
    from sattrack.control.detour import Detour
    from sattrack.control.tracker import TrackPlan
    from sattrack.mount.model import MountProfile
    from tle.bias import Bias
    from tle.propagator import Propagator

STEP_S = 0.05
MOST_SAMPLES = 60_000


def detours_for(
    propagator: Propagator, bias: Bias, plan: TrackPlan, profile: MountProfile
) -> tuple[Detour, ...]:
    """Return the detours of a plan; none where the profile does not let following go through the pole.

    Round the pole no way loses less than following as long as the axes can and catching up, which needs no
    plan. `propagator` gives what is fed. Raises TimeRangeError, PropagationError.
    """
    if not profile.through_pole:
        return ()
    duration_s = plan.end_utc_s - plan.start_utc_s
    count = min(MOST_SAMPLES, max(8, math.ceil(duration_s / STEP_S) + 1))
    path = axis_path(propagator, bias, np.linspace(plan.start_utc_s, plan.end_utc_s, count))
    if not np.isfinite(path.pointing.dec_axis_deg).all():
        return ()
    found = find_keyholes(path, profile, plan.on_target_arcsec / 3600.0)
    return tuple(k.detour for k in found if k.detour is not None and k.detour.through_pole)
