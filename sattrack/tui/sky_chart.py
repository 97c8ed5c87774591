"""The polar chart of a pass: from what is told of it to rows of styled cells. Pure.

Kinds of lines differ in how dense their dots are, and without Unicode in their character, so that no colour
is needed: the way to come is a whole line, the way flown and the rings of altitude are dotted ones, and what
is not pointed into is hatched.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

from sattrack.tui import words
from sattrack.tui.dome import Disc, Spot, apart_deg, at_instant, circle, skyline_deg, spot_of, vector
from sattrack.tui.dots import DOTS_ACROSS, DOTS_DOWN, DotCanvas, Layer
from sattrack.tui.look import DIM

if TYPE_CHECKING:
    from sattrack.tui.panels import Row
    from sattrack.views.run import PassView, PathPoint

RINGS_DEG = (30.0, 60.0)
AZIMUTH_STEPS = 360
NARROW_ROWS = 14
"""From so many rows on, the chart's labels tell more than names."""
BODY_BLOCK_S = 60.0
PLAIN_HATCH = (2 * DOTS_ACROSS, 2 * DOTS_DOWN)
HATCH = (3, 3)
PATH_STEPS = 6
"""Straight pieces between two points of the path, which bends near the zenith."""


class Kind(IntEnum):
    """What a dot belongs to; of two in one cell the later is seen."""

    RING = 0
    MASK = 1
    MOON = 2
    SUN = 3
    KEYHOLE = 4
    FLOWN = 5
    PATH = 6


LAYERS = (
    Layer("$zero-line", "."),
    Layer("$quiet", "%"),
    Layer("$quiet", "~"),
    Layer("$warning", "*"),
    Layer("$dec-line", "o"),
    Layer("$quiet", "-"),
    Layer("bold $primary", "="),
)
SATELLITE, MOUNT, BOTH = "●", "+", "⊕"
PLAIN_MARKS = {SATELLITE: "@", BOTH: "&"}
SATELLITE_STYLE, MOUNT_STYLE = "bold $success", "bold $foreground"
SUN_STYLE, MOON_STYLE, NAME_STYLE, POLE_STYLE = "bold $warning", "$foreground", "$foreground", "$dec-line"


@dataclass(frozen=True, slots=True)
class Sky:
    """What the chart shows: what was told of the pass, and where satellite and mount are at an instant."""

    told: PassView
    utc_s: float
    satellite: Spot
    mount: Spot | None

    @property
    def sun(self) -> Spot | None:
        """Where the Sun stands."""
        return at_instant(self.told.sun, self.utc_s)

    @property
    def moon(self) -> Spot | None:
        """Where the Moon stands."""
        return at_instant(self.told.moon, self.utc_s)

    @property
    def pole(self) -> Spot:
        """The celestial pole that is up."""
        latitude = self.told.latitude_deg
        return Spot(abs(latitude), 0.0 if latitude >= 0.0 else 180.0)


def mark(character: str, plain: bool) -> str:
    """Return a mark as the terminal can show it."""
    return PLAIN_MARKS.get(character, character) if plain else character


def ground(sky: Sky, columns: int, rows: int, plain: bool = False) -> DotCanvas:
    """Return what lies behind: rings, skyline, the keyhole, the cones about Sun and Moon.

    It may be kept for BODY_BLOCK_S, in which the Sun comes a quarter of a degree.
    """
    canvas = DotCanvas(columns, rows, LAYERS, plain)
    disc = Disc.within(columns, rows)
    _rings(canvas, disc)
    told = sky.told
    if told.horizon or told.floor_altitude_deg > 0.0:
        azimuths = [360.0 * step / AZIMUTH_STEPS for step in range(AZIMUTH_STEPS + 1)]
        edge = [Spot(skyline_deg(told.horizon, told.floor_altitude_deg, az), az) for az in azimuths]
        canvas.line([disc.place(spot) for spot in edge], Kind.MASK)
    for body, cone_deg, kind in (
        (sky.sun, told.sun_cone_deg, Kind.SUN),
        (sky.moon, told.moon_cone_deg, Kind.MOON),
    ):
        if body is not None and cone_deg > 0.0 and body.alt_deg > -cone_deg:
            canvas.line([disc.place(spot) for spot in circle(body, cone_deg, 120)], kind)
    _hatch(canvas, disc, sky, plain)
    if told.keyhole_deg is not None:
        for number, spot in enumerate(circle(sky.pole, told.keyhole_deg, 90)):
            place = disc.place(spot)
            if place is not None and (plain or number % 3):
                canvas.dot(*place, Kind.KEYHOLE)
    return canvas


def chart(sky: Sky, behind: DotCanvas) -> DotCanvas:
    """Return the chart of an instant, drawn over its ground."""
    canvas, plain = behind.copy(), behind.plain
    disc = Disc.within(canvas.columns, canvas.rows)
    _path(canvas, disc, sky)
    _marks(canvas, disc, sky, plain)
    _labels(canvas, disc, sky, canvas.rows >= NARROW_ROWS)
    return canvas


def notes(sky: Sky, plain: bool = False) -> list[Row]:
    """Return in words what the chart shows, each with its mark."""
    told = sky.told
    rows: list[Row] = [
        _note(mark(SATELLITE, plain), SATELLITE_STYLE, "satellite", _where(sky.satellite)),
        _note(MOUNT, MOUNT_STYLE, "mount", words.NOTHING if sky.mount is None else _where(sky.mount)),
    ]
    if told.path:
        first, last = told.path[0], told.path[-1]
        top = max(told.path, key=lambda point: point.alt_deg)
        for name, point in (
            ("rise" if told.rises else "from", first),
            ("highest", top),
            ("set" if told.sets else "until", last),
        ):
            place = _where(Spot(point.alt_deg, point.az_deg))
            rows.append(_note("", "", name, f"{place} {words.clock(point.utc_s)}"))
    for name, body, cone_deg, style in (
        ("Sun", sky.sun, told.sun_cone_deg, SUN_STYLE),
        ("Moon", sky.moon, told.moon_cone_deg, MOON_STYLE),
    ):
        if body is not None:
            away = f"{apart_deg(body, sky.satellite):3.0f}° away"
            rows.append(_note("", style, name, f"{_where(body)} {away}"))
            if cone_deg > 0.0:
                rows.append(_note("", "", "", f" cone {cone_deg:g}°: not pointed into"))
    if told.keyhole_deg is not None:
        to_pole = apart_deg(sky.pole, sky.satellite)
        rows.append(_note("", POLE_STYLE, "pole", f" {to_pole:.0f}° away, keyhole {told.keyhole_deg:.1f}°"))
    if told.horizon:
        heights = [altitude for _, altitude in told.horizon]
        rows.append(_note("", "", "skyline", f" {min(heights):.0f}° to {max(heights):.0f}°"))
    if told.floor_altitude_deg > 0.0:
        rows.append(_note("", "", "floor", f" {told.floor_altitude_deg:g}°"))
    return rows


def legend(columns: int, plain: bool = False) -> Row:
    """Return what the marks mean, in one row: as much of it as there is room for."""
    row: Row = [
        (f" {mark(SATELLITE, plain)}", SATELLITE_STYLE),
        (" satellite  ", DIM),
        (MOUNT, MOUNT_STYLE),
        (" mount", DIM),
    ]
    room = columns - sum(len(part if isinstance(part, str) else part[0]) for part in row)
    side = next((text for text in ("  east is left", "  E is left") if len(text) <= room), "")
    return [*row, (side, DIM)] if room >= 0 else []


def _note(sign: str, style: str, name: str, text: str) -> Row:
    return [(f"{sign:1} ", style), (f"{name:<9}", style or DIM), text]


def _where(spot: Spot) -> str:
    turned = round(spot.az_deg) % 360
    cardinal = words.CARDINALS[round(spot.az_deg / 45.0) % 8]
    return f"{spot.alt_deg:5.1f}° up {cardinal:<2} {turned:3d}°".replace("-", words.MINUS)


def _rings(canvas: DotCanvas, disc: Disc) -> None:
    for alt_deg in (0.0, *RINGS_DEG):
        out = disc.radius * (90.0 - alt_deg) / 90.0
        # The horizon is whole, the rings have gaps.
        count = max(12, math.ceil(math.tau * out / (1.0 if alt_deg == 0.0 else 4.0)))
        for step in range(count):
            place = disc.place(Spot(alt_deg, 360.0 * step / count))
            if place is not None:
                canvas.dot(*place, Kind.RING)


def _hatch(canvas: DotCanvas, disc: Disc, sky: Sky, plain: bool) -> None:
    """Hatch what is not pointed into."""
    told, sun, moon = sky.told, sky.sun, sky.moon
    across, down = PLAIN_HATCH if plain else HATCH
    for y in range(down // 2, canvas.rows * DOTS_DOWN, down):
        for x in range(across // 2 + y // down % 2 * (across // 2), canvas.columns * DOTS_ACROSS, across):
            spot = disc.spot(x + 0.5, y + 0.5)
            if spot is None:
                continue
            if spot.alt_deg < skyline_deg(told.horizon, told.floor_altitude_deg, spot.az_deg):
                canvas.dot(x, y, Kind.MASK)
            if sun is not None and told.sun_cone_deg > 0.0 and apart_deg(spot, sun) < told.sun_cone_deg:
                canvas.dot(x, y, Kind.SUN)
            if moon is not None and told.moon_cone_deg > 0.0 and apart_deg(spot, moon) < told.moon_cone_deg:
                canvas.dot(x, y, Kind.MOON)


def _path(canvas: DotCanvas, disc: Disc, sky: Sky) -> None:
    number = 0
    for spot, utc_s in _fine(sky.told.path):
        place = disc.place(spot)
        number += 1
        if place is None:
            continue
        if utc_s > sky.utc_s:
            canvas.dot(*place, Kind.PATH)
        elif number % 6 < 2:
            canvas.dot(*place, Kind.FLOWN)


@lru_cache(maxsize=1)
def _fine(path: tuple[PathPoint, ...]) -> list[tuple[Spot, float]]:
    """Return a path with points between its own, along great circles."""
    found: list[tuple[Spot, float]] = []
    for one, other in pairwise(path):
        a, b = vector(Spot(one.alt_deg, one.az_deg)), vector(Spot(other.alt_deg, other.az_deg))
        for step in range(PATH_STEPS):
            share = step / PATH_STEPS
            x, y, z = (p + share * (q - p) for p, q in zip(a, b, strict=True))
            found.append((spot_of((x, y, z)), one.utc_s + share * (other.utc_s - one.utc_s)))
    if path:
        found.append((Spot(path[-1].alt_deg, path[-1].az_deg), path[-1].utc_s))
    return found


def _cell(disc: Disc, spot: Spot | None) -> tuple[int, int] | None:
    place = None if spot is None else disc.place(spot)
    if place is None:
        return None
    return math.floor(place[0]) // DOTS_ACROSS, math.floor(place[1]) // DOTS_DOWN


def _marks(canvas: DotCanvas, disc: Disc, sky: Sky, plain: bool) -> None:
    satellite, mount = _cell(disc, sky.satellite), _cell(disc, sky.mount)
    if satellite is not None and satellite == mount:
        canvas.write(*satellite, mark(BOTH, plain), SATELLITE_STYLE)
        return
    if satellite is not None:
        canvas.write(*satellite, mark(SATELLITE, plain), SATELLITE_STYLE)
    if mount is not None:
        canvas.write(*mount, MOUNT, MOUNT_STYLE)


def _labels(canvas: DotCanvas, disc: Disc, sky: Sky, roomy: bool) -> None:
    for body, name, style in ((sky.sun, "Sun", SUN_STYLE), (sky.moon, "Moon", MOON_STYLE)):
        _label(canvas, _cell(disc, body), name, style, over=True)
    path, told = sky.told.path, sky.told
    if path:
        top = max(path, key=lambda point: point.alt_deg)
        for point, name in (
            (path[0], "rise" if told.rises else "from"),
            (path[-1], "set" if told.sets else "end"),
            (top, f"{top.alt_deg:.0f}°"),
        ):
            if point is not top and path[-1].utc_s - path[0].utc_s >= words.DAY_S:
                # What never sets comes round to where it was, and a time of day would be of another day.
                continue
            text = f"{name} {words.clock(point.utc_s)[:5]}" if roomy and point is not top else name
            _label(canvas, _cell(disc, Spot(point.alt_deg, point.az_deg)), text, NAME_STYLE)
    if told.keyhole_deg is not None:
        _label(canvas, _cell(disc, sky.pole), "pole" if roomy else "P", POLE_STYLE, over=True)
    for name, az in (("N", 0.0), ("E", 90.0), ("S", 180.0), ("W", 270.0)):
        _label(canvas, _cell(disc, Spot(0.0, az)), name, f"bold {DIM}", over=True)


def _label(
    canvas: DotCanvas, cell: tuple[int, int] | None, text: str, style: str, over: bool = False
) -> None:
    """Write a name at a place, or where beside it there is room and least of the path is hidden."""
    if cell is None:
        return
    column, row = cell
    half, length = len(text) // 2, len(text)
    places = [
        *([(column - half, row)] if over else []),
        (column + 1, row),
        (column - length, row),
        *((column + shift, row + up) for up in (-1, 1) for shift in (-half, 1, -length)),
    ]
    free = [at for at in places if canvas.room(*at, length)]
    if free:
        hidden = [canvas.covers(*at, length, layer=Kind.FLOWN) for at in free]
        canvas.write(*free[hidden.index(min(hidden))], text, style)
