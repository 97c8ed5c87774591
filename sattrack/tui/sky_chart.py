"""The polar chart of a pass: from what is known of it to rows of styled cells, and the panels that show them.

The sky over the site is a disc: zenith in the middle, horizon as rim, north up and east to the left. Kinds of
lines differ in how dense their dots are, and without Unicode in their character, so that no colour is needed:
the path to come is a whole line, the path flown and the rings of altitude are dotted ones, and what is not
pointed into is hatched.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from textual.content import Content
from textual.widget import Widget

from sattrack.core import local_time
from sattrack.mount.model import mean_sidereal_deg
from sattrack.tui.look import DIM
from sattrack.tui.panels import DOTS_ACROSS, DOTS_DOWN, DotCanvas, Layer, Panel, Row, cells_of, rows_content
from sattrack.views import formatting

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from textual.events import Resize

    from sattrack.tui.scene import Scene
    from sattrack.views.run import PassView, PathPoint, SkyPoint

RIGHT_DEG = 90.0


class SkySpot(NamedTuple):
    """A direction over the site, degrees; azimuth from north through east."""

    alt_deg: float
    az_deg: float


Vector = tuple[float, float, float]
"""A unit vector: north, east, up."""


class Disc(NamedTuple):
    """Where the disc lies among the dots of a canvas: its middle and its radius."""

    x: float
    y: float
    radius: float

    @classmethod
    def within(cls, columns: int, rows: int) -> Disc:
        """Return the largest that fits into so many cells."""
        return cls(float(columns), 2.0 * rows, max(1.0, min(columns, 2 * rows) - 0.6))

    def place(self, spot: SkySpot) -> tuple[float, float] | None:
        """Return where a direction lies; None below the horizon. Distance from the zenith to scale."""
        if spot.alt_deg < 0.0:
            return None
        out = self.radius * (RIGHT_DEG - spot.alt_deg) / RIGHT_DEG
        az = math.radians(spot.az_deg)
        return self.x - out * math.sin(az), self.y - out * math.cos(az)

    def spot(self, x: float, y: float) -> SkySpot | None:
        """Return the direction at a place; None outside the disc."""
        west, south = x - self.x, y - self.y
        out = math.hypot(west, south) / self.radius
        if out > 1.0:
            return None
        return SkySpot(RIGHT_DEG * (1.0 - out), math.degrees(math.atan2(-west, -south)) % 360.0)


def vector(spot: SkySpot) -> Vector:
    """Return the unit vector of a direction."""
    alt, az = math.radians(spot.alt_deg), math.radians(spot.az_deg)
    return math.cos(alt) * math.cos(az), math.cos(alt) * math.sin(az), math.sin(alt)


def spot_of(v: Vector) -> SkySpot:
    """Return the direction of a vector of any length but 0."""
    alt = math.degrees(math.atan2(v[2], math.hypot(v[0], v[1])))
    return SkySpot(alt, math.degrees(math.atan2(v[1], v[0])) % 360.0)


def apart_deg(one: SkySpot, other: SkySpot) -> float:
    """Return the angle between two directions."""
    a, b = vector(one), vector(other)
    cross = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    return math.degrees(math.atan2(math.hypot(*cross), sum(p * q for p, q in zip(a, b, strict=True))))


def circle(middle: SkySpot, radius_deg: float, count: int) -> Iterator[SkySpot]:
    """Give points around a circle on the sky, the first once more at the end."""
    up, az = math.radians(middle.alt_deg), math.radians(middle.az_deg)
    c = vector(middle)
    u = (-math.sin(up) * math.cos(az), -math.sin(up) * math.sin(az), math.cos(up))
    w = (-math.sin(az), math.cos(az), 0.0)
    near, far = math.cos(math.radians(radius_deg)), math.sin(math.radians(radius_deg))
    for step in range(count + 1):
        turn = math.tau * step / count
        p, q = far * math.cos(turn), far * math.sin(turn)
        x, y, z = (near * c[i] + p * u[i] + q * w[i] for i in range(3))
        yield spot_of((x, y, z))


def at_instant(points: Sequence[SkyPoint], utc_s: float) -> SkySpot | None:
    """Return where a row of points leads at an instant, held at its ends; None of none."""
    if not points:
        return None
    after = bisect_right(points, utc_s, key=lambda point: point.utc_s)
    one, other = points[max(0, after - 1)], points[min(len(points) - 1, after)]
    span_s = other.utc_s - one.utc_s
    share = min(1.0, max(0.0, (utc_s - one.utc_s) / span_s)) if span_s > 0.0 else 0.0
    a, b = vector(SkySpot(one.alt_deg, one.az_deg)), vector(SkySpot(other.alt_deg, other.az_deg))
    x, y, z = (p + share * (q - p) for p, q in zip(a, b, strict=True))
    return spot_of((x, y, z))


def skyline_deg(horizon: Sequence[tuple[float, float]], floor_deg: float, az_deg: float) -> float:
    """Return the least altitude at an azimuth: straight between the skyline's points, or the floor."""
    if not horizon:
        return floor_deg
    turned = az_deg % 360.0
    after = bisect_right(horizon, turned, key=lambda point: point[0])
    (az_1, alt_1), (az_2, alt_2) = horizon[after - 1], horizon[after % len(horizon)]
    span = (az_2 - az_1) % 360.0
    share = (turned - az_1) % 360.0 / span if span > 0.0 else 0.0
    return max(floor_deg, alt_1 + share * (alt_2 - alt_1))


def over_site(
    ra_deg: float, dec_deg: float, utc_s: float, latitude_deg: float, longitude_deg: float
) -> SkySpot:
    """Return where a right ascension and declination of date stand, without air; mean sidereal time."""
    hour = math.radians(mean_sidereal_deg(utc_s, longitude_deg) - ra_deg)
    dec, lat = math.radians(dec_deg), math.radians(latitude_deg)
    north = math.cos(lat) * math.sin(dec) - math.sin(lat) * math.cos(dec) * math.cos(hour)
    east = -math.cos(dec) * math.sin(hour)
    up = math.sin(lat) * math.sin(dec) + math.cos(lat) * math.cos(dec) * math.cos(hour)
    return spot_of((north, east, up))


RINGS_DEG = (30.0, 60.0)
AZIMUTH_STEPS = 360
NARROW_ROWS = 14
"""From so many rows on, the chart's labels say more than names."""
BODY_BLOCK_S = 60.0
PLAIN_HATCH = (2 * DOTS_ACROSS, 2 * DOTS_DOWN)
HATCH = (3, 3)
PATH_STEPS = 6
"""Straight pieces between two points of the path, which bends near the zenith."""


class SkyLayer(IntEnum):
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
class ChartedSky:
    """What the chart shows: what is known of the pass, and where satellite and mount are at an instant."""

    pass_view: PassView
    utc_s: float
    satellite: SkySpot
    mount: SkySpot | None

    @property
    def sun(self) -> SkySpot | None:
        """Where the Sun stands."""
        return at_instant(self.pass_view.sun, self.utc_s)

    @property
    def moon(self) -> SkySpot | None:
        """Where the Moon stands."""
        return at_instant(self.pass_view.moon, self.utc_s)

    @property
    def pole(self) -> SkySpot:
        """The end of the mount's first axis that is up: the celestial pole, of an equatorial mount."""
        mount_pole = self.pass_view.mount_pole_deg
        if mount_pole is not None:
            alt_deg, az_deg = mount_pole
            return SkySpot(abs(alt_deg), (az_deg if alt_deg >= 0.0 else az_deg + 180.0) % 360.0)
        latitude = self.pass_view.latitude_deg
        return SkySpot(abs(latitude), 0.0 if latitude >= 0.0 else 180.0)


def mark(character: str, plain: bool) -> str:
    """Return a mark as the terminal can show it."""
    return PLAIN_MARKS.get(character, character) if plain else character


def ground(sky: ChartedSky, columns: int, rows: int, plain: bool = False) -> DotCanvas:
    """Return what lies behind: rings, skyline, the keyhole, the cones about Sun and Moon.

    It may be kept for BODY_BLOCK_S, in which the Sun comes a quarter of a degree.
    """
    canvas = DotCanvas(columns, rows, LAYERS, plain)
    disc = Disc.within(columns, rows)
    _rings(canvas, disc)
    known = sky.pass_view
    if known.horizon or known.floor_altitude_deg > 0.0:
        azimuths = [360.0 * step / AZIMUTH_STEPS for step in range(AZIMUTH_STEPS + 1)]
        edge = [SkySpot(skyline_deg(known.horizon, known.floor_altitude_deg, az), az) for az in azimuths]
        canvas.line([disc.place(spot) for spot in edge], SkyLayer.MASK)
    for body, cone_deg, kind in (
        (sky.sun, known.sun_cone_deg, SkyLayer.SUN),
        (sky.moon, known.moon_cone_deg, SkyLayer.MOON),
    ):
        if body is not None and cone_deg > 0.0 and body.alt_deg > -cone_deg:
            canvas.line([disc.place(spot) for spot in circle(body, cone_deg, 120)], kind)
    _hatch(canvas, disc, sky, plain)
    if known.keyhole_deg is not None:
        for number, spot in enumerate(circle(sky.pole, known.keyhole_deg, 90)):
            place = disc.place(spot)
            if place is not None and (plain or number % 3):
                canvas.dot(*place, SkyLayer.KEYHOLE)
    return canvas


def chart(sky: ChartedSky, behind: DotCanvas) -> DotCanvas:
    """Return the chart of an instant, drawn over its ground."""
    canvas, plain = behind.copy(), behind.plain
    disc = Disc.within(canvas.columns, canvas.rows)
    _path(canvas, disc, sky)
    _marks(canvas, disc, sky, plain)
    _labels(canvas, disc, sky, canvas.rows >= NARROW_ROWS)
    return canvas


def notes(sky: ChartedSky, plain: bool = False) -> list[Row]:
    """Return what the chart shows as text, each with its mark."""
    known = sky.pass_view
    rows: list[Row] = [
        _note(mark(SATELLITE, plain), SATELLITE_STYLE, "satellite", _where(sky.satellite)),
        _note(MOUNT, MOUNT_STYLE, "mount", formatting.NOTHING if sky.mount is None else _where(sky.mount)),
    ]
    if known.path:
        first, last = known.path[0], known.path[-1]
        top = max(known.path, key=lambda point: point.alt_deg)
        for name, point in (
            ("rise" if known.rises else "from", first),
            ("highest", top),
            ("set" if known.sets else "until", last),
        ):
            place = _where(SkySpot(point.alt_deg, point.az_deg))
            rows.append(_note("", "", name, f"{place} {local_time.clock(point.utc_s)}"))
    for name, body, cone_deg, style in (
        ("Sun", sky.sun, known.sun_cone_deg, SUN_STYLE),
        ("Moon", sky.moon, known.moon_cone_deg, MOON_STYLE),
    ):
        if body is not None:
            away = f"{apart_deg(body, sky.satellite):3.0f}° away"
            rows.append(_note("", style, name, f"{_where(body)} {away}"))
            if cone_deg > 0.0:
                rows.append(_note("", "", "", f" cone {cone_deg:g}°: not pointed into"))
    if known.keyhole_deg is not None:
        to_pole = apart_deg(sky.pole, sky.satellite)
        rows.append(_note("", POLE_STYLE, "pole", f" {to_pole:.0f}° away, keyhole {known.keyhole_deg:.1f}°"))
    if known.horizon:
        heights = [altitude for _, altitude in known.horizon]
        rows.append(_note("", "", "skyline", f" {min(heights):.0f}° to {max(heights):.0f}°"))
    if known.floor_altitude_deg > 0.0:
        rows.append(_note("", "", "floor", f" {known.floor_altitude_deg:g}°"))
    return rows


def legend(columns: int, plain: bool = False) -> Row:
    """Return what the marks mean, in one row: as much of it as there is room for."""
    row: Row = [
        (f" {mark(SATELLITE, plain)}", SATELLITE_STYLE),
        (" satellite  ", DIM),
        (MOUNT, MOUNT_STYLE),
        (" mount", DIM),
    ]
    room = columns - cells_of(row)
    side = next((text for text in ("  east is left", "  E is left") if len(text) <= room), "")
    return [*row, (side, DIM)] if room >= 0 else []


def _note(sign: str, style: str, name: str, text: str) -> Row:
    return [(f"{sign:1} ", style), (f"{name:<9}", style or DIM), text]


def _where(spot: SkySpot) -> str:
    turned = round(spot.az_deg) % 360
    cardinal = formatting.cardinal(spot.az_deg)
    return f"{spot.alt_deg:5.1f}° up {cardinal:<2} {turned:3d}°".replace("-", formatting.MINUS)


def _rings(canvas: DotCanvas, disc: Disc) -> None:
    for alt_deg in (0.0, *RINGS_DEG):
        out = disc.radius * (90.0 - alt_deg) / 90.0
        # The horizon is whole, the rings have gaps.
        count = max(12, math.ceil(math.tau * out / (1.0 if alt_deg == 0.0 else 4.0)))
        for step in range(count):
            place = disc.place(SkySpot(alt_deg, 360.0 * step / count))
            if place is not None:
                canvas.dot(*place, SkyLayer.RING)


def _hatch(canvas: DotCanvas, disc: Disc, sky: ChartedSky, plain: bool) -> None:
    """Hatch what is not pointed into."""
    known, sun, moon = sky.pass_view, sky.sun, sky.moon
    across, down = PLAIN_HATCH if plain else HATCH
    for y in range(down // 2, canvas.rows * DOTS_DOWN, down):
        for x in range(across // 2 + y // down % 2 * (across // 2), canvas.columns * DOTS_ACROSS, across):
            spot = disc.spot(x + 0.5, y + 0.5)
            if spot is None:
                continue
            if spot.alt_deg < skyline_deg(known.horizon, known.floor_altitude_deg, spot.az_deg):
                canvas.dot(x, y, SkyLayer.MASK)
            if sun is not None and known.sun_cone_deg > 0.0 and apart_deg(spot, sun) < known.sun_cone_deg:
                canvas.dot(x, y, SkyLayer.SUN)
            if moon is not None and known.moon_cone_deg > 0.0 and apart_deg(spot, moon) < known.moon_cone_deg:
                canvas.dot(x, y, SkyLayer.MOON)


def _path(canvas: DotCanvas, disc: Disc, sky: ChartedSky) -> None:
    number = 0
    for spot, utc_s in _fine(sky.pass_view.path):
        place = disc.place(spot)
        number += 1
        if place is None:
            continue
        if utc_s > sky.utc_s:
            canvas.dot(*place, SkyLayer.PATH)
        elif number % 6 < 2:
            canvas.dot(*place, SkyLayer.FLOWN)


@lru_cache(maxsize=1)
def _fine(path: tuple[PathPoint, ...]) -> list[tuple[SkySpot, float]]:
    """Return a path with points between its own, along great circles."""
    found: list[tuple[SkySpot, float]] = []
    for one, other in pairwise(path):
        a, b = vector(SkySpot(one.alt_deg, one.az_deg)), vector(SkySpot(other.alt_deg, other.az_deg))
        for step in range(PATH_STEPS):
            share = step / PATH_STEPS
            x, y, z = (p + share * (q - p) for p, q in zip(a, b, strict=True))
            found.append((spot_of((x, y, z)), one.utc_s + share * (other.utc_s - one.utc_s)))
    if path:
        found.append((SkySpot(path[-1].alt_deg, path[-1].az_deg), path[-1].utc_s))
    return found


def _cell(disc: Disc, spot: SkySpot | None) -> tuple[int, int] | None:
    place = None if spot is None else disc.place(spot)
    if place is None:
        return None
    return math.floor(place[0]) // DOTS_ACROSS, math.floor(place[1]) // DOTS_DOWN


def _marks(canvas: DotCanvas, disc: Disc, sky: ChartedSky, plain: bool) -> None:
    satellite, mount = _cell(disc, sky.satellite), _cell(disc, sky.mount)
    if satellite is not None and satellite == mount:
        canvas.write(*satellite, mark(BOTH, plain), SATELLITE_STYLE)
        return
    if satellite is not None:
        canvas.write(*satellite, mark(SATELLITE, plain), SATELLITE_STYLE)
    if mount is not None:
        canvas.write(*mount, MOUNT, MOUNT_STYLE)


def _labels(canvas: DotCanvas, disc: Disc, sky: ChartedSky, roomy: bool) -> None:
    for body, name, style in ((sky.sun, "Sun", SUN_STYLE), (sky.moon, "Moon", MOON_STYLE)):
        _label(canvas, _cell(disc, body), name, style, over=True)
    path, known = sky.pass_view.path, sky.pass_view
    if path:
        top = max(path, key=lambda point: point.alt_deg)
        for point, name in (
            (path[0], "rise" if known.rises else "from"),
            (path[-1], "set" if known.sets else "end"),
            (top, f"{top.alt_deg:.0f}°"),
        ):
            if point is not top and path[-1].utc_s - path[0].utc_s >= formatting.DAY_S:
                # What never sets comes round to where it was, and a time of day would be of another day.
                continue
            text = f"{name} {local_time.clock(point.utc_s)[:5]}" if roomy and point is not top else name
            _label(canvas, _cell(disc, SkySpot(point.alt_deg, point.az_deg)), text, NAME_STYLE)
    if known.keyhole_deg is not None:
        _label(canvas, _cell(disc, sky.pole), "pole" if roomy else "P", POLE_STYLE, over=True)
    for name, az in (("N", 0.0), ("E", 90.0), ("S", 180.0), ("W", 270.0)):
        _label(canvas, _cell(disc, SkySpot(0.0, az)), name, f"bold {DIM}", over=True)


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
        hidden = [canvas.covers(*at, length, layer=SkyLayer.FLOWN) for at in free]
        canvas.write(*free[hidden.index(min(hidden))], text, style)


NOTES_CELLS = 40
"""What stands beside the chart where there is so much room."""
WIDEST_SHARE = 0.45


class SkyPanel(Widget):
    """Draws the chart, with a legend or notes where there is room for them; what lies behind is kept."""

    def __init__(self) -> None:
        super().__init__(id="sky")
        self._scene: Scene | None = None
        self._drawn = Content("")
        self._ground: tuple[tuple[object, ...], DotCanvas] | None = None

    def draw(self, scene: Scene) -> None:
        """Take a new scene; nothing is redrawn where nothing has changed."""
        self._scene = scene
        self.display = scene.sky is not None
        content = rows_content(self._rows(scene))
        if not content.is_same(self._drawn):
            self._drawn = content
            self.refresh()

    def render(self) -> Content:
        """Draw."""
        return self._drawn

    def on_resize(self, event: Resize) -> None:
        """Draw again in the new size."""
        del event
        if self._scene is not None:
            self.draw(self._scene)

    def _rows(self, scene: Scene) -> list[Row]:
        columns, rows = self.content_size
        known = scene.sky
        if known is None or columns < 4 or rows < 2:
            return []
        sky = sky_of(known, scene)
        if columns >= 2 * rows + NOTES_CELLS:
            beside = [*notes(sky, scene.plain), [], *_error(scene)]
            drawn = self._chart(sky, 2 * rows, rows, scene.plain)
            return [
                [*row, "  ", *(beside[number - 1] if 0 < number <= len(beside) else [])]
                for number, row in enumerate(drawn)
            ]
        if rows > NARROW_ROWS:
            return [*self._chart(sky, columns, rows - 1, scene.plain), legend(columns, scene.plain)]
        return self._chart(sky, columns, rows, scene.plain)

    def _chart(self, sky: ChartedSky, columns: int, rows: int, plain: bool) -> list[Row]:
        key = (id(sky.pass_view), columns, rows, plain, sky.utc_s // BODY_BLOCK_S)
        if self._ground is None or self._ground[0] != key:
            self._ground = key, ground(sky, columns, rows, plain)
        return chart(sky, self._ground[1]).drawn()


class NotesPanel(Panel):
    """What the chart shows, as text."""

    def full(self, scene: Scene) -> list[Row]:
        """Return a row for each."""
        return [] if scene.sky is None else notes(sky_of(scene.sky, scene), scene.plain)


def _error(scene: Scene) -> list[Row]:
    """Return the error in two rows: where the sky is alone, its panels are not there."""
    error, view = scene.view.error, scene.view
    if error is None:
        return []
    name = "error" if scene.following else "way to go"
    size, along, across = (
        (formatting.arcsec(value, sign), "bold")
        for value, sign in (
            (error.total_arcsec, False),
            (error.along_arcsec, True),
            (error.across_arcsec, True),
        )
    )
    recent = formatting.arcsec(view.rms_10s_arcsec)
    return [
        [(f"  {name:<10}", DIM), size, ("  RMS 10 s ", DIM), (recent, "bold")],
        [("  along     ", DIM), along, ("  across ", DIM), across],
    ]


def sky_of(known: PassView, scene: Scene) -> ChartedSky:
    """Return the sky of a scene: satellite and mount by what its view says."""
    view = scene.view
    mount = None
    if view.mount_ra_deg is not None and view.mount_dec_deg is not None:
        mount = over_site(
            view.mount_ra_deg, view.mount_dec_deg, view.utc_s, known.latitude_deg, known.longitude_deg
        )
    return ChartedSky(known, view.utc_s, SkySpot(view.target_alt_deg, view.target_az_deg), mount)


def chart_columns(width: int, height: int, frame: int) -> int:
    """Return how wide the chart is beside a plot, in an area of so many cells, `frame` its border."""
    return min(2 * (height - frame) + frame, int(WIDEST_SHARE * width))
