"""The moving picture shows each screen in its turn, and has what they share once."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

from tools.moving_picture import FRAMES, animated


def screen(number: int) -> str:
    """A screen as rich writes it, of two texts; identifiers differ from screen to screen."""
    name = f"terminal-{1000 + number}"
    return (
        '<svg viewBox="0 0 9 9" xmlns="http://www.w3.org/2000/svg"><style>'
        f".{name}-r1 {{ fill: #c5c8c6 }}</style>"
        f'<defs></defs><rect fill="#292929"/><g transform="translate(9, 41)" clip-path="url(#{name})">'
        f'<rect fill="#{number:06d}" x="0"/>'
        f'<text class="{name}-r1" clip-path="url(#{name}-0)">the same</text>'
        f'<text class="{name}-r1" x="1">screen {number}.</text></g></svg>'
    )


def test_each_screen_is_shown_in_its_turn_and_what_they_share_is_there_once() -> None:
    svg = animated([screen(number) for number in range(FRAMES)])
    ET.fromstring(svg)
    assert svg.count("the same") == 1
    assert "url(" not in svg
    for number in range(FRAMES):
        assert svg.count(f"screen {number}.") == 1
        (steps,) = re.findall(rf"@keyframes f{number}\{{(.*?\}})\}}", svg)
        shown = [float(at) for at, seen in re.findall(r"([\d.]+)%\{opacity:(\d)\}", steps) if seen == "1"]
        assert round(shown[0] * FRAMES / 100.0) == number
    # Backgrounds lie below all text.
    assert svg.rindex("<rect") < svg.index("<text")
