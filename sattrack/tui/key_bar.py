"""The keys at the foot of a run's screens; each can be touched as well."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from rich.cells import cell_len

from sattrack.tui.look import DIM, PLATE
from sattrack.tui.pages import LIVE, LOG, MOUNT, PAGES, SCHEDULE, TONIGHT
from sattrack.tui.panels import Panel
from sattrack.tui.scene import Scene, Tone
from sattrack.tui.touch import Touch, TouchBar

if TYPE_CHECKING:
    from collections.abc import Sequence


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


STOP: Touch = (" SPACE STOP ", PLATE[Tone.BAD], "space")


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
