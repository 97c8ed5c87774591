"""The error against time, both axes, over the last minutes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from textual.containers import Grid, Vertical
from textual.strip import Strip
from textual_hires_canvas import Canvas
from textual_plot import HiResMode, PlotWidget
from textual_plot.axis_formatter import AxisFormatter
from textual_plot.plot_widget import Legend

from sattrack.tui import words
from sattrack.tui.history import SMALLEST_ARCSEC, WINDOW_S, ErrorHistory, Scale
from sattrack.tui.look import DIM, SPOKEN
from sattrack.tui.panels import Panel, Row
from sattrack.tui.scene import Scene, Tone
from sattrack.tui.themed import ThemedApp

if TYPE_CHECKING:
    from collections.abc import Sequence

    from textual.app import ComposeResult

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
        return ["now" if tick == 0.0 else f"{words.MINUS}{-tick / MINUTE_S:g} min" for tick in ticks]


class Arcseconds(AxisFormatter):
    """Labels of a symmetric range: its ends, halves and zero."""

    def get_ticks(self, min_: float, max_: float, max_ticks: int = 8) -> list[float]:
        """Return as many as are to be told apart."""
        if max_ticks < 5:
            return [min_, 0.0, max_]
        return [min_, min_ / 2.0, 0.0, max_ / 2.0, max_]

    def get_labels_for_ticks(self, ticks: Sequence[float]) -> list[str]:
        """Return signed arcseconds."""
        return ["0" if t == 0.0 else f"{t:+g}″".replace("-", words.MINUS) for t in ticks]


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
        shapes = plain or (isinstance(self.app, ThemedApp) and self.app.shapes)
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
        shapes = scene.plain or (isinstance(self.app, ThemedApp) and self.app.shapes)
        row: Row = [
            ("error  ", DIM),
            (f"{LEGEND[shapes]} RA on the sky", "$ra-line"),
            "   ",
            ("⠒⠒ Dec", "$dec-line"),
            f"   scale {words.within(f'{self.range_arcsec:g}″', scene.plain)}",
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
