"""The error against time, both axes, over the last minutes."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from textual.containers import Grid, Vertical
from textual.strip import Strip
from textual_hires_canvas import Canvas
from textual_plot import HiResMode, PlotWidget
from textual_plot.axis_formatter import AxisFormatter
from textual_plot.plot_widget import Legend

from sattrack.tui.look import DIM, SPOKEN, ScreenApp
from sattrack.tui.panels import Panel, Row
from sattrack.tui.scene import Scene, Tone, axis_names
from sattrack.views import formatting

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray
    from textual.app import ComposeResult

    from sattrack.views.run import TrackView

WINDOW_S = 180.0
GAP_S = 1.2
"""A pause between errors beyond which no line is drawn across; virtual runs give two views a second."""
RECENT_S = 2.0
HEADROOM = 1.1
TYPICAL_SHARE = 98.0
SMALLEST_ARCSEC = 0.05
LARGEST_ARCSEC = 5000.0
HOLD_S = 5.0
"""For so long must a smaller scale suffice before the scale shrinks."""


class ErrorSample(NamedTuple):
    """One error of both axes on the sky, arcseconds; `tracking` where it was acquired."""

    utc_s: float
    ra_arcsec: float
    dec_arcsec: float
    tracking: bool


class PlotLine(NamedTuple):
    """A line without gaps: seconds before now (negative) and the error of both axes, arcseconds."""

    ago_s: NDArray[np.float64]
    ra_arcsec: NDArray[np.float64]
    dec_arcsec: NDArray[np.float64]


class ErrorHistory:
    """Keeps the errors of following; the way of a slew is no error."""

    def __init__(self) -> None:
        self._samples: deque[ErrorSample] = deque()

    def add(self, view: TrackView) -> None:
        """Take the error of a view, if it has a new one."""
        error = view.error
        if error is None or view.phase not in {"acquiring", "tracking"}:
            return
        ahead_s = self._samples[-1].utc_s - error.utc_s if self._samples else -1.0
        if ahead_s > GAP_S:
            # The clock was set back: what was seen before it has no place on this axis any more.
            self._samples.clear()
        elif ahead_s >= 0.0:
            return
        sample = ErrorSample(error.utc_s, error.ra_arcsec, error.dec_arcsec, view.phase == "tracking")
        self._samples.append(sample)
        while self._samples[0].utc_s < error.utc_s - WINDOW_S:
            self._samples.popleft()

    def need_arcsec(self) -> float | None:
        """Return how far the scale must reach: what is typical of tracking, and all of the last moments."""
        if not self._samples:
            return None
        last_utc_s = self._samples[-1].utc_s
        sizes = [(s, max(abs(s.ra_arcsec), abs(s.dec_arcsec))) for s in self._samples]
        recent = max(size for s, size in sizes if s.utc_s > last_utc_s - RECENT_S)
        tracking = [size for s, size in sizes if s.tracking]
        typical = float(np.percentile(tracking, TYPICAL_SHARE)) if tracking else 0.0
        return max(recent, typical)

    def traces(self, now_utc_s: float, columns: int) -> list[PlotLine]:
        """Return the lines to draw, thinned to two points in each of `columns` columns."""
        return [
            _thin(part, now_utc_s, WINDOW_S / max(1, columns)) for part in self._parts(now_utc_s - WINDOW_S)
        ]

    def _parts(self, from_utc_s: float) -> Iterator[list[ErrorSample]]:
        part: list[ErrorSample] = []
        for sample in self._samples:
            if sample.utc_s < from_utc_s:
                continue
            if part and sample.utc_s - part[-1].utc_s > GAP_S:
                yield part
                part = []
            part.append(sample)
        if part:
            yield part


def _thin(part: list[ErrorSample], now_utc_s: float, column_s: float) -> PlotLine:
    table = np.array([sample[:3] for sample in part], dtype=np.float64)
    # Columns hang on the clock, not on now: the line must slide to the left, not shimmer.
    column = np.floor(table[:, 0] / column_s)
    starts = np.flatnonzero(np.diff(column, prepend=column[0] - 1.0))
    ends = np.append(starts[1:], len(table)) - 1
    lows, highs = (reduce.reduceat(table[:, 1:], starts, axis=0) for reduce in (np.minimum, np.maximum))
    # Each column keeps its extremes, so that a spike of one sample is still seen, in the order of its trend.
    falling = table[ends, 1:] < table[starts, 1:]
    first, second = np.where(falling, highs, lows), np.where(falling, lows, highs)
    values = np.stack((first, second), axis=1).reshape(-1, 2)
    ago = np.stack((table[starts, 0], table[ends, 0]), axis=1).ravel() - now_utc_s
    return PlotLine(ago, values[:, 0], values[:, 1])


class Scale:
    """A symmetric range in steps of 1, 2, 5: grows at once, shrinks once less has sufficed for a while."""

    def __init__(self) -> None:
        self._less_since_s: float | None = None
        self.range_arcsec = SMALLEST_ARCSEC

    def fit(self, need_arcsec: float, utc_s: float) -> float:
        """Return the range to draw, arcseconds to either side, given what must be seen at an instant."""
        wanted = self._step_for(need_arcsec * HEADROOM)
        if wanted >= self.range_arcsec:
            self.range_arcsec, self._less_since_s = wanted, None
        elif self._less_since_s is None or utc_s < self._less_since_s:
            self._less_since_s = utc_s
        elif utc_s - self._less_since_s >= HOLD_S:
            self.range_arcsec, self._less_since_s = wanted, None
        return self.range_arcsec

    def _step_for(self, need_arcsec: float) -> float:
        need = min(LARGEST_ARCSEC, max(SMALLEST_ARCSEC, need_arcsec))
        power = math.floor(math.log10(need))
        for factor in (1.0, 2.0, 5.0):
            step = float(f"{factor:g}e{power}")
            if need <= step * (1.0 + 1e-9):
                return step
        return float(f"1e{power + 1}")


LEFT_CELLS = 9
MINUTE_S = 60.0
ROOM_FOR_ALL_WORDS = 72
LEGEND = {False: "⠒⠒", True: "▀▀"}
"""What the line of right ascension looks like, with colour and without."""


class MinutesBeforeNow(AxisFormatter):
    """Labels of a time axis that ends now."""

    def get_ticks(self, min_: float, max_: float, max_ticks: int = 8) -> list[float]:
        """Return whole minutes."""
        del max_ticks
        return [float(t) for t in np.arange(min_, max_ + 1.0, MINUTE_S)]

    def get_labels_for_ticks(self, ticks: Sequence[float]) -> list[str]:
        """Return `−3 min` to `now`."""
        return ["now" if tick == 0.0 else f"{formatting.MINUS}{-tick / MINUTE_S:g} min" for tick in ticks]


class Arcseconds(AxisFormatter):
    """Labels of a symmetric range: its ends, halves and zero."""

    def get_ticks(self, min_: float, max_: float, max_ticks: int = 8) -> list[float]:
        """Return as many as can be distinguished."""
        if max_ticks < 5:
            return [min_, 0.0, max_]
        return [min_, min_ / 2.0, 0.0, max_ / 2.0, max_]

    def get_labels_for_ticks(self, ticks: Sequence[float]) -> list[str]:
        """Return signed arcseconds."""
        return ["0" if t == 0.0 else f"{t:+g}″".replace("-", formatting.MINUS) for t in ticks]


class StyledCanvas(Canvas):
    """A canvas whose blank lines have a style: without one, drawing without colour fails on them."""

    def render_line(self, y: int) -> Strip:
        """Return one line."""
        strip = super().render_line(y)
        return strip if strip.cell_length else Strip.blank(self.size.width, self.rich_style)


class ErrorPlot(PlotWidget, can_focus=False):
    """The lines; the keys of the plot itself are off, the arrows belong to the nudges."""

    def __init__(self) -> None:
        super().__init__(allow_pan_and_zoom=False)

    def compose(self) -> ComposeResult:
        """Make the parts that the plot draws on, by the names it knows them by."""
        with Grid():
            for name in ("margin-top", "margin-left", "plot", "margin-bottom"):
                yield StyledCanvas(1, 1, id=name)
        yield Legend(id="legend")

    def on_mount(self) -> None:
        """Set up the axes."""
        super().on_mount()
        self.margin_top, self.margin_bottom, self.margin_left = 0, 1, LEFT_CELLS
        self.set_xlimits(-WINDOW_S, 0.0)
        self.set_ylimits(-SMALLEST_ARCSEC, SMALLEST_ARCSEC)
        self.set_x_formatter(MinutesBeforeNow())
        self.set_y_formatter(Arcseconds())

    def draw(self, history: ErrorHistory, now_utc_s: float, range_arcsec: float, plain: bool = False) -> bool:
        """Draw the history up to an instant; return whether some of it lies beyond the range.

        Where colour cannot tell the lines apart, or there is no Unicode, that of right ascension has dots of
        another kind.
        """
        colours = self.app.theme_variables
        shapes = plain or (isinstance(self.app, ScreenApp) and self.app.shapes)
        ra_mode = HiResMode.QUADRANT if shapes else HiResMode.BRAILLE
        columns = max(8, self.size.width - LEFT_CELLS - 2)
        traces = history.traces(now_utc_s, columns)
        self.clear()
        self.set_xlimits(-WINDOW_S, 0.0)
        self.set_ylimits(-range_arcsec, range_arcsec)
        ticks = Arcseconds().get_ticks(-range_arcsec, range_arcsec, 5 if self.size.height >= 9 else 3)
        self.set_yticks(ticks)
        # A hair above zero: exactly there, rounding would put the line in the row below its label.
        hair = 0.01 * range_arcsec
        if not plain:
            self.plot([-WINDOW_S, 0.0], [hair, hair], colours["zero-line"], HiResMode.BRAILLE)
        beyond = False
        for trace in traces:
            for values, style, mode in (
                (trace.ra_arcsec, colours["ra-line"], ra_mode),
                (trace.dec_arcsec, colours["dec-line"], HiResMode.BRAILLE),
            ):
                beyond = beyond or bool(np.any(np.abs(values) > range_arcsec))
                self.plot(trace.ago_s, np.clip(values, -range_arcsec, range_arcsec), style, mode)
        return beyond


class PlotCaption(Panel):
    """Says which line is which, and how large the scale is."""

    def __init__(self) -> None:
        super().__init__()
        self.range_arcsec = SMALLEST_ARCSEC
        self.beyond = False
        self.empty = True
        """Whether there is nothing to be drawn."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        shapes = scene.plain or (isinstance(self.app, ScreenApp) and self.app.shapes)
        first, second = axis_names(scene)
        row: Row = [
            ("error  ", DIM),
            (f"{LEGEND[shapes]} {first} on the sky", "$ra-line"),
            "   ",
            (f"⠒⠒ {second}", "$dec-line"),
            f"   scale {formatting.within(f'{self.range_arcsec:g}″', scene.plain)}",
        ]
        if self.empty:
            row[-1] = ("   nothing followed yet", DIM)
        if self.beyond:
            roomy = self.content_size.width >= ROOM_FOR_ALL_WORDS
            row.append(("   some beyond the scale" if roomy else "  beyond", SPOKEN[Tone.NOTICE]))
        return [row]


class ErrorPanel(Vertical):
    """The plot with its caption; keeps the scale."""

    def __init__(self) -> None:
        super().__init__()
        self.scale = Scale()

    def compose(self) -> ComposeResult:
        """Make the parts."""
        yield PlotCaption()
        yield ErrorPlot()

    def draw(self, scene: Scene, history: ErrorHistory) -> None:
        """Draw a history up to a scene's instant."""
        now_utc_s = scene.view.utc_s
        need = history.need_arcsec()
        range_arcsec = self.scale.range_arcsec if need is None else self.scale.fit(need, now_utc_s)
        caption = self.query_one(PlotCaption)
        caption.beyond = self.query_one(ErrorPlot).draw(history, now_utc_s, range_arcsec, scene.plain)
        caption.range_arcsec, caption.empty = range_arcsec, need is None
        caption.show(scene)
