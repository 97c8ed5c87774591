"""Look on at a mount that a session owns: its statuses as the session hears them, and no way to speak."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING

import msgspec

from sattrack.mount.xerxes.client import Arrival
from sattrack.runtime.owner import Overheard, door_to_watch

if TYPE_CHECKING:
    from sattrack.runtime.mounts import MountAddress

READ_BYTES = 65536


class OverheardLink:
    """In place of a `UdpLink`: the same datagrams with the same arrivals; what is sent goes nowhere."""

    def __init__(self, address: MountAddress, door: socket.socket) -> None:
        self.address = address
        self.strangers = self.unsent = 0
        self.stranger_hosts: list[str] = []
        self.trouble: str | None = None
        self.ended = False
        """Whether the session has ended, and nothing more is to be heard."""
        self._door = door
        self._nobody: socket.socket | None = None
        self._rest = b""
        self._decoder = msgspec.json.Decoder(Overheard)

    def fileno(self) -> int:
        """Give the descriptor to wait on."""
        return self._door.fileno()

    def send(self, data: bytes) -> None:
        """Send nothing, and count it."""
        del data
        self.unsent += 1

    def receive(self) -> list[Arrival]:
        """Return what the owner has heard meanwhile, in order."""
        try:
            data = self._door.recv(READ_BYTES)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._end()
        *lines, self._rest = (self._rest + data).split(b"\n")
        overheard = [self._decoder.decode(line) for line in lines]
        return [Arrival(heard.data, heard.monotonic_s) for heard in overheard]

    def close(self) -> None:
        """Look away."""
        self._door.close()
        if self._nobody is not None:
            self._nobody.close()

    def _end(self) -> None:
        """Put a door that stays silent in place of one that says again and again that it is closed."""
        self.ended = True
        self._door.close()
        self._door, self._nobody = socket.socketpair()
        self._door.setblocking(False)


def look_on(address: MountAddress) -> OverheardLink | None:
    """Return what to look on by; None where nobody on this machine owns the mount."""
    door = door_to_watch(address.name)
    return None if door is None else OverheardLink(address, door)
