"""The bars across a run's screen: what is followed, what to read first, what wants attention, the tape."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.cells import cell_len

from sattrack.tui import words
from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.panels import CautionsPanel, HeadlinePanel, Panel, Row, rows_content
from sattrack.tui.scene import Caution, Headline, Scene, Tone, cautions, headline

if TYPE_CHECKING:
    from textual.content import Content

UNCALIBRATED = "uncalibrated"


class TitleBar(Panel):
    """What is followed, with what, and what time it is."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        view = scene.view
        # What is over has a clock that stands.
        over = "as of " if scene.ended and scene.tape is None else ""
        time = f"{over}{words.date(view.utc_s)} {words.clock(view.utc_s)} UTC"
        replay: Row = [] if scene.tape is None else [(" REPLAY ", PLATE[Tone.NOTICE]), " "]
        room = self.content_size.width - cell_len(f"{view.name}  {view.catalog_number}   mount  {time}")
        room -= len(" REPLAY  ") if replay else 0
        # Addresses can be long; nothing else in this row may give way.
        mount = view.mount if len(view.mount) <= room else view.mount[: max(0, room - 1)] + "…"
        gap = room - len(mount) + 1
        return [
            [
                *replay,
                (view.name, "bold"),
                (f"  {view.catalog_number}", DIM),
                ("   mount ", DIM),
                mount,
                " " * max(1, gap),
                (time, "bold"),
            ]
        ]


class HeadlineBar(Panel, HeadlinePanel[Scene]):
    """The phase, or whatever matters more."""

    def _content(self) -> Content:
        if self._scene is None:
            return rows_content(
                [
                    [
                        (" STARTING ", PLATE[Tone.CALM]),
                        " ",
                        ("nothing was heard of the run yet", SPOKEN[Tone.CALM]),
                    ]
                ]
            )
        return super()._content()

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row; that the mount is not calibrated stands at its end, where there is room."""
        rows = super().full(scene)
        view = scene.view
        if view.calibrated is not False or view.mount == "sim":
            return rows
        used = sum(cell_len(part if isinstance(part, str) else part[0]) for part in rows[0])
        gap = self.content_size.width - used - len(UNCALIBRATED)
        if gap > 1:
            rows[0] += [" " * gap, (UNCALIBRATED, SPOKEN[Tone.NOTICE])]
        return rows

    def headline_of(self, scene: Scene) -> Headline:
        """Return what is to be read first."""
        return headline(scene)


class Cautions(Panel, CautionsPanel[Scene]):
    """What wants attention in a run."""

    def cautions_of(self, scene: Scene) -> tuple[Caution, ...]:
        """Return what wants attention."""
        return cautions(scene)


class TapeBar(Panel):
    """Where a recording stands, and at what speed it runs; takes no room where there is none."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        tape = scene.tape
        if tape is None:
            return []
        state = "AT THE END" if tape.ended else "PLAYING" if tape.playing else "PAUSED"
        tone = Tone.CALM if tape.playing or tape.ended else Tone.NOTICE
        row: Row = [
            (f" {state} ", PLATE[tone]),
            (f" ×{tape.speed:g}".ljust(6), "bold"),
            (words.span(tape.at_s), "bold"),
            (" of ", DIM),
            words.span(tape.length_s),
            ("" if tape.whole else ", reading on", DIM),
            "  ",
        ]
        room = self.content_size.width - sum(cell_len(p if isinstance(p, str) else p[0]) for p in row)
        name = tape.name[-(room // 2) :] if room > 1 else ""
        cells = max(0, room - cell_len(name) - 2)
        done = min(cells, round(cells * tape.at_s / tape.length_s)) if tape.length_s > 0.0 else cells
        return [[*row, ("█" * done, "$primary"), ("·" * (cells - done), DIM), "  ", (name, DIM)]]

    def show(self, scene: Scene) -> None:
        """Take a new scene."""
        self.display = scene.tape is not None
        super().show(scene)
