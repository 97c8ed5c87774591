"""The screens beside the live one: which is shown, what they are drawn from, and where their lists stand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from sattrack.core.errors import SattrackError
from sattrack.tui.attached import folder_of, schedule_in
from sattrack.tui.console_panels import MountPage
from sattrack.tui.log import LogBook, LogPage
from sattrack.tui.scene import LIVE, LOG, MOUNT, PAGE_CLASSES, SCHEDULE, TONIGHT
from sattrack.tui.schedule_page import SchedulePage, schedule_text
from sattrack.tui.tonight import PassList, TonightPage
from sattrack.views import formatting

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from textual.dom import DOMNode

    from sattrack.tui.beside import Aside, PassRow
    from sattrack.tui.panels import ListPage
    from sattrack.tui.scene import Scene
    from sattrack.tui.seen_run import News
    from sattrack.views.messages import SessionMessage
    from sattrack.views.run import ConsoleView, LearntView
    from sattrack.views.schedule import ScheduleView

SEARCH_AGAIN_S = 600.0
READ_AGAIN_S = 2.0
LOOK_AWAY_S = 30.0
"""How long a look at the mount lasts after its screen was left."""
LISTS: dict[str, type[ListPage]] = {TONIGHT: TonightPage, SCHEDULE: SchedulePage, LOG: LogPage}
NO_ASIDE = "nothing to show: this screen was started for the pass alone"


class Screens:
    """Tonight, mount, schedule and log. `aside` None: there is nothing but the log."""

    def __init__(
        self, aside: Aside | None, read: Callable[[Path], ScheduleView | None] = schedule_in
    ) -> None:
        self._read = read
        self._aside = aside
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
        if news.run is not None and self._aside is not None and news.run != self._aside.pid:
            self._aside.pid = news.run
            self._aside.look.close()
        if news.session is not None:
            self.book.hear(news.session)
        if news.rewound:
            self._ended = False
        if news.summary is not None and not self._ended:
            self._ended = True
            self.book.end(news.summary)
        found = None if self._aside is None else self._aside.search.take()
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
        if self._aside is not None:
            self._aside.search.begun_utc_s = None

    def arm(self, scene: Scene, now: bool) -> SessionMessage | None:
        """Return what arms the pass under the cursor; after the end of a run it is followed at once."""
        queue = () if scene.session is None else scene.session.queue
        return self.night.arm(queue, now or scene.ended)

    def beside(self, by: int, scene: Scene) -> PassRow | None:
        """Point to the pass after the one that goes on, or before it; None where none is known."""
        return self.night.point_beside(by, scene.view.catalog_number, scene.view.culminate_utc_s)

    @property
    def mount(self) -> ConsoleView | None:
        """The last look at the mount; None where there was none."""
        return self._console

    def console_command(self) -> list[str] | None:
        """Return what operates the mount by hand; None for a simulated one, which ends with its run."""
        return None if self._aside is None else self._aside.console

    def list_shown(self, main: DOMNode) -> ListPage | None:
        """Return the list on the screen that is shown; None where it has none."""
        kind = LISTS.get(self.page)
        return None if kind is None else main.query_one(kind)

    def close(self) -> None:
        """End what was started for them."""
        if self._aside is not None:
            self._aside.close()

    def _search(self, utc_s: float) -> str:
        """Search for passes where that is due; return the state of the search."""
        if self._aside is None:
            return NO_ASIDE
        search = self._aside.search
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
        if self._aside is None:
            return
        look = self._aside.look
        if self.page == MOUNT and not scene.ended:
            self._looked_s = now_s
            look.open(self._aside.pid)
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
        if self._aside is None:
            return NO_ASIDE
        if scene.ended:
            if self._aside.console is None:
                return "the run is over, and the simulated mount with it"
            return "the run is over: j operates the mount by hand (jog, slew, sync, park, home)"
        if self._aside.look.trouble:
            return self._aside.look.trouble
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
