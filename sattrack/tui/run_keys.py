"""The keys of a run's screen (move the target, pause, jog, park), and the pages that they turn to."""

from __future__ import annotations

import subprocess
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec
from textual.app import SuspendNotSupported

from sattrack.core.errors import SattrackError
from sattrack.tui.attached import PICTURE_SIDE, PictureLook, folder_of, schedule_in
from sattrack.tui.camera_page import CameraDesk, CameraPage
from sattrack.tui.console_app import LAGGING_S
from sattrack.tui.console_panels import FIRST_RATE, RATES, MountPage, jog_rates_deg_s
from sattrack.tui.dialogs import PARK_TEXT, Question
from sattrack.tui.look import ScreenApp
from sattrack.tui.pages import LogBook, LogPage, PassList, SchedulePage, TonightPage, schedule_text
from sattrack.tui.scene import CAMERA, LIVE, LOG, MOUNT, PAGE_CLASSES, PAUSED, SCHEDULE, TONIGHT
from sattrack.views import formatting
from sattrack.views.messages import Arm, DropRemembered, Go, Guide, Jog, Pause, StopNow

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from textual.dom import DOMNode

    from sattrack.tui.feeds import Feed, Helpers, News, PassRow
    from sattrack.tui.panels import ListPage
    from sattrack.tui.scene import OffsetKeys, Scene
    from sattrack.views.messages import Message, SessionMessage
    from sattrack.views.run import ConsoleView, LearntView, Summary, TrackView
    from sattrack.views.schedule import ScheduleView

PAUSE_FIRST = "by hand only while the pass is paused: p pauses it"


@dataclass(slots=True)
class RestState:
    """What the operator has chosen for a mount at rest, and the hint shown last."""

    jog_rate: int = FIRST_RATE
    """Which of the six jog rates is chosen, 1 to 6."""
    park_due: bool = False
    """Whether to park the mount as soon as the run is over."""
    hint: str = ""
    hinted_s: float = 0.0
    looked_s: float = 0.0
    """When this process last came to look, by its own clock."""


class RunKeys(ScreenApp):
    """The actions of a run's screen; how the screen is drawn and left, its subclass says."""

    _feed: Feed
    _offsets: OffsetKeys
    _rest: RestState
    _screens: Screens
    _view: TrackView | None
    _summary: Summary | None
    _ended: bool
    _gone: bool
    _stop_sent_s: float | None
    _monotonic: Callable[[], float]

    @property
    def scene(self) -> Scene | None:
        """What to draw; None before the first view."""
        raise NotImplementedError

    def plot(self) -> None:
        """Draw the error against time."""
        raise NotImplementedError

    def _may_command(self) -> bool:
        """Return whether commands from here are obeyed; where not, show that."""
        raise NotImplementedError

    def _send(self, message: Message | SessionMessage) -> None:
        raise NotImplementedError

    def _draw(self) -> None:
        raise NotImplementedError

    def _may_move(self) -> bool:
        """Return whether keys that move the target are obeyed from here; where not, show that."""
        return self._screens.page == LIVE and self._may_command()

    def action_nudge(self, along: int, across: int) -> None:
        """Move the target by one step, along its track, across it, or as the frame has it.

        On other screens: down a list, or the mount by hand while the pass is paused.
        """
        if self._screens.page == MOUNT:
            self._jog(east=-along, north=across)
        elif self._screens.page == CAMERA:
            self._screens.desk.move(along, across)
            self._draw()
        elif self._screens.page != LIVE:
            self._scroll(lambda listed: listed.move(-across))
        elif self._may_move():
            self._send_all(self._offsets.nudge(along, across, self._view))

    def action_creep(self, along: int, across: int) -> None:
        """Move the target gently, by several steps."""
        if self._may_move() and self._view is not None:
            self._send_all(self._offsets.creep(along, across, self._view))

    def action_undo(self) -> None:
        """Take back what was last done to the offsets."""
        if self._screens.page in {LIVE, CAMERA} and self._may_command():
            self._send_all(self._offsets.undo(self._view))

    def action_step(self, by: int) -> None:
        """Choose a smaller or a larger step, of a nudge or of a jog."""
        if self._screens.page == MOUNT:
            self._resize_jog(by)
            return
        self._offsets.resize(by)
        self._draw()

    def action_frame(self) -> None:
        """Go on to the next frame in which the arrows move, or to the next filter of a list."""
        if self._screens.page == LIVE:
            self._offsets.turn_frame()
            self._draw()
        elif self._screens.page == CAMERA:
            self._screens.desk.turn()
            self._draw()
        else:
            self._scroll(lambda listed: listed.turn_filter())

    def action_search(self, how: str) -> None:
        """Begin a search, its size by the step; or end the one that runs where it is."""
        if self._may_move():
            self._send_all(self._offsets.search(how, self._view))

    def action_cancel_search(self) -> None:
        """End a search that runs, back in its centre; in a picture, take the cursor away."""
        if self._screens.page == CAMERA:
            self._screens.desk.point(None)
            self._draw()
        elif self._may_move():
            self._send_all(self._offsets.cancel_search(self._view))

    def action_reset(self) -> None:
        """Take the offsets of the frame away; on the camera's screen, reject the last observation."""
        if self._screens.page == CAMERA:
            self._guide("reject")
        elif self._may_move():
            self._send_all(self._offsets.reset(self._view))

    def action_clear_bias(self) -> None:
        """Take everything back: nudges, offsets, search and estimate."""
        if self._may_move():
            self._send_all(self._offsets.clear(self._view))

    def action_drop_remembered(self) -> None:
        """Take back the bias that an earlier pass left, and have it offered no more."""
        if self._may_move():
            self._send(DropRemembered())

    def action_slip(self, way: int) -> None:
        """Have the T0 of a launch later, or earlier."""
        if self._may_move():
            self._send_all(self._offsets.slip(way))

    def _guide(self, how: str) -> None:
        """Decide about the observations of a camera."""
        if self._may_command() and not self._ended:
            self._send(Guide(how))

    def _centre(self) -> None:
        """Move the target so that what is pointed to in the picture comes to its middle.

        A camera that leads the mount would undo that: its observations are left aside then.
        """
        if self._view is None or self._ended or not self._may_command():
            return
        loop, desk = self._view.loop, self._screens.desk
        shift = desk.shift_deg(self._view)
        leading = loop if loop is not None and loop.guided and loop.state == "camera" else None
        if isinstance(shift, str):
            self._hint(shift)
            return
        if leading is not None:
            if desk.cursor is None and leading.last == "taken":
                self._hint("the camera centres that already: the arrows point to something else")
                return
            self._send(Guide("off"))
            self._hint("the camera is left aside, or it would undo that: g guides by it again")
        self._send_all(self._offsets.shift(*shift, self._view))
        self._screens.desk.point(None)

    def _send_all(self, messages: Sequence[Message]) -> None:
        for message in messages:
            self._send(message)

    def action_page(self, page: str) -> None:
        """Show another screen."""
        self._draw_on_main(lambda main: self._screens.turn_to(page, main))
        self._draw()
        self.call_after_refresh(self.plot)

    def action_leaf(self, by: int) -> None:
        """Go down a list by screens, or up."""
        self._scroll(lambda listed: listed.page(by))

    def action_look_again(self) -> None:
        """Search for the passes again; on the camera's screen, guide by it or not."""
        if self._screens.page == CAMERA:
            loop = None if self._view is None else self._view.loop
            self._guide("on" if loop is not None and not loop.guided else "off")
        if self._screens.page == TONIGHT:
            self._screens.look_again()
            self._draw()

    def action_arm(self) -> None:
        """Arm the pass under the cursor, or take it back; once a run is over, follow it.

        Where there is no list of passes: go on with a pass that is paused.
        """
        scene = self.scene
        if self._screens.page == CAMERA:
            self._centre()
        elif self._screens.page != TONIGHT:
            self._go_on()
        if self._screens.page == TONIGHT and scene is not None and self._may_command():
            self._order(self._screens.arm(scene, now=False))

    def action_follow(self, which: str) -> None:
        """Leave this satellite for another: ask first where a pass is being followed.

        The key for the pass that is pointed to accepts an observation on the camera's screen.
        """
        scene = self.scene
        if which == "pointed" and self._screens.page == CAMERA:
            self._guide("accept")
            return
        if scene is None or (which == "pointed" and self._screens.page != TONIGHT) or not self._may_command():
            return
        by = {"next": 1, "before": -1}.get(which, 0)
        row = self._screens.neighbour(by, scene) if by else self._screens.night.pointed
        if row is None or row.catalog_number is None:
            self.action_page(TONIGHT)
            return
        order = Arm(row.catalog_number, row.culminate_utc_s, row.name, now=True)
        if scene.ended or scene.view.phase == "waiting":
            self._order(order)
            return
        when = f"highest at {formatting.iso_clock(row.culminate_utc)} with {row.max_alt_deg:.0f}°"
        text = f"{scene.view.name} is left, and the mount goes on to {row.name}, {when}."
        if row.feasible is False:
            text += f" That pass is no-go: {row.why_not or 'the mount cannot follow it'}."
        question = Question(f"leave {scene.view.name} for {row.name}?", text)
        self.push_screen(question, lambda sure: self._order(order) if sure else None)

    def _order(self, order: SessionMessage | None) -> None:
        """Send what to follow; it is received after the end of a run too."""
        if order is not None and not self._gone:
            self._feed.send(order)
        self._draw()

    def _scroll(self, act: Callable[[ListPage], None]) -> None:
        """Do something with the list that is shown, if there is one."""

        def on_main(main: DOMNode) -> None:
            listed = self._screens.list_shown(main)
            if listed is not None:
                act(listed)

        self._draw_on_main(on_main)
        self._draw()

    @property
    def _paused(self) -> bool:
        return self._view is not None and self._view.phase == PAUSED and not self._ended

    def action_pause_or_go(self) -> None:
        """Pause the pass, or go on with it."""
        if self._paused:
            self._go_on()
        elif self._view is not None and self._view.ended_by is None and self._may_command():
            self._send(Pause())

    def _go_on(self) -> None:
        """Go on with a pass that is paused."""
        if self._paused and self._may_command():
            self._send(Go())

    def _jog(self, east: int, north: int) -> None:
        """Move the mount by one touch, unless the key is an old one."""
        if self._ended or not self._may_command():
            return
        seen = self._screens.mount
        if not self._paused or seen is None:
            self._hint("the mount is not seen yet" if self._paused else PAUSE_FIRST)
            return
        if self._monotonic() - self._rest.looked_s > LAGGING_S:
            return
        rate = jog_rates_deg_s(seen)[self._rest.jog_rate - 1]
        self._send(Jog(ra_rate_deg_s=east * rate) if east else Jog(dec_rate_deg_s=north * rate))

    def _resize_jog(self, by: int) -> None:
        self._rest.jog_rate = min(RATES, max(1, self._rest.jog_rate + by))
        self._draw()

    def action_by_hand(self) -> None:
        """Operate the mount by hand, by the console's own screen, once no run has it."""
        command = self._screens.console_command()
        if self._screens.page != MOUNT:
            return
        if not self._ended:
            self._hint("the arrows jog, [ ] choose how fast" if self._paused else PAUSE_FIRST)
        elif command is not None:
            self._hand_over(command)

    def action_park(self) -> None:
        """Ask, end the run, and have the mount parked by the console."""
        scene = self.scene
        if scene is None or not self._may_command():
            return
        why_not = self._no_parking(scene)
        if why_not is not None:
            self._hint(why_not)
            return
        text = f"{'' if scene.ended else 'The run ends. '}{PARK_TEXT} SPACE stops it on its way."
        self.push_screen(Question("park?", text), lambda sure: self._begin_parking() if sure else None)

    def _no_parking(self, scene: Scene) -> str | None:
        """Return why the mount cannot be parked from here, or None where it can."""
        if self._screens.console_command() is None:
            if scene.view.mount == "sim":
                return "the simulated mount ends with its run: there is nothing to park"
            return "not parked from here: press P where the run was started, or `sattrack mount park`"
        if scene.sky is None or not scene.sky.can_park:
            return "not parked: the mount's profile has no park position"
        if scene.beginning or scene.between is not None:
            return "not parked: another run is about to begin"
        if self._driver is None or not self._driver.can_suspend:
            return "parking needs a terminal: `sattrack mount park` parks it"
        return None

    def _begin_parking(self) -> None:
        if self._ended:
            # Whatever ended the run, whoever asks now has read it.
            self._park(self._summary is None or self._summary.mount_stopped is not False)
            return
        self._rest.park_due = True
        if self._stop_sent_s is None:
            self._stop_sent_s = self._monotonic()
        self._send(StopNow())

    def _park_when_due(self) -> None:
        """Hand a mount over to the console to be parked, once its run is over and it stands."""
        if not (self._rest.park_due and self._ended):
            return
        self._rest.park_due = False
        summary = self._summary
        planned = summary is not None and summary.ended_by in {"operator", "set"}
        self._park(planned and summary is not None and summary.mount_stopped is True)

    def _park(self, well: bool) -> None:
        command = self._screens.console_command()
        if well and command is not None:
            self._hand_over([*command, "--park"])
        else:
            self._hint("not parked: the run did not end with the mount at rest")

    def _hand_over(self, command: list[str]) -> None:
        """Give the terminal to the console until that ends; it looks as this screen does."""
        plain = ("--ascii",) if self._appearance.plain else ()
        with suppress(SuspendNotSupported), self.suspend():
            subprocess.run([*command, "--theme", self.theme, *plain], check=False)
        self.refresh()

    def _hint(self, text: str) -> None:
        self._rest.hint, self._rest.hinted_s = text, self._monotonic()
        self._draw()


SEARCH_AGAIN_S = 600.0
READ_AGAIN_S = 2.0
LOOK_AWAY_S = 30.0
"""How long a look at the mount lasts after its screen was left."""
LISTS: dict[str, type[ListPage]] = {TONIGHT: TonightPage, SCHEDULE: SchedulePage, LOG: LogPage}
NO_HELPERS = "nothing to show: this screen was started for this pass only"


class Screens:
    """Tonight, mount, schedule and log. `helpers` None: there is nothing but the log."""

    def __init__(
        self,
        helpers: Helpers | None,
        picture_side: int = PICTURE_SIDE,
        read: Callable[[Path], ScheduleView | None] = schedule_in,
    ) -> None:
        self._read = read
        self._helpers = helpers
        self.page = LIVE
        self.night = PassList()
        self.book = LogBook()
        self.desk = CameraDesk()
        self.pictures = PictureLook(picture_side)
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
            self.desk.forget()
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
        self._look_at_cameras(scene, now_s)
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
        elif self.page == CAMERA:
            main.query_one(CameraPage).draw(self.desk, scene, now_s)

    def look_again(self) -> None:
        """Search for the passes again."""
        if self._helpers is not None:
            self._helpers.search.begun_utc_s = None

    def arm(self, scene: Scene, now: bool) -> SessionMessage | None:
        """Return what arms the pass under the cursor; after the end of a run it is followed at once."""
        queue = () if scene.session is None else scene.session.queue
        return self.night.arm(queue, now or scene.ended)

    def neighbour(self, by: int, scene: Scene) -> PassRow | None:
        """Point to the pass after or before the present one; None if none is known."""
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
        self.pictures.close()
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
        """Return a schedule's view as of now: by an active run's clock, else by the time passed since."""
        if view is None or not view.running:
            return view
        if scene.ended or scene.beginning:
            return self._gone_by(view, now_s)
        return msgspec.structs.replace(view, utc_s=scene.view.utc_s)

    def _gone_by(self, view: ScheduleView, now_s: float) -> ScheduleView:
        return msgspec.structs.replace(view, utc_s=view.utc_s + now_s - self._changed_s)

    def _look_at_cameras(self, scene: Scene, now_s: float) -> None:
        """Have pictures sent while they are shown, and at no other time."""
        if self._helpers is None or self.page != CAMERA or scene.ended:
            self.pictures.close()
            return
        self.pictures.open(self._helpers.pid)
        self.desk.take(self.pictures.take(), now_s)

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
        if latest.ended or (self.page != MOUNT and now_s - self._looked_s > LOOK_AWAY_S):
            look.close()

    def _console_of(self, scene: Scene) -> ConsoleView | None:
        """Return the last look at the mount, with what the run knows of link and clock.

        The look began when it was opened, and may know neither the run's time nor its site.
        """
        seen, link = self._console, scene.view.link
        return seen and msgspec.structs.replace(seen, link=link, clock_offset_s=link.clock_offset_s)

    def _mount_note(self, scene: Scene) -> str:
        if self._helpers is None:
            return NO_HELPERS
        if scene.ended:
            return self._over_note(scene)
        if self._helpers.look.trouble:
            return self._helpers.look.trouble
        if self._console is None:
            return "looking at the mount …"
        paused = "paused: the arrows jog, [ ] choose how fast; p goes on"
        jog = "; p pauses, then the arrows jog" if scene.in_control else ""
        heard = f"as the run hears it{jog}{_learnt(scene.view.learnt)}"
        return heard if scene.jog_rate is None or not scene.in_control else paused

    def _over_note(self, scene: Scene) -> str:
        if scene.view.mount == "sim":
            return "the run is over, and the simulated mount with it"
        if self.console_command() is None:
            return "the run is over: `sattrack mount watch` operates the mount by hand"
        return "the run is over: j operates the mount by hand (jog, slew, sync, park, home)"


def _learnt(learnt: LearntView | None) -> str:
    """Return what was learnt of the axes, right ascension first; empty where nothing was."""
    if learnt is None:
        return ""
    lags = f"{1e3 * learnt.ra_lag_s:.0f}, {1e3 * learnt.dec_lag_s:.0f} ms"
    gains = ", ".join("?" if g is None else f"{g:.4f}" for g in (learnt.ra_gain, learnt.dec_gain))
    return f"   learnt: lag {lags}  gain {gains}  settling {learnt.settling_s:.2f} s".replace(
        "-", formatting.MINUS
    )
