"""How stars and the satellite move in an image, by what a run shows of mount and target. No I/O."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sattrack.camera.detection import Expected

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.camera.centring import ImageGeometry
    from sattrack.views.run import TrackView

LONGEST_GAP_S = 3.0
FOLLOWING = frozenset({"tracking"})


def expected(
    views: Sequence[TrackView], utc_s: float, geometry: ImageGeometry, middle: tuple[float, float]
) -> Expected | None:
    """Return how stars and the satellite move in an image of an instant, pixels a second.

    None where the views do not reach to the instant, or no scale is known. While the mount follows, the
    satellite stands in the image; before, both are told by the directions of target and mount in two views.
    """
    del middle
    scale = geometry.scale_arcsec_px
    known = [one for one in views if one.mount_ra_deg is not None and one.mount_dec_deg is not None]
    if scale is None or len(known) < 2:
        return None
    last = min(range(1, len(known)), key=lambda i: abs(known[i].utc_s - utc_s))
    one, other = known[max(0, last - 5)], known[last]
    span_s = other.utc_s - one.utc_s
    if abs(other.utc_s - utc_s) > LONGEST_GAP_S or span_s <= 0.0:
        return None
    assert one.mount_ra_deg is not None
    assert one.mount_dec_deg is not None
    assert other.mount_ra_deg is not None
    assert other.mount_dec_deg is not None
    mount = _rates(one.mount_ra_deg, one.mount_dec_deg, other.mount_ra_deg, other.mount_dec_deg, span_s)
    stars = in_image(-mount[0], -mount[1], scale, geometry)
    if other.phase in FOLLOWING:
        return Expected(stars, 0.0)
    target = _rates(one.target_ra_deg, one.target_dec_deg, other.target_ra_deg, other.target_dec_deg, span_s)
    return Expected(stars, in_image(target[0] - mount[0], target[1] - mount[1], scale, geometry))


def _rates(ra: float, dec: float, to_ra: float, to_dec: float, span_s: float) -> tuple[float, float]:
    """Return motion east and north on the sky, arcseconds a second."""
    east = ((to_ra - ra + 180.0) % 360.0 - 180.0) * math.cos(math.radians(0.5 * (dec + to_dec)))
    return east * 3600.0 / span_s, (to_dec - dec) * 3600.0 / span_s


def in_image(east: float, north: float, scale: float, geometry: ImageGeometry) -> tuple[float, float] | float:
    """Return a motion in the image, pixels a second; its speed alone where the rotation is not known."""
    if geometry.rotation_deg is None:
        return math.hypot(east, north) / scale
    angle = math.radians(geometry.rotation_deg)
    up = east * math.sin(angle) + north * math.cos(angle)
    right = -east * math.cos(angle) + north * math.sin(angle)
    return (-right if geometry.flipped else right) / scale, up / scale
