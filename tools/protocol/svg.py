"""The few shapes that the document's pictures are made of, as SVG text that is the same on every machine."""

from __future__ import annotations

import math
from html import escape

INK = "#1f2933"
FAINT = "#7b8794"
FONT = "font-family=\"'DejaVu Sans', Verdana, Arial, sans-serif\""


def picture(width: float, height: float, title: str, parts: list[str]) -> str:
    """Return a whole SVG on white, so that it also reads on a dark page."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        f'width="{width:g}" height="{height:g}" {FONT}>'
    )
    ground = f'<rect width="{width:g}" height="{height:g}" fill="#ffffff"/>'
    return "\n".join([head, f"<title>{escape(title)}</title>", ground, *parts, "</svg>"]) + "\n"


def text(x: float, y: float, words: str, size: float = 12, anchor: str = "middle", more: str = "") -> str:
    """Return one line of text."""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" text-anchor="{anchor}" fill="{INK}"{more}>'
        f"{escape(words)}</text>"
    )


def label(x: float, y: float, words: str, colour: str = INK) -> str:
    """Return text that stays legible on a line: with a white edge."""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="12" text-anchor="middle" fill="{colour}" stroke="#ffffff" '
        f'stroke-width="5" stroke-linejoin="round" paint-order="stroke">{escape(words)}</text>'
    )


def line(points: list[tuple[float, float]], colour: str = INK, width: float = 1.5, more: str = "") -> str:
    """Return a polyline."""
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="{width:g}"{more}/>'


def arrow(
    start: tuple[float, float], bend: tuple[float, float], end: tuple[float, float], colour: str = INK
) -> str:
    """Return a curve from start to end, pulled towards `bend`, with a head."""
    angle = math.atan2(end[1] - bend[1], end[0] - bend[0])
    wings = [
        (end[0] - 10.0 * math.cos(angle + turn), end[1] - 10.0 * math.sin(angle + turn))
        for turn in (0.4, -0.4)
    ]
    head = " ".join(f"{x:.1f},{y:.1f}" for x, y in (end, *wings))
    return (
        f'<path d="M {start[0]:.1f},{start[1]:.1f} Q {bend[0]:.1f},{bend[1]:.1f} {end[0]:.1f},{end[1]:.1f}" '
        f'fill="none" stroke="{colour}" stroke-width="1.5"/>\n<polygon points="{head}" fill="{colour}"/>'
    )
