"""Small turns of a direction on the sky, with the rates that go with them."""

from __future__ import annotations

import math
from typing import NamedTuple

Vector = tuple[float, float, float]

_TINY = 1e-40
_SMALL = 1e-4


class Turn(NamedTuple):
    """How far a direction is turned, and how fast that grows: degrees, degrees a second.

    First along a great circle, `east` towards growing right ascension and `north` towards the pole, both
    measured on the sky; then by `pole`, about the pole, which adds to the right ascension itself.
    """

    east_deg: float = 0.0
    north_deg: float = 0.0
    pole_deg: float = 0.0
    east_deg_s: float = 0.0
    north_deg_s: float = 0.0
    pole_deg_s: float = 0.0


def turned_on_sky(q: Vector, q_rate: Vector, turn: Turn) -> tuple[Vector, Vector]:
    """Return a vector turned by `turn`, and its derivative; its length is kept.

    By Rodrigues' formula, its derivative taken term by term. A direction that is turned beyond a pole comes
    down on the other side.
    """
    (x, y, z), (dx, dy, dz) = q, q_rate
    xy2 = x * x + y * y + _TINY
    xy = math.sqrt(xy2)
    length = math.sqrt(xy2 + z * z)
    # East and north as vectors of the direction's own length, and how they turn with it.
    k = length / xy
    k_rate = (x * dx + y * dy + z * dz) / (length * xy) - k * (x * dx + y * dy) / xy2
    ex, ey = -y * k, x * k
    dex, dey = -dy * k - y * k_rate, dx * k + x * k_rate
    xy_rate = (x * dx + y * dy) / xy
    z_xy, z_xy_rate = z / xy, (dz - z * xy_rate / xy) / xy
    nx, ny, nz = -x * z_xy, -y * z_xy, xy
    dnx, dny, dnz = -dx * z_xy - x * z_xy_rate, -dy * z_xy - y * z_xy_rate, xy_rate

    east, north = math.radians(turn.east_deg), math.radians(turn.north_deg)
    east_rate, north_rate = math.radians(turn.east_deg_s), math.radians(turn.north_deg_s)
    rho2 = east * east + north * north
    rho = math.sqrt(rho2)
    c = math.cos(rho)
    s = math.sin(rho) / rho if rho > _SMALL else 1.0 - rho2 / 6.0
    half = east * east_rate + north * north_rate
    c_rate = -s * half
    s_rate = half * ((c - s) / rho2 if rho > _SMALL else -1.0 / 3.0)
    a, b = east * s, north * s
    a_rate, b_rate = east_rate * s + east * s_rate, north_rate * s + north * s_rate

    px, py, pz = x * c + ex * a + nx * b, y * c + ey * a + ny * b, z * c + nz * b
    dpx = dx * c + x * c_rate + dex * a + ex * a_rate + dnx * b + nx * b_rate
    dpy = dy * c + y * c_rate + dey * a + ey * a_rate + dny * b + ny * b_rate
    dpz = dz * c + z * c_rate + dnz * b + nz * b_rate
    return _about_pole((px, py, pz), (dpx, dpy, dpz), turn)


def _about_pole(q: Vector, q_rate: Vector, turn: Turn) -> tuple[Vector, Vector]:
    if not (turn.pole_deg or turn.pole_deg_s):
        return q, q_rate
    angle, spin = math.radians(turn.pole_deg), math.radians(turn.pole_deg_s)
    c, s = math.cos(angle), math.sin(angle)
    (x, y, z), (dx, dy, dz) = q, q_rate
    x, y, dx, dy = x * c - y * s, x * s + y * c, dx * c - dy * s, dx * s + dy * c
    return (x, y, z), (dx - spin * y, dy + spin * x, dz)
