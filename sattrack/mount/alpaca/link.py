"""An Alpaca telescope's gateway, started and ended, and the messages on its channel.

Towards the session the gateway is a mount behind a UDP socket on loopback.
"""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys

import msgspec

from sattrack.core.channel import Channel, start_process
from sattrack.core.errors import LinkLostError, SattrackError
from sattrack.mount.alpaca.address import AlpacaAddress
from sattrack.mount.alpaca.device import DeviceFacts
from sattrack.mount.xerxes.client import Address, UdpLink, bind


class GatewayConfig(msgspec.Struct, frozen=True):
    """A gateway's task."""

    address: AlpacaAddress
    peer_port: int
    channel: int


class GatewayReady(msgspec.Struct, frozen=True, tag=True):
    """It stands between: its port on loopback, and the telescope."""

    port: int
    facts: DeviceFacts


class GatewayRefusal(msgspec.Struct, frozen=True, tag=True):
    """It cannot, and why; `link` where nothing that answers is there."""

    words: str
    link: bool


class GatewayNews(msgspec.Struct, frozen=True, tag=True):
    """What is the matter with the telescope; None where nothing is any more."""

    words: str | None


START_WITHIN_S = 30.0
END_WITHIN_S = 5.0
BYE = b"bye\n"
"""The session's last word to its gateway: it has seen the stop through."""
_News = msgspec.json.Decoder(GatewayNews)


class GatewayLink(UdpLink):
    """The socket towards a gateway, and what the gateway reports of its telescope."""

    def __init__(
        self,
        address: Address,
        bound: socket.socket,
        process: subprocess.Popen[bytes],
        channel: Channel,
        facts: DeviceFacts,
    ) -> None:
        super().__init__(address, bound)
        self.facts = facts
        self.largest_rates_deg_s = facts.fastest_deg_s(0), facts.fastest_deg_s(1)
        self._process = process
        self._channel = channel
        self._trouble: str | None = None

    @property
    def trouble(self) -> str | None:
        """What is wrong with the telescope, as last reported by the gateway; None for nothing."""
        self._hear_news()
        return self._trouble

    def close(self) -> None:
        """Give the port back; the gateway ends once the telescope rests, or is in its guardian's hands."""
        self._channel.send(BYE)
        self._channel.close()
        super().close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(END_WITHIN_S)

    def _hear_news(self) -> None:
        for line in self._channel.lines():
            with contextlib.suppress(msgspec.MsgspecError):
                self._trouble = _News.decode(line).words


def open_gateway(address: AlpacaAddress) -> GatewayLink:
    """Start a gateway and return the socket towards it.

    Raises LinkLostError where no telescope answers, SattrackError where it cannot be driven.
    """
    bound = bind("127.0.0.1", 0)
    ours, theirs = socket.socketpair()
    config = GatewayConfig(address, int(bound.getsockname()[1]), theirs.fileno())
    with theirs:
        # The end of the session must not end the gateway before the telescope is stopped.
        process = start_process(
            "sattrack.mount.alpaca.gateway_process",
            msgspec.json.encode(config).decode(),
            inherits=(theirs.fileno(),),
        )
    channel = Channel(ours.detach())
    try:
        ready = _first_word(channel, address)
    except SattrackError:
        channel.close()
        bound.close()
        process.kill()
        process.wait()
        raise
    return GatewayLink(
        Address("127.0.0.1", ready.port, config.peer_port), bound, process, channel, ready.facts
    )


def _first_word(channel: Channel, address: AlpacaAddress) -> GatewayReady:
    lines = channel.first(START_WITHIN_S)
    if not lines and not channel.ended:
        raise LinkLostError(f"{address}: no answer within {START_WITHIN_S:g} s")
    if not lines:
        raise SattrackError(
            f"{address}: the gateway did not start; "
            f"`{sys.executable} -m sattrack.mount.alpaca.gateway_process` shows why"
        )
    word = msgspec.json.decode(lines[0], type=GatewayReady | GatewayRefusal)
    if isinstance(word, GatewayRefusal):
        raise (LinkLostError if word.link else SattrackError)(word.words)
    return word
