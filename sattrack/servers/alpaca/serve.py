"""What `sattrack serve alpaca` adds to the loop of a door: orders, states and answers, and the log."""

from __future__ import annotations

import socket
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import msgspec

from sattrack.core.errors import SattrackError
from sattrack.runtime.facts import build_engine, decode_facts
from sattrack.runtime.loop import StationLoop
from sattrack.servers.antenna.log_lines import spoken

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sattrack.control.engine import Engine
    from sattrack.safety import SafetyLimits
    from sattrack.servers.alpaca.door import AlpacaHttpProcess
    from sattrack.servers.alpaca.station import TelescopeStation

PROGRAM = "alpaca"
PORT = 32227
"""Of discovery, UDP."""
MOST_TOLD = 5
"""A tick's lines of the log: a flood of them is counted."""
LOOPBACK, LOOPBACK_BROADCAST, ANY = "127.0.0.1", "127.255.255.255", "0.0.0.0"


@dataclass(slots=True)
class AlpacaLoop(StationLoop):
    """Serves one mount to Alpaca's clients until `stop` is asked for and the mount is seen at rest."""

    driver: TelescopeStation
    door: AlpacaHttpProcess
    _told_doing: str = field(default="idle", init=False)

    def tell(self, words: str) -> None:
        """Have the program's own words logged."""
        self.log(spoken(words, PROGRAM))

    def serve(self, ready: list[Any]) -> None:
        """Take orders, and obey what may be obeyed now."""
        if self.door.line in ready:
            self.door.take()
        self._obey_orders()

    def obey(self, now_utc_s: float) -> None:
        """Let another order be obeyed; end where the clients' process has."""
        del now_utc_s
        if self.door.ended and not self.driver.finished:
            raise SattrackError("the HTTP server's process is gone; the mount is being stopped")
        self.door.begin_period(time.monotonic())

    def heard(self) -> None:
        """Push what the mount has said at once: clients then read it while it is new."""
        self._push()

    def report(self) -> None:
        """Push the mount's state and the answers that are due, and say what has changed."""
        self._push()
        self._obey_orders()
        words = [*self.driver.words, *self.door.words]
        self.driver.words.clear()
        self.door.words.clear()
        for line in words[:MOST_TOLD]:
            self.tell(line)
        if len(words) > MOST_TOLD:
            self.tell(f"and {len(words) - MOST_TOLD} lines more")
        self.report_mount("satellite", "AbortSlew")

    def _obey_orders(self) -> None:
        while True:
            asked, void = self.door.next_order()
            self.driver.answers.ready += void
            if asked is None:
                if void:
                    self._push()
                return
            began_s = time.monotonic()
            self.driver.obey(asked, self.connection.now_utc_s())
            self._push()
            self.door.took(time.monotonic() - began_s, time.monotonic())

    def _push(self) -> None:
        answers = self.driver.answers
        ready, answers.ready = answers.ready, []
        self.door.push(self.driver.state(self.connection.now_utc_s()), ready)


def engine_maker(limits: SafetyLimits) -> Callable[[msgspec.Raw, float], Engine]:
    """Return what makes an engine of the facts of a run, with this process' own limits."""

    def make(raw: msgspec.Raw, now_utc_s: float) -> Engine:
        try:
            facts = decode_facts(raw)
        except msgspec.MsgspecError as error:
            raise ValueError(f"these are not the facts of a run: {error}") from error
        return build_engine(msgspec.structs.replace(facts, limits=limits, started_utc_s=now_utc_s))

    return make


def discovery_sockets(host: str) -> tuple[Sequence[socket.socket], str | None]:
    """Return sockets on which discovery's questions come in, or why there are none.

    On loopback alone for a server on loopback: there, questions come by its own broadcast address.
    """
    inside = host.startswith("127.") or host == "localhost"
    opened: list[socket.socket] = []
    for address in (LOOPBACK, LOOPBACK_BROADCAST) if inside else (ANY,):
        one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.append(one)
        try:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            one.bind((address, PORT))
        except OSError as error:
            for each in opened:
                each.close()
            words = f"discovery is not answered: UDP port {PORT} on {address} is not available"
            return (), f"{words} ({error.strerror})"
        one.setblocking(False)
    return opened, None
