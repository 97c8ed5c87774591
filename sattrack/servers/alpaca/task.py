"""What the process that Alpaca's clients talk to is told at its start: one JSON line."""

from __future__ import annotations

import ipaddress

import msgspec

from sattrack.core.utc_json import decode_utc, encode_utc
from sattrack.mount.model import MountProfile
from sattrack.servers.alpaca.device import Abilities
from sattrack.servers.alpaca.satellites import Satellites
from sattrack.servers.callers import CallerLimits
from sattrack.settings import SiteSettings

READY = "ready"
"""What that process says first."""


class ClockNumbers(msgspec.Struct, frozen=True):
    """A simulated clock's three numbers."""

    start_utc_s: float
    anchor_s: float
    speed: float


class AlpacaTask(msgspec.Struct, frozen=True):
    """Everything that this process is told at its start; descriptors are inherited."""

    listener: int
    discovery: tuple[int, ...]
    port: int
    profile: MountProfile
    site: SiteSettings
    mount: str
    version: str
    host: str
    callers: int
    idle_s: float
    requests_per_s: float
    allowed: tuple[str, ...] | None
    satellites: Satellites
    abilities: Abilities
    clock: ClockNumbers | None = None
    names: tuple[str, ...] = ()
    """Names by which clients call this computer, beside its own."""

    def limits(self) -> CallerLimits:
        """Return what clients may take."""
        allowed = None if self.allowed is None else tuple(ipaddress.ip_network(one) for one in self.allowed)
        return CallerLimits(self.callers, self.idle_s, self.requests_per_s, allowed)


def encode_task(task: AlpacaTask) -> bytes:
    """Return a task as one JSON line."""
    return msgspec.json.encode(task, enc_hook=encode_utc) + b"\n"


def decode_task(line: bytes) -> AlpacaTask:
    """Return the task of one JSON line; raises msgspec.MsgspecError."""
    return msgspec.json.decode(line, type=AlpacaTask, dec_hook=decode_utc)
