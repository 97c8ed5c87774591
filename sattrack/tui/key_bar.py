"""The keys at the foot of a run's screens; each can be touched as well."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from sattrack.tui.look import DIM, PLATE
from sattrack.tui.pages import LIVE, LOG, PAGES, SCHEDULE, TONIGHT
from sattrack.tui.panels import Panel, Row
from sattrack.tui.scene import Tone

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.tui.scene import Scene

ROOM_FOR_ALL_KEYS = 108


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
LIVE_KEYS = (ALONG, ACROSS, STEP, MORE)
WIDE_LIVE_KEYS = (
    *(ALONG, ACROSS, STEP, _key("f", "f", "frame"), _key("s", "s", "spiral")),
    *(_key("w", "w", "sweep"), _key("0", "0", "clear"), MORE),
)
UP_AND_DOWN = Key((("↑", "up"), ("↓", "down")), "")
FILTER = _key("f", "f", "filter")
LIST_KEYS = {
    TONIGHT: (
        *(UP_AND_DOWN, _key("Enter", "enter", "arm"), _key("a", "a", "now")),
        *(FILTER, _key("g", "g", "again")),
    ),
    SCHEDULE: (UP_AND_DOWN,),
    LOG: (UP_AND_DOWN, FILTER),
}
ENDS = (_key("q", "q", "quit"), _key("?", "question_mark", "help"))
TAPE_KEYS = (
    _key("SPACE", "space", "pause"),
    Key((("←", "left"), ("→", "right")), "10 s"),
    Key(((", ", "comma"), (".", "full_stop")), "step"),
    Key((("[ ", "left_square_bracket"), ("]", "right_square_bracket")), "speed"),
    Key((("Home ", "home"), ("End", "end")), ""),
)
WIDE_TAPE_KEYS = (
    *TAPE_KEYS[:2],
    Key((("PgUp ", "pageup"), ("PgDn", "pagedown")), "60 s"),
    *TAPE_KEYS[2:],
    _key("v", "v", "sky"),
)


class KeyBar(Panel):
    """The keys."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        wide = self.content_size.width >= ROOM_FOR_ALL_KEYS
        if scene.tape is not None:
            return [_row((*(WIDE_TAPE_KEYS if wide else TAPE_KEYS), *ENDS), 3)]
        if scene.page != LIVE:
            keys = LIST_KEYS.get(scene.page, ()) if wide else ()
            return [[*_pages(scene.page), *_row(keys, 2, gap_after=True), _stop(), "  ", *_row(ENDS, 2)]]
        keys = WIDE_LIVE_KEYS if wide else LIVE_KEYS
        return [[*_row(keys, 3, gap_after=True), _stop(), "   ", *_row(ENDS, 3)]]


def _stop() -> tuple[str, str]:
    return " SPACE STOP ", _touch(PLATE[Tone.BAD], "space")


def _pages(page: str) -> Row:
    row: Row = []
    for key, name in PAGES.items():
        style = PLATE[Tone.CALM] if name == page else DIM
        row += [(f"{key} ", _touch("bold", key)), (name, _touch(style, key)), "  "]
    return row


def _row(keys: Sequence[Key], gap: int, gap_after: bool = False) -> Row:
    row: Row = []
    for key in keys:
        row += [(text, _touch("bold", name)) for text, name in key.touches]
        if key.what:
            # A word is of all its keys, and touched for none of two.
            style = _touch(DIM, key.touches[0][1]) if len(key.touches) == 1 else DIM
            row.append((f" {key.what}", style))
        row.append(" " * gap)
    return row if gap_after else row[:-1]


def _touch(style: str, key: str) -> str:
    return f"{style} @click=app.touch('{key}')"
