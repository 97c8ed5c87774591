"""INDI's telescope interface, as its own programs see it: `sattrack serve indi` beside INDI's simulator.

What is declared is read from the definitions that a server sends; properties are set by `indi_setprop`, and
their states watched by `indi_getprop`. The simulator is the reference: INDI has no conformance test.
"""

from __future__ import annotations

import contextlib
import queue
import socket
import subprocess
import threading
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, NamedTuple, cast
from xml.etree import ElementTree

from conformu_checks import Finding

from sattrack.servers.alpaca.indi import DEVICE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

__all__ = ["DEVICE"]
REFERENCE = "Telescope Simulator"
DECLARED_WITHIN_S, SETTLES_WITHIN_S, QUIET_S = 3.0, 60.0, 2.0


class Declared(NamedTuple):
    """What a definition says of a property."""

    kind: str
    permission: str
    rule: str
    group: str
    elements: tuple[str, ...]


@dataclass(frozen=True)
class Action:
    """Something that is set; `lasts` tells that the property may stay busy."""

    name: str
    value: str
    lasts: bool = False


def declared(port: int, device: str) -> dict[str, Declared]:
    """Return the definitions of a device's properties."""
    text = b""
    with socket.create_connection(("127.0.0.1", port), timeout=DECLARED_WITHIN_S) as line:
        line.sendall(b'<getProperties version="1.7"/>')
        line.settimeout(0.2)
        until_s = time.monotonic() + DECLARED_WITHIN_S
        while time.monotonic() < until_s:
            with contextlib.suppress(TimeoutError):
                text += line.recv(65536)
    reader = ElementTree.XMLPullParser(["end"])
    reader.feed(b"<all>" + text)
    found = {}
    for _, one in cast("Iterator[tuple[str, ElementTree.Element]]", reader.read_events()):
        if not one.tag.startswith("def") or one.get("device") != device:
            continue
        elements = tuple(part.get("name", "") for part in one)
        said = (one.get("perm", ""), one.get("rule", ""), one.get("group", ""))
        found[one.get("name", "")] = Declared(one.tag[3:-6], *said, elements)
    return found


class Watched:
    """A device of a server, by `indi_setprop` and `indi_getprop`."""

    def __init__(self, port: int, device: str, program: Callable[[str], str]) -> None:
        self._port, self._device, self._program = str(port), device, program

    def states_after(self, action: Action) -> list[str]:
        """Set a property; return the states that clients hear of until nothing changes any more."""
        name, value = action.name, action.value
        getprop = [self._program("indi_getprop"), "-p", self._port, "-m", "-t", "120"]
        watching = subprocess.Popen(
            ["stdbuf", "-oL", *getprop, f"{self._device}.{name}._STATE"], stdout=subprocess.PIPE, text=True
        )
        heard: queue.SimpleQueue[str] = queue.SimpleQueue()

        def listen() -> None:
            for line in watching.stdout or ():
                heard.put(line.strip().rpartition("=")[2])

        listener = threading.Thread(target=listen)
        listener.start()
        try:
            heard.get(timeout=SETTLES_WITHIN_S)
            command = [self._program("indi_setprop"), "-p", self._port, f"{self._device}.{name}.{value}"]
            subprocess.run(command, check=False, capture_output=True, timeout=SETTLES_WITHIN_S)
            return self._settled(heard, action.lasts)
        finally:
            watching.kill()
            listener.join()
            watching.wait()
            if watching.stdout is not None:
                watching.stdout.close()

    def number(self, name: str) -> float:
        """Return an element's value."""
        command = [self._program("indi_getprop"), "-p", self._port, "-1", f"{self._device}.{name}"]
        return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)

    @staticmethod
    def _settled(heard: queue.SimpleQueue[str], lasts: bool) -> list[str]:
        states: list[str] = []
        changed_s, until_s = time.monotonic(), time.monotonic() + SETTLES_WITHIN_S
        # A place is told again and again: only what changes counts.
        while time.monotonic() < until_s:
            busy = states[-1:] == ["Busy"] and not lasts
            if not busy and time.monotonic() > changed_s + QUIET_S:
                break
            with contextlib.suppress(queue.Empty):
                state = heard.get(timeout=QUIET_S)
                if states[-1:] != [state]:
                    states.append(state)
                    changed_s = time.monotonic()
        return states


SAME, LESS, ABSENT = "as the simulator", "fewer elements than the simulator", "not there"
ENDS = "ends with the client that pressed the key, and `indi_setprop` leaves at once"
WHY = {
    "TELESCOPE_TRACK_MODE": "sidereal alone",
    "TELESCOPE_TRACK_RATE": "satellites are followed by SAT_TRACKING_STAT",
    "TELESCOPE_PARK_POSITION": "the profile has it",
    "TELESCOPE_PARK_OPTION": "the profile has it",
    "TELESCOPE_INFO": "the optics are unknown",
    "GUIDE_RATE": "the mount's own; clients guide by milliseconds",
    "TELESCOPE_REVERSE_MOTION": "the profile has the signs",
}
"""Why a property is not as the simulator's; those of INDI's own library are no part of the interface."""


def compare_declared(ours: dict[str, Declared], theirs: dict[str, Declared]) -> Iterator[Finding]:
    """Give a finding for each property that either has."""
    for name in sorted(ours | theirs):
        here, there = ours.get(name), theirs.get(name)
        if there is None:
            yield Finding(name, True, "a telescope's, for satellites; the simulator has none")
        elif here == there:
            yield Finding(name, True, SAME)
        elif here is not None:
            less = here._replace(elements=there.elements) == there and set(here.elements) < set(
                there.elements
            )
            yield Finding(name, False, f"{LESS}: {WHY.get(name)}" if less else "declared otherwise")
        elif name in WHY:
            yield Finding(name, False, f"{ABSENT}: {WHY[name]}")


def compare_states(action: Action, ours: list[str], theirs: list[str]) -> Finding:
    """Return whether a property ends in the state in which the simulator's does."""
    holds = ours[-1:] == theirs[-1:]
    words = f"ends {ours[-1] if ours else 'unanswered'}"
    if not holds:
        words += f"; the simulator's {theirs[-1] if theirs else 'unanswered'}"
        words += f": {ENDS}" if "MOTION_N" in action.name or "MOTION_W" in action.name else ""
    return Finding(f"{action.name} {action.value.partition('=')[0]}", holds, words)


def actions(ra_h: float) -> tuple[Action, ...]:
    """Return what is set, in this order; `ra_h` is a right ascension that is high in the sky."""
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return (
        Action("CONNECTION", "CONNECT=On"),
        Action("GEOGRAPHIC_COORD", "LAT=52.1541;LONG=4.4908;ELEV=0"),
        Action("TIME_UTC", f"UTC={now};OFFSET=0"),
        Action("TELESCOPE_PARK", "UNPARK=On"),
        Action("ON_COORD_SET", "TRACK=On"),
        Action("EQUATORIAL_EOD_COORD", f"RA={ra_h};DEC=40"),
        Action("TELESCOPE_TRACK_STATE", "TRACK_OFF=On"),
        Action("TELESCOPE_TRACK_STATE", "TRACK_ON=On", lasts=True),
        Action("TELESCOPE_TRACK_MODE", "TRACK_SIDEREAL=On"),
        Action("TELESCOPE_SLEW_RATE", "2x=On"),
        Action("TELESCOPE_MOTION_NS", "MOTION_NORTH=On", lasts=True),
        Action("TELESCOPE_MOTION_NS", "MOTION_NORTH=Off", lasts=True),
        Action("TELESCOPE_MOTION_WE", "MOTION_WEST=On", lasts=True),
        Action("TELESCOPE_MOTION_WE", "MOTION_WEST=Off", lasts=True),
        Action("TELESCOPE_TIMED_GUIDE_NS", "TIMED_GUIDE_N=300"),
        Action("TELESCOPE_TIMED_GUIDE_WE", "TIMED_GUIDE_W=300"),
        Action("ON_COORD_SET", "SYNC=On"),
        Action("EQUATORIAL_EOD_COORD", f"RA={ra_h};DEC=40"),
        Action("TELESCOPE_ABORT_MOTION", "ABORT=On"),
        Action("TELESCOPE_PARK", "PARK=On"),
    )
