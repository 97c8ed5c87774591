"""What `sattrack serve antenna` adds to the loop of a door: antcn, the console's words, what is shown.

A position status is latched when its bytes are read.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any

from sattrack.runtime.loop import StationLoop
from sattrack.servers.antenna.log_lines import refused, spoken, typed
from sattrack.servers.antenna.trajectory import NS, to_ns
from sattrack.servers.antenna.transactions import NAK_MEANINGS
from sattrack.views.run import (
    LONGEST_SHOWN,
    SHOWN_EXCHANGES,
    SHOWN_REFUSALS,
    AntennaView,
    AxesView,
    ExchangeView,
    FocusView,
    RefusalView,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.servers.antenna.antenna_focus import FocusProcesses
    from sattrack.servers.antenna.door import AntennaServer
    from sattrack.servers.antenna.station import Station

SHOW_EVERY_TICKS = 5
MOST_REFUSALS_TOLD = 5
"""A tick's refusals in the log: a flood of them is counted."""
LEAVE = "leave"
WORDS = ("local", "remote", "stop", "reset", "last", LEAVE)


@dataclass(slots=True)
class AntennaLoop(StationLoop):
    """Serves one station at one door until `stop` is asked for and the mount is seen at rest.

    `words` gives what the operator typed since the last call.
    """

    driver: Station
    door: AntennaServer
    words: Callable[[], Sequence[str]]
    where: str = ""
    """The door, in words."""
    show: Callable[[AntennaView], None] | None = None
    """Takes a view a few times a second; must not wait."""
    focus: FocusProcesses | None = None
    """The focuser, where it is not simulated."""
    _told_refusals: int = field(default=0, init=False)
    _told_caller: bool = field(default=False, init=False)
    _told_hung_up_on: int = field(default=0, init=False)
    _told_foreign: int = field(default=0, init=False)

    def tell(self, words: str) -> None:
        """Have the program's own words logged."""
        self.log(spoken(words))

    def serve(self, ready: list[Any]) -> None:
        """Serve antcn."""
        if self.door.serve(ready, self.connection.now_utc_s, self.driver.receive_command):
            self.driver.controller.hang_up()
            self._told_caller = False
            self.tell("antcn is gone; the trajectory in force stays")

    def obey(self, now_utc_s: float) -> None:
        """Heed the serial line, the focuser and the words of the console."""
        del now_utc_s
        if self.door.mend(time.monotonic()):
            self._told_caller = True
            self.tell("the serial line is there again")
        if self.focus is not None:
            for told in self.focus.exchange(self._at_ns):
                self.tell(told)
        for word in self.words():
            self._obey_word(word)

    def _at_ns(self, monotonic_s: float) -> int:
        """Return an instant by the antenna's clock."""
        return to_ns(self.connection.clock.utc_s(monotonic_s) + self.driver.clock_ahead_s)

    def _obey_word(self, word: str) -> None:
        """Obey a word typed at the controller's own console."""
        controller, now_ns = self.driver.controller, self._at_ns(time.monotonic())
        if word:
            self.log(typed(word))
        if word in {"local", "remote"}:
            controller.switch(word == "remote", now_ns)
            self.tell(f"the controller is in {word}")
        elif word == "last":
            for exchange in controller.exchanges:
                self.tell(f"{exchange.received} -> {exchange.answered}")
        elif word == "stop":
            controller.stop(now_ns)
            self.tell("the operator has ended the trajectory")
        elif word == "reset":
            controller.reset()
        elif word == LEAVE:
            self.driver.end(self.connection.now_utc_s())
        elif word:
            self.tell(f"{word!r} is no word of this console: {', '.join(WORDS)}")

    def _show(self) -> None:
        if self.show is not None:
            self.show(self.view())

    def view(self) -> AntennaView:
        """Return what the controller's console shows now."""
        station, controller = self.driver, self.driver.controller
        now_utc_s = self.connection.now_utc_s()
        at_ns = self._at_ns(time.monotonic())
        states = (controller.commanded(at_ns), station.actual(at_ns))
        commanded, actual = (None if s is None else AxesView(s.first_deg, s.second_deg) for s in states)
        return AntennaView(
            utc_s=now_utc_s,
            door=self.where,
            caller=self.door.channel is not None,
            axes=station.antenna.axes,
            mount="sim" if self.connection.simulated is not None else str(self.connection.link.address),
            link_up=station.link_up,
            remote=controller.remote,
            doing=controller.doing.value,
            servo=controller.servo,
            outside_limits=station.outside_limits,
            tripped=station.tripped,
            commanded=commanded,
            actual=actual,
            refused=controller.refused,
            exchanges=tuple(
                ExchangeView(e.utc_ns / NS, e.received[:LONGEST_SHOWN], e.answered[:LONGEST_SHOWN])
                for e in islice(reversed(controller.exchanges), SHOWN_EXCHANGES)
            ),
            refusals=tuple(
                RefusalView(e.utc_ns / NS, e.received[:LONGEST_SHOWN], NAK_MEANINGS[e.refused])
                for e in islice(reversed(controller.refusals), SHOWN_REFUSALS)
                if e.refused is not None
            ),
            focus=self._focus_view(at_ns),
        )

    def _focus_view(self, at_ns: int) -> FocusView | None:
        focuser = self.driver.antenna.focuser
        if focuser is None:
            return None
        report = focuser.report(at_ns)
        return FocusView(tuple(place.actual_mm for place in report.axes), report.moving)

    def report(self) -> None:
        """Say what has changed: refusals, callers, interlocks, the link."""
        self._report_refusals()
        self._report_callers()
        self.report_mount("trajectory", "RESET")
        if self.ticks % SHOW_EVERY_TICKS == 0:
            self._show()

    def _report_refusals(self) -> None:
        controller = self.driver.controller
        count = controller.refused - self._told_refusals
        if count == 0:
            return
        self._told_refusals = controller.refused
        told = [(e, e.refused) for e in controller.refusals if e.refused is not None]
        told = told[-min(count, MOST_REFUSALS_TOLD) :]
        for exchange, why in told:
            self.log(refused(exchange, why))
        if count > len(told):
            self.tell(f"{count - len(told)} more were refused")

    def _report_callers(self) -> None:
        caller = self.door.channel is not None
        if caller and not self._told_caller:
            self.tell("antcn is there")
        self._told_caller = caller
        if self.door.hung_up_on != self._told_hung_up_on:
            self._told_hung_up_on = self.door.hung_up_on
            self.tell("a second caller was hung up on: one antenna, one antcn")
        if self.door.foreign != self._told_foreign:
            self._told_foreign = self.door.foreign
            self.tell("a caller that speaks HTTP or TLS was hung up on")
