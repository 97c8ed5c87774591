"""From pixels to the sky: offsets, plate solutions, and the messages for a run. No I/O.

`tetra3rs` finds the stars of a field in its catalogue (Gaia DR3 to magnitude 10, Hipparcos for the brightest)
and gives a tangential projection. How the image lies on the sky is read from that projection itself, by steps
up and to the right, so that nothing hangs on the solver's own signs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sattrack.camera.detection import ExpectedMotion
from sattrack.camera.frames import reduced
from sattrack.core.angles import wrap180
from sattrack.views.messages import (
    LEAST_SIGMA_ARCSEC,
    MOST_OFFSET_ARCSEC,
    MOST_SCALE_ARCSEC_PX,
    MOST_SIGMA_ARCSEC,
    Message,
    ObservationMessage,
    SeenOffset,
    SolvedField,
)
from sattrack.views.picture import MOST_STARS_SHOWN, PictureView, StarView

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from sattrack.camera.detection import Detection, PointSource
    from sattrack.camera.frames import CameraFrame
    from sattrack.views.run import TrackView

    Array = NDArray[np.float64]

FEWEST_STARS = 6
MOST_STARS = 60
SCALE_SHARE = 0.3
"""By which share the true scale may differ from what was said, for a field to be solved."""
SOLVE_WITHIN_MS = 400
STEP_PX = 10.0
LONGEST_GAP_S = 3.0
TOO_FAR = f"it is more than {MOST_OFFSET_ARCSEC / 3600.0:g}° from the middle, and offsets go no further"
FOLLOWING = frozenset({"tracking"})


@dataclass(frozen=True, slots=True)
class ImageGeometry:
    """How an image lies on the sky; None where it is not known.

    `rotation_deg`: position angle of up, from north through east. `flipped`: mirrored, so that with north up,
    east is to the right.
    """

    scale_arcsec_px: float | None = None
    rotation_deg: float | None = None
    flipped: bool | None = None

    def of_header(self, frame: CameraFrame) -> ImageGeometry:
        """Return the same with the scale by the header's pixel size and focal length, else its SCALE."""
        if self.scale_arcsec_px is not None:
            return self
        size_um, focal_mm, scale = (frame.header.get(key) for key in ("XPIXSZ", "FOCALLEN", "SCALE"))
        sizes = [one for one in (size_um, focal_mm) if isinstance(one, int | float) and one > 0.0]
        if len(sizes) == 2:
            scale = math.degrees(sizes[0] * 1e-3 / sizes[1]) * 3600.0
        if not isinstance(scale, int | float) or not 0.0 < scale <= MOST_SCALE_ARCSEC_PX:
            return self
        return ImageGeometry(float(scale), self.rotation_deg, self.flipped)

    def turned(self, angle_deg: float) -> ImageGeometry:
        """Return the same of a tube that is turned on the sky, north through east."""
        if self.rotation_deg is None or not angle_deg:
            return self
        return ImageGeometry(self.scale_arcsec_px, wrap180(self.rotation_deg + angle_deg), self.flipped)


class Solution(NamedTuple):
    """A field that was found among the stars: ICRS, degrees; the middle of the image."""

    ra_deg: float
    dec_deg: float
    rotation_deg: float
    flipped: bool
    scale_arcsec_px: float
    rms_arcsec: float
    stars: int
    place: Callable[[float, float], tuple[float, float]]
    """The direction of a place in the image, pixels from its middle, right and up."""

    def document(self) -> dict[str, float]:
        """Return the fields of a solution as JSON has them."""
        return {
            "ra_deg": round(self.ra_deg, 6),
            "dec_deg": round(self.dec_deg, 6),
            "rotation_deg": round(self.rotation_deg, 4),
            "scale_arcsec_px": round(self.scale_arcsec_px, 5),
        }


class Solver:
    """Solves fields of about one size, by an index of stars (`star_index`)."""

    def __init__(self, database: Any, fov_deg: float) -> None:
        """Take tetra3rs' database, and the image's width on the sky by its scale, degrees."""
        self._database, self._fov_deg = database, fov_deg

    def solve(self, shape: tuple[int, int], stars: Sequence[PointSource]) -> Solution | None:
        """Return where an image of a shape (height, width) looks, by its stars; None where none fits."""
        height, width = shape
        if len(stars) < FEWEST_STARS:
            return None
        at = np.array([[one.x, one.y, one.flux] for one in stars[:MOST_STARS]])
        # The solver's y goes down.
        places = np.stack([at[:, 0] - (width - 1) / 2.0, (height - 1) / 2.0 - at[:, 1], at[:, 2]], axis=1)
        found = self._database.solve_from_centroids(
            places,
            fov_estimate_deg=self._fov_deg,
            image_shape=(height, width),
            fov_max_error_deg=SCALE_SHARE * self._fov_deg,
            solve_timeout_ms=SOLVE_WITHIN_MS,
        )
        if not found or found.num_matches < FEWEST_STARS - 1:
            return None

        stars_at = [self._database.get_star_by_id(int(number)) for number in found.matched_catalog_ids]
        matched = places[np.asarray(found.matched_centroids, dtype=np.intp)] * (1.0, -1.0, 1.0)
        fit = _plate(
            (float(found.ra_deg), float(found.dec_deg)),
            matched[:, :2],
            np.array([[one.ra_deg, one.dec_deg] for one in stars_at]),
        )
        if fit is None:
            return None
        place, rms_arcsec, count = fit
        ra, dec = place(0.0, 0.0)
        up, up_arcsec = _step(ra, dec, *place(0.0, STEP_PX))
        right, right_arcsec = _step(ra, dec, *place(STEP_PX, 0.0))
        flipped = (right - up) % 360.0 < 180.0
        return Solution(
            ra,
            dec,
            up % 360.0,
            flipped,
            math.sqrt(up_arcsec * right_arcsec) / STEP_PX,
            rms_arcsec,
            count,
            place,
        )


def _plate(
    centre: tuple[float, float], places: Array, stars: Array
) -> tuple[Callable[[float, float], tuple[float, float]], float, int] | None:
    """Fit a plate (six constants) to stars at places, pixels from the image's middle; ICRS degrees.

    Returns the direction of a place, the RMS of the residuals on the sky (arcseconds) and how many stars were
    used: those within three sigmas. None for too few. Smart, Spherical Astronomy, chapter 12.
    """
    a0, d0 = (math.radians(each) for each in centre)
    a, d = np.radians(stars[:, 0]), np.radians(stars[:, 1])
    depth = np.sin(d) * math.sin(d0) + np.cos(d) * math.cos(d0) * np.cos(a - a0)
    plane = np.stack(
        [
            np.cos(d) * np.sin(a - a0) / depth,
            (np.sin(d) * math.cos(d0) - np.cos(d) * math.sin(d0) * np.cos(a - a0)) / depth,
        ],
        axis=1,
    )
    columns = np.concatenate([places, np.ones((len(places), 1))], axis=1)
    kept = np.ones(len(places), dtype=bool)
    for _ in range(4):
        if kept.sum() < FEWEST_STARS - 1:
            return None
        constants = np.linalg.lstsq(columns[kept], plane[kept], rcond=None)[0]
        off = np.hypot(*(columns @ constants - plane).T)
        rms = float(np.sqrt(np.sum(off[kept] ** 2) / max(int(kept.sum()) - 3, 1)))
        kept = off <= 3.0 * max(rms, 1e-9)

    def place(right: float, up: float) -> tuple[float, float]:
        xi, eta = np.array([right, up, 1.0]) @ constants
        ra = a0 + math.atan2(xi, math.cos(d0) - eta * math.sin(d0))
        dec = math.atan2(math.sin(d0) + eta * math.cos(d0), math.hypot(xi, math.cos(d0) - eta * math.sin(d0)))
        return math.degrees(ra) % 360.0, math.degrees(dec)

    return place, math.degrees(rms) * 3600.0, int(kept.sum())


def _step(ra_deg: float, dec_deg: float, to_ra_deg: float, to_dec_deg: float) -> tuple[float, float]:
    """Return position angle (degrees, north through east) and distance (arcseconds) of a near direction."""
    a, d, b, e = (math.radians(each) for each in (ra_deg, dec_deg, to_ra_deg, to_dec_deg))
    east = math.cos(e) * math.sin(b - a)
    north = math.sin(e) * math.cos(d) - math.cos(e) * math.sin(d) * math.cos(b - a)
    return math.degrees(math.atan2(east, north)), math.degrees(math.hypot(east, north)) * 3600.0


class Centred(NamedTuple):
    """What one frame comes to: what is printed of it, and what is sent to a run, if anything."""

    utc: str
    exposure_s: float
    kind: str
    dx_arcsec: float | None
    dy_arcsec: float | None
    sigma_arcsec: float | None
    snr: float | None
    solved: dict[str, float] | None
    why: str | None
    camera: str
    offset: SeenOffset | None = None
    direction: ObservationMessage | None = None
    """Where the satellite is among the stars; None where no field was found."""
    field: SolvedField | None = None
    """Where the middle pointed, for the camera's clock; None where no field was found."""

    @property
    def messages(self) -> tuple[Message, ...]:
        """What a run gets: the direction corrects the orbit, the offset also what the mount points wrong."""
        return tuple(one for one in (self.field, self.offset, self.direction) if one is not None)

    def document(self, sent: bool) -> dict[str, Any]:
        """Return the line of `sattrack camera --json`, and whether a run got what was seen."""
        told = {"offset", "direction", "field"}
        main, among = self.direction or self.offset, self.direction
        return {
            **{name: getattr(self, name) for name in self._fields if name not in told},
            "ra_deg": None if among is None else round(among.ra_deg, 6),
            "dec_deg": None if among is None else round(among.dec_deg, 6),
            "sent": None if main is None or not sent else main.__struct_config__.tag,
        }


def centred(
    frame: CameraFrame, seen: Detection, geometry: ImageGeometry, solution: Solution | None, camera: str
) -> Centred:
    """Return a detection as an offset from the image's middle, in pixels where no scale is known.

    Where the field was solved it is a direction among the stars besides, and the scale is the solution's.
    """
    utc = frame.utc.isoformat("microseconds")
    solved = None if solution is None else solution.document()
    scale = geometry.scale_arcsec_px if solution is None else solution.scale_arcsec_px
    nothing = Centred(utc, frame.exposure_s, seen.kind, None, None, None, None, solved, seen.why, camera)
    if solution is not None:
        middle = max(LEAST_SIGMA_ARCSEC, solution.rms_arcsec / math.sqrt(solution.stars))
        field = SolvedField(utc, solution.ra_deg, solution.dec_deg, min(middle, MOST_SIGMA_ARCSEC), camera)
        nothing = nothing._replace(field=field)
    if seen.kind == "none" or seen.x is None or seen.y is None or seen.sigma_px is None:
        return nothing
    middle_x, middle_y = frame.middle
    right, up = float(seen.x) - middle_x, float(seen.y) - middle_y
    snr = None if seen.snr is None else round(float(seen.snr), 2)
    sigma_px = float(seen.sigma_px)
    offset: SeenOffset | None
    if scale is None:
        offset = SeenOffset(
            utc,
            dx_px=right,
            dy_px=up,
            sigma_px=sigma_px,
            camera=camera,
            rotation_deg=geometry.rotation_deg,
            flipped=geometry.flipped,
        )
        return nothing._replace(snr=snr, offset=offset)
    # Offsets are on the tangential plane, as pixels are: 5° from the middle that is 0.25 % more.
    sigma = min(max(sigma_px * scale, LEAST_SIGMA_ARCSEC), MOST_SIGMA_ARCSEC)
    offset = direction = None
    if scale * max(abs(right), abs(up)) <= MOST_OFFSET_ARCSEC:
        offset = SeenOffset(
            utc,
            right * scale,
            up * scale,
            sigma,
            camera,
            rotation_deg=geometry.rotation_deg,
            flipped=geometry.flipped,
            scale_arcsec_px=scale,
        )
    if solution is not None:
        sigma = min(math.hypot(sigma, solution.rms_arcsec / math.sqrt(solution.stars)), MOST_SIGMA_ARCSEC)
        direction = ObservationMessage(utc, *solution.place(right, up), "icrs", sigma, camera=camera)
    return nothing._replace(
        dx_arcsec=round(right * scale, 3),
        dy_arcsec=round(up * scale, 3),
        sigma_arcsec=round(sigma, 3),
        snr=snr,
        why=TOO_FAR if offset is None else nothing.why,
        offset=offset,
        direction=direction,
    )


def picture(
    frame: CameraFrame, seen: Detection, geometry: ImageGeometry, result: Centred, side: int
) -> PictureView:
    """Return a frame for a screen, its longer side of `side` pixels at most, with what was seen in it."""
    columns, rows, pixels = reduced(frame, side)
    height, width = frame.pixels.shape
    middle_x, middle_y = frame.middle
    shown = seen.stars[:MOST_STARS_SHOWN]
    most = max((one.flux for one in shown), default=0.0)
    stars = tuple(
        StarView(round(one.x - middle_x, 1), round(one.y - middle_y, 1), round(one.flux / most, 3))
        for one in shown
        if one.flux > 0.0
    )
    found = seen.kind != "none" and seen.x is not None and seen.y is not None
    gain = frame.header.get("GAIN")
    return PictureView(
        result.camera,
        result.utc,
        frame.exposure_s,
        width,
        height,
        columns,
        rows,
        pixels,
        seen.kind if found else "none",
        float(seen.x) - middle_x if found and seen.x is not None else None,
        float(seen.y) - middle_y if found and seen.y is not None else None,
        seen.sigma_px if found else None,
        result.snr,
        seen.why,
        geometry.scale_arcsec_px,
        geometry.rotation_deg,
        geometry.flipped,
        stars,
        result.solved is not None,
        float(gain) if isinstance(gain, int | float) else None,
    )


def contradiction(said: ImageGeometry, solution: Solution) -> str | None:
    """Return what the stars show of an image that differs from what was said of it, as text."""
    wrong = []
    if said.scale_arcsec_px is not None:
        share = solution.scale_arcsec_px / said.scale_arcsec_px
        if abs(share - 1.0) > 0.01:
            wrong.append(
                f"--scale is {said.scale_arcsec_px:g}, the stars show {solution.scale_arcsec_px:.4g}"
            )
    if said.rotation_deg is not None:
        off = wrap180(solution.rotation_deg - said.rotation_deg)
        if abs(off) > 1.0:
            wrong.append(f"--rotation is {said.rotation_deg:g}, the stars show {solution.rotation_deg:.1f}")
    if bool(said.flipped) != solution.flipped:
        shown = "is mirrored" if solution.flipped else "is not mirrored"
        wrong.append(
            f"the stars show that the image {shown}: {'give' if solution.flipped else 'omit'} --flip"
        )
    return "; ".join(wrong) or None


def expected(views: Sequence[TrackView], utc_s: float, geometry: ImageGeometry) -> ExpectedMotion | None:
    """Return how stars and the satellite move in an image of an instant, pixels a second.

    None where the views do not reach to the instant, or no scale is known. While the mount follows, the
    satellite stands in the image; before, both are given by the directions of target and mount in two views.
    """
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
        return ExpectedMotion(stars, 0.0)
    target = _rates(one.target_ra_deg, one.target_dec_deg, other.target_ra_deg, other.target_dec_deg, span_s)
    return ExpectedMotion(stars, in_image(target[0] - mount[0], target[1] - mount[1], scale, geometry))


def _rates(ra: float, dec: float, to_ra: float, to_dec: float, span_s: float) -> tuple[float, float]:
    """Return motion east and north on the sky, arcseconds a second."""
    east = wrap180(to_ra - ra) * math.cos(math.radians(0.5 * (dec + to_dec)))
    return east * 3600.0 / span_s, (to_dec - dec) * 3600.0 / span_s


def in_image(east: float, north: float, scale: float, geometry: ImageGeometry) -> tuple[float, float] | float:
    """Return a motion in the image, pixels a second; its speed alone where the rotation is not known."""
    if geometry.rotation_deg is None:
        return math.hypot(east, north) / scale
    angle = math.radians(geometry.rotation_deg)
    up = east * math.sin(angle) + north * math.cos(angle)
    right = -east * math.cos(angle) + north * math.sin(angle)
    return (-right if geometry.flipped else right) / scale, up / scale
