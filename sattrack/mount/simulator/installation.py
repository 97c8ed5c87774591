"""A simulated mount as a client meets it: its loop's timer, the wires to and from it, and faults on demand.

Pure: the UDP server and a run in virtual time ask it for instants and hand it datagrams, and do the waiting.
All that is random comes from the hardware's seed. Faults are written

    loss=3%,duplicate=1%,reorder=1%,corrupt=0.1%,delay-command=20ms~5ms,freeze@30s+2s,crash@60s+5s,drive@90s

Shares and delays hold for both ways, or for one where the word ends in `-command` or `-status`. Events happen
so long after the mount's start.
"""

from __future__ import annotations

import math
import random
import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import msgspec

from sattrack.core.errors import BadInputError
from sattrack.mount.simulator.profile import MOST_DELAY_S

if TYPE_CHECKING:
    from sattrack.mount.simulator.mount import SimulatedMount, Truth
    from sattrack.mount.simulator.profile import TimerLaw


class LoopRun(NamedTuple):
    """What came of one turn of the loop: the status to send, if any, and the truth, if the loop ran."""

    status: bytes | None
    truth: Truth | None


@dataclass(slots=True)
class Installation:
    """One mount with everything around it.

    Delays are those of the hardware's settings, or else `command_delay_s` and `status_delay_s`; the faults
    come on top of the hardware's own. Raises BadInputError where those cannot be read.
    """

    mount: SimulatedMount
    faults: Faults | None = None
    command_delay_s: float = 0.0
    status_delay_s: float = 0.0
    commands: Wire = field(init=False)
    statuses: Wire = field(init=False)
    _timer: Timer = field(init=False)
    _events: list[FaultEvent] = field(init=False)
    _begun_s: float | None = None
    _frozen_until_s: float = -math.inf
    _silent_until_s: float = -math.inf
    _deaf_until_s: float = -math.inf
    _elapsed_s: float = 0.0
    """When the loop ran last, since its begin."""
    _down_until_s: float | None = None

    def __post_init__(self) -> None:
        """Lay the wires and set the timer."""
        hardware = self.mount.hardware
        faults = self.faults
        if faults is None:
            faults = parse_faults(hardware.faults, "the mount profile, simulator.faults:")
        seed = hardware.seed
        self.commands = Wire(
            faults.command.over(
                _law(hardware.command_delay_s, hardware.command_jitter_s, self.command_delay_s)
            ),
            f"commands {seed}",
        )
        self.statuses = Wire(
            faults.status.over(_law(hardware.status_delay_s, hardware.status_jitter_s, self.status_delay_s)),
            f"statuses {seed}",
        )
        self._timer = Timer(hardware.timer, self.mount.profile.period_s, hardware.timer_drift_ppm, seed)
        self._events = list(faults.events)

    def next_turn_s(self, now_s: float) -> float:
        """Return the first instant after `now_s` at which the loop runs; the first call begins it."""
        return self._timer.next(now_s)

    def receive(self, data: bytes) -> bool:
        """Take a datagram that has arrived; False where it is refused, or nobody is there to take it."""
        if self._down_until_s is not None or self._elapsed_s < self._deaf_until_s:
            return False
        return self.mount.receive(data)

    def turn(self, now_utc_s: float) -> LoopRun:
        """Run the loop at an instant, as far as faults let it."""
        if self._begun_s is None:
            self._begun_s = now_utc_s
        elapsed_s = self._elapsed_s = now_utc_s - self._begun_s
        if self._events or self._down_until_s is not None:
            self._befall(elapsed_s, now_utc_s)
        if self._down_until_s is not None or elapsed_s < self._frozen_until_s:
            return LoopRun(None, None)
        status, truth = self.mount.tick(now_utc_s)
        return LoopRun(None if elapsed_s < self._silent_until_s else status, truth)

    def _befall(self, elapsed_s: float, now_utc_s: float) -> None:
        while self._events and self._events[0].at_s <= elapsed_s:
            event = self._events.pop(0)
            amount_s = math.inf if event.amount_s is None else event.amount_s
            match event.kind:
                case "freeze":
                    self._frozen_until_s = event.at_s + amount_s
                case "crash":
                    self._down_until_s = event.at_s + amount_s
                    self.mount.crash(now_utc_s)
                case "silent":
                    self._silent_until_s = event.at_s + amount_s
                case "deaf":
                    self._deaf_until_s = event.at_s + amount_s
                case "cut":
                    self._silent_until_s = self._deaf_until_s = event.at_s + amount_s
                case "clock-step":
                    self.mount.step_clock(amount_s)
                case _:
                    self.mount.fail_drives(DRIVES[event.kind], now_utc_s)
        if self._down_until_s is not None and elapsed_s >= self._down_until_s:
            self._down_until_s = None
            self.mount.restart(now_utc_s)


def _law(delay_s: float | None, jitter_s: float, otherwise_s: float) -> WireLaw:
    return WireLaw(otherwise_s if delay_s is None else delay_s, jitter_s)


GRAIN_S = 1.0 / 64.0
LATE_S = 0.001
"""The most that a Windows timer is late beyond the interrupt."""


@dataclass(slots=True)
class Timer:
    """Instants at which the loop of 50 ms runs; the first call of `next` begins it and gives the first one.

    "Xerxes Mount Control Protocol", Theory of Operation: the loop is "approximately" 50 ms, "as the Windows
    forms timer is imprecise". Such a timer fires at the first of the system's clock interrupts, 64 a second,
    at or after it is due, and a little later where its thread is busy. Where the paper is silent:

    * `exact`: due and firing at whole multiples of the period.
    * `windows`: due at whole multiples of the period, firing at the next interrupt: 46.9 or 62.5 ms, mean 50.
    * `windows_rearmed`: due a period after it fired, firing at the next interrupt: 62.5 ms each time.

    Firings missed because the loop was held up are dropped: the messages of such a timer are merged.
    `drift_ppm` is how much longer the computer's seconds last than true ones, in millionths.
    """

    law: TimerLaw = "exact"
    period_s: float = 0.05
    drift_ppm: float = 0.0
    seed: int = 0
    _random: random.Random = field(init=False)
    _begin_s: float | None = None
    _turn: int = 0
    _phase_s: float = field(init=False)
    _fired_s: float = -math.inf

    def __post_init__(self) -> None:
        """Draw the phase of the interrupts."""
        self._random = random.Random(f"timer {self.seed}")
        self._phase_s = self._random.uniform(0.0, GRAIN_S)

    def next(self, now_s: float) -> float:
        """Return the first instant after `now_s` at which the loop runs, in the scale of `now_s`, seconds."""
        if self._begin_s is None:
            self._begin_s = now_s
            return self._fire(0.0) if self.law != "exact" else now_s
        fired_s = self._following()
        while fired_s <= now_s:
            fired_s = self._following()
        return fired_s

    def _following(self) -> float:
        assert self._begin_s is not None
        self._turn += 1
        if self.law == "exact":
            # A multiple from the beginning, not a sum: a sum of roundings would drift.
            return self._begin_s + self._turn * self.period_s * (1.0 + self.drift_ppm * 1e-6)
        if self.law == "windows":
            return self._fire(self._turn * self.period_s)
        return self._fire(self._fired_s + self.period_s)

    def _fire(self, due_s: float) -> float:
        """Return when a firing due so many of the computer's own seconds after the beginning happens."""
        assert self._begin_s is not None
        grains = math.ceil((due_s - self._phase_s) / GRAIN_S - 1e-9)
        interrupt_s = self._phase_s + grains * GRAIN_S
        fired_s = interrupt_s + self._random.uniform(0.0, LATE_S)
        # A rearmed timer counts from the interrupt at which it fired.
        self._fired_s = interrupt_s
        return self._begin_s + fired_s * (1.0 + self.drift_ppm * 1e-6)


HELD_BACK_S = 0.08
"""How much longer a reordered datagram takes: longer than the 50 ms after which the next one follows."""
DOUBLED_WITHIN_S = 0.02


@dataclass(frozen=True, slots=True)
class WireLaw:
    """How one way treats datagrams: delay and jitter in seconds, shares from 0 to 1.

    The delay of each is uniform within `jitter_s` either way of `delay_s`, never below 0.
    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    corrupt: float = 0.0


@dataclass(slots=True)
class Wire:
    """One way, with a random stream of its own: the same seed and datagrams give the same arrivals."""

    law: WireLaw
    seed: str = ""
    lost: int = 0
    _random: random.Random = field(init=False)
    _troubled: bool = field(init=False)

    def __post_init__(self) -> None:
        """Begin the stream."""
        self._random = random.Random(self.seed)
        law = self.law
        self._troubled = bool(law.jitter_s or law.loss or law.duplicate or law.reorder or law.corrupt)

    @property
    def delays(self) -> bool:
        """Whether datagrams may take longer than the real way does."""
        return bool(self.law.delay_s or self.law.jitter_s or self.law.reorder or self.law.duplicate)

    def carry(self, data: bytes) -> list[tuple[float, bytes]]:
        """Return what arrives of one datagram: none, one or two of (seconds after it was sent, bytes)."""
        law, rng = self.law, self._random
        if not self._troubled:
            return [(law.delay_s, data)]
        if law.loss and rng.random() < law.loss:
            self.lost += 1
            return []
        delay_s = law.delay_s
        if law.jitter_s:
            delay_s = max(0.0, delay_s + rng.uniform(-law.jitter_s, law.jitter_s))
        if law.reorder and rng.random() < law.reorder:
            delay_s += HELD_BACK_S
        arrivals = [(delay_s, self._corrupted(data))]
        if law.duplicate and rng.random() < law.duplicate:
            arrivals.append((delay_s + rng.uniform(0.0, DOUBLED_WITHIN_S), data))
        return arrivals

    def _corrupted(self, data: bytes) -> bytes:
        if not data or not self.law.corrupt or self._random.random() >= self.law.corrupt:
            return data
        spoilt = bytearray(data)
        spoilt[self._random.randrange(len(data))] ^= 1 << self._random.randrange(8)
        return bytes(spoilt)


GRAMMAR = (
    ("loss=3%", "share of datagrams lost"),
    ("duplicate=1%", "share that arrives twice"),
    ("reorder=1%", "share held back for 80 ms, so that later ones overtake it"),
    ("corrupt=0.1%", "share in which one bit is turned"),
    ("delay=20ms~5ms", "delay, uniform within what follows ~"),
    ("freeze@30s+2s", "at 30 s the program stands still for 2 s; the drives continue"),
    ("crash@60s+5s", "at 60 s the program ends; 5 s later it starts again"),
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
        """Return the law of a wire as it is now."""
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
                _note_path(ways, name, value)
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


def _note_path(ways: dict[str, dict[str, float]], name: str, value: str) -> None:
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
