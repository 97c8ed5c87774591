"""Draw a pass on the terminal screen as an animated SVG: `python -m tools.moving_picture FILE`.

The frames are screens of the practice pass in virtual time, with a simulated mount. Text that several frames
share is in the file once.
"""

from __future__ import annotations

import asyncio
import re
import sys
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING

from sattrack.tui.app import TrackApp
from sattrack.tui.scene import Appearance
from tools.screens import RecordedFeed, practice_sky, practice_views, self_contained

if TYPE_CHECKING:
    from sattrack.views.run import PassView, TrackView

COLUMNS, ROWS = 110, 32
FRAMES = 12
FRAME_S = 1.0
_STYLE = re.compile(r"\.(terminal-\d+-r\d+) \{ (.*?) \}")
_INNER = '<g transform="translate(9, 41)"'
_DRAWN = re.compile(r"<(?:rect|text)\b.*?(?:/>|</text>)", re.DOTALL)


async def screens(views: list[TrackView], sky: PassView) -> list[str]:
    """Return screens of the pass as SVG, evenly spaced from the slew to its end."""
    shown = [round((len(views) - 1) * (i + 0.3) / FRAMES) for i in range(FRAMES)]
    pictures = []
    for last in shown:
        feed = RecordedFeed(views[: last + 1], sky)
        app = TrackApp(feed, monotonic=lambda: 0.0, appearance=Appearance("night"))
        async with app.run_test(size=(COLUMNS, ROWS)) as pilot:
            for _ in range(3):
                # The chart's width follows from the layout, and the layout from that.
                await pilot.pause()
                app.plot()
            await pilot.pause()
            pictures.append(self_contained(app.export_screenshot(title=f"sattrack track {views[-1].name}")))
    return pictures


def animated(pictures: list[str]) -> str:
    """Return one SVG that shows screens of the same size in turn.

    Where animation is unwanted or unknown, the screen in the middle of the pass is shown.
    """
    classes: dict[str, str] = {}
    frames = [_normal(picture, classes) for picture in pictures]
    used: defaultdict[str, list[int]] = defaultdict(list)
    for number, drawn in enumerate(frames):
        for element in dict.fromkeys(drawn):
            used[element].append(number)
    # Backgrounds first: one that changes must not lie over text that stays.
    groups: dict[tuple[int, ...], list[str]] = {}
    layers: list[str] = []
    for kind in ("<rect", "<text"):
        groups = {}
        for element, seen in used.items():
            if element.startswith(kind):
                groups.setdefault(tuple(seen), []).append(element)
        layers += [f'<g class="{_name(seen)}">{"".join(group)}</g>' for seen, group in groups.items()]
    return _document(pictures[0], classes, layers, {tuple(seen) for seen in used.values()})


def _normal(picture: str, classes: dict[str, str]) -> list[str]:
    """Return what is drawn in a screen, with classes named by their style and nothing clipped."""
    for name, style in _STYLE.findall(picture):
        short = classes.setdefault(style, f"c{len(classes)}")
        picture = re.sub(rf'class="{name}"', f'class="{short}"', picture)
    drawn = _DRAWN.findall(picture.partition(_INNER)[2])
    plain = (re.sub(r' (?:clip-path|shape-rendering|xml:space)="[^"]*"', "", one) for one in drawn)
    return [re.sub(r'class="terminal-\d+-(\w+)"', r'class="\1"', one) for one in plain]


def _name(seen: tuple[int, ...]) -> str:
    return "f" + "_".join(map(str, seen))


def _document(picture: str, classes: dict[str, str], layers: list[str], sets: set[tuple[int, ...]]) -> str:
    """Return the SVG: the window's frame, and a group for each set of frames that share elements."""
    box = re.search(r'viewBox="([^"]*)"', picture)
    assert box is not None
    window = picture.partition("</defs>")[2].partition(_INNER)[0]
    rules = [f".{name}{{{style}}}" for style, name in classes.items()]
    for seen in sorted(sets):
        if len(seen) < FRAMES:
            name = _name(seen)
            shown = int(FRAMES // 2 in seen)
            rules.append(
                f".{name}{{opacity:{shown};animation:{name} {FRAMES * FRAME_S:g}s step-end infinite}}"
            )
            rules.append(f"@keyframes {name}{{{_steps(seen)}}}")
    style = "\n".join(rules)
    return (
        f'<svg viewBox="{box[1]}" xmlns="http://www.w3.org/2000/svg">\n<style>\n'
        "text{font-family:'DejaVu Sans Mono',Menlo,Consolas,monospace;font-size:20.26px;white-space:pre}\n"
        f"{style}\n@media(prefers-reduced-motion:reduce){{g{{animation:none!important}}}}\n</style>\n"
        f'{window.strip()}\n<g transform="translate(9,41)">\n{chr(10).join(layers)}\n</g>\n</svg>\n'
    )


def _steps(seen: tuple[int, ...]) -> str:
    """Return keyframes in which something is seen in some of the frames only."""
    shown = [int(number in seen) for number in range(FRAMES)]
    changes = [n for n in range(FRAMES) if n == 0 or shown[n] != shown[n - 1]]
    steps = [f"{100.0 * n / FRAMES:.3f}%{{opacity:{shown[n]}}}" for n in changes]
    return "".join([*steps, f"100%{{opacity:{shown[0]}}}"])


def main() -> int:
    """Write the picture into the file named on the command line; return the exit code."""
    if len(sys.argv) != 2:
        sys.stderr.write("usage: python -m tools.moving_picture FILE\n")
        return 2
    pictures = asyncio.run(screens(practice_views(), practice_sky()))
    Path(sys.argv[1]).write_text(animated(pictures), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
