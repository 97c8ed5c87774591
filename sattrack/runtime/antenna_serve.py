"""The loop of `sattrack serve antenna`: the mount's datagrams at their deadlines, antcn whenever it calls.

One thread, one `select`: a position status is latched when its bytes are read, and answered at once, unless a
datagram is being computed just then, which takes about a millisecond twenty times a second.
"""

from __future__ import annotations

import select
import time
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any

from sattrack.antenna.log_lines import refused, spoken, typed
from sattrack.antenna.trajectory import NS, to_ns
from sattrack.antenna.transactions import NAK_MEANINGS
from sattrack.antenna_view import (
    LONGEST_SHOWN,
    SHOWN_EXCHANGES,
    SHOWN_REFUSALS,
    AntennaView,
    AxesView,
    ExchangeView,
    FocusView,
    RefusalView,
)
from sattrack.errors import SattrackError
from sattrack.runtime.realtime import undisturbed
from sattrack.xerxes.repeats import REPEAT_AFTER_PERIODS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.antenna.station import Station
    from sattrack.runtime.antenna_door import Door
    from sattrack.runtime.antenna_focus import FocusProcesses
    from sattrack.runtime.console import Connection
    from sattrack.runtime.signals import StopRequest

LATE_ENOUGH_TO_SKIP_S = 0.5
SHOW_EVERY_TICKS = 5
MOST_REFUSALS_TOLD = 5
"""A tick's refusals in the log: a flood of them is counted."""
LEAVE = "leave"
WORDS = ("local", "remote", "stop", "reset", "last", LEAVE)
LEAD_S = 0.0015
"""How long before it is due a datagram is computed."""


@dataclass(slots=True)
class AntennaLoop:
    """Serves one station at one door until `stop` is asked for and the mount is seen at rest.

    `words` gives what the operator typed since the last call; `log` takes lines without their instant.
    """

    station: Station
    connection: Connection
    door: Door
    stop: StopRequest
    log: Callable[[str], None]
    words: Callable[[], Sequence[str]]
    where: str = ""
    """The door, in words."""
    show: Callable[[AntennaView], None] | None = None
    """Takes a view a few times a second; must not wait."""
    focus: FocusProcesses | None = None
    """The focuser, where it is not simulated."""
    _error: Exception | None = None
    _told_refusals: int = 0
    _told_trip: str | None = None
    _told_hold: str | None = None
    _told_link: bool = False
    _told_caller: bool = False
    _told_hung_up_on: int = 0

    def tell(self, words: str) -> None:
        """Have the program's own words logged."""
        self.log(spoken(words))

    def run(self) -> None:
        """Run to the end. Whatever breaks stops the mount first and is raised then."""
        guard = self.connection.guard
        with undisturbed():
            period_s = self.station.profile.period_s / self.connection.clock.speed
            due_s, ticks = time.monotonic(), 0
            while not self.station.finished and not guard.deposed:
                self._guarded(self._wait_until, due_s - LEAD_S)
                self._guarded(self._heed)
                self._guarded(self._tick, due_s)
                self._guarded(self._repeat, due_s + REPEAT_AFTER_PERIODS * period_s)
                self._guarded(self._report)
                ticks += 1
                if ticks % SHOW_EVERY_TICKS == 0:
                    self._guarded(self._show)
                shift_s = self.station.send_shift_s(self.connection.now_utc_s())
                due_s += period_s + shift_s / self.connection.clock.speed
                if time.monotonic() - due_s > LATE_ENOUGH_TO_SKIP_S:
                    due_s = time.monotonic()
        if guard.deposed:
            raise SattrackError(guard.trouble)
        guard.release(self.station.mount_stopped)
        if self._error is not None:
            raise self._error

    def _guarded(self, part: Callable[..., None], *arguments: Any) -> None:
        try:
            part(*arguments)
        except Exception as error:  # noqa: BLE001 - no error is worth a mount that is left moving
            if self._error is None:
                self._error = error
            self.station.end(self.connection.now_utc_s())

    def _wait_until(self, due_s: float) -> None:
        """Wait for an instant, taking datagrams and serving antcn as they come."""
        while True:
            left_s = max(0.0, due_s - time.monotonic())
            link, door = self.connection.link, self.door
            ready, takes_more, _ = select.select([link, *door.readers()], door.writers(), [], left_s)
            self._serve(ready)
            if takes_more:
                door.flush()
            if link in ready:
                for arrival in link.receive():
                    arrived_utc_s = self.connection.clock.utc_s(arrival.monotonic_s)
                    self.station.receive_status(arrival.data, arrived_utc_s)
            if time.monotonic() >= due_s:
                return

    def _serve(self, ready: list[Any]) -> None:
        if self.door.serve(ready, self.connection.now_utc_s, self.station.receive_command):
            self.station.controller.hang_up()
            self._told_caller = False
            self.tell("antcn is gone; the trajectory in force stays")

    def _heed(self) -> None:
        if self.connection.guard.stop_asked:
            self.stop.ask()
        if self.connection.guard.trouble is not None:
            raise SattrackError(self.connection.guard.trouble)
        if self.stop.asked:
            self.station.end(self.connection.now_utc_s())
        if self.connection.simulated is not None:
            # Nobody asks for the truth here, but the pipe must not fill up.
            self.connection.simulated.truths()
        if self.door.mend(time.monotonic()):
            self._told_caller = True
            self.tell("the serial line is there again")
        if self.focus is not None:
            for told in self.focus.exchange(self._at_ns):
                self.tell(told)
        for word in self.words():
            self._obey(word)

    def _at_ns(self, monotonic_s: float) -> int:
        """Return an instant by the antenna's clock."""
        return to_ns(self.connection.clock.utc_s(monotonic_s) + self.station.clock_ahead_s)

    def _obey(self, word: str) -> None:
        """Obey a word typed at the controller's own console."""
        controller, now_ns = self.station.controller, self._at_ns(time.monotonic())
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
            self.station.end(self.connection.now_utc_s())
        elif word:
            self.tell(f"{word!r} is no word of this console: {', '.join(WORDS)}")

    def _show(self) -> None:
        if self.show is not None:
            self.show(self.view())

    def view(self) -> AntennaView:
        """Return what the controller's console shows now."""
        station, controller = self.station, self.station.controller
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
        focuser = self.station.antenna.focuser
        if focuser is None:
            return None
        report = focuser.report(at_ns)
        return FocusView(tuple(place.actual_mm for place in report.axes), report.moving)

    def _tick(self, due_s: float) -> None:
        connection = self.connection
        datagram = self.station.tick(connection.clock.utc_s(max(due_s, time.monotonic())))
        while (left_s := due_s - time.monotonic()) > 0.0:
            # Whoever asks while a datagram waits to be due is not kept waiting.
            ready, _, _ = select.select(self.door.readers(), [], [], left_s)
            self._serve(ready)
        if connection.guard.beat(datagram):
            connection.link.send(datagram)

    def _repeat(self, due_s: float) -> None:
        """Send the last datagram once more where the link loses some."""
        self._wait_until(due_s)
        datagram = self.station.repeat()
        if datagram is not None and not (self.stop.asked or self.connection.guard.deposed):
            self.connection.link.send(datagram)

    def _report(self) -> None:
        """Say what has changed: refusals, interlocks, the link."""
        station = self.station
        self._report_refusals()
        self._report_callers()
        if station.tripped != self._told_trip:
            self._told_trip = station.tripped
            if station.tripped is not None:
                self.tell(f"safety stopped the mount: {station.tripped}; RESET makes it ready again")
        held_by = station.safety.holding
        if held_by is not None and held_by != self._told_hold:
            self._told_hold = held_by
            self.tell(f"a limit keeps the antenna off its trajectory: {held_by}")
        elif station.on_trajectory:
            self._told_hold = None
        if station.link_up != self._told_link:
            self._told_link = station.link_up
            self.tell("the mount is heard" if station.link_up else "the mount is not heard")

    def _report_refusals(self) -> None:
        controller = self.station.controller
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
