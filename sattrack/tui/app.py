"""The screen of a run. It sees views and sends messages; another process feeds the mount."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, ClassVar

import msgspec
from textual.binding import Binding, BindingType
from textual.containers import Container, Horizontal

from sattrack.core.errors import SattrackError
from sattrack.tui import figures, look
from sattrack.tui.attached import folder_of, schedule_in
from sattrack.tui.console_panels import MountPage
from sattrack.tui.dialogs import LEAVE, STOP, TEXTS, HelpScreen, LeaveDialog
from sattrack.tui.error_plot import ErrorHistory, ErrorPanel
from sattrack.tui.figures import BiasPanel
from sattrack.tui.pages import LogBook, LogPage, PassList, SchedulePage, TonightPage, schedule_text
from sattrack.tui.panels import Cautions, HeadlineBar, KeyBar, Panel, SessionBar, TapeBar, TitleBar, TooSmall
from sattrack.tui.run_keys import RestState, RunKeys
from sattrack.tui.scene import (
    DEFAULT_APPEARANCE,
    LIVE,
    LOG,
    MOUNT,
    PAGE_CLASSES,
    PAGES,
    REFUSAL_SHOWN_S,
    SCHEDULE,
    TONIGHT,
    OffsetKeys,
    Scene,
)
from sattrack.tui.sky_chart import NotesPanel, SkyPanel, chart_columns
from sattrack.views import formatting
from sattrack.views.messages import LeaveRunning, StopNow, TakeControl, YieldControl
from sattrack.views.run import STARTER

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from textual.app import ComposeResult
    from textual.dom import DOMNode

    from sattrack.tui.feeds import Feed, Helpers, News, PassRow
    from sattrack.tui.panels import ListPage
    from sattrack.tui.scene import Appearance
    from sattrack.views.messages import Message, SessionMessage
    from sattrack.views.run import ConsoleView, LearntView, PassView, SessionView, Summary, TrackView
    from sattrack.views.schedule import ScheduleView

SEARCH_AGAIN_S = 600.0
READ_AGAIN_S = 2.0
LOOK_AWAY_S = 30.0
"""How long a look at the mount lasts after its screen was left."""
LISTS: dict[str, type[ListPage]] = {TONIGHT: TonightPage, SCHEDULE: SchedulePage, LOG: LogPage}
NO_HELPERS = "nothing to show: this screen was started for the pass alone"


class Screens:
    """Tonight, mount, schedule and log. `helpers` None: there is nothing but the log."""

    def __init__(
        self, helpers: Helpers | None, read: Callable[[Path], ScheduleView | None] = schedule_in
    ) -> None:
        self._read = read
        self._helpers = helpers
        self.page = LIVE
        self.night = PassList()
        self.book = LogBook()
        self._console: ConsoleView | None = None
        self._heard_s = self._looked_s = 0.0
        self._ended = False
        self._schedule: tuple[ScheduleView | None, str] = (None, "")
        self._read_s: float | None = None
        self._changed_s = 0.0
        self._recording: str | None = None

    def take(self, news: News) -> None:
        """Take in what has come of a run."""
        for view in news.views:
            self.book.take(view)
            self._recording = view.recording
        if news.run is not None and self._helpers is not None and news.run != self._helpers.pid:
            self._helpers.pid = news.run
            self._helpers.look.close()
        if news.session is not None:
            self.book.hear(news.session)
        if news.rewound:
            self._ended = False
        if news.summary is not None and not self._ended:
            self._ended = True
            self.book.end(news.summary)
        found = None if self._helpers is None else self._helpers.search.take()
        if found is not None:
            self.night.take(found)

    def turn_to(self, page: str, main: DOMNode) -> None:
        """Show another screen."""
        self.page = page
        for name, style in PAGE_CLASSES.items():
            main.set_class(name == page, style)

    def draw(self, main: DOMNode, scene: Scene, now_s: float) -> None:
        """Draw the screen that is shown, and have what it needs brought."""
        self._look_at_mount(scene, now_s)
        if self.page == TONIGHT:
            main.query_one(TonightPage).draw(self.night, scene, self._search(scene.view.utc_s))
        elif self.page == MOUNT:
            main.query_one(MountPage).draw(
                self._console_of(scene), now_s - self._heard_s, self._mount_note(scene), scene.jog_rate
            )
        elif self.page == SCHEDULE:
            view, trouble = self._schedule_of(now_s)
            main.query_one(SchedulePage).draw(self._as_of(view, scene, now_s), trouble)
        elif self.page == LOG:
            main.query_one(LogPage).draw(self.book)

    def look_again(self) -> None:
        """Search for the passes anew."""
        if self._helpers is not None:
            self._helpers.search.begun_utc_s = None

    def arm(self, scene: Scene, now: bool) -> SessionMessage | None:
        """Return what arms the pass under the cursor; after the end of a run it is followed at once."""
        queue = () if scene.session is None else scene.session.queue
        return self.night.arm(queue, now or scene.ended)

    def neighbour(self, by: int, scene: Scene) -> PassRow | None:
        """Point to the pass after the one that goes on, or before it; None where none is known."""
        return self.night.point_next_to(by, scene.view.catalog_number, scene.view.culminate_utc_s)

    @property
    def mount(self) -> ConsoleView | None:
        """The last look at the mount; None where there was none."""
        return self._console

    def console_command(self) -> list[str] | None:
        """Return what operates the mount by hand; None for a simulated one, which ends with its run."""
        return None if self._helpers is None else self._helpers.console

    def list_shown(self, main: DOMNode) -> ListPage | None:
        """Return the list on the screen that is shown; None where it has none."""
        kind = LISTS.get(self.page)
        return None if kind is None else main.query_one(kind)

    def close(self) -> None:
        """End what was started for them."""
        if self._helpers is not None:
            self._helpers.close()

    def _search(self, utc_s: float) -> str:
        """Search for passes where that is due; return the state of the search."""
        if self._helpers is None:
            return NO_HELPERS
        search = self._helpers.search
        due = search.begun_utc_s is None or abs(utc_s - search.begun_utc_s) > SEARCH_AGAIN_S
        if due and not search.busy:
            search.begin(utc_s)
        if search.busy:
            return "looking for passes …"
        return search.trouble

    def between(self, now_s: float) -> str:
        """Return what the schedule does between two runs."""
        view, _ = self._schedule_of(now_s)
        if view is None:
            return "its schedule goes on"
        return schedule_text(self._gone_by(view, now_s))

    def _schedule_of(self, now_s: float) -> tuple[ScheduleView | None, str]:
        """Return what stands in the folder of the schedule that a run belongs to, and what is wrong with it.

        A run's recording lies in its schedule's folder.
        """
        due = self._read_s is None or now_s - self._read_s >= READ_AGAIN_S
        if due and self._recording is not None:
            self._read_s = now_s
            before = self._schedule[0]
            try:
                self._schedule = self._read(folder_of(self._recording)), ""
            except SattrackError as error:
                self._schedule = None, str(error)
            if self._schedule[0] != before:
                self._changed_s = now_s
        return self._schedule

    def _as_of(self, view: ScheduleView | None, scene: Scene, now_s: float) -> ScheduleView | None:
        """Return a schedule's view as of now: by a run's clock while one goes on, else by what went by."""
        if view is None or not view.running:
            return view
        if scene.ended or scene.beginning:
            return self._gone_by(view, now_s)
        return msgspec.structs.replace(view, utc_s=scene.view.utc_s)

    def _gone_by(self, view: ScheduleView, now_s: float) -> ScheduleView:
        return msgspec.structs.replace(view, utc_s=view.utc_s + now_s - self._changed_s)

    def _look_at_mount(self, scene: Scene, now_s: float) -> None:
        if self._helpers is None:
            return
        look = self._helpers.look
        if self.page == MOUNT and not scene.ended:
            self._looked_s = now_s
            look.open(self._helpers.pid)
        latest = look.latest()
        if latest.view is not None:
            self._console, self._heard_s = latest.view, now_s
            if scene.view.mount == "sim":
                # It keeps the time that the run has it keep, which is not this machine's.
                self._console = msgspec.structs.replace(latest.view, clock_offset_s=None)
        if latest.ended or (self.page != MOUNT and now_s - self._looked_s > LOOK_AWAY_S):
            look.close()

    def _console_of(self, scene: Scene) -> ConsoleView | None:
        """Return the last look at the mount, with the run's own counts: the look began when it was opened."""
        seen = self._console
        return None if seen is None else msgspec.structs.replace(seen, link=scene.view.link)

    def _mount_note(self, scene: Scene) -> str:
        if self._helpers is None:
            return NO_HELPERS
        if scene.ended:
            if self._helpers.console is None:
                return "the run is over, and the simulated mount with it"
            return "the run is over: j operates the mount by hand (jog, slew, sync, park, home)"
        if self._helpers.look.trouble:
            return self._helpers.look.trouble
        if self._console is None:
            return "looking at the mount …"
        paused = "paused: the arrows jog, [ ] choose how fast; p goes on"
        jog = "; p pauses, then the arrows jog" if scene.in_control else ""
        heard = f"as the run hears it{jog}{_learnt(scene.view.learnt)}"
        return heard if scene.jog_rate is None or not scene.in_control else paused


def _learnt(learnt: LearntView | None) -> str:
    """Return what was learnt of the axes, right ascension first; empty where nothing was."""
    if learnt is None:
        return ""
    lags = f"{1e3 * learnt.ra_lag_s:.0f}, {1e3 * learnt.dec_lag_s:.0f} ms"
    gains = ", ".join("?" if g is None else f"{g:.4f}" for g in (learnt.ra_gain, learnt.dec_gain))
    return f"   learnt: lag {lags}  gain {gains}  settling {learnt.settling_s:.2f} s".replace(
        "-", formatting.MINUS
    )


PLOT_EVERY_S = 0.25
LEAVE_WITHIN_S = 4.0
"""How long the screen stays for the mount to come to rest before it is left."""


class TrackApp(RunKeys):
    """Shows a run and takes the operator's keys.

    With `stay`, the screen of an ended run remains until it is left. `monotonic` is this process's own
    clock, seconds.
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
        Binding("v", "sky", "sky alone"),
    ]

    def __init__(
        self,
        feed: Feed,
        stay: bool = True,
        monotonic: Callable[[], float] = time.monotonic,
        appearance: Appearance = DEFAULT_APPEARANCE,
        helpers: Helpers | None = None,
    ) -> None:
        super().__init__(appearance)
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
        self._screens = Screens(helpers)
        self._session: SessionView | None = None
        self._you = STARTER
        self._refused_s: float | None = None
        self._leave_running = False
        self.left_running = False
        """Whether the run goes on without this screen."""
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
        self.push_screen(HelpScreen(TEXTS[self._screens.page]))

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
