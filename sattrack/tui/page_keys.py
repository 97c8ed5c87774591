"""What a run's screen does by the keys of the screens beside the live one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.app import App

from sattrack.tui import words
from sattrack.tui.console_dialogs import Question
from sattrack.tui.pages import TONIGHT
from sattrack.views.messages import Arm

if TYPE_CHECKING:
    from collections.abc import Callable

    from textual.dom import DOMNode

    from sattrack.tui.feed import Feed
    from sattrack.tui.scene import Scene
    from sattrack.tui.screens import Screens
    from sattrack.views.messages import SessionMessage


class PageKeys(App[None]):
    """The actions about which screen is shown, and which pass is followed."""

    _feed: Feed
    _screens: Screens
    _ended: bool
    _gone: bool

    @property
    def scene(self) -> Scene | None:
        """What is to be drawn; None before the first view."""
        raise NotImplementedError

    def plot(self) -> None:
        """Draw the error against time."""
        raise NotImplementedError

    def _may_say(self) -> bool:
        """Tell whether what is said about what to follow is obeyed from here; where not, have that shown."""
        raise NotImplementedError

    def _go_on(self) -> None:
        raise NotImplementedError

    def _draw(self) -> None:
        raise NotImplementedError

    def _draw_on_main(self, draw: Callable[[DOMNode], object]) -> None:
        raise NotImplementedError

    def action_page(self, page: str) -> None:
        """Show another screen."""
        self._turn(lambda main: self._screens.turn_to(page, main))
        self.call_after_refresh(self.plot)

    def action_leaf(self, by: int) -> None:
        """Go down a list by screens, or up."""
        self._turn(lambda main: self._screens.turn_leaf(main, by))

    def action_look_again(self) -> None:
        """Search for the passes anew."""
        if self._screens.page == TONIGHT:
            self._screens.look_again()
            self._draw()

    def action_arm(self) -> None:
        """Arm the pass under the cursor, or take it back; once a run is over, follow it.

        Where there is no list of passes: go on with a pass that is paused.
        """
        scene = self.scene
        if self._screens.page != TONIGHT:
            self._go_on()
        if self._screens.page == TONIGHT and scene is not None and self._may_say():
            self._order(self._screens.arm(scene, now=False))

    def action_follow(self, which: str) -> None:
        """Leave this satellite for another: ask first where a pass is being followed."""
        scene = self.scene
        if scene is None or (which == "pointed" and self._screens.page != TONIGHT) or not self._may_say():
            return
        by = {"next": 1, "before": -1}.get(which, 0)
        row = self._screens.beside(by, scene) if by else self._screens.night.pointed
        if row is None:
            self.action_page(TONIGHT)
            return
        order = Arm(row.catalog_number, row.culminate_utc_s, row.name, now=True)
        if scene.ended or scene.view.phase == "waiting":
            self._order(order)
            return
        when = f"highest at {words.iso_clock(row.culminate_utc)} with {row.max_alt_deg:.0f}°"
        text = f"{scene.view.name} is left, and the mount goes on to {row.name}, {when}."
        if row.feasible is False:
            text += f" That pass is no-go: {row.why_not or 'the mount cannot follow it'}."
        question = Question(f"leave {scene.view.name} for {row.name}?", text)
        self.push_screen(question, lambda sure: self._order(order) if sure else None)

    def _order(self, order: SessionMessage | None) -> None:
        """Say something about what is to be followed: it is heard also after the end of a run."""
        if order is not None and not self._gone:
            self._feed.send(order)
        self._draw()

    def _turn(self, turn: Callable[[DOMNode], object]) -> None:
        self._draw_on_main(turn)
        self._draw()
