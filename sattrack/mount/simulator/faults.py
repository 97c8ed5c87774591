"""Faults that a simulated mount shows on demand: what can be asked for, and how it is written.

    loss=3%,duplicate=1%,reorder=1%,corrupt=0.1%,delay-command=20ms~5ms,freeze@30s+2s,crash@60s+5s,drive@90s

Shares and delays hold for both ways, or for one where the word ends in `-command` or `-status`. Events happen
so long after the mount's start.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, get_args

import msgspec

from sattrack.core.errors import BadInputError

if TYPE_CHECKING:
    from sattrack.mount.simulator.wire import WireLaw

GRAMMAR = (
    ("loss=3%", "share of datagrams lost"),
    ("duplicate=1%", "share that arrives twice"),
    ("reorder=1%", "share held back for 80 ms, so that later ones overtake it"),
    ("corrupt=0.1%", "share in which one bit is turned"),
    ("delay=20ms~5ms", "delay, uniform within what follows ~"),
    ("freeze@30s+2s", "at 30 s the program stands still for 2 s; the drives go on"),
    ("crash@60s+5s", "at 60 s the program ends; 5 s later it starts anew"),
    ("drive@90s", "both drives lose their power, until a restart; drive-ra@, drive-dec@: one of them"),
    ("clock-step@40s+0.5s", "the mount's clock is set ahead by 0.5 s, or back with -0.5s"),
    ("silent@20s+3s", "no status for 3 s, commands still obeyed; silent:SECONDS: from then on"),
    ("deaf@20s+3s", "no command arrives for 3 s, statuses still come"),
    ("cut@20s+3s", "both: the link is cut for 3 s"),
)
"""What may be asked for: an example of each, and what it does."""

SHARES = ("loss", "duplicate", "reorder", "corrupt")
Kind = Literal["freeze", "crash", "drive", "drive-ra", "drive-dec", "clock-step", "silent", "deaf", "cut"]
EVENTS: dict[str, Kind] = {kind: kind for kind in get_args(Kind)}
WITH_DURATION = ("freeze", "crash", "clock-step")
WITHOUT_DURATION = ("drive", "drive-ra", "drive-dec")
DRIVES = {"drive": ("ra", "dec"), "drive-ra": ("ra",), "drive-dec": ("dec",)}
UNITS = {"s": 1.0, "ms": 1e-3}
_TIME = r"\d+(?:\.\d*)?|\.\d+"
_EVENT = re.compile(rf"({_TIME})(s|ms)(?:([+-])({_TIME})(s|ms))?")
_DELAY = re.compile(rf"({_TIME})(s|ms)(?:~({_TIME})(s|ms))?")
_SHARE = re.compile(rf"({_TIME})%")
MOST_DELAY_S = 5.0


class FaultEvent(msgspec.Struct, frozen=True):
    """What happens so many seconds after the start, and its length (None: for good) or size."""

    kind: Kind
    at_s: float
    amount_s: float | None = None


class WireFaults(msgspec.Struct, frozen=True):
    """What befalls datagrams on one way; the delay None where the wire's own holds."""

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    corrupt: float = 0.0
    delay_s: float | None = None
    jitter_s: float = 0.0

    def over(self, law: WireLaw) -> WireLaw:
        """Return what becomes of a wire's own law."""
        law = replace(
            law, loss=self.loss, duplicate=self.duplicate, reorder=self.reorder, corrupt=self.corrupt
        )
        return law if self.delay_s is None else replace(law, delay_s=self.delay_s, jitter_s=self.jitter_s)


class Faults(msgspec.Struct, frozen=True):
    """Everything that goes wrong, by share and by date; events in the order of their instants."""

    command: WireFaults = WireFaults()
    status: WireFaults = WireFaults()
    events: tuple[FaultEvent, ...] = ()


def parse_faults(text: str | None, where: str = "--faults") -> Faults:
    """Read faults as `GRAMMAR` has them, separated by commas; none for None or an empty text.

    Raises BadInputError, naming the part that is wrong and what may stand there.
    """
    ways: dict[str, dict[str, float]] = {"command": {}, "status": {}}
    events: list[FaultEvent] = []
    for part in (text or "").split(","):
        word = part.strip()
        if not word:
            continue
        name, mark, value = _parted(word)
        try:
            if mark == "=":
                _note_way(ways, name, value)
            else:
                events.append(_event(name, mark, value))
        except ValueError as error:
            raise BadInputError(f"{where} {word}: {error}") from None
    return Faults(
        WireFaults(**ways["command"]),
        WireFaults(**ways["status"]),
        tuple(sorted(events, key=lambda event: event.at_s)),
    )


def _parted(word: str) -> tuple[str, str, str]:
    found = re.fullmatch(r"([a-z-]+)([=@:])(.*)", word)
    return (found[1], found[2], found[3]) if found else (word, "", "")


def _note_way(ways: dict[str, dict[str, float]], name: str, value: str) -> None:
    base, chosen = name, tuple(ways)
    for way in ways:
        if name.endswith(f"-{way}"):
            base, chosen = name.removesuffix(f"-{way}"), (way,)
    if base in SHARES:
        found = _SHARE.fullmatch(value)
        if found is None or float(found[1]) > 100.0:
            raise ValueError(f"write a share from 0% to 100%, e.g. {base}=3%")
        entries = {base: float(found[1]) / 100.0}
    elif base == "delay":
        found = _DELAY.fullmatch(value)
        delay_s = math.inf if found is None else float(found[1]) * UNITS[found[2]]
        if found is None or delay_s > MOST_DELAY_S:
            raise ValueError(f"write a delay up to {MOST_DELAY_S:g} s and its jitter, e.g. {name}=20ms~5ms")
        jitter_s = float(found[3]) * UNITS[found[4]] if found[3] else 0.0
        entries = {"delay_s": delay_s, "jitter_s": jitter_s}
    else:
        raise ValueError(_no_such(name))
    for way in chosen:
        ways[way] |= entries


def _event(name: str, mark: str, value: str) -> FaultEvent:
    if name not in EVENTS:
        raise ValueError(_no_such(name))
    if mark == ":":
        if name != "silent" or re.fullmatch(_TIME, value) is None:
            raise ValueError("write silent:SECONDS, or silent@20s+3s")
        return FaultEvent("silent", float(value))
    found = _EVENT.fullmatch(value)
    example = next(text for text, _ in GRAMMAR if text.partition("@")[0] in (name, name[:5]))
    if found is None or mark != "@":
        raise ValueError(f"write the instant after @, with its unit, e.g. {example}")
    at_s = float(found[1]) * UNITS[found[2]]
    if not found[3]:
        if name in WITH_DURATION:
            raise ValueError(f"say for how long, or by how much, e.g. {example}")
        return FaultEvent(EVENTS[name], at_s)
    if name in WITHOUT_DURATION:
        raise ValueError(f"a drive stays without power until a restart; write {name}@90s")
    amount_s = float(found[4]) * UNITS[found[5]]
    if found[3] == "-":
        if name != "clock-step":
            raise ValueError(f"only a clock can be set back; write e.g. {example}")
        amount_s = -amount_s
    return FaultEvent(EVENTS[name], at_s, amount_s)


def _no_such(name: str) -> str:
    examples = ", ".join(text for text, _ in GRAMMAR)
    return f"no fault is called {name!r}; write {examples}, or silent:SECONDS, separated by commas"
