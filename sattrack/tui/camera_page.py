"""The page of a run's cameras: the picture, what was seen in it, and whether it leads the mount.

The picture is drawn in real pixels where the terminal has them (`graphics`), else with half blocks, two of
its pixels in a cell. Where colours do not tell levels of light apart, a chart shows what was detected.
"""

from __future__ import annotations

import math
from enum import IntEnum
from functools import lru_cache
from textwrap import wrap
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rich.segment import Segment
from rich.style import Style
from textual.containers import Horizontal
from textual.content import Content
from textual.strip import Strip

from sattrack.tui.graphics import ImagePlacement, ImageSpot, Mark, RealPicture, painted, picture_of
from sattrack.tui.look import DIM, SPOKEN, ScreenApp, concrete
from sattrack.tui.panels import (
    DOTS_ACROSS,
    DOTS_DOWN,
    DotCanvas,
    Layer,
    Redrawn,
    Row,
    labelled,
    rows_content,
)
from sattrack.tui.scene import Tone
from sattrack.views import formatting
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from textual.app import ComposeResult
    from textual.events import Click
    from textual.theme import Theme

    from sattrack.tui.graphics import Levels
    from sattrack.tui.scene import Scene, TerminalPixels
    from sattrack.views.picture import PictureView
    from sattrack.views.run import CameraView, LoopView, TrackView

LIGHTS = 32
"""So many levels of light are drawn."""
NOISE_LEVEL = 40
"""Of 255: what is darker is noise, and drawn as the sky is."""
OLD_S = 5.0
"""A picture that is older has its age beside it."""
CURSOR_STEPS = 24
"""So many presses of an arrow cross the picture."""
CROSS_SHARE, GAP_SHARE = 0.08, 0.02
"""Of the picture's shorter side: how far the crosshair's arms reach, and where they begin."""
CROSS, CIRCLE, SEEN, CURSOR = "$primary", "$quiet", "$success", "$warning"
NO_PICTURE = "no picture yet: `track --camera SOURCE`, or `sattrack camera SOURCE` beside the run"
LABEL_CELLS = 8
MOST_LINES = 3
"""Of one reason."""
MORE_ROOM = "80 × 24"


class CameraDesk:
    """The newest pictures of a run's cameras, the one that is shown, and the cursor in it."""

    def __init__(self) -> None:
        self._pictures: dict[str, tuple[PictureView, float]] = {}
        self._chosen = ""
        self.cursor: ImageSpot | None = None

    def take(self, pictures: Mapping[str, PictureView], now_s: float) -> None:
        """Take in what has come, at an instant of this process' clock."""
        for name, picture in pictures.items():
            self._pictures[name] = picture, now_s
        if self._chosen not in self._pictures and self._pictures:
            self._chosen = min(self._pictures)

    @property
    def picture(self) -> PictureView | None:
        """The one that is shown."""
        found = self._pictures.get(self._chosen)
        return None if found is None else found[0]

    @property
    def count(self) -> int:
        """How many cameras have shown a picture."""
        return len(self._pictures)

    def age_s(self, now_s: float) -> float:
        """Return for how long the picture has been shown."""
        found = self._pictures.get(self._chosen)
        return 0.0 if found is None else now_s - found[1]

    def turn(self) -> None:
        """Go on to the next camera."""
        names = sorted(self._pictures)
        if names:
            self._chosen = names[(names.index(self._chosen) + 1) % len(names)]
            self.cursor = None

    def forget(self) -> None:
        """Begin with another run."""
        self._pictures.clear()
        self._chosen, self.cursor = "", None

    def move(self, right: int, up: int) -> None:
        """Move the cursor by steps; it begins in the middle."""
        picture = self.picture
        if picture is None:
            return
        step = max(picture.width, picture.height) / CURSOR_STEPS
        at = self.cursor or ImageSpot(0.0, 0.0)
        self.point(ImageSpot(at.right_px + right * step, at.up_px + up * step))

    def point(self, spot: ImageSpot | None) -> None:
        """Put the cursor somewhere, within the frame; None takes it away."""
        picture = self.picture
        if spot is None or picture is None:
            self.cursor = None
            return
        half = 0.5 * picture.width, 0.5 * picture.height
        right, up = (max(-most, min(most, value)) for value, most in zip(spot, half, strict=True))
        self.cursor = ImageSpot(right, up)

    @property
    def pointed(self) -> ImageSpot | None:
        """What Enter brings to the middle: what the cursor is on, else what was detected."""
        picture = self.picture
        if self.cursor is not None or picture is None:
            return self.cursor
        if picture.right_px is None or picture.up_px is None:
            return None
        return ImageSpot(picture.right_px, picture.up_px)

    def shift_deg(self, view: TrackView) -> tuple[float, float] | str:
        """Return how far east and north the mount must go for that; why that is unknown, in words."""
        picture, spot = self.picture, self.pointed
        if picture is None or spot is None:
            return "nothing to centre: the arrows move a cursor in the picture"
        if picture.scale_arcsec_px is None:
            return "not centred: the camera's scale is not known; give --scale"
        turned = turned_deg(picture, view)
        angle = math.radians(field_deg(view) if turned is None else turned)
        flipped, known = picture.flipped, camera_of(picture, view)
        scale_deg = picture.scale_arcsec_px / 3600.0
        if known is not None:
            flipped = (known.flipped if flipped is None else flipped) != known.found_mirrored
            scale_deg *= 1.0 + known.found_scale
        right = -spot.right_px if flipped else spot.right_px
        east = spot.up_px * math.sin(angle) - right * math.cos(angle)
        north = spot.up_px * math.cos(angle) + right * math.sin(angle)
        return scale_deg * east, scale_deg * north


def field_deg(view: TrackView) -> float:
    """Return how a camera on the tube is turned on the sky; 0 for an equatorial mount."""
    return 0.0 if view.axes is None else view.axes.field_angle_deg


def camera_of(picture: PictureView, view: TrackView) -> CameraView | None:
    """Return what the run knows of the camera of a picture; None where it has taken none of its offsets."""
    cameras = () if view.loop is None else view.loop.cameras
    return next((one for one in cameras if one.name == picture.camera), None)


def turned_deg(picture: PictureView, view: TrackView) -> float | None:
    """Return the position angle of a picture's up: by the camera, else by the run, with what was found."""
    known = camera_of(picture, view)
    if known is None:
        return picture.rotation_deg
    said = picture.rotation_deg
    return (known.rotation_deg + field_deg(view) if said is None else said) + known.found_rotation_deg


class ImageDots(NamedTuple):
    """So many dots of a screen, across and down."""

    across: int
    down: int


def marks(
    fit: ImagePlacement, picture: PictureView, cursor: ImageSpot | None, fov_deg: float | None
) -> Iterator[Mark]:
    """Give what lies over a picture, what must not be hidden last."""
    if fov_deg is not None and picture.scale_arcsec_px is not None:
        radius = 0.5 * 3600.0 * fov_deg / picture.scale_arcsec_px
        dots = max(16, int(2.0 * radius * fit.scale))
        for step in range(dots):
            turn = math.tau * step / dots
            yield Mark(*fit.place(radius * math.cos(turn), radius * math.sin(turn)), CIRCLE)
    x, y = fit.place(0.0, 0.0)
    short = min(fit.across, fit.down)
    for out in range(max(2, round(GAP_SHARE * short)), max(4, round(CROSS_SHARE * short)) + 1):
        for dx, dy in ((out, 0), (-out, 0), (0, out), (0, -out)):
            yield Mark(x + dx, y + dy, CROSS)
    if picture.right_px is not None and picture.up_px is not None:
        yield from _corners(*fit.place(picture.right_px, picture.up_px), max(3, round(0.04 * short)))
    if cursor is not None:
        x, y = fit.place(*cursor)
        reach = max(2, round(0.02 * short))
        for out in range(-reach, reach + 1):
            yield Mark(x + out, y + out, CURSOR)
            yield Mark(x + out, y - out, CURSOR)


def _corners(x: int, y: int, out: int) -> Iterator[Mark]:
    """Give the corners of a square about a dot, which itself stays visible."""
    for sign_x in (-1, 1):
        for sign_y in (-1, 1):
            for inward in range(max(2, out // 2)):
                yield Mark(x + sign_x * (out - inward), y + sign_y * out, SEEN)
                yield Mark(x + sign_x * out, y + sign_y * (out - inward), SEEN)


def scaled(picture: PictureView, across: int, down: int) -> Levels:
    """Return a picture's levels in so many columns and rows: where it shrinks, a point keeps its light."""
    levels = np.frombuffer(picture.pixels, np.uint8).reshape(picture.rows, picture.columns)
    for axis, wanted in ((0, down), (1, across)):
        have = levels.shape[axis]
        starts = np.arange(wanted) * have // wanted
        if wanted < have:
            levels = np.maximum.reduceat(levels, starts, axis=axis)
        else:
            levels = np.take(levels, starts, axis=axis)
    return levels


def lit(levels: Levels) -> Levels:
    """Return levels from 0 to 255 without what is noise."""
    above = np.maximum(levels, NOISE_LEVEL).astype(np.uint16) - NOISE_LEVEL
    return (above * 255 // (255 - NOISE_LEVEL)).astype(np.uint8)


@lru_cache(maxsize=4096)
def _style(upper: str, lower: str) -> Style:
    return Style.parse(f"{upper} on {lower}")


@lru_cache(maxsize=8)
def _ramp(dark: str, light: str) -> tuple[str, ...]:
    """Return the colours from the darkest to the lightest."""
    ends = [[int(text[i : i + 2], 16) for i in (1, 3, 5)] for text in (dark, light)]
    shares = (step / (LIGHTS - 1) for step in range(LIGHTS))
    return tuple(
        "#" + "".join(f"{round(a + share * (b - a)):02x}" for a, b in zip(*ends, strict=True))
        for share in shares
    )


def half_blocks(
    picture: PictureView, size: tuple[int, int], theme: Theme, over: tuple[Mark, ...], fit: ImagePlacement
) -> list[Strip]:
    """Return a picture in so many columns and rows of cells, with what lies over it."""
    columns, rows = size
    dark = concrete("$background", theme)
    ramp = _ramp(dark, concrete("$foreground", theme))
    lights = lit(scaled(picture, fit.across, fit.down)).astype(np.uint16) * (LIGHTS - 1) // 255
    pixels = [[dark] * columns for _ in range(2 * rows)]
    top, left = int(fit.top), int(fit.left)
    for y, row in enumerate(lights):
        pixels[top + y][left : left + fit.across] = [ramp[level] for level in row]
    for x, y, style in over:
        inside = top <= y < top + fit.down and left <= x < left + fit.across
        if inside:
            pixels[y][x] = concrete(style, theme)
    strips = []
    for upper, lower in zip(pixels[::2], pixels[1::2], strict=True):
        segments: list[Segment] = []
        for pair in zip(upper, lower, strict=True):
            colours = _style(*pair)
            if segments and segments[-1].style is colours:
                segments[-1] = Segment(segments[-1].text + "▀", colours)
            else:
                segments.append(Segment("▀", colours))
        strips.append(Strip(segments, columns))
    return strips


class ChartLayer(IntEnum):
    """What a dot of the chart belongs to."""

    EDGE = 0
    CIRCLE = 1


CHART_LAYERS = (Layer("$quiet", "."), Layer("$foreground", "-"))
BRIGHT_SHARE = 0.3


def chart(picture: PictureView, size: tuple[int, int], cursor: ImageSpot | None, scene: Scene) -> list[Row]:
    """Return what was detected, as rows of cells: without the picture's own light."""
    columns, rows = size
    canvas = DotCanvas(columns, rows, CHART_LAYERS, scene.plain)
    fit = ImagePlacement.into(DOTS_ACROSS * columns, DOTS_DOWN * rows, picture)
    half = 0.5 * picture.width, 0.5 * picture.height
    corners = ((-1, 1), (1, 1), (1, -1), (-1, -1), (-1, 1))
    inset = 1.0 / fit.scale
    canvas.line(
        [fit.place(x * (half[0] - inset), y * (half[1] - inset)) for x, y in corners], ChartLayer.EDGE
    )
    fov_deg = None if scene.sky is None else scene.sky.fov_deg
    for mark in marks(fit, picture, None, fov_deg):
        if mark.style == CIRCLE:
            canvas.dot(mark.x, mark.y, ChartLayer.CIRCLE)
    written: list[tuple[float, float, str, str]] = []
    if picture.right_px is not None and picture.up_px is not None:
        written.append((picture.right_px, picture.up_px, "●", f"bold {SEEN}"))
    if cursor is not None:
        written.append((*cursor, "×", f"bold {CURSOR}"))
    written.append((0.0, 0.0, "+", f"bold {CROSS}"))
    written += [
        (star.right_px, star.up_px, "*" if star.share > BRIGHT_SHARE else "·", "") for star in picture.stars
    ]
    for right, up, text, style in written:
        x, y = fit.place(right, up)
        canvas.write(x // DOTS_ACROSS, y // DOTS_DOWN, text, style)
    return canvas.drawn()


class PictureBox(Redrawn):
    """Draws the picture, or the chart; a click puts the cursor there."""

    def __init__(self) -> None:
        super().__init__(id="picture")
        self._desk = CameraDesk()
        self._scene: Scene | None = None
        self._strips: list[Strip] = []
        self._shown: tuple[object, ...] = ()

    def draw(self, desk: CameraDesk, scene: Scene) -> None:
        """Take the newest; nothing is redrawn where nothing has changed."""
        self._desk, self._scene = desk, scene
        if self._blocks:
            if self._state() != self._shown:
                self.refresh()
        else:
            self.renew()

    @property
    def _blocks(self) -> bool:
        """Whether the picture itself can be shown."""
        assert isinstance(self.app, ScreenApp)
        plain = self._scene is not None and self._scene.plain
        return self._desk.picture is not None and not (self.app.shapes or plain)

    def _state(self) -> tuple[object, ...]:
        """Return what the strips depend on."""
        size = self.content_size
        return self._desk.picture, self._desk.cursor, size, self.app.theme, self._fov_deg

    @property
    def _fov_deg(self) -> float | None:
        return None if self._scene is None or self._scene.sky is None else self._scene.sky.fov_deg

    def _fit(self, picture: PictureView, across: int, down: int) -> ImagePlacement:
        columns, rows = self.content_size
        return ImagePlacement.into(across * columns, down * rows, picture)

    def render_line(self, y: int) -> Strip:
        """Draw one row."""
        picture = self._desk.picture
        if not self._blocks or picture is None or not self.content_size.area:
            self._shown = ()
            return super().render_line(y)
        state = self._state()
        if state != self._shown:
            size = self.content_size
            fit = self._fit(picture, 1, 2)
            over = tuple(marks(fit, picture, self._desk.cursor, self._fov_deg))
            self._strips = half_blocks(picture, (size.width, size.height), self._theme, over, fit)
            self._shown = state
        inside = y - (self.content_region.y - self.region.y)
        if not 0 <= inside < len(self._strips):
            return super().render_line(y)
        return self._strips[inside]

    @property
    def _theme(self) -> Theme:
        return self.app.current_theme

    def _content(self) -> Content:
        picture = self._desk.picture
        if picture is None or self._scene is None:
            return rows_content([[(NO_PICTURE, DIM)]])
        columns, rows = self.content_size
        if self._blocks or not (columns and rows):
            return Content("")
        return rows_content(chart(picture, (columns, rows), self._desk.cursor, self._scene))

    def on_click(self, event: Click) -> None:
        """Put the cursor where the picture was clicked."""
        across, down = (1, 2) if self._blocks else (DOTS_ACROSS, DOTS_DOWN)
        columns, rows = self.content_size
        spot = (event.x + 0.5) * across, (event.y + 0.5) * down
        self.point(ImageDots(across * columns, down * rows), *spot)

    def point(self, dots: ImageDots, x: float, y: float) -> None:
        """Put the cursor on a dot of so many."""
        picture = self._desk.picture
        if picture is None or self._scene is None or not self._scene.in_control:
            return
        self._desk.point(ImagePlacement.into(*dots, picture).spot(x, y))
        self.draw(self._desk, self._scene)

    def paint(self, real: RealPicture, now_s: float) -> None:
        """Have the picture shown in real pixels, where it has changed: those need no colours of the text."""
        picture, dots = self._desk.picture, ImageDots(*real.dots)
        state = picture, self._desk.cursor, dots, self.app.theme, self._fov_deg
        if picture is None or not all(dots) or not real.wants(state, now_s):
            return
        fit = ImagePlacement.into(*dots, picture)
        over = marks(fit, picture, self._desk.cursor, self._fov_deg)
        levels = lit(scaled(picture, fit.across, fit.down))
        real.show(painted(levels, fit, dots, over, self._theme))


class CameraState(Redrawn):
    """Says beside the picture what leads the mount, and what was seen."""

    def __init__(self) -> None:
        super().__init__(id="camera-state")
        self._rows: list[Row] = []

    def draw(self, desk: CameraDesk, scene: Scene, age_s: float) -> None:
        """Take the newest; nothing is redrawn where nothing has changed."""
        columns = max(1, self.content_size.width - LABEL_CELLS)
        self._rows = state_rows(desk, scene, age_s, columns)
        self.renew()

    def _content(self) -> Content:
        room = max(1, self.content_size.height)
        rows = self._rows
        if len(rows) > room:
            hidden = len(rows) - room + 1
            rows = [*rows[: room - 1], [(f"{hidden} more lines: {MORE_ROOM}", SPOKEN[Tone.NOTICE])]]
        return rows_content(rows)


def state_rows(desk: CameraDesk, scene: Scene, age_s: float, columns: int) -> list[Row]:
    """Return the rows beside the picture, the most important first; reasons wrap after so many columns."""
    picture, loop = desk.picture, scene.view.loop
    rows = _loop_rows(loop, scene.plain, columns)
    if picture is None:
        return rows
    rows += [*_seen_rows(picture, scene, columns), *_frame_rows(picture, scene.view, age_s, desk.count)]
    if desk.cursor is not None:
        rows.append(_labelled("cursor", _apart(*desk.cursor, picture.scale_arcsec_px)))
    if scene.in_control and not scene.ended:
        guided = loop is None or loop.guided
        rows += [[], [("g", "bold"), (f" {'not by camera' if guided else 'guide by camera'}", DIM)]]
        rows.append([("a", "bold"), (" accept  ", DIM), ("r", "bold"), (" reject", DIM)])
        rows.append([("← → ↑ ↓", "bold"), (" cursor  ", DIM), ("Enter", "bold"), (" centre it", DIM)])
    return rows


def _labelled(label: str, *parts: str | tuple[str, str]) -> Row:
    return labelled(label, *parts, cells=LABEL_CELLS)


def _wrapped(label: str, text: str, style: str, columns: int) -> list[Row]:
    lines = wrap(text, columns)[:MOST_LINES]
    return [_labelled("" if n else label, (line, style)) for n, line in enumerate(lines)]


def _loop_rows(loop: LoopView | None, plain: bool, columns: int) -> list[Row]:
    if loop is None:
        return [_labelled("loop", ("elements only", "bold"))]
    tone = {"camera": Tone.GOOD, "lost": Tone.NOTICE}.get(loop.state, Tone.CALM)
    rows = [_labelled("loop", (formatting.loop_text(loop, plain), SPOKEN[tone]))]
    if not loop.guided:
        rows.append(_labelled("", ("the camera is not followed", SPOKEN[Tone.NOTICE])))
    if loop.last is not None:
        taken = loop.last == "taken"
        rows += _wrapped("last", loop.last, SPOKEN[Tone.GOOD] if taken else "", columns)
    return rows


def _seen_rows(picture: PictureView, scene: Scene, columns: int) -> list[Row]:
    estimate = scene.view.estimate
    rows: list[Row] = []
    if picture.kind == "none" or picture.right_px is None or picture.up_px is None:
        rows += [_labelled("seen", ("nothing", SPOKEN[Tone.NOTICE]))]
        rows += _wrapped("", picture.why or "", DIM, columns)
    else:
        snr = "" if picture.snr is None else f"  SNR {picture.snr:.0f}"
        rows.append(_labelled("seen", (picture.kind, SPOKEN[Tone.GOOD]), snr))
        rows.append(_labelled("at", _apart(picture.right_px, picture.up_px, picture.scale_arcsec_px)))
    if estimate is not None:
        every = estimate.accepted + estimate.rejected + estimate.refused
        rows.append(_labelled("used", f"{estimate.accepted} of {every}"))
    return rows


def _frame_rows(picture: PictureView, view: TrackView, age_s: float, count: int) -> list[Row]:
    more: Row = [("  f", "bold"), (" next", DIM)] if count > 1 else []
    gain = "" if picture.gain is None else f"  gain {picture.gain:g}"
    when = formatting.clock(float(Utc.parse(picture.utc).unix_s))
    late: Row = [(f"  {age_s:.0f} s old", SPOKEN[Tone.NOTICE])] if age_s > OLD_S else []
    turned = turned_deg(picture, view)
    scale = "no scale" if picture.scale_arcsec_px is None else f"{picture.scale_arcsec_px:.3g}″/px"
    up = "up not known" if turned is None else f"up at {round(turned) % 360}°"
    field = "solved" if picture.solved else "not solved"
    return [
        _labelled("camera", (picture.camera, "bold"), *more),
        _labelled("frame", when, *late),
        _labelled("exposed", f"{picture.exposure_s:.3g} s{gain}"),
        _labelled("image", f"{scale}  {up}{'  mirrored' if picture.flipped else ''}"),
        _labelled("field", f"{field}  {formatting.counted(len(picture.stars), 'star')}"),
        *_clock_rows(picture, view.loop),
    ]


def _clock_rows(picture: PictureView, loop: LoopView | None) -> list[Row]:
    """Return what the stars say of the camera's clock."""
    for one in () if loop is None else loop.clocks:
        if one.camera == picture.camera:
            value = f"{one.clock_s:+.3f} ± {one.sigma_s:.3f} s".replace("-", formatting.MINUS)
            done = ("  corrected", SPOKEN[Tone.GOOD]) if one.corrected_s else ("  not corrected", DIM)
            return [_labelled("clock", value, done)]
    return []


def _apart(right_px: float, up_px: float, scale: float | None) -> str:
    """Return a place from the middle, on the sky where the scale is known."""
    if scale is None:
        return f"{right_px:+.0f} {up_px:+.0f} px".replace("-", formatting.MINUS)
    right, up = (formatting.arcsec(value * scale, sign=True) for value in (right_px, up_px))
    return f"{right} right  {up} up"


class CameraPage(Horizontal):
    """The picture, and beside it what it comes to."""

    def __init__(self, pixels: TerminalPixels | None = None) -> None:
        super().__init__(id="camera")
        self._pixels = pixels

    def compose(self) -> ComposeResult:
        """Make both."""
        yield PictureBox()
        if self._pixels is not None:
            yield picture_of(self._pixels)
        yield CameraState()

    def draw(self, desk: CameraDesk, scene: Scene, now_s: float) -> None:
        """Draw the newest picture."""
        box = self.query_one(PictureBox)
        box.draw(desk, scene)
        for real in self.query(RealPicture):
            shown = desk.picture is not None and not (scene.plain or self.app.no_color) and real.possible
            real.display, box.display = shown, not shown
            if shown:
                box.paint(real, now_s)
        self.query_one(CameraState).draw(desk, scene, desk.age_s(now_s))

    def on_real_picture_pointed(self, event: RealPicture.Pointed) -> None:
        """Put the cursor where the picture was clicked."""
        dots = ImageDots(*self.query_one(RealPicture).dots)
        self.query_one(PictureBox).point(dots, event.x, event.y)
