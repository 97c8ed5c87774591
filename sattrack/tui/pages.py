"""The pages of a run beside the live one that are lists: the passes to come, the schedule, the log."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

from textual.content import Content

from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.panels import ListPage, Row, fitted, rows_content
from sattrack.tui.scene import Tone, why_ended
from sattrack.views import formatting
from sattrack.views.messages import Arm, Disarm
from sattrack.views.run import SAME_PASS_S

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from textual.events import Click

    from sattrack.tui.feeds import PassRow
    from sattrack.tui.scene import Scene
    from sattrack.views.messages import SessionMessage
    from sattrack.views.run import Armed, SessionView, Summary, TrackView
    from sattrack.views.schedule import SchedulePassView, ScheduleView

NAME_CELLS, SHORT_NAME_CELLS = 24, 18
ROOM_FOR_LONG_NAMES = 100
FOLLOWING, WAITING, IN_PROGRESS = "following", "waiting", "in progress"


HIGH_DEG = 30.0


class Filter(NamedTuple):
    """A label of which passes are shown, and the test."""

    label: str
    lets: Callable[[PassRow], bool]


FILTERS = (
    Filter("all", lambda _: True),
    Filter("go", lambda row: row.feasible is not False),
    Filter(f"above {HIGH_DEG:g}°", lambda row: row.max_alt_deg >= HIGH_DEG),
    Filter(
        "sunlit by night", lambda row: row.sunlit_from_utc is not None and (row.sun_alt_deg or 0.0) < -6.0
    ),
)


class PassList:
    """The passes to come, the one that is pointed at, and what to say to have one followed."""

    def __init__(self) -> None:
        self._all: tuple[PassRow, ...] = ()
        self._filter = 0
        self.rows: tuple[PassRow, ...] = ()
        self.cursor = 0

    @property
    def filter_label(self) -> str:
        """Which passes are shown."""
        return FILTERS[self._filter].label

    @property
    def count(self) -> int:
        """How many there are, shown or not."""
        return len(self._all)

    @property
    def pointed(self) -> PassRow | None:
        """The pass under the cursor."""
        return self.rows[self.cursor] if self.rows else None

    def take(self, rows: Sequence[PassRow]) -> None:
        """Take a new list; the cursor stays on its pass."""
        self._all = tuple(rows)
        self._choose()

    def turn_filter(self) -> None:
        """Go on to the next filter."""
        self._filter = (self._filter + 1) % len(FILTERS)
        self._choose()

    def move(self, by: int) -> None:
        """Point to a pass further down, or up where negative."""
        self.cursor = max(0, min(len(self.rows) - 1, self.cursor + by))

    def point_next_to(self, by: int, catalog_number: int | None, culminate_utc_s: float) -> PassRow | None:
        """Point to the next pass but for the one named, or to the one before; None where there is none."""
        later = [n for n, row in enumerate(self.rows) if row.culminate_utc_s > culminate_utc_s + SAME_PASS_S]
        at = next((n for n, row in enumerate(self.rows) if row.is_of(catalog_number, culminate_utc_s)), None)
        here = at if at is not None else (later[0] if later else len(self.rows)) - (1 if by > 0 else 0)
        goal = here + by
        if not 0 <= goal < len(self.rows):
            return None
        self.cursor = goal
        return self.rows[goal]

    def arm(self, queue: Sequence[Armed], now: bool) -> SessionMessage | None:
        """Return what arms the pass under the cursor, or takes it back where it is armed."""
        row = self.pointed
        if row is None or row.catalog_number is None:
            return None
        if not now and any(row.is_of(one.catalog_number, one.culminate_utc_s) for one in queue):
            return Disarm(row.catalog_number, row.culminate_utc_s)
        return Arm(row.catalog_number, row.culminate_utc_s, row.name, now)

    def _choose(self) -> None:
        pointed = self.pointed
        self.rows = tuple(row for row in self._all if FILTERS[self._filter].lets(row))
        self.cursor = 0
        if pointed is not None:
            found = (
                n
                for n, row in enumerate(self.rows)
                if row.is_of(pointed.catalog_number, pointed.culminate_utc_s)
            )
            self.cursor = next(found, 0)


HEAD_ROWS = 2


class TonightPage(ListPage):
    """Draws the list about its cursor, and details of the pass under it."""

    rows_that_stay = HEAD_ROWS + 2

    def __init__(self) -> None:
        super().__init__(id="tonight")
        self._night: PassList | None = None
        self._scene: Scene | None = None
        self._state = ""
        self._first = 0

    def draw(self, night: PassList, scene: Scene | None, state: str) -> None:
        """Take the list and the active run; `state` is the state of the search."""
        self._night, self._scene, self._state = night, scene, state
        self.renew()

    def move(self, rows: int) -> None:
        """Move the cursor by so many rows."""
        if self._night is not None:
            self._night.move(rows)
            self.refresh()

    def turn_filter(self) -> None:
        """Go on to the next filter."""
        if self._night is not None:
            self._night.turn_filter()

    def on_click(self, event: Click) -> None:
        """Point to the row that was clicked."""
        row = event.y - HEAD_ROWS
        if self._night is not None and 0 <= row < self._room:
            self.move(self._first + row - self._night.cursor)

    def _content(self) -> Content:
        night = self._night
        if night is None:
            return Content("")
        last = max(0, len(night.rows) - self._room)
        self._first = min(last, max(night.cursor - self._room + 1, min(self._first, night.cursor)))
        shown = night.rows[self._first : self._first + self._room]
        head: Row = [("passes to come ", DIM), (night.filter_label, "bold")]
        head.append((f"   {len(night.rows)} of {night.count}", DIM))
        if self._state:
            head += ["   ", (self._state, SPOKEN[Tone.NOTICE])]
        else:
            head += ["   ", ("Enter", "bold"), (" arms  ", DIM), ("a", "bold"), (" follows now  ", DIM)]
            head += [("f", "bold"), (" filters", DIM)]
        columns: Row = [
            (f"  {'rise':<9}{'highest':<9}{'set':<9}{'alt':>4}  {'satellite':<{NAME_CELLS}}  ", DIM)
        ]
        rows = [head, columns]
        rows += [self._row(row, self._first + n == night.cursor) for n, row in enumerate(shown)]
        rows += [[] for _ in range(self._room - len(shown))]
        return rows_content([*rows, *_about(night.pointed)])

    def _row(self, row: PassRow, pointed: bool) -> Row:
        style = "reverse" if pointed else ""
        name = fitted(row.name, NAME_CELLS)
        rise = "is up" if row.rise_utc is None else formatting.iso_clock(row.rise_utc)
        times = (rise, formatting.iso_clock(row.culminate_utc), formatting.iso_clock(row.set_utc))
        text = "".join(f"{time:<9}" for time in times)
        text += f"{row.max_alt_deg:3.0f}°  {name}"
        return [("▶ " if pointed else "  ", "bold"), (text, style), "  ", *self._verdict(row)]

    def _verdict(self, row: PassRow) -> Row:
        scene = self._scene
        queue: Sequence[Armed] = () if scene is None or scene.session is None else scene.session.queue
        for place, one in enumerate(queue, start=1):
            if row.is_of(one.catalog_number, one.culminate_utc_s):
                return [(f" armed {place} ", PLATE[Tone.CALM])]
        if scene is not None and row.is_of(scene.view.catalog_number, scene.view.culminate_utc_s):
            return [
                (" over " if scene.ended else " this one ", PLATE[Tone.CALM if scene.ended else Tone.GOOD])
            ]
        if row.feasible is None:
            return [(formatting.NOTHING, DIM)]
        return [("go", SPOKEN[Tone.GOOD])] if row.feasible else [("NO-GO", SPOKEN[Tone.BAD])]


NO_NUMBER = "no number: `sattrack track` follows it by its name"


def _about(row: PassRow | None) -> list[Row]:
    """Return details of a pass, in two rows."""
    if row is None:
        return [[], []]
    path: Row = [(f"{NO_NUMBER if row.catalog_number is None else row.catalog_number}  ", DIM)]
    if row.rise_az_deg is not None and row.set_az_deg is not None:
        path += [
            ("from ", DIM),
            formatting.azimuth(row.rise_az_deg),
            (" to ", DIM),
            formatting.azimuth(row.set_az_deg),
        ]
    lit = "in shadow throughout"
    if row.sunlit_from_utc is not None:
        lit = (
            f"sunlit {formatting.iso_clock(row.sunlit_from_utc)} to {formatting.iso_clock(row.sunlit_to_utc)}"
        )
    path.append((f"  {lit}", DIM))
    verdict: Row = [("the mount can follow it", DIM)] if row.feasible else []
    if row.why_not:
        verdict = [("no-go: ", SPOKEN[Tone.BAD]), row.why_not]
    return [path, verdict]


TONES = {"done": Tone.GOOD, IN_PROGRESS: Tone.CALM, "partly": Tone.NOTICE, "lost": Tone.BAD}
RESULTS = ("done", "partly", "lost")
OVER = {
    "ended": ("the schedule is over", Tone.CALM),
    "stopped": ("its runner has ended; run it again to continue", Tone.NOTICE),
}
"""The text for a schedule that nobody runs, by its last state."""
NO_SCHEDULE = "this run belongs to no schedule; `sattrack run FILE` runs one"


class SchedulePage(ListPage):
    """Draws what the runner of a schedule says of it, the passes about the present one."""

    rows_that_stay = 4

    def __init__(self) -> None:
        super().__init__(id="schedule")
        self._view: ScheduleView | None = None
        self._trouble = ""
        self._below = 0
        """How far it was scrolled from where it stands by itself."""

    def draw(self, view: ScheduleView | None, trouble: str) -> None:
        """Take the newest status; nothing is redrawn where nothing has changed."""
        self._view, self._trouble = view, trouble
        self.renew()

    def move(self, rows: int) -> None:
        """Scroll."""
        count = 0 if self._view is None else len(self._view.passes)
        self._below = max(-count, min(count, self._below + rows))
        self.refresh()

    def _content(self) -> Content:
        view = self._view
        if view is None:
            return rows_content([[(self._trouble or NO_SCHEDULE, DIM)]])
        first = self._first(view)
        shown = view.passes[first : first + self._room]
        return rows_content([*self._head(view), *(self._row(view, one) for one in shown)])

    def _first(self, view: ScheduleView) -> int:
        """Return the first pass shown: by itself, one pass before the present or the next one."""
        at = view.current if view.current is not None else view.next_number
        here = next((n for n, one in enumerate(view.passes) if one.number == at), 0)
        last = max(0, len(view.passes) - self._room)
        return max(0, min(last, here - 1 + self._below))

    def _head(self, view: ScheduleView) -> list[Row]:
        # What it does often begins with the very word.
        doing, tone = view.doing.removeprefix(view.state).strip(), Tone.CALM
        if not view.running:
            doing, tone = OVER.get(view.state, ("its runner has ended", Tone.BAD))
            if view.stopped_utc is not None:
                doing = f"by an operator; {view.resume}"
        elif view.old and view.age_s is not None:
            doing, tone = f"{doing}   NO NEWS for {formatting.span(view.age_s)}", Tone.BAD
        state = (f" {view.state.upper()} ", PLATE[tone])
        second: Row = [("night ", DIM), f"{view.night}", "   ", *_count(view)]
        left_s = next_in_s(view)
        if left_s is not None:
            second += [("   next in ", DIM), formatting.span(left_s)]
        second += [("   mount ", DIM), view.mount]
        if view.weather:
            second += [("   ", DIM), view.weather]
        note: Row = [(view.notes[-1], SPOKEN[Tone.NOTICE])] if view.notes else []
        columns = f"  {'from':<9}{'highest':<9}{'to':<9}{'alt':>4}  {'satellite':<{self._name_cells}}  "
        return [[state, " ", (doing, "bold"), (f"   {view.schedule}", DIM)], second, note, [(columns, DIM)]]

    @property
    def _name_cells(self) -> int:
        return NAME_CELLS if self.content_size.width >= ROOM_FOR_LONG_NAMES else SHORT_NAME_CELLS

    def _row(self, view: ScheduleView, one: SchedulePassView) -> Row:
        name = fitted(one.name, self._name_cells)
        times = "".join(
            f"{formatting.iso_clock(utc):<9}" for utc in (one.start_utc, one.culminate_utc, one.end_utc)
        )
        mark = "▶ " if one.number in {view.current, view.next_number} else "  "
        row: Row = [(mark, "bold"), f"{times}{one.max_alt_deg:3.0f}°  {name}  "]
        return [*row, *_state(view, one)]


def schedule_text(view: ScheduleView) -> str:
    """Return what a runner does between two runs, and in how long the next pass begins."""
    left_s = next_in_s(view)
    if view.state == FOLLOWING:
        # It is from the time of the run that is over.
        coming = _coming(view)
        doing = "its schedule goes on" if coming is None else f"next {coming.name}"
    else:
        doing = view.doing
    return doing if left_s is None else f"{doing}, in {formatting.span(left_s)}"


def next_in_s(view: ScheduleView) -> float | None:
    """Return in how many seconds the next pass begins; None if none comes, or it has begun."""
    coming = _coming(view)
    left_s = 0.0 if coming is None else formatting.iso_unix_s(coming.start_utc) - view.utc_s
    return left_s if view.running and left_s > 0.0 else None


def _coming(view: ScheduleView) -> SchedulePassView | None:
    return next((one for one in view.passes if one.state == WAITING), None)


def _count(view: ScheduleView) -> Row:
    """Return how many passes came to what."""
    states = [one.state for one in view.passes]
    row: Row = [f"{states.count('done')} of {len(states)} done"]
    for state in ("partly", "lost"):
        if state in states:
            row += [", ", (f"{states.count(state)} {state}", SPOKEN[TONES[state]])]
    return row


def _state(view: ScheduleView, one: SchedulePassView) -> Row:
    """Return the outcome of a pass, or the time to its beginning or end."""
    coming_s, left_s = (formatting.iso_unix_s(utc) - view.utc_s for utc in (one.start_utc, one.end_utc))
    if not view.running:
        coming_s = left_s = 0.0
    if coming_s > 0.0 and (one.number == view.current or one is _coming(view)):
        return [("in ", DIM), (formatting.span(coming_s), "bold")]
    row: Row = [(one.state, SPOKEN[TONES[one.state]] if one.state in TONES else DIM)]
    if one.state == IN_PROGRESS and left_s > 0.0:
        row.append((f" {formatting.span(left_s)}", "bold"))
    if one.state in RESULTS and one.on_target_s:
        row.append(f" {one.on_target_s:.0f} s")
    if one.rms_arcsec is not None:
        row.append(f"  {formatting.arcsec(one.rms_arcsec)}")
    if one.words or one.cause:
        row.append((f"  {one.words or one.cause}", DIM))
    return row


MOST_LINES = 2000
LOG_FILTERS = ("all", "warnings", "people")
"""What is shown: everything, what wanted attention, or what the people before the run did."""
_NUMBERS = re.compile(r"[-+−]?[0-9][0-9.]*")


class LogLine(NamedTuple):
    """One line: when (UTC, POSIX seconds), its tone, its source, and the text."""

    utc_s: float
    tone: Tone
    source: str
    text: str


class LogBook:
    """Lines as they come, a bounded number."""

    def __init__(self) -> None:
        self.lines: list[LogLine] = []
        self.dropped = 0
        """How many old lines were let go."""
        self._phase = self._link = ""
        self._ended_by: str | None = None
        self._warned: set[str] = set()
        self._last_event: str | None = None
        self._utc_s = 0.0

    def take(self, view: TrackView) -> None:
        """Take in a view: what is new in it is a line each."""
        self._utc_s = view.utc_s
        if view.phase != self._phase:
            self._phase = view.phase
            off = "" if view.error is None else f", {formatting.arcsec(view.error.total_arcsec)} off"
            self.say(Tone.CALM, "run", f"{view.name}: {view.phase}{off if view.phase == 'tracking' else ''}")
        if view.link.state != self._link:
            self._link = view.link.state
            tone = Tone.CALM if self._link in {"up", "silent"} else Tone.BAD
            self.say(tone, "warning" if tone is Tone.BAD else "run", f"link {self._link}")
        # A figure that changes in a warning does not make it another one.
        warned = {_NUMBERS.sub("#", text): text for text in view.warnings}
        for key, text in warned.items():
            if key not in self._warned:
                self.say(Tone.NOTICE, "warning", text)
        self._warned = set(warned)
        if view.ended_by != self._ended_by:
            self._ended_by = view.ended_by
            if view.ended_by is not None:
                bad = view.ended_by not in {"set", "operator"}
                self.say(
                    Tone.BAD if bad else Tone.CALM, "warning" if bad else "run", why_ended(view.ended_by)
                )

    def hear(self, session: SessionView) -> None:
        """Take in what happened among the people before the run."""
        if session.said is not None and session.said != self._last_event:
            self.say(Tone.CALM, "people", session.said)
        self._last_event = session.said

    def end(self, summary: Summary) -> None:
        """Take in what a run came to."""
        rms = summary.reported_rms_arcsec
        error = "" if rms is None else f", error {formatting.arcsec(rms)} RMS"
        rest = {True: "at rest", False: "NO STOP CONFIRMED", None: "never heard"}[summary.mount_stopped]
        tone = Tone.BAD if summary.mount_stopped is False else Tone.CALM
        text = f"{summary.name}: {summary.on_target_s:.0f} s on target{error}; mount {rest}"
        self.say(tone, "warning" if tone is Tone.BAD else "run", text)

    def say(self, tone: Tone, source: str, text: str) -> None:
        """Add a line, dated by the last view."""
        self.lines.append(LogLine(self._utc_s, tone, source, text))
        if len(self.lines) > MOST_LINES:
            self.dropped += len(self.lines) - MOST_LINES
            del self.lines[:-MOST_LINES]

    def shown(self, chosen: str) -> list[LogLine]:
        """Return the lines that a filter lets through."""
        source = {"warnings": "warning", "people": "people"}.get(chosen)
        return [one for one in self.lines if source is None or one.source == source]


class LogPage(ListPage):
    """Draws a part of the log. Scrolled back, it keeps its place while lines are added."""

    def __init__(self) -> None:
        super().__init__(id="log")
        self._book = LogBook()
        self._filter = 0
        self._top: LogLine | None = None
        """The first line shown; None where it follows."""

    def draw(self, book: LogBook) -> None:
        """Take the log; nothing is redrawn where nothing has changed."""
        self._book = book
        self.renew()

    def turn_filter(self) -> None:
        """Go on to the next filter."""
        self._filter = (self._filter + 1) % len(LOG_FILTERS)
        self._top = None
        self.refresh()

    def move(self, rows: int) -> None:
        """Scroll by so many rows, down where positive; at the end it follows again."""
        lines = self._book.shown(LOG_FILTERS[self._filter])
        first = max(0, min(self._first(lines) + rows, len(lines) - self._room))
        self._top = None if first >= len(lines) - self._room else lines[first]
        self.refresh()

    def _first(self, lines: list[LogLine]) -> int:
        if self._top is not None and self._top in lines:
            return lines.index(self._top)
        return max(0, len(lines) - self._room)

    def _content(self) -> Content:
        chosen = LOG_FILTERS[self._filter]
        lines = self._book.shown(chosen)
        first = self._first(lines)
        shown = lines[first : first + self._room]
        later = len(lines) - first - len(shown)
        place = "the newest" if later == 0 else f"{formatting.counted(later, 'later one')} below"
        head: Row = [
            ("log ", DIM),
            (chosen, "bold"),
            (f"   {formatting.counted(len(lines), 'line')}, {place}", DIM),
        ]
        return rows_content([head, *(self._row(one) for one in shown)])

    def _row(self, one: LogLine) -> Row:
        return [
            (f"{formatting.clock(one.utc_s)} ", DIM),
            (one.text, SPOKEN[one.tone] if one.source != "run" else ""),
        ]
