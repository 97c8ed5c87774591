"""An Alpaca telescope with a simulated mount in virtual time: requests as on the wire, no sockets."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlencode

import msgspec
from antenna_harness import SITE, VirtualAntenna

from sattrack.mount.model import AxesPosition, MountProfile
from sattrack.servers.alpaca.protocol import (
    Answered,
    Fault,
    Number,
    NumberedOrder,
    Order,
    Passes,
    TrackSatellite,
)
from sattrack.servers.alpaca.serve import engine_maker
from sattrack.servers.alpaca.station import TelescopeStation
from sattrack.servers.alpaca.telescope import Device, Pending, Reply, ServedTelescope, Server

BEGIN_UTC_S = 1790946000.0
"""2026-10-02T13:00:00Z, two minutes before the practice satellite rises."""
PROFILE = MountProfile(name="bench mount", park=AxesPosition(0.0, 60.0), home=AxesPosition(0.0, 40.0))
LONGEST_S = 300.0


@dataclass
class VirtualTelescope(VirtualAntenna):
    """Runs a telescope; `get` and `put` are requests of one client, that is connected from the beginning."""

    begin_utc_s: float = BEGIN_UTC_S
    profile: MountProfile = PROFILE
    connected: bool = True
    _numbers: int = 0
    _answers: dict[int, Answered] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.telescope = ServedTelescope(Device(self.profile, SITE, "the simulated mount", "0.0", "bench"))
        self.server = Server(self.telescope, "52.1541, 4.4908, 0 m")
        self.run_for(1.0)
        if self.connected:
            assert self.put("connected", Connected="True") is None

    def make_station(self) -> Any:
        return TelescopeStation(
            self.profile, self.limits, SITE, "the simulated mount", engine_maker(self.limits)
        )

    def get(self, member: str, **parameters: Any) -> Any:
        """Return a member's value; raises Fault."""
        return self.reply(self.ask("GET", member, **parameters)).get("Value")

    def put(self, member: str, **parameters: Any) -> Any:
        """Do what a PUT asks, and wait for its answer; raises Fault."""
        return self.reply(self.finished(self.ask("PUT", member, **parameters))).get("Value")

    def ask(self, method: str, member: str, **parameters: Any) -> Reply | Pending:
        """Ask now; what is not answered at once is returned as it is."""
        words = urlencode({"ClientID": 1, "ClientTransactionID": 2, **parameters}).encode()
        query, body = (words, b"") if method == "GET" else (b"", words)
        return self.asked(method, f"/api/v1/telescope/0/{member}", query, body)

    def asked(self, method: str, path: str, query: bytes = b"", body: bytes = b"") -> Reply | Pending:
        """Ask in the wire's own words."""
        self._see()
        return self.server.answer(method, path, query, body, self.now_utc_s)

    def finished(self, asked: Reply | Pending) -> Reply:
        """Wait until a request is answered, and return the answer."""
        if isinstance(asked, Reply):
            return asked
        assert not isinstance(asked.order, TrackSatellite | Passes)
        return self.answer_of(asked, self.give(asked.order, asked.waits))

    def give(self, order: Order, waits: bool = False) -> int:
        """Give the mount's side an order; return its number."""
        self._numbers += 1
        # As on the wire between the two processes.
        asked = msgspec.json.decode(
            msgspec.json.encode(NumberedOrder(self._numbers, order, waits)), type=NumberedOrder
        )
        self.station.obey(asked, self.now_utc_s)
        self._see()
        return self._numbers

    def answer_of(self, asked: Pending, number: int) -> Reply:
        """Run until an order is answered; return the answer to the request behind it."""
        until_s = self.now_utc_s + LONGEST_S
        while number not in self._answers:
            assert self.now_utc_s < until_s, "never answered"
            self.run_for(0.05)
            self._see()
        answer = self._answers[number]
        fault = Fault(Number(answer.fault), answer.message) if answer.fault else None
        return self.server.finish(asked, fault=fault)

    def answered(self, number: int) -> Answered | None:
        """Return what became of an order so far."""
        self._see()
        return self._answers.get(number)

    @staticmethod
    def reply(reply: Reply | Pending) -> dict[str, Any]:
        """Return what an answer says; raises Fault for an error number."""
        assert isinstance(reply, Reply)
        assert reply.status == 200, reply.body
        told: dict[str, Any] = json.loads(reply.body)
        if told["ErrorNumber"]:
            raise Fault(Number(told["ErrorNumber"]), told["ErrorMessage"])
        return told

    def wait_while(self, member: str) -> None:
        """Run until a member is false."""
        until_s = self.now_utc_s + LONGEST_S
        while self.get(member):
            assert self.now_utc_s < until_s, f"{member} never ends"
            self.run_for(0.05)

    def fault_of(self, member: str, **parameters: Any) -> Number:
        """Return the error number of a PUT, OK where there is none."""
        try:
            self.put(member, **parameters)
        except Fault as fault:
            return fault.number
        return Number.OK

    def get_fault(self, member: str, **parameters: Any) -> Number:
        """Return the error number of a GET, OK where there is none."""
        try:
            self.get(member, **parameters)
        except Fault as fault:
            return fault.number
        return Number.OK

    def _see(self) -> None:
        self.telescope.state = self.station.state(self.now_utc_s)
        for answer in self.station.answers.ready:
            self._answers[answer.number] = answer
        self.station.answers.ready.clear()
