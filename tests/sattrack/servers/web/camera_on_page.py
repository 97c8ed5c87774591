"""A run's screen with a made-up camera's picture, as a visitor's process: `python camera_on_page.py FOLDER`.

FOLDER has the builders of screens.
"""

from __future__ import annotations

import sys

sys.path.insert(0, sys.argv[1])

from test_camera_screen import LOOP, FakePictures
from test_other_screens import HERE, FakeHelpers
from tui_builders import SKY, VIEW, FakeFeed, changed

from sattrack.tui.app import TrackApp
from sattrack.tui.feeds import News
from sattrack.tui.launch import _browser_pixels
from sattrack.tui.scene import Appearance

news = News((changed(VIEW, loop=LOOP),), session=HERE, sky=SKY, you=0)
app = TrackApp(FakeFeed([news]), helpers=FakeHelpers(), pixels=_browser_pixels(Appearance()))  # type: ignore[arg-type]
app._screens.pictures = FakePictures()  # type: ignore[assignment]
app.run()
