"""Who has control of a run, where that is to be known."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.tui.look import DIM, PLATE
from sattrack.tui.panels import Panel, Row
from sattrack.tui.scene import Tone

if TYPE_CHECKING:
    from sattrack.tui.scene import Scene


class SessionBar(Panel):
    """Who has control and how many look on; takes no room for one who started a run and is
    alone with it."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        session = scene.session
        if session is None:
            return []
        row: Row = [(" IN CONTROL ", PLATE[Tone.CALM])]
        if not scene.in_control:
            who = session.name_of(session.controller)
            row = [(" LOOKING ON ", PLATE[Tone.NOTICE]), (" control: ", DIM), (who, "bold")]
            row += ["  ", ("c", "bold"), (" takes it", DIM)]
        others = session.watching - scene.attached
        if others > 0:
            row.append(f"  {others} others look on" if others > 1 else "  1 other looks on")
        if session.said:
            row.append((f"  {session.said}", DIM))
        return [row]

    def show(self, scene: Scene) -> None:
        """Take a new scene, and no room where there is nothing to say."""
        session = scene.session
        alone = session is None or (scene.in_control and session.watching == 0)
        self.display = not alone and scene.tape is None
        super().show(scene)
