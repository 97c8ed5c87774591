"""A session, the gateway's bridge and a simulated Alpaca telescope in virtual time, HTTP's ways included.

Requests take half of the telescope's latency each way, with its jitter; the gateway's turns are uneven by
TURN_JITTER_S, as an event loop's are. The truth is that of the simulated axes.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field, replace
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any

import msgspec
from strangers.alpaca_two_axes import Parameters, Telescope

from sattrack.calibration.calibrator import Calibrator
from sattrack.calibration.findings import Findings, conclude, dated_by_requests
from sattrack.calibration.guard import Plan, Surroundings
from sattrack.calibration.profile import bounded, calibrated
from sattrack.control.target import sky_error
from sattrack.core.figures import RunningError
from sattrack.mount.alpaca.bridge import Bridge
from sattrack.mount.alpaca.device import DeviceFacts, DeviceState, RateSpan, SkyPlace
from sattrack.mount.alpaca.link import AlpacaAddress
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import SitePlace
from sattrack.mount.simulator.alpaca_telescope import (
    RefusedError,
    SimulatedPlace,
    SimulatedTelescope,
    TelescopeSettings,
)
from sattrack.runtime.facts import RunRequest, build_engine, prepare, suited_to

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.alpaca.bridge import Order
    from sattrack.mount.model import MountProfile

TURN_JITTER_S = 0.001
LOOPBACK_S = 0.0002
LOOK_EVERY_S = 0.02


def address(settings: TelescopeSettings, hz: float = 10.0) -> AlpacaAddress:
    return AlpacaAddress("192.0.2.9", 11111, 0, hz, settings.longitude_deg)


def facts_of(settings: TelescopeSettings) -> DeviceFacts:
    """What the telescope would tell over HTTP."""
    spans = tuple(RateSpan(low, high) for low, high in settings.rates_deg_s)
    return DeviceFacts(
        equatorial_system=2 if settings.system == "j2000" else 1,
        latitude_deg=settings.latitude_deg,
        longitude_deg=settings.longitude_deg,
        can_set_tracking=True,
        can_slew=True,
        can_sync=True,
        primary_rates=spans,
        secondary_rates=spans,
    )


class TwoAxes:
    """A stranger's telescope (`strangers/alpaca_two_axes.py`) in virtual time, for `VirtualTelescope`."""

    def __init__(self, parameters: Parameters, utc_s: float) -> None:
        self.scope = Telescope(parameters, utc_s)

    @property
    def connected(self) -> bool:
        return self.scope.connected

    @connected.setter
    def connected(self, value: bool) -> None:
        self.scope.connected = value

    @property
    def parked(self) -> bool:
        return self.scope.parked

    def truth(self, utc_s: float) -> SimulatedPlace:
        self.scope.advance(utc_s)
        return SimulatedPlace(self.scope.now_s, *self.scope.equatorial(self.scope.now_s))

    reported = truth

    def slewing(self, utc_s: float) -> bool:
        self.scope.advance(utc_s)
        return self.scope.slewing()

    def tracks(self) -> bool:
        return self.scope.tracking

    def track(self, on: bool, utc_s: float) -> None:
        self.scope.advance(utc_s)
        self.scope.tracking = on

    def move_axis(self, axis: int, rate_deg_s: float, utc_s: float) -> None:
        self.scope.advance(utc_s)
        self.scope.move_axis(axis, rate_deg_s)

    def abort(self, utc_s: float) -> None:
        self.scope.advance(utc_s)
        self.scope.moving, self.scope.aim = [None, None], None


@dataclass
class VirtualTelescope:
    """Gateway and telescope; `deliver` hears each status with its instant."""

    settings: TelescopeSettings
    begin_utc_s: float
    hz: float
    deliver: Callable[[bytes, float], None]
    device: Any = None
    """The telescope, if it is no `SimulatedTelescope` of the settings."""
    queue: list[tuple[float, int, Callable[[float], None]]] = field(default_factory=list)
    _number: int = 0

    def __post_init__(self) -> None:
        self.telescope: Any = self.device or SimulatedTelescope(self.settings, self.begin_utc_s)
        self.telescope.connected = True
        self.bridge = Bridge(facts_of(self.settings), self.settings.longitude_deg)
        self._random = random.Random(self.settings.seed)
        self._waiting: dict[str, list[Order]] = {"ra": [], "dec": [], "rest": []}
        self._busy = {"ra": False, "dec": False, "rest": False}
        self._reading = False
        self.refusals: list[str] = []
        self.at(self.begin_utc_s + 0.0137, self._turn)

    def at(self, utc_s: float, happen: Callable[[float], None]) -> None:
        self._number += 1
        heappush(self.queue, (utc_s, self._number, happen))

    def next(self) -> float:
        utc_s, _, happen = heappop(self.queue)
        happen(utc_s)
        return utc_s

    def hear(self, datagram: bytes, utc_s: float) -> None:
        self.at(utc_s + LOOPBACK_S, lambda now: self.bridge.hear(datagram, now))

    def _way(self) -> float:
        jitter = self._random.uniform(-self.settings.jitter_s, self.settings.jitter_s)
        share = self.settings.held_up_share
        held_up_s = self.settings.held_up_s if share and self._random.random() < share else 0.0
        return max(0.0, self.settings.latency_s / 2.0 + jitter) + held_up_s

    def _turn(self, now: float) -> None:
        for order in self.bridge.turn(now):
            waiting = self._waiting[order.lane]
            if order.lane != "rest":
                waiting.clear()
            waiting.append(order)
            self._work(order.lane, now)
        if not self._reading:
            self._reading = True
            self._read(now)
        due = self.begin_utc_s + (round((now - self.begin_utc_s) * self.hz) + 1) / self.hz
        self.at(due + 0.0137 + self._random.uniform(0.0, TURN_JITTER_S), self._turn)

    def _work(self, lane: str, now: float) -> None:
        if self._busy[lane] or not self._waiting[lane]:
            return
        self._busy[lane] = True
        order = self._waiting[lane].pop(0)
        self.at(now + self._way(), lambda at: self._do(order, at))

    def _do(self, order: Order, now: float) -> None:
        fields, telescope, refusal = dict(order.fields), self.telescope, None
        try:
            if order.member == "moveaxis":
                telescope.move_axis(int(fields["Axis"]), float(fields["Rate"]), now)
            elif order.member == "slewtocoordinatesasync":
                telescope.slew(float(fields["RightAscension"]) * 15.0, float(fields["Declination"]), now)
            elif order.member == "synctocoordinates":
                telescope.sync(float(fields["RightAscension"]) * 15.0, float(fields["Declination"]), now)
            elif order.member == "tracking":
                telescope.track(fields["Tracking"] == "true", now)
            elif order.member == "abortslew":
                telescope.abort(now)
            else:
                raise AssertionError(order)
        except RefusedError as refused:
            refusal = refused.words
            self.refusals.append(f"{order.member} {fields}: {refusal}")

        def back(at: float) -> None:
            self._busy[order.lane] = False
            self.bridge.answered(order, refusal, at)
            self._work(order.lane, at)

        self.at(now + self._way(), back)

    def _read(self, begun: float) -> None:
        got: dict[str, tuple[float, float]] = {}

        def ask(name: str) -> None:
            def sample(now: float) -> None:
                place = self.telescope.reported(now)
                value = place.ra_deg if name == "ra" else place.dec_deg
                standing = DeviceState(
                    begun, self.telescope.slewing(now), self.telescope.tracks(), self.telescope.parked
                )

                def answered(at: float) -> None:
                    got[name] = (0.5 * (begun + at), value)
                    if len(got) == 2:
                        self.bridge.stand(standing)
                        self._reading = False
                        status = self.bridge.see(SkyPlace(*got["ra"], *got["dec"], at - begun))
                        if status is not None:
                            self.at(at + LOOPBACK_S, lambda now: self.deliver(status, now))

                self.at(now + self._way(), answered)

            self.at(begun + self._way(), sample)

        ask("ra")
        ask("dec")


def calibrate(
    settings: TelescopeSettings, hz: float = 10.0, plan: Plan | None = None, begin_utc_s: float = 1.79e9
) -> tuple[MountProfile, Findings]:
    """Run `mount calibrate` in virtual time; raises AssertionError where it is refused."""
    around = Surroundings(settings.latitude_deg, settings.longitude_deg, 180.0, -20.0, 200.0)
    plan = (plan or Plan()).suited(settings.rates_deg_s[-1][1], 1.0 / hz)
    calibrator = Calibrator(around, begin_utc_s, plan)
    virtual = VirtualTelescope(settings, begin_utc_s, hz, calibrator.receive)
    while calibrator.ending is None:
        due = calibrator.due()
        if virtual.queue and virtual.queue[0][0] < due:
            virtual.next()
            continue
        virtual.hear(calibrator.tick(due), due)
        calibrator.sent(due)
    assert calibrator.ending.kind == "done", calibrator.ending
    assert calibrator.ending.at_rest
    found = conclude(calibrator.seen, settings.longitude_deg, dated_by_requests(calibrator.seen))
    base = bounded(address(settings, hz).usual_profile(), (settings.rates_deg_s[-1][1],) * 2)
    return calibrated(base, found, "found", "bench"), found


@dataclass
class PassResult:
    """How near a pass was followed, arcseconds, and the instants at which errors were taken."""

    true: RunningError
    reported: RunningError
    ended_by: str | None
    stopped: bool | None
    refusals: list[str]
    message: str | None
    errors: list[tuple[float, float]]
    of_first_axis: list[tuple[float, float]] = field(default_factory=list)
    """The same errors, each with how far the tube was from the first axis, degrees: of `TwoAxes` alone."""


def follow_two_axes(
    parameters: Parameters, hz: float = 10.0, seconds: float = 1e9, begins_s: float = 0.0
) -> PassResult:
    """Follow the practice pass with a stranger's two axes, whose geometry the profile has.

    `begins_s` is by how much later than usual the run begins: in the middle of the pass.
    """
    settings = TelescopeSettings()
    geometry = AxisGeometry(parameters.pole_azimuth_deg, parameters.pole_altitude_deg)
    profile = msgspec.structs.replace(
        address(settings, hz).usual_profile(),
        geometry=geometry,
        stands_at=SitePlace(settings.latitude_deg, settings.longitude_deg),
        additive=False,
        command_delay_s=0.5 * settings.latency_s,
        status_delay_s=0.5 * settings.latency_s,
    )
    here = replace(parameters, latitude_deg=settings.latitude_deg, longitude_deg=settings.longitude_deg)
    return follow(settings, profile, hz, seconds, lambda utc_s: TwoAxes(here, utc_s), begins_s)


def follow(
    settings: TelescopeSettings,
    profile: MountProfile,
    hz: float = 10.0,
    seconds: float = 1e9,
    device: Callable[[float], Any] | None = None,
    begins_s: float = 0.0,
    **facts: Any,
) -> PassResult:
    """Follow the practice pass in virtual time; true errors from the first acquisition on.

    `device` makes the telescope at an instant, if it is no `SimulatedTelescope`.
    """
    prepared = prepare(RunRequest("ISS", "sim", None, None, None, min_alt_deg=10.0, virtual=True)).facts
    where = address(settings, hz)
    plan = suited_to(prepared.plan, profile, where.on_target_arcsec)
    made = msgspec.structs.replace(prepared, profile=profile, plan=plan, mount_name=str(where), **facts)
    engine = build_engine(made)
    made = msgspec.structs.replace(made, started_utc_s=made.started_utc_s + begins_s)
    begin = made.started_utc_s
    made_device = None if device is None else device(begin)
    virtual = VirtualTelescope(settings, begin, hz, engine.receive, made_device)
    true, errors = RunningError(), []
    of_first_axis: list[tuple[float, float]] = []

    def client(now: float) -> None:
        if now - begin > seconds and engine.tracker.ended_by is None:
            engine.tracker.end("operator")
        virtual.hear(engine.tick(now), now)
        virtual.at(now + profile.period_s + engine.send_shift_s(now), client)

    def look(now: float) -> None:
        following = engine.tracker.acquired_utc_s is not None and engine.tracker.ended_by is None
        if following:
            place = virtual.telescope.truth(now)
            error = sky_error(now, place.ra_deg, place.dec_deg, engine.tracker.direction_at(now))
            true.add(error.total_arcsec)
            errors.append((now, error.total_arcsec))
            if isinstance(made_device, TwoAxes):
                from_pole_deg = 90.0 - abs(made_device.scope.angles[1])
                of_first_axis.append((error.total_arcsec, from_pole_deg))
        virtual.at(now + LOOK_EVERY_S, look)

    virtual.at(begin, client)
    virtual.at(begin + 0.001, look)
    while not engine.finished:
        virtual.next()
    return PassResult(
        true,
        engine.reported,
        engine.tracker.ended_by,
        engine.mount_stopped,
        virtual.refusals,
        engine.message,
        errors,
        of_first_axis,
    )
