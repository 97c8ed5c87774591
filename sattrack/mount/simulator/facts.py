"""What a simulated mount is told of its place, and what is true of it whatever it reports."""

from __future__ import annotations

import msgspec


class SimulatedSite(msgspec.Struct, frozen=True):
    """Where the simulated mount believes it stands, degrees and metres."""

    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0


class StartPosition(msgspec.Struct, frozen=True):
    """Where the axes are at power-up, degrees: of the axes, cables counted, so 190 is not -170."""

    hour_angle_deg: float = -30.0
    dec_deg: float = 20.0


class Truth(msgspec.Struct, frozen=True, gc=False):
    """Where the axes really were when a status was packed, in the frame that the mount reports.

    The axes' own angles have their cables' turns counted; `at_limit` tells that a hard limit holds an axis.
    """

    counter: int
    utc_s: float
    ra_deg: float
    dec_deg: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float
    hour_angle_axis_deg: float
    dec_axis_deg: float
    beyond_pole: bool
    at_limit: bool
