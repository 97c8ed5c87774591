"""The error to expect beside the camera's field of view, to one scale, as rows of styled cells. Pure.

Ahead on the track is to the right, left of the motion is up. The middle is where the elements alone have the
satellite; the field lies where offsets have moved the mount to.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from sattrack.tui import words
from sattrack.tui.dots import DOTS_ACROSS, DOTS_DOWN, DotCanvas, Layer
from sattrack.tui.look import DIM

if TYPE_CHECKING:
    from sattrack.tui.panels import Row
    from sattrack.views.run import PassView, TrackView

ARCSEC = 3600.0
SIGMAS = 2.0
ROOM = 1.08
CENTRE, PLAIN_CENTRE = "×", "x"


class Kind(IntEnum):
    """What a dot belongs to."""

    FIELD = 0
    EXPECTED = 1


LAYERS = (Layer("$quiet", "."), Layer("bold $primary", "o"))


@dataclass(frozen=True, slots=True)
class Field:
    """What is drawn, arcseconds on the sky: one sigma along and across, the field's radius, its offsets."""

    along_arcsec: float
    across_arcsec: float
    radius_arcsec: float | None
    offset_along_arcsec: float
    offset_across_arcsec: float

    @property
    def seen(self) -> str | None:
        """How much of two sigmas lies in the field, in words; None where no field is known."""
        if self.radius_arcsec is None:
            return None
        corners = [
            math.hypot(
                SIGMAS * self.along_arcsec * math.cos(turn) - self.offset_along_arcsec,
                SIGMAS * self.across_arcsec * math.sin(turn) - self.offset_across_arcsec,
            )
            for turn in (math.tau * step / 72 for step in range(72))
        ]
        inside = sum(distance <= self.radius_arcsec for distance in corners)
        return "inside" if inside == len(corners) else "partly" if inside else "outside"


def field_of(told: PassView | None, view: TrackView) -> Field | None:
    """Return what is to be drawn at a view's instant; None where no error is to be expected."""
    if told is None or told.along_arcsec is None or told.across_arcsec is None:
        return None
    near = min(told.path, key=lambda point: abs(point.utc_s - view.utc_s), default=None)
    along_deg_s = 0.0 if near is None else near.along_deg_s
    return Field(
        told.along_arcsec,
        told.across_arcsec,
        None if told.fov_deg is None else 0.5 * told.fov_deg * ARCSEC,
        view.bias_along_s * along_deg_s * ARCSEC,
        view.bias_cross_deg * ARCSEC,
    )


def picture(field: Field, columns: int, rows: int, plain: bool = False) -> list[Row]:
    """Return the ellipse of two sigmas and the field's circle, as large as fits."""
    canvas = DotCanvas(columns, rows, LAYERS, plain)
    x, y = 0.5 * columns * DOTS_ACROSS, 0.5 * rows * DOTS_DOWN
    wide, high = SIGMAS * field.along_arcsec, SIGMAS * field.across_arcsec
    if field.radius_arcsec is not None:
        wide = max(wide, field.radius_arcsec + abs(field.offset_along_arcsec))
        high = max(high, field.radius_arcsec + abs(field.offset_across_arcsec))
    scale = min((x - 0.5) / max(wide, 1e-9), (y - 0.5) / max(high, 1e-9)) / ROOM
    if field.radius_arcsec is not None:
        middle = x + scale * field.offset_along_arcsec, y - scale * field.offset_across_arcsec
        _oval(canvas, middle, scale * field.radius_arcsec, scale * field.radius_arcsec, Kind.FIELD)
        mark = PLAIN_CENTRE if plain else CENTRE
        canvas.write(int(middle[0]) // DOTS_ACROSS, int(middle[1]) // DOTS_DOWN, mark, DIM)
    axes = scale * SIGMAS * field.along_arcsec, scale * SIGMAS * field.across_arcsec
    _oval(canvas, (x, y), *axes, Kind.EXPECTED)
    return canvas.drawn()


def figures(field: Field | None, plain: bool = False) -> list[Row]:
    """Return its sizes, a name and a figure in turn: two sigmas of the error, and the field's diameter."""
    if field is None:
        return [[("no error", DIM)], [("known", DIM)]]
    rows: list[Row] = [
        [("along", DIM)],
        [(words.within(words.arcsec(SIGMAS * field.along_arcsec), plain), "bold")],
        [("across", DIM)],
        [(words.within(words.arcsec(SIGMAS * field.across_arcsec), plain), "bold")],
    ]
    if field.radius_arcsec is None:
        return [*rows, [("field", DIM)], [("--fov", DIM)]]
    return [*rows, [("field", DIM)], [(words.arcsec(2.0 * field.radius_arcsec), "bold")]]


def _oval(canvas: DotCanvas, middle: tuple[float, float], wide: float, high: float, kind: Kind) -> None:
    count = max(16, math.ceil(math.tau * max(wide, high)))
    for step in range(count):
        turn = math.tau * step / count
        canvas.dot(middle[0] + wide * math.cos(turn), middle[1] + high * math.sin(turn), kind)
