"""The polar chart on the screen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.content import Content
from textual.widget import Widget

from sattrack.tui import words
from sattrack.tui.dome import Spot, over_site
from sattrack.tui.look import DIM
from sattrack.tui.panels import Panel, Row, rows_content
from sattrack.tui.sky_chart import BODY_BLOCK_S, NARROW_ROWS, Sky, chart, ground, legend, notes

if TYPE_CHECKING:
    from textual.events import Resize

    from sattrack.tui.dots import DotCanvas
    from sattrack.tui.scene import Scene
    from sattrack.views.run import PassView

NOTES_CELLS = 40
"""What stands beside the chart where there is so much room."""
WIDEST_SHARE = 0.45


class SkyPanel(Widget):
    """Draws the chart, with a legend or notes where there is room for them; what lies behind is kept."""

    def __init__(self) -> None:
        super().__init__(id="sky")
        self._scene: Scene | None = None
        self._drawn = Content("")
        self._ground: tuple[tuple[object, ...], DotCanvas] | None = None

    def draw(self, scene: Scene) -> None:
        """Take a new scene; nothing is redrawn where nothing has changed."""
        self._scene = scene
        self.display = scene.sky is not None
        content = rows_content(self._rows(scene))
        if not content.is_same(self._drawn):
            self._drawn = content
            self.refresh()

    def render(self) -> Content:
        """Draw."""
        return self._drawn

    def on_resize(self, event: Resize) -> None:
        """Draw anew, as large as it has become."""
        del event
        if self._scene is not None:
            self.draw(self._scene)

    def _rows(self, scene: Scene) -> list[Row]:
        columns, rows = self.content_size
        told = scene.sky
        if told is None or columns < 4 or rows < 2:
            return []
        sky = sky_of(told, scene)
        if columns >= 2 * rows + NOTES_CELLS:
            beside = [*notes(sky, scene.plain), [], *_error(scene)]
            drawn = self._chart(sky, 2 * rows, rows, scene.plain)
            return [
                [*row, "  ", *(beside[number - 1] if 0 < number <= len(beside) else [])]
                for number, row in enumerate(drawn)
            ]
        if rows > NARROW_ROWS:
            return [*self._chart(sky, columns, rows - 1, scene.plain), legend(columns, scene.plain)]
        return self._chart(sky, columns, rows, scene.plain)

    def _chart(self, sky: Sky, columns: int, rows: int, plain: bool) -> list[Row]:
        key = (id(sky.told), columns, rows, plain, sky.utc_s // BODY_BLOCK_S)
        if self._ground is None or self._ground[0] != key:
            self._ground = key, ground(sky, columns, rows, plain)
        return chart(sky, self._ground[1]).drawn()


class NotesPanel(Panel):
    """What the chart shows, in words."""

    def full(self, scene: Scene) -> list[Row]:
        """Return a row for each."""
        return [] if scene.sky is None else notes(sky_of(scene.sky, scene), scene.plain)


def _error(scene: Scene) -> list[Row]:
    """Return the error in two rows: where the sky is alone, its panels are not there."""
    error, view = scene.view.error, scene.view
    if error is None:
        return []
    name = "error" if scene.following else "way to go"
    size, along, across = (
        (words.arcsec(value, sign), "bold")
        for value, sign in (
            (error.total_arcsec, False),
            (error.along_arcsec, True),
            (error.across_arcsec, True),
        )
    )
    recent = words.arcsec(view.rms_10s_arcsec)
    return [
        [(f"  {name:<10}", DIM), size, ("  RMS 10 s ", DIM), (recent, "bold")],
        [("  along     ", DIM), along, ("  across ", DIM), across],
    ]


def sky_of(told: PassView, scene: Scene) -> Sky:
    """Return the sky of a scene: satellite and mount by what its view says."""
    view = scene.view
    mount = None
    if view.mount_ra_deg is not None and view.mount_dec_deg is not None:
        mount = over_site(
            view.mount_ra_deg, view.mount_dec_deg, view.utc_s, told.latitude_deg, told.longitude_deg
        )
    return Sky(told, view.utc_s, Spot(view.target_alt_deg, view.target_az_deg), mount)


def chart_columns(width: int, height: int, frame: int) -> int:
    """Return how wide the chart is to be beside a plot, in an area of so many cells, `frame` its border."""
    return min(2 * (height - frame) + frame, int(WIDEST_SHARE * width))
