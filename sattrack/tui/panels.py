"""What every panel of figures shares, and the bars across the screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from rich.cells import cell_len
from textual.content import Content
from textual.widget import Widget

from sattrack.tui import words
from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.scene import Scene, Tone, cautions, headline

if TYPE_CHECKING:
    from collections.abc import Iterable

Part = str | tuple[str, str]
"""Text, plain or with its style."""
Row = list[Part]
LABEL_CELLS = 9


def rows_content(rows: Iterable[Row]) -> Content:
    """Return rows of parts as one content; text is text, never markup."""
    return Content("\n").join([Content.assemble(*row) for row in rows])


def labelled(label: str, *parts: Part, cells: int = LABEL_CELLS) -> Row:
    """Return a row that begins with a quiet label in a column of its own."""
    return [(label.ljust(cells), DIM), *parts]


class Panel(Widget):
    """Draws one aspect of a scene: in several rows where it has room for them, else in few."""

    grows: ClassVar[bool] = False
    """Whether its height follows what it says."""

    def __init__(self, id: str | None = None) -> None:  # noqa: A002 - Textual's own name
        super().__init__(id=id)
        self._scene: Scene | None = None
        self._drawn = Content("")

    def show(self, scene: Scene) -> None:
        """Take a new scene; nothing is redrawn where nothing has changed."""
        self._scene = scene
        content = self._content()
        if not content.is_same(self._drawn):
            self.refresh(layout=self.grows)

    def render(self) -> Content:
        """Draw."""
        self._drawn = self._content()
        return self._drawn

    def _content(self) -> Content:
        if self._scene is None:
            return Content("")
        roomy = self.content_size.height > 2
        return rows_content(self.full(self._scene) if roomy else self.compact(self._scene))

    def full(self, scene: Scene) -> list[Row]:
        """Return the rows for a panel of its own."""
        raise NotImplementedError

    def compact(self, scene: Scene) -> list[Row]:
        """Return the one or two rows for a small terminal."""
        return self.full(scene)


class TitleBar(Panel):
    """What is followed, with what, and what time it is."""

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        view = scene.view
        time = f"{words.date(view.utc_s)} {words.clock(view.utc_s)} UTC"
        room = self.content_size.width - cell_len(f"{view.name}  {view.catalog_number}   mount  {time}")
        # Addresses can be long; nothing else in this row may give way.
        mount = view.mount if len(view.mount) <= room else view.mount[: max(0, room - 1)] + "…"
        gap = room - len(mount) + 1
        return [
            [
                (view.name, "bold"),
                (f"  {view.catalog_number}", DIM),
                ("   mount ", DIM),
                mount,
                " " * max(1, gap),
                (time, "bold"),
            ]
        ]


class HeadlineBar(Panel):
    """The phase, or whatever matters more."""

    def _content(self) -> Content:
        if self._scene is None:
            return rows_content(
                [[(" STARTING ", PLATE[Tone.CALM]), " ", ("what feeds the mount", SPOKEN[Tone.CALM])]]
            )
        return super()._content()

    def full(self, scene: Scene) -> list[Row]:
        """Return the one row."""
        word, rest, tone = headline(scene)
        return [[(f" {word} ", PLATE[tone]), " ", (rest, SPOKEN[tone])]]


class Cautions(Panel):
    """What wants attention, each with what to do; takes no room where there is nothing."""

    grows = True

    def _content(self) -> Content:
        return Content("") if self._scene is None else rows_content(self.full(self._scene))

    def full(self, scene: Scene) -> list[Row]:
        """Return one row for each."""
        return [[(f"! {what}", SPOKEN[tone]), f": {do}" if do else ""] for what, do, tone in cautions(scene)]

    def show(self, scene: Scene) -> None:
        """Take a new scene, and no room where there is nothing to say."""
        super().show(scene)
        self.display = bool(cautions(scene))


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
