"""The panels of a mount, for the console and for a run's mount screen, and the scene they draw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rich.cells import cell_len
from textual.containers import Container, Vertical
from textual.content import Content
from textual.widgets import Static

from sattrack.core.errors import UNHEARD
from sattrack.core.local_time import zone_name
from sattrack.mount.model import DTICS_S_PER_DEG_S
from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.panels import (
    STOP_PLATE,
    CautionsPanel,
    HeadlinePanel,
    Part,
    Row,
    ScenePanel,
    Touch,
    TouchBar,
    labelled,
    rows_content,
)
from sattrack.tui.scene import NO_NEWS_AFTER_S, STOP_UNHEARD_AFTER_S, Caution, Headline, Tone
from sattrack.views import formatting
from sattrack.views.formatting import SIDEREAL_DTICS_S, Group, StatusLine, number

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from textual.app import ComposeResult

    from sattrack.mount.model import Status
    from sattrack.views.run import AskedView, ConsoleView

JOG_RATES_DEG_S = (0.02, 0.1, 0.5, 2.0)
"""Between the guide rate and the profile's limit."""
FIRST_RATE = 2
RATES = len(JOG_RATES_DEG_S) + 2
HALF_SIDEREAL_DEG_S = SIDEREAL_DTICS_S / DTICS_S_PER_DEG_S / 2.0


@dataclass(frozen=True, slots=True)
class ConsoleScene:
    """Everything the screen draws from."""

    view: ConsoleView
    rate: int = FIRST_RATE
    """Which of the six jog rates is chosen, 1 to 6."""
    news_age_s: float = 0.0
    """Seconds since the console was last heard, by this process's own clock."""
    stop_sent_s: float | None = None
    """Seconds since the stop key was pressed; None where it was not, or was obeyed."""
    leaving: bool = False
    ended: bool = False
    """Whether the console's process has ended its stream."""
    by_brackets: bool = False
    """Whether the brackets choose the jog rate, and not its own key."""


def jog_rates_deg_s(view: ConsoleView) -> tuple[float, ...]:
    """Return the six rates of the keys 1 to 6, growing: the mount's guide rate first, the limit last."""
    limit = min(view.max_ra_rate_deg_s, view.max_dec_rate_deg_s)
    guide = view.guide_rate_deg_s
    if guide is None or not 0.0 < guide < JOG_RATES_DEG_S[0]:
        guide = HALF_SIDEREAL_DEG_S
    return tuple(min(rate, limit) for rate in (guide, *JOG_RATES_DEG_S, limit))


def headline(scene: ConsoleScene) -> Headline:
    """Return what to read first."""
    view = scene.view
    if scene.ended:
        return Headline("CONSOLE ENDED", "nothing here is live; q leaves", Tone.BAD)
    if scene.news_age_s > NO_NEWS_AFTER_S:
        rest = f"from the console for {scene.news_age_s:.0f} s: everything below is old"
        return Headline("NO NEWS", rest, Tone.BAD)
    if view.link.state == "silent":
        return Headline("NOT HEARD", "no status from the mount yet", Tone.NOTICE)
    if view.link.state == "lost":
        return Headline("LINK LOST", "the mount is silent: everything below is old", Tone.BAD)
    if scene.stop_sent_s is not None:
        return Headline("STOP SENT", "not confirmed yet", Tone.NOTICE)
    return _doing(view) if view.status is None else _doing_of(view, view.status)


def _doing(view: ConsoleView) -> Headline:
    return Headline(view.doing.upper(), "", Tone.NOTICE)


def _doing_of(view: ConsoleView, status: Status) -> Headline:
    if view.doing == "stopping":
        return Headline("STOPPING", "bringing the mount to rest", Tone.NOTICE)
    if view.tripped is not None and view.at_rest:
        return Headline("LIMIT", f"stopped at the {view.tripped} limit; r lets it move again", Tone.BAD)
    if view.doing == "jogging":
        ra, dec = number(view.ra_rate_deg_s, 4, sign=True), number(view.dec_rate_deg_s, 4, sign=True)
        return Headline("JOGGING", f"RA {ra}  Dec {dec} °/s against the stars", Tone.NOTICE)
    if view.doing != "idle":
        word, _, rest = view.doing.partition(" ")
        return Headline(word.upper(), rest or "by order from here", Tone.NOTICE)
    return _idle(view, status)


def _idle(view: ConsoleView, status: Status) -> Headline:
    if status.slewing or not view.at_rest:
        return Headline("MOVING", "not by this console", Tone.NOTICE)
    if status.at_park:
        return Headline("PARKED", "the drives have no power", Tone.CALM)
    if abs(status.ra_rate_dtics_s) < SIDEREAL_DTICS_S / 2.0:
        return Headline("AT REST", "the axes stand still", Tone.CALM)
    return Headline("TRACKING", "following the stars", Tone.GOOD)


_ADVICE = (
    ("another program", "SPACE stops the mount all the same"),
    ("safety stopped", "once it is at rest, r lets it move again"),
)


def cautions(scene: ConsoleScene) -> tuple[Caution, ...]:
    """Return what wants attention, the gravest first."""
    view, found = scene.view, []
    if scene.leaving and not scene.ended:
        found.append(Caution("leaving as soon as nothing moves", "q again leaves at once", Tone.CALM))
    if scene.ended:
        return (Caution("the console has ended", "make sure that the mount is at rest", Tone.BAD),)
    if scene.news_age_s > NO_NEWS_AFTER_S:
        found.append(
            Caution("the console does not answer", "press SPACE, then use the mount's own stop", Tone.BAD)
        )
    elif scene.stop_sent_s is not None and scene.stop_sent_s > STOP_UNHEARD_AFTER_S:
        found.append(Caution("the stop was not obeyed", "use the mount's own stop", Tone.BAD))
    if view.refusal is not None and view.refusal not in view.warnings:
        found.append(Caution("not done", view.refusal, Tone.NOTICE))
    for text in view.warnings:
        advice = next((do for begins, do in _ADVICE if text.startswith(begins)), "")
        found.append(Caution(text, advice, Tone.BAD if view.link.state == "lost" else Tone.NOTICE))
    if view.link.state == "silent":
        found.append(Caution("the mount has not answered yet", UNHEARD, Tone.NOTICE))
    return tuple(found)


LOUD = SPOKEN[Tone.NOTICE]
ASKED_AT_MOST = 5
LAMP_ON, LAMP_OFF = "●", "○"


TITLES = {
    "pointing": "pointing",
    "drives": "drives (tics/10 s)",
    "state": "state",
    "acks": "acknowledged",
    "readings": "read as",
    "place": "site and datagram",
    "link": "link",
    "asked": "asked of late",
    "jog": "jog",
}
"""By the panels' names; on a run's mount screen these begin with `m-`."""


class ConsolePanel(ScenePanel[ConsoleScene]):
    """A panel of the console's screen, or of a run's mount screen."""

    def __init__(self, id: str | None = None) -> None:  # noqa: A002 - Textual's own name
        super().__init__(id)
        self.border_title = None if id is None else TITLES.get(id.removeprefix("m-"))


class ConsoleTitle(ConsolePanel):
    """Which mount, by which profile, and what time it is."""

    def full(self, scene: ConsoleScene) -> list[Row]:
        """Return the one row."""
        view = scene.view
        time = f"{formatting.date(view.utc_s)} {formatting.clock(view.utc_s)} {zone_name(view.utc_s)}"
        room = self.content_size.width - cell_len(f"mount    profile {view.profile}  {time}")
        # Addresses can be long; nothing else in this row may give way.
        mount = view.mount if len(view.mount) <= room else view.mount[: max(0, room - 1)] + "…"
        gap = max(1, room - len(mount) + 2)
        return [
            [
                ("mount ", DIM),
                (mount, "bold"),
                ("   profile ", DIM),
                view.profile,
                " " * (gap - 1),
                (time, "bold"),
            ]
        ]


class ConsoleHeadline(ConsolePanel, HeadlinePanel[ConsoleScene]):
    """What the mount does, or what matters more."""

    headline_of = staticmethod(headline)


class ConsoleCautions(ConsolePanel, CautionsPanel[ConsoleScene]):
    """What wants attention about a mount."""

    cautions_of = staticmethod(cautions)


class GroupPanel(ConsolePanel):
    """A group of the status' fields, a row each."""

    def __init__(self, make: Callable[[ConsoleView, Status], Group], id: str) -> None:  # noqa: A002
        super().__init__(id=id)
        self._make = make

    def full(self, scene: ConsoleScene) -> list[Row]:
        """Return the rows."""
        status = scene.view.status
        if status is None:
            return [[(formatting.NOTHING, DIM)]]
        return _rows(self._make(scene.view, status).lines)

    def compact(self, scene: ConsoleScene) -> list[Row]:
        """Return all of them in one row."""
        status = scene.view.status
        if status is None:
            return []
        return [
            _joined(
                StatusLine(_SHORT.get(line.name, line.name), *line[1:])
                for line in self._make(scene.view, status).lines
            )
        ]


class AcksPanel(GroupPanel):
    """Which commands the mount acknowledges: lamps, so that a glance suffices."""

    def __init__(self, id: str) -> None:  # noqa: A002
        super().__init__(formatting.acknowledgements, id)

    def full(self, scene: ConsoleScene) -> list[Row]:
        """Return a lamp a row."""
        return [[(part, style), f" {name}"] for name, part, style in self._lamps(scene)]

    def compact(self, scene: ConsoleScene) -> list[Row]:
        """Return the lamps in one row."""
        row: Row = [] if self.styles.border_top[0] else [("acknowledged ", DIM)]
        for name, lamp, style in self._lamps(scene):
            row += [(lamp, style), f" {name}  "]
        return [row]

    def _lamps(self, scene: ConsoleScene) -> list[tuple[str, str, str]]:
        status = scene.view.status
        if status is None:
            return []
        on = SPOKEN[Tone.GOOD]
        return [
            (line.name, LAMP_ON, on) if line.value == "yes" else (line.name, LAMP_OFF, DIM)
            for line in self._make(scene.view, status).lines
        ]


class ReadingsPanel(ConsolePanel):
    """How the fields that can be read in two ways are read."""

    def full(self, scene: ConsoleScene) -> list[Row]:
        """Return the rows."""
        return _rows(formatting.readings(scene.view).lines)

    def compact(self, scene: ConsoleScene) -> list[Row]:
        """Return two rows."""
        seen = scene.view.readings
        rates = f"{seen.ra_rate_dtics_s or '?'}/{seen.dec_rate_dtics_s or '?'}"
        guides = f"{seen.ra_guide_rate_dtics_s or '?'}/{seen.dec_guide_rate_dtics_s or '?'}"
        first: Row = [("read as ", DIM), "rates ", (rates, "bold"), ("   counter ", DIM), seen.counter or "?"]
        first += [("   guide ", DIM), guides]
        second: Row = [("        tracking ", DIM), seen.tracking or "not seen slewing"]
        return [first, [*second, ("   MoveAxis ", DIM), f"{scene.view.move_axis}, by the profile"]]


class MountLinkPanel(ConsolePanel):
    """How the mount is heard."""

    small: ClassVar[int] = 3

    def full(self, scene: ConsoleScene) -> list[Row]:
        """Return the lines in two columns."""
        lines = formatting.link(scene.view).lines
        half = (len(lines) + 1) // 2
        rows = []
        for left, right in zip(lines[:half], (*lines[half:], None), strict=False):
            row = _row(left, 8)
            if right is not None:
                row += [" " * max(1, 14 - cell_len(left.value)), *_row(right, 14)]
            rows.append(row)
        return rows

    def compact(self, scene: ConsoleScene) -> list[Row]:
        """Return them in three rows."""
        state, *others = formatting.link(scene.view).lines
        return [
            [
                ("link    ", DIM),
                (_shown(state), LOUD if state.loud else "bold"),
                "  ",
                *_joined(others[:5]),
            ],
            ["        ", *_joined(others[5:10])],
            ["        ", *_joined(others[10:])],
        ]


class AskedPanel(ConsolePanel):
    """What was asked of late, the newest first, and how far it has come."""

    def _content(self) -> Content:
        return Content("") if self._scene is None else rows_content(self.full(self._scene))

    def full(self, scene: ConsoleScene) -> list[Row]:
        """Return a row for each, or two where there is room."""
        asked = scene.view.asked
        if not asked:
            return [[("nothing asked yet: g slew  s sync  p park  h home, arrows jog", DIM)]]
        rows: list[Row] = []
        for one in reversed(asked):
            what, outcome = _asked(one)
            if self.content_size.height < 2 * ASKED_AT_MOST:
                rows.append([*what, ": ", *outcome])
            else:
                rows += [what, [" " * 9, *outcome]]
        return rows


class JogPanel(ConsolePanel):
    """The arrows, and how fast they move the mount."""

    def full(self, scene: ConsoleScene) -> list[Row]:
        """Return the arrows as they lie, and the rates."""
        rates = jog_rates_deg_s(scene.view)
        rows: list[Row] = [
            [("          ↑ ", "bold"), "north"],
            [("   east ", ""), ("←", "bold"), "   ", ("→", "bold"), " west    against the stars"],
            [("          ↓ ", "bold"), "south"],
            [],
        ]
        for keys in ((1, 2, 3), (4, 5, 6)):
            row: Row = []
            for key in keys:
                row += [_rate_key(f"{key} ", rates[key - 1], key == scene.rate, " °/s"), "  "]
            rows.append(row)
        return rows

    def compact(self, scene: ConsoleScene) -> list[Row]:
        """Return the one row."""
        row: Row = [("jog ", DIM), ("↑", "bold"), "N ", ("↓", "bold"), "S ", ("←", "bold"), "E "]
        row += [("→", "bold"), "W  "]
        for key, rate in enumerate(jog_rates_deg_s(scene.view), start=1):
            row += [_rate_key("" if scene.by_brackets else f"{key}:", rate, key == scene.rate), " "]
        return [[*row, ("°/s", DIM)]]


class ConsoleKeys(ConsolePanel, TouchBar[ConsoleScene]):
    """The keys."""

    def touches(self, scene: ConsoleScene | None) -> list[Touch]:
        """Return what stands in the row, from left to right."""
        keys = [("g", "slew"), ("s", "sync"), ("p", "park"), ("h", "home")]
        if scene is not None and scene.view.tripped is not None:
            keys.append(("r", "reset"))
        stop: list[Touch] = [(STOP_PLATE, PLATE[Tone.BAD], "space"), ("   ", "", None)]
        return [*_touches(keys), *stop, *_touches([("q", "leave"), ("?", "help")])]


def _touches(keys: list[tuple[str, str]]) -> list[Touch]:
    found: list[Touch] = []
    for key, what in keys:
        name = {"?": "question_mark"}.get(key, key)
        found += [(key, "bold", name), (f" {what}", DIM, name), ("   ", DIM, None)]
    return found


_SHORT = {"latitude": "lat", "longitude": "lon", "height": "h", "UTC bytes": "UTC"}


def _rows(lines: tuple[StatusLine, ...]) -> list[Row]:
    cells = max(len(line.name) for line in lines) + 1
    return [_row(line, cells) for line in lines]


def _row(line: StatusLine, cells: int) -> Row:
    return labelled(line.name, (_shown(line), LOUD if line.loud else "bold"), cells=cells)


def _shown(line: StatusLine) -> str:
    """Return a value as it is shown: what is wrong with the link in capitals, as on the screen of a run."""
    return line.value.upper() if line.loud and line.name == "state" else line.value


def _joined(lines: Iterable[StatusLine]) -> Row:
    row: Row = []
    for line in lines:
        row += ["  " if row else "", (f"{line.name} ", DIM), (line.value, LOUD if line.loud else "")]
    return row


def _asked(asked: AskedView) -> tuple[Row, Row]:
    """Return what was asked, and the outcome."""
    good = asked.state == "complete"
    tone = Tone.GOOD if good else Tone.CALM if not asked.settled else Tone.NOTICE
    reason = f" ({asked.reason})" if asked.reason else ""
    what: Row = [(f"{formatting.clock(asked.utc_s)} ", DIM), asked.what]
    return what, [(asked.state, SPOKEN[tone]), (reason, DIM)]


def _rate_key(before: str, rate_deg_s: float, chosen: bool, unit: str = "") -> Part:
    digits = number(rate_deg_s, 4).rstrip("0").rstrip(".")
    text = f"{before}{digits:<6}{unit}" if unit else before + digits
    return (f"[{text}]", PLATE[Tone.CALM]) if chosen else (f" {text} ", DIM)


class MountPage(Vertical):
    """Every field of the mount's last status, as the run hears it."""

    def __init__(self) -> None:
        super().__init__(id="mount-page")

    def compose(self) -> ComposeResult:
        """Make the parts."""
        yield Static("", id="m-note", markup=False)
        with Container(id="m-fields"):
            yield GroupPanel(formatting.pointing, "m-pointing")
            yield GroupPanel(formatting.drives, "m-drives")
            yield GroupPanel(formatting.state, "m-state")
        yield JogPanel("m-jog")
        yield AcksPanel("m-acks")
        with Container(id="m-below"):
            yield GroupPanel(formatting.place, "m-place")
            yield ReadingsPanel("m-readings")
            yield MountLinkPanel("m-link")

    def draw(self, view: ConsoleView | None, news_age_s: float, note: str, jog_rate: int | None) -> None:
        """Take the newest look at the mount, and a note on it.

        `jog_rate` is which rate is chosen, where the arrows jog; None where they do not.
        """
        self.query_one("#m-note", Static).update(note)
        self.query_one("#m-jog").display = jog_rate is not None
        if view is None:
            return
        rate = FIRST_RATE if jog_rate is None else jog_rate
        scene = ConsoleScene(view=view, rate=rate, news_age_s=news_age_s, by_brackets=True)
        for panel in self.query(ConsolePanel):
            panel.show(scene)
