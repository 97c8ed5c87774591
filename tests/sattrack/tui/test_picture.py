from __future__ import annotations

import asyncio
import re
import xml.etree.ElementTree as ET

from tui_builders import VIEW

from sattrack.tui.picture import draw, practice_views

NAMESPACE = "http://www.w3.org/2000/svg"


def test_the_picture_refers_to_nothing_elsewhere() -> None:
    svg = asyncio.run(draw([VIEW]))

    assert ET.fromstring(svg).tag == f"{{{NAMESPACE}}}svg"
    assert set(re.findall(r"\w+://[^\s\"')<]+", svg)) == {NAMESPACE}
    assert "url(#" in svg
    assert not re.search(r"@font-face|url\([^#]", svg)


def test_the_picture_shows_the_practice_pass_at_culmination() -> None:
    views = practice_views()
    text = " ".join(asyncio.run(draw(views)).replace("&#160;", " ").split())

    assert views[-1].phase == "tracking"
    assert 0.0 <= views[-1].culminate_utc_s - views[-1].utc_s < 1.0
    for figure in ("ISS (ZARYA)", "81.3°", "TRACKING", "all is well"):
        assert figure in text
