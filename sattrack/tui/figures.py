"""The panels of figures: error, satellite, times, link, mount, bias, and the error expected in the field."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING

from rich.cells import cell_len
from textual.containers import Horizontal, Vertical
from textual.widgets import Digits, Static

from sattrack.core import local_time
from sattrack.tui.look import DIM, SPOKEN
from sattrack.tui.panels import (
    DOTS_ACROSS,
    DOTS_DOWN,
    LABEL_CELLS,
    DotCanvas,
    Layer,
    Panel,
    Part,
    Row,
    cells_of,
    labelled,
)
from sattrack.tui.scene import LABELS, TRACK, Scene, Tone, axis_names, by_elements, headline
from sattrack.views import formatting

if TYPE_CHECKING:
    from textual.app import ComposeResult

    from sattrack.mount.model import LinkView
    from sattrack.tui.scene import Move
    from sattrack.views.run import PassView, TrackView

ARCSEC = 3600.0
MOST_UNTIL = len("in 1:45:05")
"""What the narrowest column of times has room for."""
SIGMAS = 2.0
FIELD_ROOM = 1.08
CENTRE, PLAIN_CENTRE = "×", "x"


class FieldLayer(IntEnum):
    """What a dot belongs to."""

    FIELD = 0
    EXPECTED = 1


FIELD_LAYERS = (Layer("$quiet", "."), Layer("bold $primary", "o"))


@dataclass(frozen=True, slots=True)
class ExpectedField:
    """What is drawn, arcseconds on the sky: one sigma along and across, the field's radius, its offsets."""

    along_arcsec: float
    across_arcsec: float
    radius_arcsec: float | None
    offset_along_arcsec: float
    offset_across_arcsec: float

    @property
    def seen(self) -> str | None:
        """How much of two sigmas lies in the field; None where no field is known."""
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


def field_of(pass_view: PassView | None, view: TrackView) -> ExpectedField | None:
    """Return what to draw at a view's instant; None where the expected error is not known."""
    if pass_view is None or pass_view.along_arcsec is None or pass_view.across_arcsec is None:
        return None
    near = min(pass_view.path, key=lambda point: abs(point.utc_s - view.utc_s), default=None)
    along_deg_s = 0.0 if near is None else near.along_deg_s
    return ExpectedField(
        pass_view.along_arcsec,
        pass_view.across_arcsec,
        None if pass_view.fov_deg is None else 0.5 * pass_view.fov_deg * ARCSEC,
        view.bias_along_s * along_deg_s * ARCSEC,
        view.bias_cross_deg * ARCSEC,
    )


def field_picture(field: ExpectedField, columns: int, rows: int, plain: bool = False) -> list[Row]:
    """Return the ellipse of two sigmas and the field's circle, as large as fits."""
    canvas = DotCanvas(columns, rows, FIELD_LAYERS, plain)
    x, y = 0.5 * columns * DOTS_ACROSS, 0.5 * rows * DOTS_DOWN
    wide, high = SIGMAS * field.along_arcsec, SIGMAS * field.across_arcsec
    if field.radius_arcsec is not None:
        wide = max(wide, field.radius_arcsec + abs(field.offset_along_arcsec))
        high = max(high, field.radius_arcsec + abs(field.offset_across_arcsec))
    scale = min((x - 0.5) / max(wide, 1e-9), (y - 0.5) / max(high, 1e-9)) / FIELD_ROOM
    if field.radius_arcsec is not None:
        middle = x + scale * field.offset_along_arcsec, y - scale * field.offset_across_arcsec
        _oval(canvas, middle, scale * field.radius_arcsec, scale * field.radius_arcsec, FieldLayer.FIELD)
        mark = PLAIN_CENTRE if plain else CENTRE
        canvas.write(int(middle[0]) // DOTS_ACROSS, int(middle[1]) // DOTS_DOWN, mark, DIM)
    axes = scale * SIGMAS * field.along_arcsec, scale * SIGMAS * field.across_arcsec
    _oval(canvas, (x, y), *axes, FieldLayer.EXPECTED)
    return canvas.drawn()


def field_rows(field: ExpectedField | None, plain: bool = False) -> list[Row]:
    """Return its sizes, a name and a figure in turn: two sigmas of the error, and the field's diameter."""
    if field is None:
        return [[("no error", DIM)], [("known", DIM)]]
    rows: list[Row] = [
        [("along", DIM)],
        [(formatting.within(formatting.arcsec(SIGMAS * field.along_arcsec), plain), "bold")],
        [("across", DIM)],
        [(formatting.within(formatting.arcsec(SIGMAS * field.across_arcsec), plain), "bold")],
    ]
    if field.radius_arcsec is None:
        return [*rows, [("field", DIM)], [("--fov", DIM)]]
    return [*rows, [("field", DIM)], [(formatting.arcsec(2.0 * field.radius_arcsec), "bold")]]


def _oval(canvas: DotCanvas, middle: tuple[float, float], wide: float, high: float, kind: FieldLayer) -> None:
    count = max(16, math.ceil(math.tau * max(wide, high)))
    for step in range(count):
        turn = math.tau * step / count
        canvas.dot(middle[0] + wide * math.cos(turn), middle[1] + high * math.sin(turn), kind)


RATE_NEAR_LIMIT = 0.95
FIELD_FIGURES_CELLS = 8
GAUGE_CELLS = 12
FULL_GAUGE_FREE_CELLS = 17
"""What stands beside a bar of its own row."""


class ErrorCaption(Panel):
    """Says what the large figure is."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        if scene.following or scene.view.error is None:
            return [[("error on the sky", DIM)]]
        return [[("way from mount to satellite", DIM)]]


class RmsLine(Panel):
    """The error's RMS, recent and in all."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        view = scene.view
        recent, whole = formatting.arcsec(view.rms_10s_arcsec), formatting.arcsec(view.rms_pass_arcsec)
        return [[("RMS 10 s ", DIM), (recent, "bold"), ("  pass ", DIM), (whole, "bold")]]


class ErrorBox(Vertical):
    """The error on the sky, large."""

    def compose(self) -> ComposeResult:
        """Make the parts."""
        yield ErrorCaption()
        with Horizontal(id="digits-row"):
            yield Digits(formatting.NOTHING)
            yield Static("", id="unit", markup=False)
        yield RmsLine()

    def show(self, scene: Scene) -> None:
        """Take a new scene."""
        error = scene.view.error
        digits, unit = (
            (formatting.NOTHING, "") if error is None else formatting.arcsec_parts(error.total_arcsec)
        )
        self.query_one(Digits).update(digits)
        self.query_one("#unit", Static).update(unit)
        tone = headline(scene).tone if scene.following else Tone.CALM
        for each in Tone:
            self.set_class(each is tone, each.value)


class AxesPanel(Panel):
    """The error by direction: along and across the motion, and on each axis."""

    def full(self, scene: Scene) -> list[Row]:
        """Return a row for each direction."""
        error = scene.view.error
        values = (
            ("along", None if error is None else error.along_arcsec),
            ("across", None if error is None else error.across_arcsec),
            (f"{axis_names(scene)[0]} on sky", None if error is None else error.ra_arcsec),
            (axis_names(scene)[1], None if error is None else error.dec_arcsec),
        )
        style = "bold" if scene.following else ""
        rows: list[Row] = [[("mount − satellite", DIM)]]
        cells = max(LABEL_CELLS, *(len(name) for name, _ in values))
        rows += [
            labelled(name, (f"{formatting.arcsec(value, sign=True):>10}", style), cells=cells)
            for name, value in values
        ]
        return rows


PLACE_ROWS = 5


class WherePanel(Panel):
    """Where the satellite is, and how the field of a camera on the tube turns where it does."""

    def full(self, scene: Scene) -> list[Row]:
        """Return a row for each coordinate."""
        view = scene.view
        low = view.target_alt_deg < 0.0
        alt = f"{view.target_alt_deg:.1f}°".replace("-", formatting.MINUS)
        below: Part = (" not up", SPOKEN[Tone.NOTICE]) if low else ""
        range_km = "-" if view.range_km is None else f"{view.range_km:.0f} km"
        rows = [
            labelled("alt", (alt, "bold"), below, cells=7),
            labelled("az", (formatting.azimuth(view.target_az_deg), "bold"), cells=7),
            labelled("range", (range_km, "bold"), cells=7),
            labelled("RA", formatting.right_ascension(view.target_ra_deg), cells=7),
            labelled("Dec", formatting.degrees(view.target_dec_deg), cells=7),
        ]
        if view.axes is not None:
            angle = formatting.number(view.axes.field_angle_deg, 0, "°", sign=True)
            rate = formatting.number(view.axes.field_rate_deg_s, 3, "°/s", sign=True)
            rows.append(labelled("field", (f"{angle} {rate}", "bold"), cells=7))
        if view.periodic_arcsec is not None:
            first, second = (formatting.number(one, 1, "″", sign=True) for one in view.periodic_arcsec)
            rows.append(labelled("gears", (f"{first} {second}", "bold"), cells=7))
        # The range is what one who needs these can do without, then the place by the stars.
        for _ in range(min(len(rows) - PLACE_ROWS, len(rows) - self.content_size.height)):
            del rows[2]
        return rows


TIMES_CELLS, FILE_CELLS = 12, 24


class TimesPanel(Panel):
    """How long until what, and by what that is known."""

    def full(self, scene: Scene) -> list[Row]:
        """Return a row for each instant."""
        view, width = scene.view, self.content_size.width
        first, last = _ends(scene)
        rows = [
            self._row(first, view.start_utc_s, view.utc_s),
            self._row("culmination", view.culminate_utc_s, view.utc_s),
            labelled("", f"at {view.max_alt_deg:.1f}°", cells=TIMES_CELLS),
            self._row(last, view.end_utc_s, view.utc_s),
            *_source_rows(scene, width),
            labelled("recording", _recording(scene, width - TIMES_CELLS), cells=TIMES_CELLS),
        ]
        if len(rows) > self.content_size.height:
            rows[1:3] = [self._row(f"{view.max_alt_deg:.1f}° high", view.culminate_utc_s, view.utc_s)]
        return rows

    def compact(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        view = scene.view
        first, last = _ends(scene)
        return [
            [
                (f"{first} ", DIM),
                (_until(view.start_utc_s - view.utc_s), "bold"),
                ("    culmination ", DIM),
                (_until(view.culminate_utc_s - view.utc_s), "bold"),
                f" at {view.max_alt_deg:.1f}°",
                (f"    {last} ", DIM),
                (_until(view.end_utc_s - view.utc_s), "bold"),
            ]
        ]

    @staticmethod
    def _row(name: str, at_s: float, now_s: float) -> Row:
        until = _until(at_s - now_s)
        if len(until) > MOST_UNTIL:
            # Hours off, its seconds matter less than its unit; the headline has them.
            until = re.sub(r":\d\d(?= |$)", " h", until)
        gap = " " if len(until) == MOST_UNTIL else "  "
        return labelled(name, local_time.clock(at_s), gap, (until, "bold"), cells=TIMES_CELLS)


def _ends(scene: Scene) -> tuple[str, str]:
    """Return what a pass' two ends are called: a window in time neither rises nor sets."""
    pass_view = scene.sky
    last = "set" if pass_view is None or pass_view.sets else "end"
    if scene.view.utc_s >= scene.view.start_utc_s:
        # Whether by rising or because we came late is not known.
        return "begun", last
    return "rise" if pass_view is None or pass_view.rises else "begin", last


def _until(seconds: float) -> str:
    return f"in {formatting.span(seconds)}" if seconds >= 0.0 else f"{formatting.span(seconds)} ago"


class LinkPanel(Panel):
    """How the mount is heard."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the counts in rows."""
        link = scene.view.link
        return [
            labelled("state", *_heard(scene), cells=6),
            labelled("age", _age(scene), ("  delay ", DIM), _delay(link), cells=6),
            labelled("clock", _clock(link), ("  from ours", DIM), cells=6),
            labelled("sent", f"{link.sent}", ("  heard ", DIM), f"{link.received}", cells=6),
            labelled("lost", _count(link.lost), ("  late ", DIM), _count(link.late), cells=6),
            [("rejected ", DIM), _count(link.rejected), ("  double ", DIM), _count(link.duplicate)],
        ]

    def compact(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        link = scene.view.link
        row = labelled("link", *_heard(scene), ("  age ", DIM), _age(scene))
        counts: Row = []
        for name, count in (("lost", link.lost), ("late", link.late), ("rejected", link.rejected)):
            counts += [(f"   {name} ", DIM), _count(count)]
        # As wide for 9 ms as for 900: what stands to its right is not to jump.
        delay: Row = [] if link.delay_ms is None else [("  delay ", DIM), f"{_delay(link):<6}"]
        fits = cells_of([*row, *delay, *counts]) <= self.content_size.width
        return [[*row, *delay, *counts] if fits else [*row, *counts]]


_LINK_WORDS = {
    "silent": ("not heard yet", Tone.NOTICE),
    "up": ("up", Tone.GOOD),
    "stale": ("STALE", Tone.BAD),
    "lost": ("LOST", Tone.BAD),
}


def _closed(scene: Scene) -> bool:
    """Tell whether nobody listens to the mount for this run any more."""
    return scene.ended and scene.tape is None


def _heard(scene: Scene) -> Row:
    link = scene.view.link
    if _closed(scene):
        return [("closed", DIM)]
    word, tone = _LINK_WORDS.get(link.state, (link.state, Tone.NOTICE))
    rate = formatting.NOTHING if link.rate_hz is None else f"{link.rate_hz:.1f}/s"
    return [(word, SPOKEN[tone]), "  ", rate]


def _age(scene: Scene) -> Part:
    age_s = None if _closed(scene) else scene.view.link.age_s
    return formatting.NOTHING if age_s is None else f"{age_s:.2f} s"


def _delay(link: LinkView) -> str:
    if link.delay_ms is None:
        return formatting.NOTHING
    decimals = 1 if abs(link.delay_ms) < 9.95 else 0
    return f"{link.delay_ms:.{decimals}f} ms".replace("-", formatting.MINUS)


def _clock(link: LinkView) -> Part:
    """Return the offset of the mount's clock, as finely as its size lets it matter."""
    offset_s = link.clock_offset_s
    if offset_s is None:
        return formatting.NOTHING
    return f"{formatting.number(offset_s, 3 if abs(offset_s) < 9.9995 else 1, sign=True)} s"


def _count(count: int) -> Part:
    return (str(count), SPOKEN[Tone.NOTICE] if count else "")


class MountPanel(Panel):
    """Where the mount says it is, and the rates commanded against its limits."""

    def full(self, scene: Scene) -> list[Row]:
        """Return position and rates in rows."""
        view = scene.view
        ra = (
            formatting.NOTHING if view.mount_ra_deg is None else formatting.right_ascension(view.mount_ra_deg)
        )
        dec = formatting.degrees(view.mount_dec_deg)
        rows: list[Row] = [labelled("at RA", ra), labelled("at Dec", dec)]
        for name, rate, reached, limit in self._rates(scene):
            text = formatting.number(reached, 3, sign=True)
            if scene.view.phase == "slewing" and reached is not None:
                rows += [
                    labelled(f"{name} rate ", ("the mount's own", DIM)),
                    labelled("reached", f"{text} °/s"),
                ]
                continue
            rows.append(labelled(f"{name} rate", *_rate_of(rate, limit)))
            cells = max(4, self.content_size.width - FULL_GAUGE_FREE_CELLS)
            rows.append(labelled("reached", f"{text:<7} ", _gauge(rate, reached, limit, cells)))
        return rows

    def compact(self, scene: Scene) -> list[Row]:
        """Return the one row of rates."""
        row, slewing = labelled("rates"), scene.view.phase == "slewing"
        for name, rate, reached, limit in self._rates(scene):
            bar = _gauge(rate, reached, limit, GAUGE_CELLS)
            if slewing and reached is not None:
                # A slew is asked for by its end, and its rate is the mount's own: no limit of ours is on it.
                row += [(f"{name} ", DIM), formatting.number(reached, 3, sign=True), (" °/s  ", DIM)]
                continue
            row += [(f"{name} ", DIM), *_rate_of(rate, limit), " ", bar, "  "]
        return [row]

    @staticmethod
    def _rates(scene: Scene) -> tuple[tuple[str, float, float | None, float], ...]:
        view = scene.view
        first, second = axis_names(scene)
        return (
            (first, view.ra_rate_deg_s, view.ra_rate_reached_deg_s, view.max_ra_rate_deg_s),
            (second, view.dec_rate_deg_s, view.dec_rate_reached_deg_s, view.max_dec_rate_deg_s),
        )


def _gauge(rate: float, reached: float | None, limit: float, cells: int) -> Part:
    """Return a bar of the rate reached, with a stroke at the one commanded; of that alone where no other."""
    style = _rate_style(rate, limit) or DIM
    if reached is None or not limit:
        return (formatting.gauge(rate / limit if limit else 0.0, cells), style)
    return (formatting.gauge(reached / limit, cells, rate / limit), style)


def _rate_of(rate: float, limit: float) -> Row:
    return [(formatting.number(rate, 3, sign=True), _rate_style(rate, limit)), (f" of {limit:g} °/s", DIM)]


def _rate_style(rate: float, limit: float) -> str:
    return SPOKEN[Tone.NOTICE] if abs(rate) >= RATE_NEAR_LIMIT * limit else ""


class RunPanel(Panel):
    """What gives the target's places, the error to expect, and what is recorded, in one row or in two."""

    def show(self, scene: Scene) -> None:
        """Take a new scene; what is no element set is named in a row of its own."""
        self.styles.height = 1 if by_elements(scene.view) else 2
        super().show(scene)

    def full(self, scene: Scene) -> list[Row]:
        """Return the rows."""
        width, label = self.content_size.width, "   recording "
        rest = _expected(scene)
        if not by_elements(scene.view):
            row: Row = [*rest, (label, DIM)]
            row[0] = (str(row[0][0]).strip().ljust(LABEL_CELLS), DIM)
            return [_source_row(scene, width), [*row, _recording(scene, width - cells_of(row))]]
        whole = _recording(scene, width)
        for old, label in _elements_texts(scene):
            row = [*labelled("elements", old), *rest, (label, DIM)]
            if cells_of([*row, whole]) <= width:
                break
        return [[*row, _recording(scene, width - cells_of(row))]]


def _expected(scene: Scene) -> Row:
    """Return the error to expect on the sky, and how far off the mount's clock is."""
    row: Row = []
    expected = field_of(scene.sky, scene.view)
    if expected is not None:
        along, across = (
            formatting.within(formatting.arcsec(SIGMAS * x), scene.plain)
            for x in (expected.along_arcsec, expected.across_arcsec)
        )
        sigmas = f"{SIGMAS:g} sigma" if scene.plain else f"{SIGMAS:g}σ"
        row += [(f"  expect {sigmas} ", DIM), f"{along} {across}"]
        if expected.radius_arcsec is not None:
            row += [(" in ", DIM), formatting.arcsec(2.0 * expected.radius_arcsec)]
    if scene.view.link.clock_offset_s is not None:
        row += [("  clock ", DIM), _clock(scene.view.link)]
    return row


class FieldPanel(Panel):
    """The error to expect beside the field of view, drawn and in figures."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the picture with the figures to its right."""
        expected = field_of(scene.sky, scene.view)
        rows = field_rows(expected, scene.plain)
        if expected is None:
            return rows
        height = self.content_size.height
        columns = max(2, min(2 * height, self.content_size.width - FIELD_FIGURES_CELLS))
        drawn = field_picture(expected, columns, height, scene.plain)
        return [
            [*row, " ", *(rows[number] if number < len(rows) else [])] for number, row in enumerate(drawn)
        ]


def _elements_texts(scene: Scene) -> list[tuple[str, str]]:
    """Return age and error of elements, each with a label for the recording beside it, the longest first."""
    view = scene.view
    if view.elements_age_s is None:
        return [("-", "   recording ")]
    old, age = formatting.old(view.elements_age_s), formatting.age(view.elements_age_s)
    epoch_s = view.utc_s - view.elements_age_s
    of = f"{local_time.date(epoch_s)} {local_time.clock(epoch_s)[:5]}"
    texts = [(old, "   recording "), (age, "  rec ")]
    if view.expected_error_m is None:
        return [*_with_file(view, (f"of {of}, {old}", "   recording ")), *texts]
    missed = formatting.length(view.expected_error_m)
    short = f"{age}, {formatting.within(missed, scene.plain)}"
    long = f"{old}, error {missed}"
    whole = _with_file(view, (f"of {of}, {long}", "   recording "))
    return [*whole, (long, "   recording "), (short, "  rec "), *texts]


def _with_file(view: TrackView, longest: tuple[str, str]) -> list[tuple[str, str]]:
    """Return the longest text of elements, and before it the same with the name of their file."""
    if view.source_file is None:
        return [longest]
    return [(f"{_shortened(view.source_file, FILE_CELLS)}, {longest[0]}", longest[1]), longest]


def _source_words(scene: Scene) -> tuple[str, str]:
    """Return the name of what gives the target's places, and its age and error; a body has none of these."""
    view = scene.view
    name = view.source_file or view.source or formatting.NOTHING
    if view.elements_age_s is None:
        return name, ""
    age = formatting.old(view.elements_age_s)
    if view.t0_utc_s is not None:
        age = f"T{math.floor(view.utc_s - view.t0_utc_s):+d} s"
    return name, f"{age}, {formatting.source_error(view.expected_error_m)}"


def _source_row(scene: Scene, width: int, cells: int = LABEL_CELLS) -> Row:
    """Return in one row what gives the target's places; only its name gives way."""
    view, room = scene.view, width - cells
    name, rest = _source_words(scene)
    after = f", {rest}" if rest else ""
    long = f"{name}: {view.source}{after}" if view.source_file else name + after
    if cell_len(long) > room:
        long = _shortened(name, room - cell_len(after)) + after
    return labelled("source", long, cells=cells)


def _source_rows(scene: Scene, width: int) -> list[Row]:
    """Return what gives the target's places among the times: in two rows where its name is long."""
    room = width - TIMES_CELLS
    if by_elements(scene.view):
        texts, name = [text for text, _ in _elements_texts(scene)], scene.view.source_file
        age = next((x for x in texts if len(x) <= room), texts[-1])
        if name is None or age == texts[0]:
            return [labelled("elements", age, cells=TIMES_CELLS)]
        return [
            labelled("elements", _shortened(name, room), cells=TIMES_CELLS),
            labelled("", age, cells=TIMES_CELLS),
        ]
    name, rest = _source_words(scene)
    if not rest or cell_len(f"{name}, {rest}") <= room:
        return [_source_row(scene, width, TIMES_CELLS)]
    if cell_len(rest) > width:
        rest = rest.replace("not stated", "unstated")
    first = labelled("source", name, cells=TIMES_CELLS)
    if cell_len(name) > room:
        first = [("by ", DIM), _shortened(name, width - 3)]
    return [first, [rest]]


def _shortened(text: str, room: int) -> str:
    """Return a name without its middle where there is no room for all of it."""
    return text if cell_len(text) <= room else f"{text[: max(1, room - 9)]}…{text[-8:]}"


def _recording(scene: Scene, room: int) -> Part:
    """Return where it is recorded: as much of the end of that as there is room for."""
    path = scene.view.recording
    if path is None:
        return "none"
    if cell_len(path) > room:
        path = Path(path).name
    return (path if cell_len(path) <= room else f"…{path[1 - max(room, 2) :]}", "bold")


CELLS = 8


class BiasPanel(Panel):
    """What is added to the satellite's direction, and which key moves it which way."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the biases, the frame that the arrows move in, and what searches and observes, in rows."""
        along, across = _track_values(scene)
        rows = [labelled("along", *along, cells=CELLS), labelled("across", *across, cells=CELLS)]
        if scene.tape is not None or not scene.in_control:
            return [*rows, _others(scene), _news(scene)[:1]]
        for move, keys in _moves(scene):
            hint = "  ".join(keys)
            if scene.frame is TRACK:
                rows.append(labelled("", hint, cells=CELLS))
                continue
            value = _values(scene, move)
            if len(value) == 1:
                value.append((f"  {hint}", DIM))
            rows.append(labelled(move.label, *value, cells=CELLS))
        step: Row = [f"{scene.step.along_s:g} s", (" and ", DIM), f"{scene.step.cross_deg:g}°"]
        rows.append(labelled("step", *step, ("  f ", DIM), scene.frame.name, cells=CELLS))
        rows.append(_news(scene) or _others(scene))
        return rows

    def compact(self, scene: Scene) -> list[Row]:
        """Return two rows: the track's, or beside them in few words what is more to the point."""
        along, across = _track_values(scene)
        news = _news(scene)
        if scene.tape is not None or not scene.in_control:
            return [labelled("along", *along, "   ", *news[:1]), labelled("across", *across)]
        if scene.frame is TRACK:
            rows = [labelled("along", *along), labelled("across", *across)]
            hints: list[Row] = [
                [("   ← behind  → ahead on track by ", DIM), f"{scene.step.along_s:g} s"],
                [("   ↑ left  ↓ right of motion by ", DIM), f"{scene.step.cross_deg:g}°"],
            ]
            if news:
                hints[1] = [("   ", DIM), *news]
        else:
            rows = [labelled(move.label, *_values(scene, move)) for move, _ in _moves(scene)]
            by: Row = [(" by ", DIM), f"{scene.step.cross_deg:g}°"]
            hints = [[(f"   {'  '.join(keys)}", DIM), *by] for _, keys in _moves(scene)]
            if news:
                hints[1] = [("   ", DIM), *news]
        return [row + hint for row, hint in zip(rows, hints, strict=True)]


def _moves(scene: Scene) -> list[tuple[Move, tuple[str, str]]]:
    """Return what the arrows change, and what each of the two does."""
    across, upward = scene.frame.across, scene.frame.upward
    return [
        (across, (f"← {across.minus}", f"→ {across.plus}")),
        (upward, (f"↑ {upward.plus}", f"↓ {upward.minus}")),
    ]


def _track_values(scene: Scene) -> tuple[Row, Row]:
    view = scene.view
    along: Row = [
        (f"{formatting.number(view.bias_along_s, 3, sign=True)} s", "bold"),
        *_asked(scene, TRACK.across.what, f"{formatting.number(view.bias_along_goal_s, 3, sign=True)} s"),
    ]
    across: Row = [
        (f"{formatting.number(view.bias_cross_deg, 4, sign=True)}°", "bold"),
        *_asked(scene, TRACK.upward.what, f"{formatting.number(view.bias_cross_goal_deg, 4, sign=True)}°"),
    ]
    return along, across


def _asked(scene: Scene, what: str, goal: str) -> Row:
    """Return what was asked for; where that changes gradually, the change per second."""
    rate = next((one.rate for one in scene.view.offsets if one.what == what), 0.0)
    if rate == 0.0:
        return [("  asked ", DIM), goal]
    return [("  by ", DIM), f"{formatting.number(rate, 5, sign=True)}/s"]


def _values(scene: Scene, move: Move) -> Row:
    one = next((one for one in scene.view.offsets if one.what == move.what), None)
    applied, total = (0.0, 0.0) if one is None else (one.applied, one.total)
    value: Row = [(f"{formatting.number(applied, 4, sign=True)}°", "bold")]
    if round(applied, 4) != round(total, 4):
        value += [("  asked ", DIM), f"{formatting.number(total, 4, sign=True)}°"]
    return value


def _news(scene: Scene) -> Row:
    """Return what searches, else what was estimated, else what was remembered; nothing where nothing is."""
    search, estimate = scene.view.search, scene.view.estimate
    if search is not None:
        return [(f"{search.how} {search.elapsed_s:.0f} s", "bold"), ("   s keep  Esc cancel", DIM)]
    if estimate is None:
        return _remembered(scene)
    if scene.view.loop is not None and scene.view.loop.state == "lost":
        return [(formatting.loop_text(scene.view.loop, scene.plain), "bold")]
    counts: Part = f"{estimate.accepted} seen"
    if estimate.rejected or estimate.refused:
        counts = f"{estimate.accepted} of {estimate.accepted + estimate.rejected + estimate.refused} seen"
    if estimate.along_sigma_s is None or estimate.cross_sigma_deg is None:
        return [counts]
    sigmas = (f"{estimate.along_sigma_s:.4f} s", f"{estimate.cross_sigma_deg:.4f}°")
    return [counts, (f" {' '.join(formatting.within(text, scene.plain) for text in sigmas)}", DIM)]


def _remembered(scene: Scene) -> Row:
    """Return the bias that an earlier pass left, as long as it is in force."""
    known = scene.view.remembered
    if known is None or known.state != "in force":
        return []
    hours = (scene.view.utc_s - known.utc_s) / 3600.0
    if known.along_sigma_s is None:
        return [(f"{hours:.1f} h old nudge", "bold"), ("   m drop", DIM)]
    return [
        (f"{hours:.1f} h old {formatting.within(f'{known.along_sigma_s:.3f} s', scene.plain)}", "bold"),
        ("   m drop", DIM),
    ]


def _others(scene: Scene) -> Row:
    """Return the offsets of other frames that are not nothing."""
    shown = {scene.frame.across.what, scene.frame.upward.what, TRACK.across.what, TRACK.upward.what}
    others = [LABELS.get(one.what, one.what) for one in scene.view.offsets if one.what not in shown]
    return [("also ", DIM), ", ".join(others)] if others else []
