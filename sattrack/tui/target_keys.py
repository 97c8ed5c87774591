"""What a run's screen does by the keys that move the target."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.app import App

from sattrack.tui.pages import LIVE, MOUNT
from sattrack.views.messages import DropRemembered

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from textual.dom import DOMNode

    from sattrack.tui.hand import Hand
    from sattrack.tui.screens import Screens
    from sattrack.views.messages import Message, SessionMessage
    from sattrack.views.run import TrackView


class TargetKeys(App[None]):
    """The actions about the target; on the other screens, what their keys mean there."""

    _hand: Hand
    _screens: Screens
    _view: TrackView | None

    def _may(self) -> bool:
        """Tell whether keys that move the target are obeyed from here; where not, have that shown."""
        raise NotImplementedError

    def _tell(self, message: Message | SessionMessage) -> None:
        raise NotImplementedError

    def _jog(self, east: int, north: int) -> None:
        raise NotImplementedError

    def _resize_jog(self, by: int) -> None:
        raise NotImplementedError

    def _draw(self) -> None:
        raise NotImplementedError

    def _turn(self, turn: Callable[[DOMNode], object]) -> None:
        raise NotImplementedError

    def action_nudge(self, along: int, across: int) -> None:
        """Move the target by one step, along its track, across it, or as the frame has it.

        On other screens: down a list, or the mount by hand while the pass is paused.
        """
        if self._screens.page == MOUNT:
            self._jog(east=-along, north=across)
        elif self._screens.page != LIVE:
            self._turn(lambda main: self._screens.move(main, -across))
        elif self._may():
            self._send_all(self._hand.nudge(along, across, self._view))

    def action_creep(self, along: int, across: int) -> None:
        """Move the target gently, by several steps."""
        if self._may() and self._view is not None:
            self._send_all(self._hand.creep(along, across, self._view))

    def action_undo(self) -> None:
        """Take back what was last done to the offsets."""
        if self._may():
            self._send_all(self._hand.undo(self._view))

    def action_step(self, by: int) -> None:
        """Choose a smaller or a larger step, of a nudge or of a jog."""
        if self._screens.page == MOUNT:
            self._resize_jog(by)
            return
        self._hand.resize(by)
        self._draw()

    def action_frame(self) -> None:
        """Go on to the next frame in which the arrows move, or to the next filter of a list."""
        if self._screens.page == LIVE:
            self._hand.turn_frame()
        else:
            self._turn(self._screens.turn_filter)
        self._draw()

    def action_search(self, how: str) -> None:
        """Begin a search, its size by the step; or end the one that runs where it is."""
        if self._may():
            self._send_all(self._hand.search(how, self._view))

    def action_cancel_search(self) -> None:
        """End a search that runs, back in its centre."""
        if self._may():
            self._send_all(self._hand.cancel_search(self._view))

    def action_reset(self) -> None:
        """Take the offsets of the frame away."""
        if self._may():
            self._send_all(self._hand.reset(self._view))

    def action_clear_bias(self) -> None:
        """Take everything back: nudges, offsets, search and estimate."""
        if self._may():
            self._send_all(self._hand.clear(self._view))

    def action_drop_remembered(self) -> None:
        """Take back the bias that an earlier pass left, and have it offered no more."""
        if self._may():
            self._tell(DropRemembered())

    def _send_all(self, messages: Sequence[Message]) -> None:
        for message in messages:
            self._tell(message)
