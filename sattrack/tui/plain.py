"""Every character of a screen as ASCII, one for one, for terminals that have nothing else."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.segment import Segment
from textual.filter import LineFilter

if TYPE_CHECKING:
    from textual.color import Color

_ALIKE = {
    "°": "d",
    "′": "'",
    "″": '"',
    "−": "-",
    "–": "-",
    "…": "~",
    "·": ".",
    "•": ".",
    "●": "@",
    "○": "o",
    "⊕": "&",
    "×": "x",
    "±": "~",
    "σ": "s",
    "←": "<",
    "→": ">",
    "↑": "^",
    "↓": "v",
    "▶": ">",
    "▏": "|",
    "▎": "|",
    "▍": "|",
    "▌": "|",
    "┃": "|",
    "│": "|",
    "╻": "|",
    "╹": "|",
    "╷": "|",
    "╵": "|",
    "━": "-",
    "─": "-",
    "╺": "-",
    "╸": "-",
    "╴": "-",
    "╶": "-",
}
BOX, BLOCKS, BRAILLE = range(0x2500, 0x2580), range(0x2580, 0x25A0), range(0x2800, 0x2900)


def ascii_of(text: str) -> str:
    """Return a text of as many characters, all of them ASCII: alike where there is something alike."""
    return text if text.isascii() else "".join(_one(character) for character in text)


def _one(character: str) -> str:
    if character.isascii():
        return character
    if character in _ALIKE:
        return _ALIKE[character]
    code = ord(character)
    if code in BOX:
        return "+"
    if code in BLOCKS:
        return "#"
    if code in BRAILLE:
        return " " if code == BRAILLE.start else "."
    return "?"


class PlainFilter(LineFilter):
    """Turns what is drawn into ASCII, last of all."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Return the segments with the same styles."""
        del background
        return [Segment(ascii_of(text), style, control) for text, style, control in segments]
