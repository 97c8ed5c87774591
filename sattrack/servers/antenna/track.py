"""`sattrack track` with an antenna's controller: a pass by trajectory designations over a line.

The controller keeps its antenna's limits, which are not known here. A pass that leads an optical telescope
into the cone about the Sun, or below the floor, is not begun.
"""

from __future__ import annotations

import select
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sattrack.core import local_time
from sattrack.core.angles import altitude_deg, separation_deg
from sattrack.core.clock import SystemClock
from sattrack.core.errors import BadInputError, SafetyLimitError, SattrackError
from sattrack.core.realtime import undisturbed
from sattrack.runtime.facts import choose_pass, plan_for
from sattrack.runtime.flight import age_days, source_fields
from sattrack.runtime.system import StopRequest, stopping
from sattrack.safety.bodies import moon_over, sun_over
from sattrack.servers.antenna.antcn import Antcn, AntcnRun
from sattrack.servers.antenna.protocol import encode
from sattrack.settings import NO_ELEMENTS, NO_SITE
from sattrack.views.run import DatagramsView, Summary
from tle.bias import Bias
from tle.instants import Utc
from tle.propagator import Propagator
from tle.refraction import Refraction
from tle.sources import find

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.control.tracker import TrackPlan
    from sattrack.runtime.facts import RunRequest
    from sattrack.safety import SafetyLimits
    from sattrack.servers.antenna.serve import AntennaUrl, CallerLine
    from tle.site import Site

ON_TARGET_ARCSEC = 15.0
"""Half of a tenth of a beam of five minutes: chords a second long stray by some seconds of arc themselves."""
LOUD_CLOCK_S = 0.01
RECONNECT_EVERY_S = 1.0
LOOK_S = 1.0
SUN_DOWN_DEG = -3.0
LONGEST_WAIT_S = 0.1


@dataclass(frozen=True, slots=True)
class AntennaPass:
    """A pass ready to be followed by designations."""

    url: AntennaUrl
    propagator: Propagator
    bias: Bias
    plan: TrackPlan
    max_alt_deg: float

    def path(self, utc_s: float) -> tuple[float, float]:
        """Return both axes' positions of the satellite at an instant."""
        seen = self.propagator.at(Utc(utc_s), self.bias)
        if self.url.axes == "azel":
            return float(seen.az_deg), float(seen.alt_deg)
        return float(seen.ha_deg), float(seen.dec_deg)


def prepare_pass(request: RunRequest, url: AntennaUrl, limits: SafetyLimits) -> AntennaPass:
    """Resolve a request, opening no line. Raises SattrackError and its kinds, or TleError."""
    if request.elements is None:
        raise BadInputError(NO_ELEMENTS)
    if request.site is None:
        raise BadInputError(NO_SITE)
    if request.clock_option is not None:
        raise BadInputError("--clock is for simulated mounts only; a real mount follows the real sky")
    if request.virtual or request.record is not None:
        option = "--virtual" if request.virtual else "--record"
        raise BadInputError(f"{option} does not go with an antenna's controller; leave it out")
    if request.min_alt_deg < limits.floor_altitude_deg:
        raise BadInputError(
            f"--min-alt {request.min_alt_deg:g}: the mount is kept above {limits.floor_altitude_deg:g}°"
        )
    now = Utc(SystemClock().utc_s(time.monotonic()))
    satellite = find(request.elements, request.satellite)
    satellite_pass = choose_pass(satellite, request.site, now, request.min_alt_deg)
    air = None if request.refraction == "off" else Refraction.standard(request.site.height_m)
    ready = AntennaPass(
        url,
        Propagator(satellite, request.site, refraction=air),
        Bias(request.bias_along_s, request.bias_cross_deg),
        plan_for(satellite_pass, now, satellite),
        float(satellite_pass.max_alt_deg),
    )
    check_bodies(ready, limits, request.site)
    return ready


def check_bodies(ready: AntennaPass, limits: SafetyLimits, site: Site) -> None:
    """Raise SafetyLimitError for a pass that leads into a forbidden cone."""
    bodies = (
        ("Sun", limits.sun_deg, sun_over(site.latitude_deg, site.longitude_deg)),
        ("Moon", limits.moon_cone_deg, moon_over(site.latitude_deg, site.longitude_deg)),
    )
    for name, cone_deg, body in bodies:
        if cone_deg == 0.0:
            continue
        utc_s = ready.plan.start_utc_s
        while utc_s <= ready.plan.end_utc_s:
            there = body.at(utc_s)
            seen = ready.propagator.at(Utc(utc_s), ready.bias)
            apart = separation_deg(
                float(seen.ha_deg), float(seen.dec_deg), there.hour_angle_deg, there.dec_deg
            )
            up = altitude_deg(there.hour_angle_deg, there.dec_deg, site.latitude_deg) > SUN_DOWN_DEG
            if up and apart < cone_deg:
                raise SafetyLimitError(
                    f"the pass comes within {apart:.1f}° of the {name} at {local_time.instant(utc_s)}; "
                    f"{cone_deg:g}° are kept: see [safety] in sattrack.toml"
                )
            # The two cannot come nearer than this within the next step.
            utc_s += max(LOOK_S, min(60.0, (apart - cone_deg) / 3.0))


@dataclass(slots=True)
class AntennaFlight:
    """The loop of one pass: one line, one `select`."""

    ready: AntennaPass
    stop: StopRequest
    show: Callable[[AntcnRun, float], None]
    run: AntcnRun = field(init=False)
    sent: int = 0
    _channel: CallerLine | None = None
    _next_try_s: float = 0.0

    def fly(self) -> Summary:
        """Follow the pass to its end. Raises SattrackError or its kinds where the first connection fails."""
        clock, ready = SystemClock(), self.ready
        self._channel = ready.url.connect()
        started_utc_s = clock.utc_s(time.monotonic())
        line = Antcn(ready.url.character_s, ready.url.check, per_character=ready.url.per_character)
        plan = ready.plan
        self.run = AntcnRun(
            line,
            ready.path,
            plan.start_utc_s,
            plan.end_utc_s,
            ON_TARGET_ARCSEC,
            started_utc_s,
            interval_s=ready.url.interval_s,
        )
        try:
            with undisturbed(), stopping(self.stop):
                self._send(self.run.begin(clock.utc_s(time.monotonic())))
                while not self.run.finished:
                    self._guarded(self._turn, clock)
                    self._guarded(self._show, clock)
        finally:
            if self._channel is not None:
                self._channel.close()
        return self._summary(started_utc_s, clock.utc_s(time.monotonic()))

    def warnings(self) -> list[str]:
        """Return the warnings after the pass."""
        if self.run.clock_gap_s <= LOUD_CLOCK_S:
            return []
        return [f"the controller's clock is off ours by {self.run.clock_gap_s:.3f} s at least"]

    def _guarded(self, part: Callable[[SystemClock], None], clock: SystemClock) -> None:
        """Do one part of the loop; an error in it stops the antenna."""
        try:
            part(clock)
        except Exception as error:
            if self.run.ended_by is None:
                self.run.end("error", clock.utc_s(time.monotonic()), str(error))
            elif part == self._turn:
                # The part that carries out the stop fails itself.
                self._send(encode("STOP", self.run.line.check))
                raise

    def _show(self, clock: SystemClock) -> None:
        self.show(self.run, clock.utc_s(time.monotonic()))

    def _turn(self, clock: SystemClock) -> None:
        now_utc_s = clock.utc_s(time.monotonic())
        wait_s = max(0.0, min(LONGEST_WAIT_S, self.run.due_utc_s(now_utc_s) - now_utc_s))
        if self._channel is None:
            self._reconnect(now_utc_s)
            time.sleep(min(wait_s, LONGEST_WAIT_S) if self._channel is None else 0.0)
        elif select.select([self._channel], [], [], wait_s)[0]:
            self._listen(self._channel, clock)
        now_utc_s = clock.utc_s(time.monotonic())
        if self.stop.asked:
            self.run.end("operator", now_utc_s)
        self._send(self.run.tick(now_utc_s))

    def _listen(self, channel: CallerLine, clock: SystemClock) -> None:
        data = channel.read()
        now_utc_s = clock.utc_s(time.monotonic())
        if data is not None:
            self.run.receive(data, now_utc_s)
            return
        channel.close()
        self._channel = None
        self.run.end("link", now_utc_s, "the antenna's controller hung up")

    def _reconnect(self, now_utc_s: float) -> None:
        if now_utc_s < self._next_try_s:
            return
        self._next_try_s = now_utc_s + RECONNECT_EVERY_S
        try:
            self._channel = self.ready.url.connect()
        except SattrackError:
            return
        self._send(self.run.begin(now_utc_s))

    def _send(self, data: bytes) -> None:
        while data and self._channel is not None:
            self.sent += 1
            written = self._channel.write(data)
            data = data[written:]
            if data:
                select.select([], [self._channel], [], LONGEST_WAIT_S)

    def _summary(self, started_utc_s: float, ended_utc_s: float) -> Summary:
        run, ready = self.run, self.ready
        acquired = None
        if run.acquired_utc_s is not None and run.followable_utc_s is not None:
            acquired = round(run.acquired_utc_s - run.followable_utc_s, 3)
        message = run.message
        if message is None and run.ended_by == "set" and run.acquired_utc_s is None:
            message = "the pass ended before the antenna was on the satellite"
        return Summary(
            name=ready.propagator.elements.label,
            catalog_number=ready.propagator.elements.catalog_number or None,
            mount=ready.url.text,
            started_utc=Utc(started_utc_s).isoformat("milliseconds"),
            ended_utc=Utc(ended_utc_s).isoformat("milliseconds"),
            ended_by=run.ended_by or "error",
            samples=run.reported.count,
            on_target_s=round(run.on_target_s, 3),
            acquired_after_s=acquired,
            reported_rms_arcsec=run.reported.rms_arcsec,
            reported_peak_arcsec=run.reported.peak_arcsec,
            true_rms_arcsec=None,
            true_peak_arcsec=None,
            period_ms=None,
            datagrams=DatagramsView(
                sent=self.sent,
                received=run.answered,
                lost=run.line.time_outs,
                late=0,
                duplicate=0,
                rejected=run.line.garbled + run.refused,
            ),
            bias_along_s=ready.bias.along_s,
            bias_cross_deg=ready.bias.cross_deg,
            recording=None,
            mount_stopped=run.mount_stopped,
            message=message,
            elements_age_days=age_days(ready.propagator.elements, started_utc_s),
            **source_fields(ready.propagator.elements, 0.5 * (ready.plan.start_utc_s + ready.plan.end_utc_s)),
        )
