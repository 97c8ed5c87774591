"""What a gateway is told, and what it says on its channel, a JSON line each."""

from __future__ import annotations

import msgspec

from sattrack.mount.alpaca.address import AlpacaAddress
from sattrack.mount.alpaca.device import DeviceFacts


class GatewayConfig(msgspec.Struct, frozen=True):
    """Everything that a gateway is told."""

    address: AlpacaAddress
    peer_port: int
    channel: int


class Ready(msgspec.Struct, frozen=True, tag=True):
    """It stands between: its port on loopback, and the telescope."""

    port: int
    facts: DeviceFacts


class Refused(msgspec.Struct, frozen=True, tag=True):
    """It cannot, and why; `link` where nothing that answers is there."""

    words: str
    link: bool


class News(msgspec.Struct, frozen=True, tag=True):
    """What is the matter with the telescope; None where nothing is any more."""

    words: str | None
