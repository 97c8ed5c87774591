"""What every panel of figures shares: rows of text that are drawn anew only where something has changed."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar

from textual.content import Content
from textual.widget import Widget

from sattrack.tui.look import DIM, PLATE, SPOKEN
from sattrack.tui.scene import Scene

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sattrack.tui.scene import Caution, Headline

Part = str | tuple[str, str]
"""Text, plain or with its style."""
Row = list[Part]
LABEL_CELLS = 9
SceneT = TypeVar("SceneT")


def rows_content(rows: Iterable[Row]) -> Content:
    """Return rows of parts as one content; text is text, never markup."""
    return Content("\n").join([Content.assemble(*row) for row in rows])


def labelled(label: str, *parts: Part, cells: int = LABEL_CELLS) -> Row:
    """Return a row that begins with a quiet label in a column of its own."""
    return [(label.ljust(cells), DIM), *parts]


class Redrawn(Widget):
    """Shows what `_content` returns."""

    grows: ClassVar[bool] = False
    """Whether its height follows what it says."""

    def __init__(self, id: str | None = None) -> None:  # noqa: A002 - Textual's own name
        super().__init__(id=id)
        self._drawn = Content("")

    def renew(self) -> None:
        """Draw anew where that makes a difference."""
        if not self._content().is_same(self._drawn):
            self.refresh(layout=self.grows)

    def render(self) -> Content:
        """Draw."""
        self._drawn = self._content()
        return self._drawn

    def _content(self) -> Content:
        raise NotImplementedError


class ScenePanel(Redrawn, Generic[SceneT]):
    """Draws one aspect of a scene: in several rows where it has room for them, else in few."""

    small: ClassVar[int] = 2
    """The most rows in which it is drawn compactly."""

    def __init__(self, id: str | None = None) -> None:  # noqa: A002 - Textual's own name
        super().__init__(id)
        self._scene: SceneT | None = None

    def show(self, scene: SceneT) -> None:
        """Take a new scene; nothing is redrawn where nothing has changed."""
        self._scene = scene
        self.renew()

    def _content(self) -> Content:
        if self._scene is None:
            return Content("")
        roomy = self.content_size.height > self.small
        return rows_content(self.full(self._scene) if roomy else self.compact(self._scene))

    def full(self, scene: SceneT) -> list[Row]:
        """Return the rows for a panel of its own."""
        raise NotImplementedError

    def compact(self, scene: SceneT) -> list[Row]:
        """Return the one or two rows for a small terminal."""
        return self.full(scene)


class Panel(ScenePanel[Scene]):
    """A panel of a run's screen."""


class HeadlinePanel(ScenePanel[SceneT]):
    """The one thing to read first. A style sheet knows a widget by its first base: this is the second."""

    def full(self, scene: SceneT) -> list[Row]:
        """Return the one row."""
        word, rest, tone = self.headline_of(scene)
        return [[(f" {word} ", PLATE[tone]), " ", (rest, SPOKEN[tone])]]

    def headline_of(self, scene: SceneT) -> Headline:
        """Return what is to be read first."""
        raise NotImplementedError


class CautionsPanel(ScenePanel[SceneT]):
    """What wants attention, each with what to do; takes no room where there is nothing."""

    grows = True

    def _content(self) -> Content:
        return Content("") if self._scene is None else rows_content(self.full(self._scene))

    def full(self, scene: SceneT) -> list[Row]:
        """Return one row for each."""
        found = self.cautions_of(scene)
        return [[(f"! {what}", SPOKEN[tone]), f": {do}" if do else ""] for what, do, tone in found]

    def show(self, scene: SceneT) -> None:
        """Take a new scene, and no room where there is nothing to say."""
        super().show(scene)
        self.display = bool(self.cautions_of(scene))

    def cautions_of(self, scene: SceneT) -> Sequence[Caution]:
        """Return what wants attention."""
        raise NotImplementedError
