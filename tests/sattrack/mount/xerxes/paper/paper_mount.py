"""A stand-in for the mount, written from the paper alone: raw bytes in, raw bytes out, axes without inertia.

Source: Van Deventer, "Xerxes Mount Control Protocol". Mailbox and 50 ms loop: "Mount Control Design Theory of
Operation". Rising edge, acknowledgement, its removal, one command serviced at a time: "Details". Where the
paper is silent the stand-in does the plainest thing: a slew asked for while slewing is neither launched nor
acknowledged ("Ignore if still slewing"), an abort leaves the drives at rest, park cuts them until a restart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from paper_packing import IN_THE_CODE, TRUE, CommandRow, MountGlobals, pack_datagram, unpack_command

if TYPE_CHECKING:
    from collections.abc import Collection

LOOP_S = 0.05
""" "A timer loop running at 50ms"."""
TICS = 2**26
SIDEREAL_DTICS = 7789
"""Sidereal rate as the paper rounds it, tics per second x 10; the stand-in's sky turns at this rate."""
DEG_PER_DTIC = 360.0 / TICS / 10.0
SIDEREAL_DEG_S = SIDEREAL_DTICS * DEG_PER_DTIC
GUIDE_DTICS = 3500
"""Hard-coded in the paper's mount."""
PRIORITY = (
    "AbortSlewCmd",
    "ParkCmd",
    "FindHomeCmd",
    "SlewToTargetCmd",
    "MoveAxis",
    "SyncToTargetCmd",
    "PulseGuideCmd",
)
"""Only that there is an order is in the paper; MoveAxis is "a composite command" of two flags."""
ACKS = {
    "AbortSlewCmd": "AckAbortCmd",
    "SyncToTargetCmd": "AckSyncCmd",
    "PulseGuideCmd": "AckPulseGuideCmd",
    "SlewToTargetCmd": "AckSlewCmd",
    "MoveAxisRA": "AckMoveAxisRACmd",
    "MoveAxisDec": "AckMoveAxisDecCmd",
}
"""The commands that the status acknowledges."""
SLEW_DEG_S = 10.0


def groups(up: Collection[str]) -> frozenset[str]:
    """Commands whose flags are up, the two of MoveAxis as the one that they are."""
    return frozenset("MoveAxis" if name.startswith("MoveAxis") else name for name in up)


@dataclass(frozen=True)
class Launch:
    """One command launched: in which turn of the loop, which, with what in the datagram."""

    loop: int
    command: str
    row: CommandRow


@dataclass
class PaperMount:
    """The stand-in. `silent` commands are launched and not acknowledged, `sticky` ones acknowledged forever.

    `deaf` hears nothing; `stuck` never ends a slew or a pulse; `unmoved` acknowledges a sync without obeying.
    """

    move_axis: Literal["held", "edge"] = "held"
    ra_deg: float = 150.0
    dec_deg: float = 20.0
    ack_after: int = 0
    silent: frozenset[str] = frozenset()
    sticky: frozenset[str] = frozenset()
    deaf: bool = False
    stuck: bool = False
    unmoved: bool = False
    lst_deg: float = 120.0
    loop: int = 0
    count: int = 0
    refused: int = 0
    restarts: int = 0
    launches: list[Launch] = field(default_factory=list)
    ignored: list[Launch] = field(default_factory=list)
    crowded: int = 0
    """Turns of the loop that found more than one command active."""
    mailbox: CommandRow = field(default_factory=CommandRow)
    before: CommandRow = field(default_factory=CommandRow)
    acks: dict[str, int] = field(default_factory=dict)
    target_deg: tuple[float, float] | None = None
    last_target: tuple[float, float] = (0.0, 0.0)
    rates_deg_s: dict[str, float] = field(default_factory=dict)
    """MoveAxis rates in force, by axis."""
    pulse_s: dict[str, float] = field(default_factory=dict)
    """What is left of the pulses, by axis."""
    pulse_ms: tuple[int, int] = (0, 0)
    """Durations of the pulse that was launched last."""
    stopping_loops: int = 8
    """How long an abort takes: it "will slow and then stop drive"."""
    stopping: int = 0
    going_deg_s: tuple[float, float] = (0.0, 0.0)
    """Rates from which the drives slow down."""
    resting: bool = False
    powered: bool = True
    types: dict[str, Literal["long", "double"]] = field(default_factory=lambda: dict(IN_THE_CODE))
    """How the doubtful fields of the status are packed."""
    true_byte: int = TRUE

    def receive(self, data: bytes) -> bool:
        """ "The inbound message should be thought of as a mailbox": the latest is what there is."""
        if self.deaf:
            return False
        try:
            row = unpack_command(data)
        except ValueError:
            self.refused += 1
            return False
        self.mailbox = row
        return True

    def restart(self) -> None:
        """Power off and on: flags, acknowledgements, motion and count are gone, the axes stand as they do."""
        self.restarts += 1
        self.count = 0
        self.mailbox = CommandRow()
        self.before = CommandRow()
        self.acks.clear()
        self.rates_deg_s.clear()
        self.pulse_s.clear()
        self.target_deg = None
        self.stopping = 0
        self.resting = False
        self.powered = True

    @property
    def moving(self) -> bool:
        """Whether Slewing is told: a slew, MoveAxis, or slowing down from them."""
        return self.target_deg is not None or bool(self.rates_deg_s) or self.stopping > 0

    def turn(self, seconds: float = LOOP_S) -> bytes:
        """Run the loop once and pack the status."""
        self.loop += 1
        self.count += 1
        self._move(seconds)
        self._obey(self.mailbox)
        return self.status()

    def _move(self, seconds: float) -> None:
        self.lst_deg = (self.lst_deg + SIDEREAL_DEG_S * seconds) % 360.0
        self.stopping = max(0, self.stopping - 1)
        for axis in [axis for axis, left in self.pulse_s.items() if left <= 0.0 and not self.stuck]:
            del self.pulse_s[axis]
        if self.target_deg is not None:
            self._slew(self.target_deg, SLEW_DEG_S * seconds)
            return
        ra, dec = self._drives()
        self.ra_deg = (self.ra_deg + (SIDEREAL_DEG_S - ra) * seconds) % 360.0
        self.dec_deg = max(-90.0, min(90.0, self.dec_deg + dec * seconds))
        for axis in self.pulse_s:
            self.pulse_s[axis] -= seconds

    def _slew(self, target: tuple[float, float], reach_deg: float) -> None:
        ra_left = math.remainder(target[0] - self.ra_deg, 360.0)
        dec_left = target[1] - self.dec_deg
        self.ra_deg = (self.ra_deg + max(-reach_deg, min(reach_deg, ra_left))) % 360.0
        self.dec_deg += max(-reach_deg, min(reach_deg, dec_left))
        if max(abs(ra_left), abs(dec_left)) <= reach_deg and not self.stuck:
            self.ra_deg, self.dec_deg = target
            self.target_deg = None

    def _drives(self) -> tuple[float, float]:
        """Rates of hour angle and declination axis, degrees per second; MoveAxis adds to tracking."""
        if not self.powered:
            return 0.0, 0.0
        if self.resting:
            left = self.stopping / self.stopping_loops
            return self.going_deg_s[0] * left, self.going_deg_s[1] * left
        if self.target_deg is not None:
            ra_left = math.remainder(self.target_deg[0] - self.ra_deg, 360.0)
            dec_left = self.target_deg[1] - self.dec_deg
            return (
                SIDEREAL_DEG_S - math.copysign(min(SLEW_DEG_S, abs(ra_left) / LOOP_S), ra_left),
                math.copysign(min(SLEW_DEG_S, abs(dec_left) / LOOP_S), dec_left),
            )
        ra = SIDEREAL_DEG_S + self.mailbox.RAFineRate * DEG_PER_DTIC + self.rates_deg_s.get("RA", 0.0)
        dec = self.mailbox.DecFineRate * DEG_PER_DTIC + self.rates_deg_s.get("Dec", 0.0)
        guide = GUIDE_DTICS * DEG_PER_DTIC
        # Negative is east: the hour angle falls.
        ra += math.copysign(guide, self.pulse_ms[0]) if "RA" in self.pulse_s else 0.0
        dec += math.copysign(guide, self.pulse_ms[1]) if "Dec" in self.pulse_s else 0.0
        return ra, dec

    def _obey(self, row: CommandRow) -> None:
        up, was_up = row.up(), self.before.up()
        for name in [name for name in self.acks if name not in up and name not in self.sticky]:
            del self.acks[name]
        active = groups(up - {"spare"})
        self.crowded += len(active) > 1
        going = self._drives() if self.moving else (0.0, 0.0)
        self._hold_axes(row)
        for command in PRIORITY:
            if command in active:
                edges = [n for n in up - was_up if n == command or groups([n]) == {command}]
                if edges:
                    if command == "AbortSlewCmd" and self.stopping == 0 and any(going):
                        self.stopping, self.going_deg_s = self.stopping_loops, going
                    self._launch(command, edges, row)
                break
        self.before = row

    def _launch(self, command: str, edges: list[str], row: CommandRow) -> None:
        launch = Launch(self.loop, command, row)
        if (command == "SlewToTargetCmd" and self.moving) or (not self.powered and command != "AbortSlewCmd"):
            self.ignored.append(launch)
            return
        self.launches.append(launch)
        for name in edges:
            if name in ACKS and name not in self.silent:
                self.acks[name] = self.loop + self.ack_after
        match command:
            case "AbortSlewCmd":
                self.resting = True
                self.target_deg = None
                self.rates_deg_s.clear()
                self.pulse_s.clear()
            case "ParkCmd":
                self.powered = False
                self.target_deg = None
                self.rates_deg_s.clear()
            case "SlewToTargetCmd":
                self.resting = False
                self.target_deg = self.last_target = (row.TargetRA * 15.0, row.TargetDec)
            case "SyncToTargetCmd":
                self.last_target = (row.TargetRA * 15.0, row.TargetDec)
                if not self.unmoved:
                    self.ra_deg, self.dec_deg = self.last_target
            case "PulseGuideCmd":
                self.pulse_ms = (row.PulseGuideRADuration, row.PulseGuideDecDuration)
                for axis, duration in zip(("RA", "Dec"), self.pulse_ms, strict=True):
                    if duration != 0:
                        self.pulse_s[axis] = abs(duration) / 1000.0
            case "MoveAxis":
                self.resting = False
                self.target_deg = None
                self._latch(edges, row)

    def _latch(self, edges: list[str], row: CommandRow) -> None:
        """Take the rates of the axes whose flags rise; by the edge reading 0 ends MoveAxis."""
        for name in edges:
            axis, rate = ("RA", row.MoveAxisRateRA) if name == "MoveAxisRA" else ("Dec", row.MoveAxisRateDec)
            self.rates_deg_s.pop(axis, None)
            if rate != 0.0 or self.move_axis == "held":
                self.rates_deg_s[axis] = rate

    def _hold_axes(self, row: CommandRow) -> None:
        """Held reading: a falling flag ends, a flag that stays up gives the latest rate."""
        if self.move_axis == "edge":
            return
        flags = (("RA", row.MoveAxisRA, row.MoveAxisRateRA), ("Dec", row.MoveAxisDec, row.MoveAxisRateDec))
        for axis, up, rate in flags:
            if not up:
                self.rates_deg_s.pop(axis, None)
            elif axis in self.rates_deg_s:
                self.rates_deg_s[axis] = rate

    def status(self) -> bytes:
        """Pack what Appendix A packs."""
        ra, dec = self._drives()
        seen = {name for name, loop in self.acks.items() if loop <= self.loop}
        moving_ra = self.target_deg is not None or "RA" in self.rates_deg_s or self.stopping > 0
        data = pack_datagram(
            MountGlobals(
                Alt=45.0,
                Az=180.0,
                CurrentDec=self.dec_deg,
                CurrentDecSpeed=round(dec / DEG_PER_DTIC),
                CurrentRA=self.ra_deg / 15.0,
                CurrentRASpeed=round(ra / DEG_PER_DTIC),
                CurLST=self.lst_deg / 15.0,
                Latitude=48.0,
                Longitude=11.0,
                Height=500.0,
                TargetDec=self.last_target[1],
                TargetRA=self.last_target[0] / 15.0,
                MasterTicCount=self.count,
                GuideRateDec=GUIDE_DTICS,
                GuideRateRA=GUIDE_DTICS,
                DecRawCurrent=60,
                RARawCurrent=70,
                IsRAPulseGuiding="RA" in self.pulse_s,
                IsDecPulseGuiding="Dec" in self.pulse_s,
                RASlewInProgress=moving_ra,
                DecSlewInProgress=moving_ra or "Dec" in self.rates_deg_s,
                types=self.types,
                **{ack: command in seen for command, ack in ACKS.items()},
            )
        )
        if self.true_byte == TRUE:
            return data
        return data[:136] + bytes(self.true_byte if flag else 0 for flag in data[136:])
