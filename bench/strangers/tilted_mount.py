"""A stranger's mount with errors, its pole anywhere, by rotations of vectors alone: no formula of a model.

Vectors are east, north, up of the site. Every error is a real one: the polar axis is tilted by a rotation,
the declination axis leans towards the pole, the telescope looks beside its square to that axis, the tube
sinks towards the ground. Angles in degrees, sizes of errors in arcseconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[Any]
EAST, NORTH, UP = np.eye(3)
NAMES = {"ME": "pole_up", "MA": "pole_west", "CH": "cone", "NP": "leaning", "IH": "zero_ha", "ID": "zero_dec"}
"""Terms by TPOINT's names are what must be added to what the mount reports: each error, negative."""


def turn(about: Vector, angle_rad: float) -> Vector:
    """Return the matrix of a right-handed turn about an axis (Rodrigues)."""
    x, y, z = about / np.linalg.norm(about)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle_rad) * cross + (1.0 - math.cos(angle_rad)) * cross @ cross


@dataclass(frozen=True)
class TiltedMount:
    """The axes stand at 0 on the meridian and the equator; hour angles go west, declinations north.

    `pole_up` raises the polar axis above the pole, `pole_west` leads it west of it; `cone` has the telescope
    look east of its square, `leaning` leans the west end of the declination axis to the north; the axes show
    `zero_ha` and `zero_dec` too much. `sag` is by how much the tube sinks when it is level. A pole that is
    not the sky's is as high as `latitude_deg`, at an azimuth; its meridian is the plane of pole and zenith.
    """

    latitude_deg: float
    pole_up: float = 0.0
    pole_west: float = 0.0
    cone: float = 0.0
    leaning: float = 0.0
    zero_ha: float = 0.0
    zero_dec: float = 0.0
    sag: float = 0.0
    pole_azimuth_deg: float = 0.0

    def looks(self, hour_angle_axis_deg: float, dec_axis_deg: float) -> Vector:
        """Return where the telescope looks, a unit vector, with its axes at what they show."""
        arcsec = math.radians(1.0 / 3600.0)
        latitude = math.radians(self.latitude_deg)
        swung = turn(UP, -math.radians(self.pole_azimuth_deg))
        pole = math.cos(latitude) * (swung @ NORTH) + math.sin(latitude) * UP
        equator = math.cos(latitude) * UP - math.sin(latitude) * (swung @ NORTH)
        west = swung @ -EAST
        # Leaning is a turn about the meridian's direction, cone one away from the declination axis.
        dec_axis = turn(np.cross(west, pole), self.leaning * arcsec) @ west
        tube = turn(np.cross(dec_axis, equator), self.cone * arcsec) @ equator
        # The tube is turned about the declination axis, then all about the polar axis, westward.
        tube = turn(dec_axis, math.radians(dec_axis_deg) - self.zero_dec * arcsec) @ tube
        tube = turn(pole, -(math.radians(hour_angle_axis_deg) - self.zero_ha * arcsec)) @ tube
        towards = self.pole_up * equator + self.pole_west * west
        size = float(np.linalg.norm(towards))
        if size > 0.0:
            tube = turn(np.cross(pole, towards), size * arcsec) @ tube
        level = math.hypot(float(tube @ EAST), float(tube @ NORTH))
        if self.sag and level > 0.0:
            tube = turn(np.cross(tube, -UP), self.sag * arcsec * level) @ tube
        return tube / np.linalg.norm(tube)

    def stands(self, wanted: Vector, near_deg: tuple[float, float]) -> tuple[float, float]:
        """Return where the axes stand when the telescope looks along a unit vector, by trying."""
        at = np.array(near_deg)
        for _ in range(50):
            here = self.looks(*at)
            steps = 1e-4 * np.eye(2)
            slopes = [(self.looks(*(at + one)) - self.looks(*(at - one))) / 2e-4 for one in steps]
            move = np.linalg.lstsq(np.stack(slopes, axis=1), wanted - here, rcond=None)[0]
            at = at + np.clip(move, -5.0, 5.0)
            if float(np.abs(move).max()) < 1e-9:
                break
        return float(at[0]), float(at[1])


def local(hour_angle_deg: float, dec_deg: float, latitude_deg: float) -> Vector:
    """Return the unit vector of a direction: turns from the meridian about the pole."""
    latitude = math.radians(latitude_deg)
    pole = math.cos(latitude) * NORTH + math.sin(latitude) * UP
    equator = math.cos(latitude) * UP - math.sin(latitude) * NORTH
    return turn(pole, -math.radians(hour_angle_deg)) @ turn(-EAST, math.radians(dec_deg)) @ equator


def apart_arcsec(a: Vector, b: Vector) -> float:
    """Return the angle between two unit vectors."""
    return math.degrees(math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))) * 3600.0
