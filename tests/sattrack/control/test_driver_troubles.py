"""Whatever moves a mount, what goes wrong with the mount brings it to rest in the same way and time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import msgspec
import pytest

from sattrack.calibration.calibrator import Calibrator
from sattrack.calibration.guard import Surroundings
from sattrack.control.console import Console
from sattrack.control.driver import FOUND_MOVING
from sattrack.control.engine_view import view_of
from sattrack.control.manual_operation import ConsoleSession, ManualOperation
from sattrack.control.procedures import MoveFor
from sattrack.mount.model import DTICS_S_PER_DEG_S, SIDEREAL_RATE_DEG_S, STATUS_LOST_S, MountProfile, Status
from sattrack.mount.requests import MoveAxis
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite, StartPosition
from sattrack.mount.xerxes.datagrams import (
    Command,
    decode_command,
    decode_status,
    encode_command,
    encode_status,
)
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunRequest, build_engine, prepare
from sattrack.safety import SafetyLimits
from sattrack.servers.alpaca.protocol import MoveOrder, NumberedOrder
from sattrack.servers.alpaca.station import TelescopeStation
from sattrack.servers.antenna.controller import AntennaStation
from sattrack.servers.antenna.equipment import Antenna, Focuser, SimulatedFocusAxis
from sattrack.servers.antenna.led_mount import axis_range
from sattrack.servers.antenna.protocol import encode, to_ns
from sattrack.servers.antenna.trajectory import SiteSky
from sattrack.servers.rotctld.answers import Client
from sattrack.servers.rotctld.rotator import RotatorStation
from sattrack.views.messages import Jog, StopNow
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable

PERIOD_S = 0.05
SITE = demo_pass.SITE.place()
LIMITS = SafetyLimits(optical=False)
BEGIN_UTC_S = float(Utc.parse("2026-10-02T13:05:00Z").unix_s)
STEADY = 10
"""So many datagrams in a row that move an axis are a motion."""
FASTER_DEG_S = 0.15
REACTS_WITHIN_S = STATUS_LOST_S + 4 * PERIOD_S


class Driver(Protocol):
    """Something that moves a mount."""

    def receive(self, data: bytes, at_s: float) -> None: ...

    def send(self, now_s: float) -> list[bytes]: ...

    def end(self, now_s: float) -> None: ...

    @property
    def over(self) -> bool: ...

    @property
    def at_rest(self) -> bool | None: ...


@dataclass
class Ticked:
    """What has `receive`, `tick`, `finished` and `mount_stopped`; `keep` is said to it every period."""

    part: Any
    keep: Callable[[float], None]
    finish: Callable[[float], None]
    take: Callable[[bytes, float], None]

    def receive(self, data: bytes, at_s: float) -> None:
        self.take(data, at_s)

    def send(self, now_s: float) -> list[bytes]:
        self.keep(now_s)
        datagram = self.part.tick(now_s)
        return [] if datagram is None else [datagram]

    def end(self, now_s: float) -> None:
        self.finish(now_s)

    @property
    def over(self) -> bool:
        return bool(self.part.finished)

    @property
    def at_rest(self) -> bool | None:
        rest: bool | None = self.part.mount_stopped
        return rest


@dataclass
class Calibrating:
    part: Calibrator

    def receive(self, data: bytes, at_s: float) -> None:
        self.part.receive(data, at_s)

    def send(self, now_s: float) -> list[bytes]:
        sent = []
        while self.part.ending is None and self.part.due() <= now_s + PERIOD_S - 0.005:
            at_s = max(now_s, self.part.due())
            sent.append(self.part.tick(at_s))
            self.part.sent(at_s)
        return sent

    def end(self, now_s: float) -> None:
        self.part.stop("by hand")

    @property
    def over(self) -> bool:
        return self.part.ending is not None

    @property
    def at_rest(self) -> bool | None:
        return None if self.part.ending is None else self.part.ending.at_rest


def nothing(now_s: float) -> None:
    """Say nothing."""


def once(what: Callable[[float], object], at_s: float) -> Callable[[float], None]:
    done: list[float] = []

    def keep(now_s: float) -> None:
        if now_s >= at_s and not done:
            done.append(now_s)
            what(now_s)

    return keep


def track() -> tuple[Driver, float]:
    facts = prepare(RunRequest("25544", "sim", None, None, None, 70.0, virtual=True)).facts
    engine = build_engine(facts)
    # It has a minute for its way to where the satellite rises, and takes a part of that.
    begin_utc_s = facts.started_utc_s + 40.0
    return Ticked(engine, nothing, lambda now: engine.operate(StopNow(), now), engine.receive), begin_utc_s


def antenna() -> tuple[Driver, float]:
    profile = MountProfile()
    focuser = Focuser((SimulatedFocusAxis(),))
    parts = Antenna(SiteSky(SITE), "hadec", axis_range(profile, "hadec"), None, None, focuser, "off")
    station = AntennaStation(parts, profile, LIMITS)
    designate = once(lambda now: station.receive_command(encode("TD 50 15 -0.5 0.5"), now), BEGIN_UTC_S + 1.0)
    return Ticked(station, designate, station.end, station.receive), BEGIN_UTC_S


def rotator() -> tuple[Driver, float]:
    station = RotatorStation(SiteSky(SITE), MountProfile(), LIMITS)
    client = Client(1, station.rotator)

    def say(now_s: float) -> None:
        client.receive(b"P 120 40\n")
        client.answer(to_ns(now_s), 1000)

    return Ticked(station, once(say, BEGIN_UTC_S + 1.0), station.end, station.receive), BEGIN_UTC_S


def alpaca() -> tuple[Driver, float]:
    def no_engine(*_: object) -> Any:
        raise ValueError

    station = TelescopeStation(MountProfile(), LIMITS, SITE, "bench", no_engine)
    order = once(lambda now: station.obey(NumberedOrder(1, MoveOrder(1, 0.5)), now), BEGIN_UTC_S + 1.0)
    return Ticked(station, order, station.end, station.receive), BEGIN_UTC_S


def verb() -> tuple[Driver, float]:
    console = Console(MountProfile(), LIMITS, SITE, "bench")
    operation = ManualOperation(console, MoveFor(MoveAxis(0.5, 0.5), 60.0), BEGIN_UTC_S)
    return Ticked(operation, nothing, operation.interrupt, operation.receive), BEGIN_UTC_S


def keys() -> tuple[Driver, float]:
    console_session = ConsoleSession(Console(MountProfile(), LIMITS, SITE, "bench"), BEGIN_UTC_S)

    def jog(now_s: float) -> None:
        if now_s > BEGIN_UTC_S + 1.0 and not console_session.leaving:
            console_session.obey(Jog(0.5, 0.5), now_s)

    return Ticked(console_session, jog, console_session.interrupt, console_session.receive), BEGIN_UTC_S


def calibration() -> tuple[Driver, float]:
    around = Surroundings(SITE.latitude_deg, SITE.longitude_deg, 170.0, -20.0, 180.0)
    return Calibrating(Calibrator(around, BEGIN_UTC_S)), BEGIN_UTC_S


DRIVERS = {
    "track": track,
    "serve antenna": antenna,
    "serve rotctld": rotator,
    "serve alpaca": alpaca,
    "mount move": verb,
    "console": keys,
    "mount calibrate": calibration,
}


@dataclass
class Trouble:
    """What befalls statuses and commands from the instant on in which the mount is in motion."""

    def status(self, status: Status, seconds: float) -> Status | None:
        return status

    def command(self, command: Command, last_move: Command) -> Command:
        return command


@dataclass
class Frozen(Trouble):
    first: Status | None = None

    def status(self, status: Status, seconds: float) -> Status | None:
        self.first = first = self.first or status
        return msgspec.structs.replace(
            status, sidereal_h=first.sidereal_h, ra_h=first.ra_h, dec_deg=first.dec_deg
        )


class Silent(Trouble):
    def status(self, status: Status, seconds: float) -> Status | None:
        return None


@dataclass
class ClockSet(Trouble):
    """The axes stay where they are: their right ascension goes with the clock."""

    by_h: float

    def status(self, status: Status, seconds: float) -> Status | None:
        return msgspec.structs.replace(
            status, sidereal_h=(status.sidereal_h + self.by_h) % 24.0, ra_h=(status.ra_h + self.by_h) % 24.0
        )


@dataclass
class Runaway(Trouble):
    """The mount goes on with its rates, says that it was stopped, and tells the rates of rest."""

    acknowledges: bool = False

    def status(self, status: Status, seconds: float) -> Status | None:
        return msgspec.structs.replace(
            status,
            ack_abort=self.acknowledges,
            ack_move_ra=False,
            ack_move_dec=False,
            slewing=False,
            ra_rate_dtics_s=round(SIDEREAL_RATE_DEG_S * DTICS_S_PER_DEG_S),
            dec_rate_dtics_s=0,
        )

    def command(self, command: Command, last_move: Command) -> Command:
        self.acknowledges = command.abort
        return msgspec.structs.replace(last_move, counter=command.counter)


@dataclass
class Run:
    """One driver and one simulated mount, a turn of each every 50 ms, and a trouble between them."""

    name: str
    trouble: Trouble
    stops: bool = False
    """Whether the driver is told to end when the trouble begins."""
    moving: int = 0
    since_s: float | None = None
    now_s: float = 0.0
    rose: list[float] = field(default_factory=list)
    """When aborts rose, seconds after the trouble began."""
    moves: list[float] = field(default_factory=list)
    """When datagrams asked for motion since."""
    speed_deg_s: float = 0.0
    _abort: bool = False
    _last_move: Command = field(default_factory=Command)

    def __post_init__(self) -> None:
        self.driver, self.now_s = DRIVERS[self.name]()
        place = SimulatedSite(SITE.latitude_deg, SITE.longitude_deg, SITE.height_m)
        start = StartPosition(50.0, 15.0) if self.name != "mount calibrate" else StartPosition(-20.0, 30.0)
        self.mount = SimulatedMount(MountProfile(), place, start)

    def go(self, seconds: float) -> Run:
        """Go on until so many seconds after the trouble began, or until the driver is at its end."""
        turns = 0
        while not self.driver.over and (self.since_s is None or self.now_s - self.since_s < seconds):
            turns += 1
            assert turns < 10_000, "no motion began"
            self._turn()
        return self

    def _turn(self) -> None:
        self.now_s += PERIOD_S
        data, truth = self.mount.tick(self.now_s)
        self.speed_deg_s = max(abs(SIDEREAL_RATE_DEG_S - truth.ra_rate_deg_s), abs(truth.dec_rate_deg_s))
        if self.since_s is None and self.moving >= STEADY and self.speed_deg_s > FASTER_DEG_S:
            self.since_s = self.now_s
            if self.stops:
                self.driver.end(self.now_s)
        if self.since_s is not None:
            told = self.trouble.status(decode_status(data), self.now_s - self.since_s)
            data = b"" if told is None else encode_status(told)
        if data:
            self.driver.receive(data, self.now_s + 0.001)
        for datagram in self.driver.send(self.now_s + 0.002):
            self._carry(datagram)

    def _carry(self, datagram: bytes) -> None:
        command = decode_command(datagram)
        moves = (command.move_ra and abs(command.move_ra_rate_deg_s) > 0.05) or (
            command.move_dec and abs(command.move_dec_rate_deg_s) > 0.05
        )
        self.moving = self.moving + 1 if moves else 0
        if self.since_s is not None:
            seconds = self.now_s - self.since_s
            if command.abort and not self._abort:
                self.rose.append(seconds)
            if moves:
                self.moves.append(seconds)
            command = self.trouble.command(command, self._last_move)
        elif moves:
            self._last_move = command
        self._abort = decode_command(datagram).abort
        self.mount.receive(encode_command(command))


TROUBLES: dict[str, Callable[[], Trouble]] = {
    "frozen": Frozen,
    "silent": Silent,
    "clock ahead": lambda: ClockSet(1.0),
    "clock behind": lambda: ClockSet(-1.0),
}


OWN_LOOPS = ("track", "mount calibrate")
"""Of these a clock that is set is tried both ways by default; of others, which share a driver, one way."""


@pytest.mark.parametrize(
    ("driver", "trouble"),
    [
        pytest.param(driver, trouble, marks=pytest.mark.soak)
        if trouble == "clock ahead" and driver not in OWN_LOOPS
        else (driver, trouble)
        for driver in DRIVERS
        for trouble in TROUBLES
    ],
)
def test_every_driver_stops_the_mount_in_time(driver: str, trouble: str) -> None:
    run = Run(driver, TROUBLES[trouble]()).go(6.0)
    assert run.rose, f"no stop; still asks for motion after {max(run.moves, default=0.0):.2f} s"
    assert run.rose[0] <= REACTS_WITHIN_S
    assert max(run.moves, default=0.0) <= run.rose[0]
    assert run.speed_deg_s < 0.01


@pytest.mark.parametrize("driver", DRIVERS)
def test_no_driver_takes_a_mount_that_runs_on_for_one_at_rest(driver: str) -> None:
    run = Run(driver, Runaway(), stops=True).go(70.0)
    assert run.driver.over
    assert run.driver.at_rest is False
    assert len(run.rose) > 3
    assert run.rose[-1] > 40.0


def taken_over(
    driver: Ticked, begin_utc_s: float, left_deg_s: float, seconds: float
) -> tuple[list[float], int]:
    """Have a driver take over a mount that goes on at a rate, as a program left it.

    Return its speeds, deg/s, and how many datagrams asked for an abort.
    """
    place = SimulatedSite(SITE.latitude_deg, SITE.longitude_deg, SITE.height_m)
    mount = SimulatedMount(MountProfile(move_axis="edge"), place, StartPosition(50.0, 15.0))
    left = Command(counter=1, move_dec=left_deg_s > 0.0, move_dec_rate_deg_s=left_deg_s)
    speeds, aborts = [], 0
    for turn in range(-40, int(seconds / PERIOD_S)):
        now_s = begin_utc_s + turn * PERIOD_S
        data, truth = mount.tick(now_s)
        if turn < 0:
            mount.receive(encode_command(left))
            continue
        speeds.append(abs(truth.dec_rate_deg_s))
        driver.take(data, now_s + 0.001)
        datagram = driver.part.tick(now_s + 0.002)
        if datagram is not None:
            aborts += decode_command(datagram).abort
            mount.receive(datagram)
    assert speeds[0] == pytest.approx(left_deg_s, abs=1e-3)
    return speeds, aborts


def early_track() -> tuple[Ticked, float]:
    """A run that has ten minutes until it may slew to where the satellite rises."""
    facts = prepare(RunRequest("25544", "sim", None, None, None, 70.0, virtual=True)).facts
    profile, now_s = MountProfile(move_axis="edge"), facts.plan.start_utc_s - 660.0
    engine = build_engine(msgspec.structs.replace(facts, profile=profile, started_utc_s=now_s))
    return Ticked(engine, nothing, nothing, engine.receive), now_s


ALONE: dict[str, Callable[[], tuple[Any, float]]] = {
    "track": early_track,
    "serve antenna": antenna,
    "serve rotctld": rotator,
    "serve alpaca": alpaca,
}


@pytest.mark.parametrize(("left_deg_s", "within_s"), [(6.0, 3.0), (0.5, 1.5), (0.02, 12.0)])
@pytest.mark.parametrize("name", ALONE)
def test_who_takes_over_a_mount_in_motion_and_works_alone_brings_it_to_rest(
    name: str, left_deg_s: float, within_s: float
) -> None:
    speeds, _ = taken_over(*ALONE[name](), left_deg_s, within_s + 1.0)
    assert max(speeds[-20:]) < 0.001


@pytest.mark.parametrize("name", ALONE)
def test_who_takes_over_a_mount_at_rest_leaves_it_there(name: str) -> None:
    assert taken_over(*ALONE[name](), 0.0, 13.0)[1] == 0


def test_who_watches_a_mount_leaves_its_motion_to_whoever_moves_it() -> None:
    driver, begin_utc_s = DRIVERS["console"]()
    assert isinstance(driver, Ticked)
    speeds, aborts = taken_over(driver, begin_utc_s, 0.5, 13.0)
    assert min(speeds) > 0.4
    assert aborts == 0


def test_a_run_says_that_it_stopped_what_another_program_left_moving() -> None:
    driver, begin_utc_s = early_track()
    taken_over(driver, begin_utc_s, 0.5, 2.0)
    assert FOUND_MOVING in view_of(driver.part, begin_utc_s + 2.0).warnings
