"""The panels of the console's screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from rich.cells import cell_len
from textual.content import Content

from sattrack.tui import words
from sattrack.tui.console_scene import ConsoleScene, cautions, headline, jog_rates_deg_s
from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.panels import CautionsPanel, HeadlinePanel, Part, Row, ScenePanel, labelled, rows_content
from sattrack.tui.scene import Caution, Headline, Tone
from sattrack.tui.touch import Touch, TouchBar
from sattrack.views import console_words
from sattrack.views.console_words import Group, Line, number

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from sattrack.mount.model import Status
    from sattrack.views.run import AskedView, ConsoleView

LOUD = SPOKEN[Tone.NOTICE]
ASKED_AT_MOST = 5
LAMP_ON, LAMP_OFF = "●", "○"


class ConsolePanel(ScenePanel[ConsoleScene]):
    """A panel of the console's screen."""


class ConsoleTitle(ConsolePanel):
    """Which mount, by which profile, and what time it is."""

    def full(self, scene: ConsoleScene) -> list[Row]:
        """Return the one row."""
        view = scene.view
        time = f"{words.date(view.utc_s)} {words.clock(view.utc_s)} UTC"
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
    """What the mount does, or whatever matters more."""

    def headline_of(self, scene: ConsoleScene) -> Headline:
        """Return what is to be read first."""
        return headline(scene)


class ConsoleCautions(ConsolePanel, CautionsPanel[ConsoleScene]):
    """What wants attention about a mount."""

    def cautions_of(self, scene: ConsoleScene) -> tuple[Caution, ...]:
        """Return what wants attention."""
        return cautions(scene)


class GroupPanel(ConsolePanel):
    """A group of the status' fields, a row each."""

    def __init__(self, make: Callable[[ConsoleView, Status], Group], id: str) -> None:  # noqa: A002
        super().__init__(id=id)
        self._make = make

    def full(self, scene: ConsoleScene) -> list[Row]:
        """Return the rows."""
        status = scene.view.status
        if status is None:
            return [[(words.NOTHING, DIM)]]
        return _rows(self._make(scene.view, status).lines)

    def compact(self, scene: ConsoleScene) -> list[Row]:
        """Return all of them in one row."""
        status = scene.view.status
        if status is None:
            return []
        return [
            _joined(
                Line(_SHORT.get(line.name, line.name), *line[1:])
                for line in self._make(scene.view, status).lines
            )
        ]


class AcksPanel(GroupPanel):
    """Which commands the mount acknowledges: lamps, so that a glance suffices."""

    def __init__(self, id: str) -> None:  # noqa: A002
        super().__init__(console_words.acknowledgements, id)

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
        return _rows(console_words.readings(scene.view).lines)

    def compact(self, scene: ConsoleScene) -> list[Row]:
        """Return two rows."""
        seen = scene.view.readings
        rates = f"{seen.ra_rate_dtics_s or '?'}/{seen.dec_rate_dtics_s or '?'}"
        guides = f"{seen.ra_guide_rate_dtics_s or '?'}/{seen.dec_guide_rate_dtics_s or '?'}"
        first: Row = [("read as ", DIM), "rates ", (rates, "bold"), ("   counter ", DIM), seen.counter or "?"]
        first += [("   guide ", DIM), guides]
        second: Row = [("        tracking ", DIM), seen.tracking or "not seen slewing"]
        return [first, [*second, ("   MoveAxis ", DIM), f"{scene.view.move_axis}, by the profile"]]


class LinkPanel(ConsolePanel):
    """How the mount is heard."""

    small: ClassVar[int] = 3

    def full(self, scene: ConsoleScene) -> list[Row]:
        """Return the lines in two columns."""
        lines = console_words.link(scene.view).lines
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
        state, *others = console_words.link(scene.view).lines
        return [
            [("link    ", DIM), (_said(state), LOUD if state.loud else "bold"), "  ", *_joined(others[:5])],
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
            what, became = _asked(one)
            if self.content_size.height < 2 * ASKED_AT_MOST:
                rows.append([*what, ": ", *became])
            else:
                rows += [what, [" " * 9, *became]]
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
        stop: list[Touch] = [(" SPACE STOP ", PLATE[Tone.BAD], "space"), ("   ", "", None)]
        return [*_touches(keys), *stop, *_touches([("q", "leave"), ("?", "help")])]


def _touches(keys: list[tuple[str, str]]) -> list[Touch]:
    found: list[Touch] = []
    for key, what in keys:
        name = {"?": "question_mark"}.get(key, key)
        found += [(key, "bold", name), (f" {what}", DIM, name), ("   ", DIM, None)]
    return found


_SHORT = {"latitude": "lat", "longitude": "lon", "height": "h", "UTC bytes": "UTC"}


def _rows(lines: tuple[Line, ...]) -> list[Row]:
    cells = max(len(line.name) for line in lines) + 1
    return [_row(line, cells) for line in lines]


def _row(line: Line, cells: int) -> Row:
    return labelled(line.name, (_said(line), LOUD if line.loud else "bold"), cells=cells)


def _said(line: Line) -> str:
    """Return a value as it is shown: what is wrong with the link in capitals, as on the screen of a run."""
    return line.value.upper() if line.loud and line.name == "state" else line.value


def _joined(lines: Iterable[Line]) -> Row:
    row: Row = []
    for line in lines:
        row += ["  " if row else "", (f"{line.name} ", DIM), (line.value, LOUD if line.loud else "")]
    return row


def _asked(asked: AskedView) -> tuple[Row, Row]:
    """Return what was asked, and what became of it."""
    good = asked.state == "complete"
    tone = Tone.GOOD if good else Tone.CALM if not asked.settled else Tone.NOTICE
    reason = f" ({asked.reason})" if asked.reason else ""
    what: Row = [(f"{words.clock(asked.utc_s)} ", DIM), asked.what]
    return what, [(asked.state, SPOKEN[tone]), (reason, DIM)]


def _rate_key(before: str, rate_deg_s: float, chosen: bool, unit: str = "") -> Part:
    digits = number(rate_deg_s, 4).rstrip("0").rstrip(".")
    text = f"{before}{digits:<6}{unit}" if unit else before + digits
    return (f"[{text}]", PLATE[Tone.CALM]) if chosen else (f" {text} ", DIM)
