"""The mount's status as a screen, field by field: the panels of the console, beside a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.containers import Container, Vertical
from textual.widgets import Static

from sattrack.tui import console_panels as panels
from sattrack.tui.console_scene import FIRST_RATE, ConsoleScene
from sattrack.views import console_words

if TYPE_CHECKING:
    from textual.app import ComposeResult

    from sattrack.views.run import ConsoleView

TITLES = {
    "#m-pointing": "pointing",
    "#m-drives": "drives (tics/10 s)",
    "#m-state": "state",
    "#m-acks": "acknowledged",
    "#m-readings": "read as",
    "#m-place": "site and datagram",
    "#m-link": "link",
}


class MountPage(Vertical):
    """Every field of the mount's last status, as the run hears it."""

    def __init__(self) -> None:
        super().__init__(id="mount-page")

    def compose(self) -> ComposeResult:
        """Make the parts."""
        yield Static("", id="m-note", markup=False)
        with Container(id="m-fields"):
            yield panels.GroupPanel(console_words.pointing, "m-pointing")
            yield panels.GroupPanel(console_words.drives, "m-drives")
            yield panels.GroupPanel(console_words.state, "m-state")
        yield panels.JogPanel("m-jog")
        yield panels.AcksPanel("m-acks")
        with Container(id="m-below"):
            yield panels.GroupPanel(console_words.place, "m-place")
            yield panels.ReadingsPanel("m-readings")
            yield panels.LinkPanel("m-link")

    def on_mount(self) -> None:
        """Name the parts."""
        for name, title in TITLES.items():
            self.query_one(name).border_title = title

    def draw(self, view: ConsoleView | None, news_age_s: float, note: str, jog_rate: int | None) -> None:
        """Take the newest look at the mount, and what is to be said of it.

        `jog_rate` is which rate is chosen, where the arrows jog; None where they do not.
        """
        self.query_one("#m-note", Static).update(note)
        self.query_one("#m-jog").display = jog_rate is not None
        if view is None:
            return
        rate = FIRST_RATE if jog_rate is None else jog_rate
        scene = ConsoleScene(view=view, rate=rate, news_age_s=news_age_s, by_brackets=True)
        for panel in self.query(panels.ConsolePanel):
            panel.show(scene)
