"""What screens are drawn with: rows of text, panels, keys to touch, dialogs, dots, and the bars of a run."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar

from rich.cells import cell_len, set_cell_size
from textual.content import Content
from textual.errors import NoWidget
from textual.screen import ModalScreen
from textual.widget import Widget

from sattrack.core.local_time import zone_name
from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.scene import (
    CAMERA,
    LIVE,
    LOG,
    MOUNT,
    PAGES,
    SCHEDULE,
    TONIGHT,
    Scene,
    Tone,
    cautions,
    headline,
)
from sattrack.views import formatting
from tle.errors import printable

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from textual.events import Click, MouseScrollDown, MouseScrollUp

    from sattrack.tui.scene import Caution, Headline


Part = str | tuple[str, str]
"""Text, plain or with its style."""
Row = list[Part]
LABEL_CELLS = 9
WHEEL_ROWS = 3
SceneT = TypeVar("SceneT")


def rows_content(rows: Iterable[Row]) -> Content:
    """Return rows of parts as one content; text is text, neither markup nor commands to the terminal."""
    return Content("\n").join([Content.assemble(*map(_printable, row)) for row in rows])


def _printable(part: Part) -> Part:
    return printable(part) if isinstance(part, str) else (printable(part[0]), part[1])


def cells_of(row: Row) -> int:
    """Return how many cells a row takes."""
    return sum(cell_len(part if isinstance(part, str) else part[0]) for part in row)


def labelled(label: str, *parts: Part, cells: int = LABEL_CELLS) -> Row:
    """Return a row that begins with a quiet label in a column of its own."""
    return [(label.ljust(cells), DIM), *parts]


class Redrawn(Widget):
    """Shows what `_content` returns."""

    grows: ClassVar[bool] = False
    """Whether its height follows what it says."""

    def __init__(self, id: str | None = None) -> None:  # noqa: A002 - Textual's own name
        super().__init__(id=id)
        self._drawn = Content("")

    def renew(self) -> None:
        """Draw again if that makes a difference."""
        if not self._content().is_same(self._drawn):
            self.refresh(layout=self.grows)

    def render(self) -> Content:
        """Draw."""
        self._drawn = self._content()
        return self._drawn

    def _content(self) -> Content:
        raise NotImplementedError


class ListPage(Redrawn):
    """A list to scroll through, by keys and by the wheel, between rows that stay."""

    rows_that_stay: ClassVar[int] = 1

    @property
    def _room(self) -> int:
        return max(1, self.content_size.height - self.rows_that_stay)

    def move(self, rows: int) -> None:
        """Go down by so many rows, up where negative."""
        raise NotImplementedError

    def page(self, pages: int) -> None:
        """Go down by so many screens, up where negative."""
        self.move(pages * max(1, self._room - 1))

    def turn_filter(self) -> None:
        """Go on to the next filter, where the list has any."""

    def on_mouse_scroll_up(self, event: MouseScrollUp) -> None:
        """Scroll back."""
        event.stop()
        self.move(-WHEEL_ROWS)

    def on_mouse_scroll_down(self, event: MouseScrollDown) -> None:
        """Scroll on."""
        event.stop()
        self.move(WHEEL_ROWS)


class ScenePanel(Redrawn, Generic[SceneT]):
    """Draws one aspect of a scene: in several rows where it has room for them, else in few."""

    small: ClassVar[int] = 2
    """The most rows in which it is drawn compactly."""

    def __init__(self, id: str | None = None) -> None:  # noqa: A002 - Textual's own name
        super().__init__(id)
        self._scene: SceneT | None = None

    def show(self, scene: SceneT) -> None:
        """Take a new scene; nothing is redrawn where nothing has changed."""
        self._scene = scene
        self.renew()

    def _content(self) -> Content:
        if self._scene is None:
            return Content("")
        roomy = self.content_size.height > self.small
        return rows_content(self.full(self._scene) if roomy else self.compact(self._scene))

    def full(self, scene: SceneT) -> list[Row]:
        """Return the rows for a panel of its own."""
        raise NotImplementedError

    def compact(self, scene: SceneT) -> list[Row]:
        """Return the one or two rows for a small terminal."""
        return self.full(scene)


class Panel(ScenePanel[Scene]):
    """A panel of a run's screen."""


class HeadlinePanel(ScenePanel[SceneT]):
    """The one thing to read first. A style sheet knows a widget by its first base: this is the second."""

    @staticmethod
    def headline_of(scene: Any) -> Headline:
        """Return what to read first."""
        raise NotImplementedError

    def full(self, scene: SceneT) -> list[Row]:
        """Return the one row."""
        word, rest, tone = self.headline_of(scene)
        return [[(f" {word} ", PLATE[tone]), " ", (rest, SPOKEN[tone])]]


class CautionsPanel(ScenePanel[SceneT]):
    """What wants attention, each with what to do; takes no room where there is nothing."""

    grows = True

    @staticmethod
    def cautions_of(scene: Any) -> Sequence[Caution]:
        """Return what wants attention."""
        raise NotImplementedError

    def _content(self) -> Content:
        return Content("") if self._scene is None else rows_content(self.full(self._scene))

    def full(self, scene: SceneT) -> list[Row]:
        """Return one row for each."""
        found = self.cautions_of(scene)
        return [[(f"! {what}", SPOKEN[tone]), f": {do}" if do else ""] for what, do, tone in found]

    def show(self, scene: SceneT) -> None:
        """Take a new scene, and no room where there is nothing to say."""
        super().show(scene)
        self.display = bool(self.cautions_of(scene))


AnswerT = TypeVar("AnswerT")
STOP_PLATE = " SPACE STOP "
Touch = tuple[str, str, str | None]
"""A text, its style, and the key that it stands for, if any."""


class TouchBar(ScenePanel[SceneT]):
    """One row of keys. A style sheet knows a widget by its first base: this is the second."""

    def touches(self, scene: SceneT | None) -> list[Touch]:
        """Return what stands in the row, from left to right; None: there is no view yet."""
        raise NotImplementedError

    def _content(self) -> Content:
        return rows_content([[(text, style) for text, style, _ in self.touches(self._scene)]])

    def on_click(self, event: Click) -> None:
        """Do what the key does that was touched."""
        key = self.key_at(event.screen_x, event.screen_y)
        if key is not None:
            self.app.simulate_key(key)

    def key_at(self, screen_x: int, screen_y: int) -> str | None:
        """Return the key that stands in a cell of the terminal; None for none."""
        room = self.content_region
        if not room.contains(screen_x, screen_y):
            return None
        cells = screen_x - room.x
        for text, _, key in self.touches(self._scene):
            cells -= cell_len(text)
            if cells < 0:
                return key
        return None


class Dialog(ModalScreen[AnswerT]):
    """What lies over a screen. A touch beside it stops where the stop is, and else closes it, no yes."""

    def on_click(self, event: Click) -> None:
        """Take a touch of a part of it, or beside it."""
        try:
            part, _ = self.get_widget_at(event.screen_x, event.screen_y)
        except NoWidget:
            part = self
        if part is not self:
            self.touched(part.name or "")
            return
        feet = self.app.screen_stack[0].query("*").results(TouchBar)
        if any(foot.key_at(event.screen_x, event.screen_y) == "space" for foot in feet):
            # Said by the application: what a dialog sends does not get beyond it.
            self.app.call_later(self.app.simulate_key, "space")
        else:
            self.dismiss(None)

    def touched(self, name: str) -> None:
        """Take a touch of a part by its name; "" for one without."""


DOTS_ACROSS, DOTS_DOWN = 2, 4
BRAILLE = 0x2800
_BITS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))


class Layer(NamedTuple):
    """How dots of one kind look: their style, and the character of a cell with such a dot without Unicode."""

    style: str
    plain: str


class DotCanvas:
    """Cells of dots and of characters. Of several layers in a cell the later in `layers` gives its look.

    Dots are counted from the upper left, two across and four down a cell, so that they are as wide as high.
    """

    def __init__(self, columns: int, rows: int, layers: Sequence[Layer], plain: bool = False) -> None:
        self.columns, self.rows = columns, rows
        self._layers = layers
        self.plain = plain
        self._dots: dict[tuple[int, int], tuple[int, int]] = {}
        self._characters: dict[tuple[int, int], tuple[str, str]] = {}

    def copy(self) -> DotCanvas:
        """Return another with the same on it."""
        other = DotCanvas(self.columns, self.rows, self._layers, self.plain)
        other._dots = dict(self._dots)
        other._characters = dict(self._characters)
        return other

    def dot(self, x: float, y: float, layer: int) -> None:
        """Set the dot that holds a point; nothing outside."""
        across, down = math.floor(x), math.floor(y)
        cell = across // DOTS_ACROSS, down // DOTS_DOWN
        if not (0 <= cell[0] < self.columns and 0 <= cell[1] < self.rows):
            return
        bits, top = self._dots.get(cell, (0, -1))
        self._dots[cell] = bits | _BITS[across % DOTS_ACROSS][down % DOTS_DOWN], max(top, layer)

    def line(self, points: Iterable[tuple[float, float] | None], layer: int) -> None:
        """Join points by lines; None parts them."""
        before: tuple[float, float] | None = None
        for point in points:
            if point is not None and before is not None:
                steps = max(1, math.ceil(max(abs(point[0] - before[0]), abs(point[1] - before[1]))))
                for step in range(steps + 1):
                    share = step / steps
                    self.dot(
                        before[0] + share * (point[0] - before[0]),
                        before[1] + share * (point[1] - before[1]),
                        layer,
                    )
            before = point

    def write(self, column: int, row: int, text: str, style: str) -> bool:
        """Put characters over the dots; nothing, and False, where they do not fit or others stand."""
        if not self.room(column, row, len(text)):
            return False
        for at, character in enumerate(text):
            self._characters[column + at, row] = character, style
        return True

    def room(self, column: int, row: int, length: int) -> bool:
        """Tell whether so many characters fit there and none stand there."""
        inside = 0 <= row < self.rows and column >= 0 and column + length <= self.columns
        return inside and not any((column + i, row) in self._characters for i in range(length))

    def covers(self, column: int, row: int, length: int, *, layer: int) -> int:
        """Return how many cells from there on have dots of a layer or of one after it."""
        cells = ((column + i, row) for i in range(length))
        return sum(self._dots.get(cell, (0, -1))[1] >= layer for cell in cells)

    def drawn(self) -> list[Row]:
        """Return the rows of the picture, neighbours of one style together."""
        return [self._row(row) for row in range(self.rows)]

    def _row(self, row: int) -> Row:
        parts: list[tuple[str, str]] = []
        for column in range(self.columns):
            text, style = self._cell((column, row))
            if parts and parts[-1][1] == style:
                parts[-1] = parts[-1][0] + text, style
            else:
                parts.append((text, style))
        return list(parts)

    def _cell(self, cell: tuple[int, int]) -> tuple[str, str]:
        if cell in self._characters:
            return self._characters[cell]
        bits, top = self._dots.get(cell, (0, -1))
        if not bits:
            return " ", ""
        layer = self._layers[top]
        return layer.plain if self.plain else chr(BRAILLE + bits), layer.style


def fitted(text: str, cells: int) -> str:
    """Return a text that takes just so many cells: filled up with spaces, or cut, which is shown."""
    return set_cell_size(text, cells) if cell_len(text) <= cells else set_cell_size(text, cells - 1) + "…"


ENOUGH = "80 × 24"
STOP_ROW = 2


class TooSmall(Widget):
    """Lies over everything where the terminal is too small for it; the stop key works all the same."""

    def render(self) -> Content:
        """Draw."""
        columns, rows = self.app.size
        lines: list[Row] = [[f"too small: {columns} × {rows}"], [(f"{ENOUGH} is enough", DIM)]]
        return rows_content([*lines, [(STOP_PLATE, PLATE[Tone.BAD]), " q leave"]])

    def on_click(self, event: Click) -> None:
        """Do what the key does that was touched."""
        if event.y == STOP_ROW:
            self.app.simulate_key("space" if event.x < len(STOP_PLATE) else "q")


UNCALIBRATED = "uncalibrated"


class TitleBar(Panel):
    """What is followed, with what, and what time it is."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        view = scene.view
        # What is over has a clock that stands.
        over = "as of " if scene.ended and scene.tape is None else ""
        time = f"{over}{formatting.date(view.utc_s)} {formatting.clock(view.utc_s)} {zone_name(view.utc_s)}"
        replay: Row = [] if scene.tape is None else [(" REPLAY ", PLATE[Tone.NOTICE]), " "]
        number = "" if view.catalog_number is None else f"  {view.catalog_number}"
        room = self.content_size.width - cell_len(f"{view.name}{number}   mount  {time}")
        room -= len(" REPLAY  ") if replay else 0
        # Addresses can be long; nothing else in this row may give way.
        mount = fitted(view.mount, max(1, room))
        return [
            [
                *replay,
                (view.name, "bold"),
                (number, DIM),
                ("   mount ", DIM),
                f"{mount} ",
                (time, "bold"),
            ]
        ]


class HeadlineBar(Panel, HeadlinePanel[Scene]):
    """The phase, or what matters more."""

    headline_of = staticmethod(headline)

    def _content(self) -> Content:
        if self._scene is None:
            return rows_content(
                [
                    [
                        (" STARTING ", PLATE[Tone.CALM]),
                        " ",
                        ("no news from the run yet", SPOKEN[Tone.CALM]),
                    ]
                ]
            )
        return super()._content()

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row; that the mount is not calibrated stands at its end, where there is room."""
        rows = super().full(scene)
        view = scene.view
        if view.calibrated is not False or view.mount == "sim":
            return rows
        used = cells_of(rows[0])
        gap = self.content_size.width - used - len(UNCALIBRATED)
        if gap > 1:
            rows[0] += [" " * gap, (UNCALIBRATED, SPOKEN[Tone.NOTICE])]
        return rows


class Cautions(Panel, CautionsPanel[Scene]):
    """What wants attention in a run."""

    cautions_of = staticmethod(cautions)


class TapeBar(Panel):
    """Where a recording stands, and at what speed it runs; takes no room where there is none."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        tape = scene.tape
        if tape is None:
            return []
        state = "AT THE END" if tape.ended else "PLAYING" if tape.playing else "PAUSED"
        tone = Tone.CALM if tape.playing or tape.ended else Tone.NOTICE
        row: Row = [
            (f" {state} ", PLATE[tone]),
            (f" ×{tape.speed:g}".ljust(6), "bold"),
            (formatting.span(tape.at_s), "bold"),
            (" of ", DIM),
            formatting.span(tape.length_s),
            ("" if tape.whole else ", reading on", DIM),
            "  ",
        ]
        room = self.content_size.width - cells_of(row)
        name = tape.name[-(room // 2) :] if room > 1 else ""
        cells = max(0, room - cell_len(name) - 2)
        done = min(cells, round(cells * tape.at_s / tape.length_s)) if tape.length_s > 0.0 else cells
        return [[*row, ("█" * done, "$primary"), ("·" * (cells - done), DIM), "  ", (name, DIM)]]

    def show(self, scene: Scene) -> None:
        """Take a new scene."""
        self.display = scene.tape is not None
        super().show(scene)


class SessionBar(Panel):
    """Who has control and how many look on; takes no room for one who started a run and is
    alone with it."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        session = scene.session
        if session is None:
            return []
        row: Row = [(" IN CONTROL ", PLATE[Tone.CALM])]
        if not scene.in_control:
            who = session.name_of(session.controller)
            row = [(" LOOKING ON ", PLATE[Tone.NOTICE]), (" control: ", DIM), (who, "bold")]
            row += ["  ", ("c", "bold"), (" takes it", DIM)]
        others = session.watching - scene.attached
        if others > 0:
            row.append(f"  {others} others look on" if others > 1 else "  1 other looks on")
        if session.said:
            row.append((f"  {session.said}", DIM))
        return [row]

    def show(self, scene: Scene) -> None:
        """Take a new scene, and no room where there is nothing to say."""
        session = scene.session
        alone = session is None or (scene.in_control and session.watching == 0)
        self.display = not alone and scene.tape is None
        super().show(scene)


ROOM_FOR_ALL_KEYS = 114


class Key(NamedTuple):
    """One or two keys with what they do: texts with the keys' names, and a word."""

    touches: tuple[tuple[str, str], ...]
    what: str


def _key(text: str, key: str, what: str) -> Key:
    return Key(((text, key),), what)


ALONG = Key((("←", "left"), ("→", "right")), "along")
ACROSS = Key((("↑", "up"), ("↓", "down")), "across")
STEP = Key((("[ ", "left_square_bracket"), ("]", "right_square_bracket")), "step")
PAUSE, GO, PARK = _key("p", "p", "pause"), _key("p", "p", "go on"), _key("P", "P", "park")
MORE, MORE_WITH_CAMERA = _key("1-6", "2", "more"), _key("1-6", "6", "more")
TAKE_CONTROL = _key("c", "c", "take control")


LIVE_KEYS = (ALONG, ACROSS, STEP)
WIDE_LIVE_KEYS = (
    *(ALONG, ACROSS, STEP, _key("f", "f", "frame"), _key("s", "s", "spiral")),
    *(_key("w", "w", "sweep"), _key("0", "0", "clear")),
)
JOG = Key((("↑", "up"), ("↓", "down"), ("←", "left"), ("→", "right")), "jog")
UP_AND_DOWN = Key((("↑", "up"), ("↓", "down")), "")
FILTER = _key("f", "f", "filter")
LOOK_AGAIN = _key("g", "g", "again")
LOOKING_ON_KEYS = (TAKE_CONTROL, _key("v", "v", "sky"), _key("t", "t", "theme"))
"""Of the live screen, for somebody whose keys do not move the target."""
HARMLESS_KEYS = (UP_AND_DOWN, FILTER, LOOK_AGAIN)
"""Of the lists, those that need no control."""
LIST_KEYS = {
    TONIGHT: (
        *(UP_AND_DOWN, _key("Enter", "enter", "arm"), _key("a", "a", "now")),
        *(FILTER, LOOK_AGAIN),
    ),
    SCHEDULE: (UP_AND_DOWN,),
    LOG: (UP_AND_DOWN, FILTER),
    MOUNT: (PAUSE, _key("j", "j", "by hand"), PARK),
}
ENDS = (_key("q", "q", "leave"), _key("?", "question_mark", "help"))
TAPE_KEYS = (
    Key((("←", "left"), ("→", "right")), "10 s"),
    Key(((", ", "comma"), (".", "full_stop")), "step"),
    Key((("[ ", "left_square_bracket"), ("]", "right_square_bracket")), "speed"),
    Key((("Home ", "home"), ("End", "end")), ""),
)
WIDE_TAPE_KEYS = (
    TAPE_KEYS[0],
    Key((("PgUp ", "pageup"), ("PgDn", "pagedown")), "60 s"),
    *TAPE_KEYS[1:],
    _key("v", "v", "sky"),
)


class KeyBar(Panel, TouchBar[Scene]):
    """The keys."""

    def touches(self, scene: Scene | None) -> list[Touch]:
        """Return what stands in the row, from left to right."""
        if scene is None:
            return [STOP, *_spread(ENDS, "   ", first=True)]
        wide = self.content_size.width >= ROOM_FOR_ALL_KEYS
        if scene.tape is not None:
            does = "again" if scene.tape.ended else "pause" if scene.tape.playing else "go on"
            tape = (_key("p", "p", does), *(WIDE_TAPE_KEYS if wide else TAPE_KEYS))
            return _spread((*tape, *ENDS), "   ")
        if scene.page == LIVE and not scene.ended:
            own = (*(WIDE_LIVE_KEYS if wide else LIVE_KEYS), PAUSE if scene.jog_rate is None else GO)
            more = MORE if scene.view.loop is None else MORE_WITH_CAMERA
            keys = (*(own if scene.in_control else LOOKING_ON_KEYS), more)
            return self._with_stop(_spread(keys, "  "), " ")
        listed: tuple[Key, ...] = LIST_KEYS.get(scene.page, ()) if wide else ()
        if wide and scene.page == MOUNT and scene.jog_rate is not None:
            listed = (JOG, STEP, GO, PARK)
        if listed and not scene.in_control:
            listed = (*(key for key in listed if key in HARMLESS_KEYS), TAKE_CONTROL)
        with_camera = scene.view.loop is not None or scene.page == CAMERA
        gap = " " if with_camera and not wide else "  "
        pages = [*_pages(scene.page, with_camera, gap), *_spread(listed, "  ", first=True)]
        return self._with_stop(pages, gap if with_camera else "   ")

    def _with_stop(self, keys: list[Touch], gap: str) -> list[Touch]:
        """Return the keys and the stop behind them; the stop comes first where it would be cut off."""
        ends = _spread(ENDS, "  ", first=True)
        row = [*keys, _gap(gap), STOP, *ends]
        room = self.content_size.width
        if room and sum(cell_len(text) for text, _, _ in row) > room:
            return [STOP, *ends, _gap("  "), *keys]
        return row


SHORT_NAMES = {SCHEDULE: "sched"}
"""Of screens, where there is no room for the whole ones."""
STOP: Touch = (STOP_PLATE, PLATE[Tone.BAD], "space")


def _gap(text: str) -> Touch:
    return text, "", None


def _pages(page: str, with_camera: bool, gap: str) -> list[Touch]:
    found: list[Touch] = []
    for key, name in PAGES.items():
        if name == CAMERA and not with_camera:
            continue
        style = PLATE[Tone.CALM] if name == page else DIM
        text = SHORT_NAMES.get(name, name) if len(gap) == 1 else name
        found += [(f"{key} ", "bold", key), (text, style, key), _gap(gap)]
    return found[:-1]


def _spread(keys: Sequence[Key], gap: str, first: bool = False) -> list[Touch]:
    """Return the keys with their words, `gap` between them, and with `first` before them too."""
    found: list[Touch] = []
    for key in keys:
        if found or first:
            found.append(_gap(gap))
        found += [(text, "bold", name) for text, name in key.touches]
        if key.what:
            # A word is of all its keys, and touched for none of two.
            found.append((f" {key.what}", DIM, key.touches[0][1] if len(key.touches) == 1 else None))
    return found
