"""How a screen is to look; apart from what draws it, which takes a while to load."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Appearance:
    """By which theme a screen is drawn, and whether with the characters of ASCII alone."""

    theme: str = "night"
    plain: bool = False


NIGHT = Appearance()


def can_show(encoding: str | None) -> bool:
    """Tell whether a terminal of an encoding has the characters that the screens are drawn with."""
    try:
        "⣿●━″".encode(encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
