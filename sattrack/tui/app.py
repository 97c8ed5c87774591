"""The screen of a run. It sees views and sends messages; another process feeds the mount."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, ClassVar

from textual.binding import Binding, BindingType
from textual.containers import Container, Horizontal

from sattrack.tui import figures, look
from sattrack.tui.attached import PICTURE_SIDE
from sattrack.tui.camera_page import CameraPage
from sattrack.tui.console_panels import MountPage
from sattrack.tui.dialogs import ATTACHED_TEXT, LEAVE, STOP, TEXTS, LeaveDialog, show_help
from sattrack.tui.error_plot import ErrorHistory, ErrorPanel
from sattrack.tui.figures import BiasPanel
from sattrack.tui.graphics import RealPicture
from sattrack.tui.pages import LogPage, SchedulePage, TonightPage
from sattrack.tui.panels import Cautions, HeadlineBar, KeyBar, Panel, SessionBar, TapeBar, TitleBar, TooSmall
from sattrack.tui.run_keys import RestState, RunKeys, Screens
from sattrack.tui.scene import (
    DEFAULT_APPEARANCE,
    LIVE,
    PAGES,
    REFUSAL_SHOWN_S,
    OffsetKeys,
    Scene,
)
from sattrack.tui.sky_chart import NotesPanel, SkyPanel, chart_columns
from sattrack.views.messages import LeaveRunning, StopNow, TakeControl, YieldControl
from sattrack.views.picture import MOST_SIDE
from sattrack.views.run import STARTER

if TYPE_CHECKING:
    from collections.abc import Callable

    from textual.app import ComposeResult
    from textual.dom import DOMNode

    from sattrack.tui.feeds import Feed, Helpers
    from sattrack.tui.scene import Appearance, TerminalPixels
    from sattrack.views.messages import Message, SessionMessage
    from sattrack.views.run import PassView, SessionView, Summary, TrackView

PLOT_EVERY_S = 0.25
LEAVE_WITHIN_S = 4.0
"""How long the screen stays for the mount to come to rest before it is left."""


class TrackApp(RunKeys):
    """Shows a run and takes the operator's keys.

    With `stay`, the screen of an ended run remains until it is left. `monotonic` is this process's own
    clock, seconds. `pixels` is of a terminal that draws them.
    """

    TITLE = "sattrack"
    CSS = look.CSS
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("left", "nudge(-1, 0)", "behind, or less"),
        Binding("right", "nudge(1, 0)", "ahead, or more"),
        Binding("up", "nudge(0, 1)", "left of motion, or more"),
        Binding("down", "nudge(0, -1)", "right of motion, or less"),
        Binding("shift+left", "creep(-1, 0)", "gently behind"),
        Binding("shift+right", "creep(1, 0)", "gently ahead"),
        Binding("shift+up", "creep(0, 1)", "gently left"),
        Binding("shift+down", "creep(0, -1)", "gently right"),
        Binding("pageup", "leaf(-1)", "up"),
        Binding("pagedown", "leaf(1)", "down"),
        Binding("home", "leaf(-1000)", "to the top"),
        Binding("end", "leaf(1000)", "to the end"),
        Binding("enter", "arm", "arm"),
        Binding("a", "follow('pointed')", "follow now"),
        Binding("n", "follow('next')", "next satellite"),
        Binding("b", "follow('before')", "satellite before"),
        Binding("g", "look_again", "search again"),
        Binding("j", "by_hand", "by hand"),
        Binding("p", "pause_or_go", "pause, or go on"),
        Binding("P", "park", "park"),
        *(Binding(key, f"page('{page}')", page) for key, page in PAGES.items()),
        Binding("u", "undo", "undo"),
        Binding("c", "control", "control"),
        Binding("left_square_bracket", "step(-1)", "smaller step"),
        Binding("right_square_bracket", "step(1)", "larger step"),
        Binding("f", "frame", "frame"),
        Binding("s", "search('spiral')", "spiral"),
        Binding("w", "search('sweep')", "sweep"),
        Binding("escape", "cancel_search", "cancel search"),
        Binding("r", "reset", "reset frame"),
        Binding("0", "clear_bias", "clear bias"),
        Binding("m", "drop_remembered", "drop remembered bias"),
        Binding("plus", "slip(1)", "T0 later"),
        Binding("minus", "slip(-1)", "T0 earlier"),
        Binding("v", "sky", "sky alone"),
    ]

    def __init__(
        self,
        feed: Feed,
        stay: bool = True,
        monotonic: Callable[[], float] = time.monotonic,
        appearance: Appearance = DEFAULT_APPEARANCE,
        helpers: Helpers | None = None,
        pixels: TerminalPixels | None = None,
    ) -> None:
        super().__init__(appearance)
        self._pixels = pixels
        self._feed = feed
        self._stay = stay
        self._monotonic = monotonic
        self._history = ErrorHistory()
        self._view: TrackView | None = None
        self._summary: Summary | None = None
        self._sky: PassView | None = None
        self._ended = False
        self._beginning = False
        """Whether another run was announced, and no view of it has come."""
        self._between = False
        """Whether the next run of a schedule is waited for."""
        self._gone = False
        """Whether no more views will come."""
        self._offsets = OffsetKeys()
        self._rest = RestState()
        self._screens = Screens(helpers, PICTURE_SIDE if pixels is None else MOST_SIDE)
        self._session: SessionView | None = None
        self._you = STARTER
        self._refused_s: float | None = None
        self._leave_running = False
        self.left_running = False
        """Whether the run continues without this screen."""
        self._heard_s = monotonic()
        self._stop_sent_s: float | None = None
        self._leaving_since_s: float | None = None

    def compose(self) -> ComposeResult:
        """Make the parts, from top to bottom."""
        yield TitleBar()
        yield HeadlineBar()
        yield SessionBar()
        yield Cautions()
        with Container(id="live"):
            yield from self._live()
        yield TonightPage()
        yield MountPage()
        yield SchedulePage()
        yield LogPage()
        yield CameraPage(self._pixels)
        yield TapeBar()
        yield KeyBar()
        yield TooSmall()

    def _live(self) -> ComposeResult:
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

    def on_mount(self) -> None:
        """Title the panels, and plot from now on."""
        for name, title in look.TITLES.items():
            self.query_one(name).border_title = title
        self.every(PLOT_EVERY_S, self.plot)
        self.call_after_refresh(self.plot)

    def on_exit_app(self) -> None:
        """Forget the picture while the terminal still shows this screen: it keeps images with it."""
        self._draw_on_main(lambda screen: screen.query_one(RealPicture).forget())

    def look(self) -> None:
        """Take in what has come, and draw the newest."""
        self._rest.looked_s = self._monotonic()
        news = self._feed.news()
        if news.rewound:
            self._begin_anew()
        for view in news.views:
            self._history.add(view)
        if news.views:
            self._view = news.views[-1]
            self._heard_s = self._monotonic()
            self._beginning = False
        self._sky = news.sky or self._sky
        if news.session is not None:
            self._session, self._you = news.session, news.you
        self._screens.take(news)
        self._summary = news.summary or self._summary
        self._gone = self._gone or news.ended
        self._between = news.between
        self._ended = self._ended or news.ended or news.between or news.summary is not None
        self._draw()
        if self._gone and self._view is None:
            # It never began; the plain terminal shows why.
            self.exit()
        self._leave_when_due()
        self._park_when_due()

    def _begin_anew(self) -> None:
        self._history = ErrorHistory()
        self._ended, self._summary, self._stop_sent_s = False, None, None
        self._offsets.forget()
        self._beginning = True

    def plot(self) -> None:
        """Draw the error against time."""
        scene = self.scene
        huge = self.size.width >= look.HUGE[0] and self.size.height >= look.HUGE[1]
        self._draw_on_main(lambda main: _lay_out(main, huge))
        if scene is not None:
            self._draw_on_main(lambda main: _plot(main, scene, self._history))

    @property
    def scene(self) -> Scene | None:
        """What to draw; None before the first view."""
        if self._view is None:
            return None
        now_s = self._monotonic()
        return Scene(
            view=self._view,
            step=self._offsets.step,
            news_age_s=now_s - self._heard_s,
            stop_sent_s=None if self._stop_sent_s is None else now_s - self._stop_sent_s,
            leaving=self._leaving_since_s is not None,
            ended=self._ended,
            summary=self._summary,
            frame=self._offsets.frame,
            sky=self._sky,
            plain=self._appearance.plain,
            session=self._session,
            you=self._you,
            page=self._screens.page,
            beginning=self._beginning,
            between=self._screens.between(now_s) if self._between else None,
            refused_s=None if self._refused_s is None else now_s - self._refused_s,
            hint=self._rest.hint if now_s - self._rest.hinted_s < REFUSAL_SHOWN_S else "",
            jog_rate=self._rest.jog_rate if self._paused else None,
        )

    def action_stop(self) -> None:
        """Stop everything; every press says it again. Nothing may then hide what the mount does."""
        self._close_dialogs()
        self._leave_running = self._rest.park_due = False
        if self._stop_sent_s is None:
            self._stop_sent_s = self._monotonic()
        self._send(StopNow())

    def stop_at_once(self) -> None:
        """Say that the mount is to stop."""
        if not self._gone:
            self._feed.send(StopNow())

    def action_interrupt(self) -> None:
        """Stop the mount and leave, for a program that was interrupted."""
        self.interrupted = True
        self._leave()

    def action_leave(self) -> None:
        """Leave: ask first where the run can be left running; where it was started elsewhere, at once."""
        if self._session is None or self._ended or self._leaving_since_s is not None or self._attached:
            self._leave()
        elif not isinstance(self.screen, LeaveDialog):
            self._close_dialogs()
            self.push_screen(LeaveDialog(), self._leave_as_answered)

    def _leave(self) -> None:
        """Stop the mount, then leave once it is at rest; asked again, leave at once."""
        self._close_dialogs()
        if self._ended or self._attached or self._leaving_since_s is not None:
            self.exit()
            return
        self._leaving_since_s = self._monotonic()
        self.action_stop()

    def _leave_as_answered(self, answer: str | None) -> None:
        if answer == STOP:
            self._leave()
        elif answer == LEAVE:
            self._leave_running = True
            self._send(LeaveRunning())

    def action_control(self) -> None:
        """Take control, or give it up."""
        if self._session is not None:
            self._send(YieldControl() if self._session.controller == self._you else TakeControl())

    def on_unmount(self) -> None:
        """End what was started for the screens."""
        self._screens.close()

    def action_sky(self) -> None:
        """Show the sky alone, as large as it goes, or all again."""
        if self._sky is not None and self._screens.page == LIVE:
            self.screen_stack[0].toggle_class("-sky-alone")
            self.call_after_refresh(self.plot)

    def action_next_theme(self) -> None:
        """Go on to the next theme."""
        super().action_next_theme()
        self.call_after_refresh(self.plot)

    def action_help(self) -> None:
        """Show what the keys do."""
        page = self._screens.page
        show_help(self, ATTACHED_TEXT if self._attached and page == LIVE else TEXTS[page])

    @property
    def _attached(self) -> bool:
        return self._you != STARTER

    def _may_command(self) -> bool:
        if self._session is None or self._session.controller == self._you:
            return True
        self._refused_s = self._monotonic()
        self._draw()
        return False

    def _send(self, message: Message | SessionMessage) -> None:
        # After a run, another may be about to begin: a stop is sent as long as anybody can receive it.
        if not (self._gone if isinstance(message, StopNow) else self._ended):
            self._feed.send(message)
        self._draw()

    def _draw(self) -> None:
        scene = self.scene
        if scene is not None:
            self._draw_on_main(lambda main: _show(main, scene))
            now_s = self._monotonic()
            self._draw_on_main(lambda main: self._screens.draw(main, scene, now_s))

    def _leave_when_due(self) -> None:
        if self._was_asked_to_leave():
            self._leave()
        if self._leave_running and self._session is not None and self._session.left_running:
            self.left_running = True
            self.exit()
        since_s = self._leaving_since_s
        overdue = since_s is not None and self._monotonic() - since_s > LEAVE_WITHIN_S
        if overdue or (self._ended and (since_s is not None or not self._stay)):
            self.exit()


def _lay_out(main: DOMNode, huge: bool) -> None:
    """Give the parts their sizes, whether or not there is anything to draw yet."""
    main.set_class(huge, "-huge")
    middle, sky = main.query_one("#middle"), main.query_one(SkyPanel)
    if main.has_class("-sky-alone"):
        sky.styles.width = "1fr"
    else:
        frame = sky.size.width - sky.content_size.width if sky.size.width else 0
        sky.styles.width = chart_columns(middle.size.width, middle.size.height, frame)


def _plot(main: DOMNode, scene: Scene, history: ErrorHistory) -> None:
    if not main.has_class("-sky-alone"):
        main.query_one(ErrorPanel).draw(scene, history)
    main.query_one(SkyPanel).draw(scene)


def _show(main: DOMNode, scene: Scene) -> None:
    main.query_one(figures.ErrorBox).show(scene)
    for panel in main.query(Panel):
        panel.show(scene)
