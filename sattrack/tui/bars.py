"""The bars across a run's screen: title, headline, who has control, cautions, the tape, the keys."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from rich.cells import cell_len

from sattrack.tui import words
from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.panels import (
    STOP_PLATE,
    CautionsPanel,
    HeadlinePanel,
    Panel,
    Row,
    Touch,
    TouchBar,
    cells_of,
    rows_content,
)
from sattrack.tui.scene import (
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

if TYPE_CHECKING:
    from collections.abc import Sequence

    from textual.content import Content

UNCALIBRATED = "uncalibrated"


class TitleBar(Panel):
    """What is followed, with what, and what time it is."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        view = scene.view
        # What is over has a clock that stands.
        over = "as of " if scene.ended and scene.tape is None else ""
        time = f"{over}{words.date(view.utc_s)} {words.clock(view.utc_s)} UTC"
        replay: Row = [] if scene.tape is None else [(" REPLAY ", PLATE[Tone.NOTICE]), " "]
        number = "" if view.catalog_number is None else f"  {view.catalog_number}"
        room = self.content_size.width - cell_len(f"{view.name}{number}   mount  {time}")
        room -= len(" REPLAY  ") if replay else 0
        # Addresses can be long; nothing else in this row may give way.
        mount = words.fitted(view.mount, max(1, room))
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
                        ("nothing was heard of the run yet", SPOKEN[Tone.CALM]),
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
            (words.span(tape.at_s), "bold"),
            (" of ", DIM),
            words.span(tape.length_s),
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
MORE = _key("1-5", "2", "more")
TAKE_CONTROL = _key("c", "c", "take control")
PAUSE, GO, PARK = _key("p", "p", "pause"), _key("p", "p", "go on"), _key("P", "P", "park")
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
            keys = (*(own if scene.in_control else LOOKING_ON_KEYS), MORE)
            return self._with_stop(_spread(keys, "  "), " ")
        more = LIST_KEYS.get(scene.page, ()) if wide else ()
        if wide and scene.page == MOUNT and scene.jog_rate is not None:
            more = (JOG, STEP, GO, PARK)
        if more and not scene.in_control:
            more = (*(key for key in more if key in HARMLESS_KEYS), TAKE_CONTROL)
        pages = [*_pages(scene.page), *_spread(more, "  ", first=True)]
        return self._with_stop(pages, "   ")

    def _with_stop(self, keys: list[Touch], gap: str) -> list[Touch]:
        """Return the keys and the stop behind them; the stop comes first where it would be cut off."""
        ends = _spread(ENDS, "  ", first=True)
        row = [*keys, _gap(gap), STOP, *ends]
        room = self.content_size.width
        if room and sum(cell_len(text) for text, _, _ in row) > room:
            return [STOP, *ends, _gap("  "), *keys]
        return row


STOP: Touch = (STOP_PLATE, PLATE[Tone.BAD], "space")


def _gap(text: str) -> Touch:
    return text, "", None


def _pages(page: str) -> list[Touch]:
    found: list[Touch] = []
    for key, name in PAGES.items():
        style = PLATE[Tone.CALM] if name == page else DIM
        found += [(f"{key} ", "bold", key), (name, style, key), _gap("  ")]
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
