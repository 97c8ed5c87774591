"""What a run's screen does by the keys that pause a pass, jog the mount meanwhile, and park it at the end."""

from __future__ import annotations

import subprocess
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from textual.app import App, SuspendNotSupported

from sattrack.tui.console_app import LAGGING_S
from sattrack.tui.console_dialogs import Question
from sattrack.tui.console_scene import FIRST_RATE, RATES, jog_rates_deg_s
from sattrack.tui.pages import MOUNT
from sattrack.tui.scene import PAUSED
from sattrack.views.messages import Go, Jog, Pause, StopNow

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.tui.appearance import Appearance
    from sattrack.tui.scene import Scene
    from sattrack.tui.screens import Screens
    from sattrack.views.messages import Message, SessionMessage
    from sattrack.views.run import Summary, TrackView

PAUSE_FIRST = "by hand only while the pass is paused: p pauses it"
PARK = (
    "the mount slews to its profile's park position and stops; then the drives' power is cut. There is no "
    "unpark: the mount's own window gives the power back. SPACE stops it on its way."
)


@dataclass(slots=True)
class RestHand:
    """What the operator has chosen and been told about a mount at rest."""

    jog_rate: int = FIRST_RATE
    """Which of the six jog rates is chosen, 1 to 6."""
    park_due: bool = False
    """Whether the mount is to be parked as soon as the run is over."""
    hint: str = ""
    hinted_s: float = 0.0
    looked_s: float = 0.0
    """When this process last came to look, by its own clock."""


class RestKeys(App[None]):
    """The actions about a mount at rest."""

    _screens: Screens
    _view: TrackView | None
    _summary: Summary | None
    _ended: bool
    _stop_sent_s: float | None
    _monotonic: Callable[[], float]
    _rest: RestHand
    _appearance: Appearance

    @property
    def scene(self) -> Scene | None:
        """What is to be drawn; None before the first view."""
        raise NotImplementedError

    def _may_say(self) -> bool:
        raise NotImplementedError

    def _tell(self, message: Message | SessionMessage) -> None:
        raise NotImplementedError

    def _draw(self) -> None:
        raise NotImplementedError

    @property
    def _paused(self) -> bool:
        return self._view is not None and self._view.phase == PAUSED and not self._ended

    def action_pause_or_go(self) -> None:
        """Pause the pass, or go on with it."""
        if self._paused:
            self._go_on()
        elif self._view is not None and self._view.ended_by is None and self._may_say():
            self._tell(Pause())

    def _go_on(self) -> None:
        """Go on with a pass that is paused."""
        if self._paused and self._may_say():
            self._tell(Go())

    def _jog(self, east: int, north: int) -> None:
        """Move the mount by one touch, unless the key is an old one."""
        if self._ended or not self._may_say():
            return
        seen = self._screens.mount
        if not self._paused or seen is None:
            self._hint("the mount is not seen yet" if self._paused else PAUSE_FIRST)
            return
        if self._monotonic() - self._rest.looked_s > LAGGING_S:
            return
        rate = jog_rates_deg_s(seen)[self._rest.jog_rate - 1]
        self._tell(Jog(ra_rate_deg_s=east * rate) if east else Jog(dec_rate_deg_s=north * rate))

    def _resize_jog(self, by: int) -> None:
        self._rest.jog_rate = min(RATES, max(1, self._rest.jog_rate + by))
        self._draw()

    def action_by_hand(self) -> None:
        """Operate the mount by hand, by the console's own screen, once no run has it."""
        command = self._screens.console_command()
        if self._screens.page != MOUNT:
            return
        if not self._ended:
            self._hint("the arrows jog, [ ] choose how fast" if self._paused else PAUSE_FIRST)
        elif command is not None:
            self._hand_over(command)

    def action_park(self) -> None:
        """Ask, end the run, and have the mount parked by the console."""
        scene = self.scene
        if scene is None or not self._may_say():
            return
        why_not = self._no_parking(scene)
        if why_not is not None:
            self._hint(why_not)
            return
        text = PARK[0].upper() + PARK[1:] if scene.ended else f"The run ends, and {PARK}"
        self.push_screen(Question("park?", text), lambda sure: self._begin_parking() if sure else None)

    def _no_parking(self, scene: Scene) -> str | None:
        """Return why the mount cannot be parked from here, or None where it can."""
        if self._screens.console_command() is None:
            if scene.view.mount == "sim":
                return "the simulated mount ends with its run: there is nothing to park"
            return "not parked from here: press P where the run was started, or `sattrack mount park`"
        if scene.sky is None or not scene.sky.can_park:
            return "not parked: the mount's profile has no park position"
        if scene.beginning or scene.between is not None:
            return "not parked: another run is about to begin"
        if self._driver is None or not self._driver.can_suspend:
            return "parking needs a terminal to be shown on: `sattrack mount park` parks it"
        return None

    def _begin_parking(self) -> None:
        if self._ended:
            # Whatever ended the run, whoever asks now has read it.
            self._park(self._summary is None or self._summary.mount_stopped is not False)
            return
        self._rest.park_due = True
        if self._stop_sent_s is None:
            self._stop_sent_s = self._monotonic()
        self._tell(StopNow())

    def _park_when_due(self) -> None:
        """Hand a mount that is to be parked over to the console, once its run is over and it stands."""
        if not (self._rest.park_due and self._ended):
            return
        self._rest.park_due = False
        summary = self._summary
        planned = summary is not None and summary.ended_by in {"operator", "set"}
        self._park(planned and summary is not None and summary.mount_stopped is True)

    def _park(self, well: bool) -> None:
        command = self._screens.console_command()
        if well and command is not None:
            self._hand_over([*command, "--park"])
        else:
            self._hint("not parked: the run did not end as asked, with the mount seen at rest")

    def _hand_over(self, command: list[str]) -> None:
        """Give the terminal to the console until that ends; it looks as this screen does."""
        plain = ("--ascii",) if self._appearance.plain else ()
        with suppress(SuspendNotSupported), self.suspend():
            subprocess.run([*command, "--theme", self.theme, *plain], check=False)
        self.refresh()

    def _hint(self, words: str) -> None:
        self._rest.hint, self._rest.hinted_s = words, self._monotonic()
        self._draw()
