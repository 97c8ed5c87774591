from __future__ import annotations

import asyncio
import re
import xml.etree.ElementTree as ET
from pathlib import Path

from tui_builders import SKY, VIEW

from tools.screens import SHOTS, draw, practice_sky, practice_views

DOCS = Path(__file__).parents[3] / "docs"
NAMESPACE = "http://www.w3.org/2000/svg"


def said(svg: str) -> str:
    return " ".join(svg.replace("&#160;", " ").split())


def test_the_picture_refers_to_nothing_elsewhere() -> None:
    svg = asyncio.run(draw([VIEW], sky=SKY))

    assert ET.fromstring(svg).tag == f"{{{NAMESPACE}}}svg"
    assert set(re.findall(r"\w+://[^\s\"')<]+", svg)) == {NAMESPACE}
    assert "url(#" in svg
    assert not re.search(r"@font-face|url\([^#]", svg)


def test_the_pictures_show_the_practice_pass_at_culmination() -> None:
    # No more of it is flown than stands on a screen at culmination, and what must not stand there.
    views, sky = practice_views("2026-10-02T13:04:20Z", 65.0), practice_sky()
    assert views[0].utc_s < views[-1].culminate_utc_s < views[-1].utc_s - 10.0
    texts = {name: said(asyncio.run(draw(views, shot, sky))) for name, shot in SHOTS.items()}
    for name, text in texts.items():
        tonight = name == "tui-tonight.svg"
        live = ("81.3°", "Sun", "rise")
        for figure in ("ISS (ZARYA)", "TRACKING", "all is well", "13:05:2", *(() if tonight else live)):
            assert figure in text
        if tonight:
            assert "this one" in text
            assert "NO-GO" in text
    assert "PAUSED" in texts["tui-replay.svg"]
    assert "skyline" in texts["tui-sky.svg"]
    assert texts.keys() <= {path.name for path in DOCS.iterdir()}
