"""The screen of a run. It sees views and sends messages; whatever it does, the mount is fed elsewhere."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import TYPE_CHECKING, ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container, Horizontal
from textual.css.query import NoMatches

from sattrack.messages import ClearBias, DropRemembered, Nudge, OffsetBy, Search, StopNow
from sattrack.tui import figures, look
from sattrack.tui.appearance import Appearance
from sattrack.tui.bias_panel import BiasPanel
from sattrack.tui.error_plot import ErrorPanel
from sattrack.tui.frames import FRAMES, TRACK
from sattrack.tui.help import HelpScreen
from sattrack.tui.history import ErrorHistory
from sattrack.tui.panels import Cautions, HeadlineBar, KeyBar, Panel, TapeBar, TitleBar
from sattrack.tui.plain import PlainFilter
from sattrack.tui.scene import Scene
from sattrack.tui.sky_panel import NotesPanel, SkyPanel, chart_columns
from sattrack.tui.steps import FIRST_STEP, STEPS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from textual.dom import DOMNode
    from textual.filter import LineFilter

    from sattrack.messages import Message
    from sattrack.tui.feed import Feed
    from sattrack.view import PassView, Summary, TrackView

NIGHT_LOOK = Appearance()
LOOK_EVERY_S = 0.1
PLOT_EVERY_S = 0.25
SPIRAL_STEPS = 10.0
SPIRAL_ARMS_S = 0.5
"""A spiral's arms lie ten steps apart, and half of that is run in a second."""
SWEEP_STEPS = 10.0
SWEEP_PERIOD_S = 20.0
LEAVE_WITHIN_S = 4.0
"""How long the screen stays for the mount to come to rest once it is to be left."""


class TrackApp(App[None]):
    """Shows a run and takes the operator's keys.

    With `stay`, the screen of an ended run remains until it is left. `monotonic` is this process's own
    clock, seconds.
    """

    TITLE = "sattrack"
    CSS = look.CSS
    ENABLE_COMMAND_PALETTE = False
    HORIZONTAL_BREAKPOINTS = look.WIDTHS
    VERTICAL_BREAKPOINTS = look.HEIGHTS
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "stop", "STOP", priority=True),
        Binding("ctrl+c", "interrupt", "interrupt", priority=True),
        Binding("ctrl+q", "leave", "quit", priority=True),
        Binding("q", "leave", "quit"),
        Binding("left", "nudge(-1, 0)", "behind, or less"),
        Binding("right", "nudge(1, 0)", "ahead, or more"),
        Binding("up", "nudge(0, 1)", "left of motion, or more"),
        Binding("down", "nudge(0, -1)", "right of motion, or less"),
        Binding("left_square_bracket", "step(-1)", "smaller step"),
        Binding("right_square_bracket", "step(1)", "larger step"),
        Binding("f", "frame", "frame"),
        Binding("s", "search('spiral')", "spiral"),
        Binding("w", "search('sweep')", "sweep"),
        Binding("escape", "cancel_search", "cancel search"),
        Binding("r", "reset", "reset frame"),
        Binding("0", "clear_bias", "clear bias"),
        Binding("m", "drop_remembered", "drop remembered bias"),
        Binding("v", "sky", "sky alone"),
        Binding("t", "next_theme", "theme"),
        Binding("question_mark", "help", "help"),
    ]

    def __init__(
        self,
        feed: Feed,
        stay: bool = True,
        monotonic: Callable[[], float] = time.monotonic,
        appearance: Appearance = NIGHT_LOOK,
    ) -> None:
        self._appearance = appearance
        super().__init__()
        self._feed = feed
        self._stay = stay
        self._monotonic = monotonic
        self._history = ErrorHistory()
        self._view: TrackView | None = None
        self._summary: Summary | None = None
        self._sky: PassView | None = None
        self._ended = False
        self._step = FIRST_STEP
        self._frame = 0
        self._heard_s = monotonic()
        self._stop_sent_s: float | None = None
        self._leaving_since_s: float | None = None
        self.interrupted = False
        self._leave_asked = False

    def compose(self) -> ComposeResult:
        """Make the parts, from top to bottom."""
        yield TitleBar()
        yield HeadlineBar()
        yield Cautions()
        with Horizontal(id="state"):
            yield figures.ErrorBox()
            yield figures.AxesPanel(id="axes")
            yield figures.WherePanel(id="where")
            yield figures.TimesPanel(id="wide-times")
        yield figures.TimesPanel(id="narrow-times")
        with Horizontal(id="middle"):
            yield ErrorPanel()
            yield SkyPanel()
        with Container(id="below"):
            yield figures.LinkPanel(id="link")
            yield figures.MountPanel(id="mount")
            yield BiasPanel(id="bias")
            yield figures.FieldPanel(id="field")
            yield NotesPanel(id="notes")
            yield figures.RunPanel(id="run")
        yield TapeBar()
        yield KeyBar()

    def on_mount(self) -> None:
        """Set the look, and look at the feed from now on."""
        for theme in look.THEMES:
            self.register_theme(theme)
        self.theme = self._appearance.theme
        for name, title in look.TITLES.items():
            self.query_one(name).border_title = title
        self.set_interval(LOOK_EVERY_S, self.look)
        self.set_interval(PLOT_EVERY_S, self.plot)
        self.look()
        self.call_after_refresh(self.plot)

    def look(self) -> None:
        """Take in what has come, and draw the newest."""
        news = self._feed.news()
        if news.rewound:
            self._history = ErrorHistory()
            self._ended, self._summary = False, None
        for view in news.views:
            self._history.add(view)
        if news.views:
            self._view = news.views[-1]
            self._heard_s = self._monotonic()
        self._sky = news.sky or self._sky
        self._summary = news.summary or self._summary
        self._ended = self._ended or news.ended
        self._draw()
        self._leave_when_due()

    def plot(self) -> None:
        """Draw the error against time."""
        scene = self.scene
        if scene is not None:
            self._draw_on_main(lambda main: _plot(main, scene, self._history))

    @property
    def scene(self) -> Scene | None:
        """What is to be drawn; None before the first view."""
        if self._view is None:
            return None
        now_s = self._monotonic()
        return Scene(
            view=self._view,
            step=STEPS[self._step],
            news_age_s=now_s - self._heard_s,
            stop_sent_s=None if self._stop_sent_s is None else now_s - self._stop_sent_s,
            leaving=self._leaving_since_s is not None,
            ended=self._ended,
            summary=self._summary,
            frame=FRAMES[self._frame],
            sky=self._sky,
            plain=self._appearance.plain,
        )

    def get_theme_variable_defaults(self) -> dict[str, str]:
        """Return the colours beyond Textual's own, which the layout names before a theme is set."""
        return look.NIGHT.variables

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Return what everything that is drawn goes through at last."""
        filters = super().get_line_filters()
        return [*filters, PlainFilter()] if self._appearance.plain else filters

    def action_stop(self) -> None:
        """Stop everything; every press says it again. Nothing may then hide what the mount does."""
        while len(self.screen_stack) > 1:
            self.pop_screen()
        if self._stop_sent_s is None:
            self._stop_sent_s = self._monotonic()
        self._send(StopNow())

    def action_interrupt(self) -> None:
        """Leave as `q` does, for a program that was interrupted."""
        self.interrupted = True
        self.action_leave()

    def action_leave(self) -> None:
        """Stop the mount, then leave once it is at rest; asked again, leave at once."""
        if self._ended or self._leaving_since_s is not None:
            self.exit()
            return
        self._leaving_since_s = self._monotonic()
        self.action_stop()

    async def action_quit(self) -> None:
        """Leave as `q` does, whoever asks."""
        self.action_leave()

    def action_nudge(self, along: int, across: int) -> None:
        """Move the target by one step: along its track or across it, or as the frame has it."""
        step, frame = STEPS[self._step], FRAMES[self._frame]
        if frame is not TRACK:
            move, sign = (frame.across, along) if along else (frame.upward, across)
            self._send(OffsetBy(move.what, "add", sign * step.cross_deg))
            return
        if along:
            self._send(Nudge(along_s=along * step.along_s))
        if across:
            self._send(Nudge(cross_deg=across * step.cross_deg))

    def action_step(self, by: int) -> None:
        """Choose a smaller or a larger step."""
        self._step = min(len(STEPS) - 1, max(0, self._step + by))
        self._draw()

    def action_frame(self) -> None:
        """Go on to the next frame in which the arrows move."""
        self._frame = (self._frame + 1) % len(FRAMES)
        self._draw()

    def action_search(self, how: str) -> None:
        """Begin a search, its size by the step; or end the one that runs where it is."""
        step = STEPS[self._step]
        if self._searching:
            self._send(Search("stop"))
        elif how == "spiral":
            spacing_deg = SPIRAL_STEPS * step.cross_deg
            self._send(Search(how, spacing_deg=spacing_deg, speed_deg_s=SPIRAL_ARMS_S * spacing_deg))
        else:
            self._send(Search(how, reach_s=SWEEP_STEPS * step.along_s, period_s=SWEEP_PERIOD_S))

    def action_cancel_search(self) -> None:
        """End a search that runs, back in its centre."""
        if self._searching:
            self._send(Search("cancel"))

    @property
    def _searching(self) -> bool:
        return self._view is not None and self._view.search is not None

    def action_reset(self) -> None:
        """Take the offsets of the frame away."""
        frame = FRAMES[self._frame]
        for move in (frame.across, frame.upward):
            self._send(OffsetBy(move.what, "reset"))

    def action_clear_bias(self) -> None:
        """Take everything back: nudges, offsets, search and estimate."""
        self._send(ClearBias())

    def action_drop_remembered(self) -> None:
        """Take back the bias that an earlier pass left, and have it offered no more."""
        self._send(DropRemembered())

    def action_sky(self) -> None:
        """Show the sky alone, as large as it goes, or all again."""
        if self._sky is not None:
            self.screen_stack[0].toggle_class("-sky-alone")
            self.call_after_refresh(self.plot)

    def action_next_theme(self) -> None:
        """Go on to the next theme."""
        at = look.THEME_NAMES.index(self.theme)
        self.theme = look.THEME_NAMES[(at + 1) % len(look.THEME_NAMES)]
        self.call_after_refresh(self.plot)

    def action_help(self) -> None:
        """Show what the keys do."""
        self.push_screen(HelpScreen())

    def ask_to_leave(self) -> None:
        """Leave soon, as `q` does; may be called from a signal handler."""
        self._leave_asked = True

    def _send(self, message: Message) -> None:
        if not self._ended:
            self._feed.send(message)
        self._draw()

    def _draw(self) -> None:
        scene = self.scene
        if scene is not None:
            huge = self.size.width >= look.HUGE[0] and self.size.height >= look.HUGE[1]
            self._draw_on_main(lambda main: _show(main, scene, huge))

    def _draw_on_main(self, draw: Callable[[DOMNode], object]) -> None:
        """Draw on what lies under any dialog; nothing while it is being put up or taken down."""
        if self.screen_stack:
            with suppress(NoMatches):
                draw(self.screen_stack[0])

    def _leave_when_due(self) -> None:
        if self._leave_asked:
            self._leave_asked = False
            self.action_leave()
        since_s = self._leaving_since_s
        overdue = since_s is not None and self._monotonic() - since_s > LEAVE_WITHIN_S
        if overdue or (self._ended and (since_s is not None or not self._stay)):
            self.exit()


def _plot(main: DOMNode, scene: Scene, history: ErrorHistory) -> None:
    middle, sky = main.query_one("#middle"), main.query_one(SkyPanel)
    if main.has_class("-sky-alone"):
        sky.styles.width = "1fr"
    else:
        frame = sky.size.width - sky.content_size.width if sky.size.width else 0
        sky.styles.width = chart_columns(middle.size.width, middle.size.height, frame)
        main.query_one(ErrorPanel).draw(scene, history)
    sky.draw(scene)


def _show(main: DOMNode, scene: Scene, huge: bool) -> None:
    main.set_class(huge, "-huge")
    main.query_one(figures.ErrorBox).show(scene)
    for panel in main.query(Panel):
        panel.show(scene)
