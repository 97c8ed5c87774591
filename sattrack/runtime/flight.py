"""Fly a prepared run, in real or in virtual time, from its first datagram to its summary.

In virtual time, the same engine and the same simulated mount are joined without sockets or waiting; the
mount's timer, the delays and troubles of its link and its faults are those of its hardware's settings.
`what_if` flies a recorded pass so with another control law.
"""

from __future__ import annotations

import queue
import threading
import time
from collections import Counter, deque
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any, Protocol, TypedDict

import msgspec
import numpy as np

from sattrack.control.engine import learnt_view
from sattrack.control.engine_view import estimate_view, loop_view, offset_views, source_file, view_of
from sattrack.control.following import ControlLaw
from sattrack.core.errors import (
    BadInputError,
    InterruptedRunError,
    LinkLostError,
    SafetyLimitError,
    SattrackError,
    error_type,
    meant,
    refused_key,
)
from sattrack.core.figures import RunningError
from sattrack.core.toml_text import read_toml
from sattrack.mount.simulator.installation import Installation
from sattrack.mount.simulator.mount import SimulatedMount
from sattrack.mount.simulator.profile import SimulatorProfile, simulator_profile
from sattrack.mount.xerxes.session import REPEAT_AFTER_PERIODS
from sattrack.recording.fits import AxisFit, fit_axes
from sattrack.recording.format import messages
from sattrack.recording.recorder import BackgroundRecorder, NoRecording, Recorder, Sink, create
from sattrack.recording.replay import Figures, Replay, replay
from sattrack.recording.trace import trace
from sattrack.runtime import demo_pass
from sattrack.runtime.connection import (
    Connection,
    EmbeddedMount,
    owned,
    simulated_site,
    simulator_config,
    start_embedded,
)
from sattrack.runtime.control_arbiter import A_TICK
from sattrack.runtime.facts import RunFacts, build_engine, decode_facts, encode_facts, engine_of
from sattrack.runtime.loop import RealtimeLoop
from sattrack.runtime.system import stopping
from sattrack.views.messages import Message, StopNow
from sattrack.views.run import DatagramsView, PeriodView, Summary
from tle.bodies import Body
from tle.elements import Elements
from tle.ephemeris import expected_error_m
from tle.errors import TleError
from tle.instants import DAY_S, Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from sattrack.control.engine import Engine
    from sattrack.mount.model import MountProfile
    from sattrack.recording.format import Recording
    from sattrack.recording.replay import Choice
    from sattrack.recording.trace import Trace
    from sattrack.runtime.control_arbiter import Observers
    from sattrack.runtime.facts import Prepared
    from sattrack.runtime.mounts import MountAddress
    from sattrack.runtime.system import StopRequest
    from sattrack.views.messages import Reported
    from sattrack.views.run import TrackView
    from tle.ephemeris import Ephemeris


def fly_virtual(
    prepared: Prepared,
    progress: Callable[[TrackView], None] | None = None,
    messages: tuple[tuple[float, Message], ...] = (),
    observers: Observers | None = None,
) -> Summary:
    """Run in virtual time with a simulated mount, as fast as it goes; observations come at their instants."""
    facts = prepared.facts
    with ExitStack() as stack:
        sink = stack.enter_context(_recording(facts, background=False))
        hardware = simulator_profile(prepared.simulator)
        mount = SimulatedMount(facts.profile, simulated_site(facts.site), demo_pass.START, hardware)
        engine = build_engine(facts)
        if observers is not None:
            messages += tuple(_dated(seen, facts) for seen in observers.everything())
            engine.malformed, engine.dropped = observers.malformed, observers.dropped
        run = VirtualRun(engine, mount, facts.started_utc_s, sink, messages, progress)
        ended_utc_s = run.run()
        summary = summarise(run.engine, run.statistics, ended_utc_s)
        summary = _remembered(summary, run.engine, prepared, ended_utc_s)
        sink.summary(ended_utc_s, summary)
    return msgspec.structs.replace(summary, recording_trouble=sink.trouble)


def fly_live(
    prepared: Prepared,
    show: Callable[[TrackView], None],
    stop: StopRequest,
    inbox: Inbox | None = None,
    deadline_s: float = float("inf"),
    observers: Observers | None = None,
) -> Summary:
    """Run in real time, over UDP; the simulated mount is started beside it where there is no other.

    Raises SattrackError where the mount has an owner, or a port or the simulated mount is not available.
    """
    facts = in_run_time(prepared.facts, prepared.clock.speed)
    with ExitStack() as stack:
        simulated: EmbeddedMount | None = None
        address: MountAddress | None = prepared.address
        if address is None:
            profile, site = prepared.facts.profile, facts.site.place()
            simulated = start_embedded(simulator_config(profile, prepared.simulator, site, prepared.clock))
            stack.callback(simulated.close)
            address = simulated.address
        link, guard = stack.enter_context(
            owned(address, prepared.facts.profile, prepared.clock.speed, facts.mount_name)
        )
        sink = stack.enter_context(_recording(facts, background=True))
        screen = Screen(show)
        stack.callback(screen.close)
        engine = build_engine(facts)
        connection = Connection(link, prepared.clock, simulated, guard)
        loop = LiveLoop(connection, stop, engine, sink, screen, inbox, deadline_s, observers)
        if observers is not None:
            engine.expect_observations()
        stack.enter_context(stopping(stop))
        ended_utc_s = loop.run()
        summary = summarise(engine, loop.statistics, ended_utc_s)
        trouble = "the simulated mount has ended: nothing moves" if connection.gone else link.trouble
        if summary.message is not None and trouble is not None:
            summary = msgspec.structs.replace(summary, message=f"{summary.message}; {trouble}")
        summary = _remembered(summary, engine, prepared, ended_utc_s)
        if guard.deposed:
            summary = msgspec.structs.replace(summary, mount_stopped=guard.mount_stopped)
        sink.summary(ended_utc_s, summary)
    realtime = loop.grant is not None and loop.grant.realtime
    return msgspec.structs.replace(summary, recording_trouble=sink.trouble, realtime_priority=realtime)


def _remembered(summary: Summary, engine: Engine, prepared: Prepared, ended_utc_s: float) -> Summary:
    """Return the summary with what of the run's bias was kept for the next pass."""
    from sattrack.runtime.bias_memory import keep  # brings SQLite, only needed here

    kept = keep(engine, ended_utc_s, prepared.memory)
    return msgspec.structs.replace(summary, bias_memory=kept)


def _dated(seen: Reported, facts: RunFacts) -> tuple[float, Message]:
    return max(facts.started_utc_s, float(Utc.parse(seen.utc).unix_s)), seen


def in_run_time(facts: RunFacts, speed: float) -> RunFacts:
    """Return the facts for a clock that runs at `speed`: real delays last longer by it."""
    if speed == 1.0:
        return facts
    profile = msgspec.structs.replace(
        facts.profile,
        command_delay_s=facts.profile.command_delay_s * speed,
        status_delay_s=facts.profile.status_delay_s * speed,
    )
    return msgspec.structs.replace(facts, profile=profile)


@contextmanager
def _recording(facts: RunFacts, background: bool) -> Iterator[Sink]:
    if facts.recording is None:
        yield NoRecording()
        return
    from pathlib import Path

    recorder = Recorder(create(Path(facts.recording)), msgspec.Raw(encode_facts(facts)))
    sink: Recorder | BackgroundRecorder = BackgroundRecorder(recorder) if background else recorder
    try:
        yield sink
    finally:
        sink.close()


@dataclass(slots=True)
class RunStatistics:
    """What the loop gathers beside the engine."""

    periods_us: Counter[int] = field(default_factory=Counter)
    """How often each period between two datagrams came, microseconds: few differ in a night."""
    true_error: RunningError = field(default_factory=RunningError)
    strangers: int = 0
    unsent: int = 0
    _last_sent_s: float | None = None

    def note_sent(self, at_s: float) -> None:
        """Note the instant of a send, seconds of the run's clock."""
        if self._last_sent_s is not None:
            self.periods_us[round(1e6 * (at_s - self._last_sent_s))] += 1
        self._last_sent_s = at_s

    def note_truth(self, engine: Engine, counter: int, utc_s: float, ra_deg: float, dec_deg: float) -> None:
        """Note where a simulated mount's axes really were."""
        error = engine.true_error(counter, utc_s, ra_deg, dec_deg)
        if error is not None:
            self.true_error.add(error.total_arcsec)

    def period(self) -> PeriodView | None:
        """Return how regularly datagrams went out, milliseconds; None before the second one."""
        if not self.periods_us:
            return None
        ordered, count = sorted(self.periods_us), self.periods_us.total()

        def below_ms(share: float) -> float:
            left = min(count - 1, int(share * count))
            for us in ordered:
                left -= self.periods_us[us]
                if left < 0:
                    return us / 1000.0
            return ordered[-1] / 1000.0

        return PeriodView(
            p50=below_ms(0.5), p99=below_ms(0.99), p999=below_ms(0.999), max=ordered[-1] / 1000.0
        )


def summarise(engine: Engine, statistics: RunStatistics, ended_utc_s: float) -> Summary:
    """Return the summary of a finished run."""
    spec, tracker, health = engine.spec, engine.tracker, engine.session.health
    acquired = tracker.acquired_utc_s
    followable = tracker.followable_utc_s
    along_s, cross_deg = tracker.steering.biases.totals(ended_utc_s)
    why = engine.why_not_acquired()
    return Summary(
        name=spec.propagator.elements.label,
        catalog_number=spec.propagator.elements.catalog_number or None,
        mount=spec.mount_name,
        started_utc=Utc(spec.started_utc_s).isoformat("milliseconds"),
        ended_utc=Utc(ended_utc_s).isoformat("milliseconds"),
        ended_by=tracker.ended_by or "error",
        samples=engine.reported.count,
        on_target_s=round(engine.on_target_s, 3),
        acquired_after_s=_seconds_between(followable, acquired),
        reported_rms_arcsec=engine.reported.rms_arcsec,
        reported_peak_arcsec=engine.reported.peak_arcsec,
        true_rms_arcsec=statistics.true_error.rms_arcsec,
        true_peak_arcsec=statistics.true_error.peak_arcsec,
        period_ms=statistics.period(),
        datagrams=DatagramsView(
            sent=health.sent,
            received=health.received,
            lost=health.lost,
            late=health.late,
            duplicate=health.duplicate,
            rejected=health.rejected + health.frozen + statistics.strangers,
            unsent=statistics.unsent,
        ),
        bias_along_s=along_s,
        bias_cross_deg=cross_deg,
        offsets=offset_views(tracker, ended_utc_s),
        estimate=estimate_view(tracker, ended_utc_s, engine.malformed + engine.dropped),
        loop=loop_view(tracker, ended_utc_s),
        remembered=tracker.steering.remembered,
        recording=spec.recording,
        mount_stopped=engine.mount_stopped,
        message=engine.message or _never_followed(engine, why),
        held_s={name: round(seconds, 3) for name, seconds in engine.held_s.items()},
        paused_s=round(engine.paused_s, 3),
        rejoining_s=round(engine.rejoining_s, 3),
        lost_peak_arcsec=engine.lost_peak_arcsec if engine.held_s and acquired is not None else None,
        calibrated=spec.profile.calibration is not None,
        learnt=learnt_view(engine),
        why_not_acquired=why,
        elements_age_days=age_days(spec.propagator.elements, spec.started_utc_s),
        **source_fields(spec.propagator.elements, spec.culminate_utc_s),
    )


def age_days(source: Elements | Ephemeris, utc_s: float) -> float | None:
    """Return how old elements are at an instant, days; None for what has no epoch."""
    if not isinstance(source, Elements):
        return None
    return round(float(source.age_s(Utc(utc_s))) / DAY_S, 3)


class SourceFields(TypedDict):
    """What a summary says of the source of a target's place; see `Summary`."""

    source: str
    source_file: str | None
    source_age_s: float | None
    expected_error_m: float | None


def source_fields(source: Elements | Ephemeris, culminate_utc_s: float) -> SourceFields:
    """Return what a summary says of what gave the target's place, as of when the pass was highest."""
    age_s = culminate_utc_s - float(source.epoch.unix_s)
    return {
        "source": source.provenance,
        "source_file": source_file(source),
        "source_age_s": None if isinstance(source, Body) else round(age_s, 3),
        "expected_error_m": expected_error_m(source, Utc(culminate_utc_s)),
    }


def _seconds_between(first_s: float | None, second_s: float | None) -> float | None:
    return None if first_s is None or second_s is None else round(max(0.0, second_s - first_s), 3)


def _never_followed(engine: Engine, why: str | None) -> str | None:
    if engine.tracker.ended_by == "set" and engine.tracker.acquired_utc_s is None:
        paused = f" (it was paused for {engine.paused_s:.0f} s)" if engine.paused_s else ""
        cause = "" if why is None else f": {why}"
        return f"the pass ended before the mount was on the satellite{paused}{cause}"
    return None


def failure(summary: Summary, interrupted: bool) -> SattrackError | None:
    """Return the error whose exit code a run ends with; None where it went as planned."""
    message = summary.message or f"the run ended: {summary.ended_by}"
    if summary.mount_stopped is False:
        message += "; THE MOUNT DID NOT CONFIRM THE STOP: stop it by hand"
    kind = error_type(summary.ended_by)
    if kind in {SafetyLimitError, LinkLostError}:
        return kind(message)
    never_followed = summary.ended_by == "set" and summary.message is not None
    if summary.ended_by == "error" or summary.mount_stopped is False or never_followed:
        return SattrackError(message)
    if interrupted:
        return InterruptedRunError(f"interrupted; {_stop_text(summary)}")
    if summary.recording_trouble is not None:
        return SattrackError(summary.recording_trouble)
    return None


def _stop_text(summary: Summary) -> str:
    return "no mount was ever heard" if summary.mount_stopped is None else "the mount is stopped"


LAST_VIEW_WITHIN_S = 1.0


class Screen:
    """Hands the newest view to `draw` as often as that is ready for one; what it misses is gone.

    A terminal that does not drain blocks the thread that writes to it and nothing else. What `draw` raises is
    raised by the next call of `show`. `show` takes no lock that the thread may hold.
    """

    def __init__(self, draw: Callable[[TrackView], None]) -> None:
        self._draw = draw
        self._newest: deque[TrackView] = deque(maxlen=1)
        self._news: queue.SimpleQueue[bool] = queue.SimpleQueue()
        """True where there is a view, False where there will be no more."""
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._work, name="screen", daemon=True)
        self._thread.start()

    def show(self, view: TrackView) -> None:
        """Take a view, without waiting."""
        if self._error is not None:
            raise self._error
        self._newest.append(view)
        if self._news.empty():
            self._news.put(True)

    def close(self) -> None:
        """Have the last view drawn, if that does not take long."""
        self._news.put(False)
        self._thread.join(LAST_VIEW_WITHIN_S)

    def _work(self) -> None:
        more = True
        while more:
            more = self._news.get()
            try:
                while self._newest:
                    self._draw(self._newest.popleft())
            except Exception as error:  # noqa: BLE001 - it is for the loop to decide what that means
                self._error = error
                return


VIEW_EVERY_TICKS, RECORD_VIEW_EVERY_TICKS = 2, 10
OBSERVATION_S = 0.025
"""An observation that contradicts the estimate takes so long on a busy machine."""


class Inbox(Protocol):
    """Where the operator's messages come from."""

    @property
    def malformed(self) -> int:
        """How many lines were none."""

    def messages(self) -> Sequence[Message]:
        """Return what has come, without waiting."""


@dataclass(slots=True)
class LiveLoop(RealtimeLoop):
    """Feeds one engine until the mount is seen at rest.

    `deadline_s` (monotonic) ends the run like an operator's stop.
    """

    reported = (SattrackError, TleError)

    driver: Engine
    sink: Sink
    screen: Screen
    inbox: Inbox | None = None
    deadline_s: float = float("inf")
    observers: Observers | None = None
    statistics: RunStatistics = field(default_factory=RunStatistics)

    @property
    def over(self) -> bool:
        """See RealtimeLoop. A simulated mount that has ended needs no stop."""
        no_mount = self.driver.stop is not None and self.connection.gone
        return self.driver.finished or self.connection.guard.deposed or no_mount

    def run(self) -> float:
        """Run to the end; return the UTC instant of the end, POSIX seconds."""
        self.feed()
        guard, link = self.connection.guard, self.connection.link
        self.guarded(self.heed_guard)
        if self.over and not guard.deposed:
            guard.release(self.rest)
        self.guarded(self._show_end)
        self.statistics.strangers, self.statistics.unsent = link.strangers, link.unsent
        self.raise_error()
        self.gather()
        return self.connection.now_utc_s()

    def take(self, data: bytes, arrival_utc_s: float) -> None:
        """Record a datagram from the mount, and have the engine take it."""
        self.sink.status(arrival_utc_s, data)
        self.driver.receive(data, arrival_utc_s)

    def interrupt(self, now_utc_s: float) -> None:
        """Have the engine stop the mount, until it does."""
        if self.driver.tracker.ended_by is None:
            self._operate(StopNow(), now_utc_s)

    def fail(self, error: Exception, now_utc_s: float) -> None:
        """Have the engine stop the mount for an error, and record that."""
        self.driver.fail(str(error))
        self.sink.failure(now_utc_s, str(error))

    def obey(self, now_utc_s: float) -> None:
        """Have the engine obey the operator's messages."""
        for message in self.inbox.messages() if self.inbox is not None else ():
            self._operate(message, now_utc_s)
        if time.monotonic() >= self.deadline_s:
            self.interrupt(now_utc_s)
        self.driver.session.health.strangers = self.connection.link.strangers

    def sent(self, now_utc_s: float, datagram: bytes) -> None:
        """Record what was sent, and show how the run stands."""
        self.statistics.note_sent(time.monotonic() * self.connection.clock.speed)
        self.sink.command(now_utc_s, datagram)
        self.driver.prepare(now_utc_s)
        if self.ticks % VIEW_EVERY_TICKS == 0 and not self.driver.failed:
            view = self._with_trouble(view_of(self.driver, now_utc_s))
            self.screen.show(view)
            if self.ticks % RECORD_VIEW_EVERY_TICKS == 0:
                self.sink.view(now_utc_s, view)

    def repeat(self) -> None:
        """Send the last datagram once more where that is wanted, and record it."""
        datagram = self.send_copy(self.driver.repeat)
        if datagram is not None:
            self.sink.repeat(self.connection.now_utc_s(), datagram)

    def report(self) -> None:
        """Take in an observation, and another one where there is time."""
        if self.observers is None:
            return
        next_due_s = self._due_s + self.period_s
        for _ in range(A_TICK):
            for seen in self.observers.observations(1):
                self._operate(seen, self.connection.now_utc_s())
            if next_due_s - time.monotonic() < OBSERVATION_S:
                break
        malformed = 0 if self.inbox is None else self.inbox.malformed
        self.driver.malformed = self.observers.malformed + malformed
        self.driver.dropped = self.observers.dropped

    def shift_s(self, now_utc_s: float) -> float:
        """See RealtimeLoop."""
        return self.driver.send_shift_s(now_utc_s)

    def _operate(self, message: Message, now_utc_s: float) -> None:
        self.sink.operator(now_utc_s, message)
        self.driver.operate(message, now_utc_s)

    def _with_trouble(self, view: TrackView) -> TrackView:
        """Add what is wrong with the recording, or on the way to the mount, to what is shown."""
        troubles = (self.sink.trouble, self.connection.link.trouble)
        shown = tuple(each for each in troubles if each is not None)
        return msgspec.structs.replace(view, warnings=(*view.warnings, *shown)) if shown else view

    def _show_end(self) -> None:
        if not self.driver.failed:
            self.screen.show(view_of(self.driver, self.connection.now_utc_s()))

    def gather(self) -> None:
        """Note where the axes of a simulated mount really were."""
        if self.connection.simulated is None:
            return
        for truth in self.connection.simulated.truths():
            self.statistics.note_truth(self.driver, truth.counter, truth.utc_s, truth.ra_deg, truth.dec_deg)


MOUNT_PHASE_S = 0.0217
"""How far the mount's loop runs behind ours; two free-running loops have no reason to agree."""


@dataclass(slots=True)
class VirtualRun:
    """An engine and a simulated mount, joined by its wires, run from `begin_utc_s` to the mount's rest.

    `messages` are the operator's, each with its instant. `progress` hears views now and then.
    """

    engine: Engine
    mount: SimulatedMount
    begin_utc_s: float
    sink: Sink
    messages: tuple[tuple[float, Message], ...] = ()
    progress: Callable[[TrackView], None] | None = None
    statistics: RunStatistics = field(default_factory=RunStatistics)
    _queue: list[tuple[float, int, Callable[[float, Any], None], Any]] = field(default_factory=list)
    _order: int = 0
    _installation: Installation = field(init=False)

    def __post_init__(self) -> None:
        """Lay the wires; raises BadInputError where the hardware's faults cannot be read."""
        profile = self.engine.spec.profile
        self._installation = Installation(self.mount, None, profile.command_delay_s, profile.status_delay_s)

    def run(self) -> float:
        """Run to the end; return the UTC instant of the end, POSIX seconds."""
        period_s = self.engine.spec.profile.period_s
        self._at(self.begin_utc_s, self._client_turn, 0)
        first = self._installation.next_turn_s(self.begin_utc_s - period_s + MOUNT_PHASE_S)
        self._at(first, self._mount_turn, None)
        for instant, message in self.messages:
            self._at(instant, self._operate, message)
        now_utc_s = self.begin_utc_s
        while not self.engine.finished:
            now_utc_s, _, happen, what = heappop(self._queue)
            happen(now_utc_s, what)
        return now_utc_s

    def _at(self, utc_s: float, happen: Callable[[float, Any], None], what: Any) -> None:
        self._order += 1
        heappush(self._queue, (utc_s, self._order, happen, what))

    def _client_turn(self, now_utc_s: float, turn: int) -> None:
        profile = self.engine.spec.profile
        datagram = self.engine.tick(now_utc_s)
        self.statistics.note_sent(now_utc_s)
        self.sink.command(now_utc_s, datagram)
        self._send(now_utc_s, datagram)
        self.engine.prepare(now_utc_s)
        if profile.repeat_rates != "never":
            self._at(now_utc_s + REPEAT_AFTER_PERIODS * profile.period_s, self._repeat, None)
        next_utc_s = now_utc_s + profile.period_s + self.engine.send_shift_s(now_utc_s)
        self._at(next_utc_s, self._client_turn, turn + 1)
        if turn % RECORD_VIEW_EVERY_TICKS == 0 and (self.sink.wanted or self.progress is not None):
            view = view_of(self.engine, now_utc_s)
            self.sink.view(now_utc_s, view)
            if self.progress is not None:
                self.progress(view)

    def _repeat(self, now_utc_s: float, _: None) -> None:
        datagram = self.engine.repeat()
        if datagram is not None:
            self.sink.repeat(now_utc_s, datagram)
            self._send(now_utc_s, datagram)

    def _send(self, now_utc_s: float, datagram: bytes) -> None:
        for delay_s, arriving in self._installation.commands.carry(datagram):
            self._at(now_utc_s + delay_s, self._command_arrives, arriving)

    def _mount_turn(self, now_utc_s: float, _: None) -> None:
        status, truth = self._installation.turn(now_utc_s)
        if status is not None:
            for delay_s, arriving in self._installation.statuses.carry(status):
                self._at(now_utc_s + delay_s, self._status_arrives, (arriving, truth))
        self._at(self._installation.next_turn_s(now_utc_s), self._mount_turn, None)

    def _command_arrives(self, _: float, datagram: bytes) -> None:
        self._installation.receive(datagram)

    def _status_arrives(self, now_utc_s: float, what: Any) -> None:
        status, truth = what
        self.sink.status(now_utc_s, status)
        self.engine.receive(status, now_utc_s)
        self.statistics.note_truth(self.engine, truth.counter, truth.utc_s, truth.ra_deg, truth.dec_deg)

    def _operate(self, now_utc_s: float, message: Message) -> None:
        self.sink.operator(now_utc_s, message)
        self.engine.operate(message, now_utc_s)


QUANTILES = (0.01, 0.5, 0.99)
WAITS_S = 0.025
"""How long a command waits for the mount's loop in the mean, which the fitted delay holds: half a turn."""


@dataclass(frozen=True, slots=True)
class WhatIf:
    """The recorded law and another one: the commands to the recorded samples, and the errors, simulated.

    `fitted` says what of the simulated mount came from the recording, in words.
    """

    replayed: Replay
    before: Figures
    """With the recorded law, as the simulated mount reports it; None where it was never on target."""
    after: Figures
    fitted: str


def read_law(path: Path | None, settings: Sequence[str], base: ControlLaw) -> ControlLaw:
    """Return a law: the file's, else `base`, changed by settings like feeder.settling_s=0.2.

    Raises BadInputError, naming the file, line and key, or the setting.
    """
    law = base if path is None else read_toml(path, ControlLaw, "the control law")
    values: dict[str, Any] = msgspec.to_builtins(law)
    for setting in settings:
        name, equals, number = setting.partition("=")
        group, _, key = name.strip().partition(".")
        if not equals or group not in values or key not in values[group]:
            near = meant(name, [f"{g}.{k}" for g, table in values.items() for k in table])
            words = f"--set {setting}: give KEY=N{near}"
            raise BadInputError(f"{words}{'' if near else ','} docs/recordings.md lists the keys")
        try:
            values[group][key] = float(number)
        except ValueError:
            raise BadInputError(f"--set {setting}: {number!r} is no number") from None
    try:
        return msgspec.convert(values, ControlLaw)
    except msgspec.ValidationError as error:
        what, group = refused_key(error)
        raise BadInputError(f"--set: {group}.{what}") from error


def with_law(facts: RunFacts, law: ControlLaw) -> RunFacts:
    """Return a run's facts with another law."""
    return msgspec.structs.replace(facts, plan=msgspec.structs.replace(facts.plan, law=law))


def what_if(
    recording: Recording,
    facts: RunFacts,
    law: ControlLaw,
    choice: Choice,
    progress: Callable[[float], None] | None = None,
) -> WhatIf:
    """Return what another law would have commanded, and what the error would have been.

    The first is the recorded samples run through it. For the second both laws follow the pass with one and
    the same simulated mount, its gains, delays and noise as the recording shows them.
    """

    def build(spec: msgspec.Raw) -> Engine:
        return build_engine(with_law(decode_facts(spec), law))

    run = trace(recording, engine_of, _part(progress, 0, 4))
    mount, hardware, words = fitted_mount(run, facts)
    heard = tuple((max(utc_s, facts.started_utc_s), message) for utc_s, message in messages(recording))
    errors = []
    for number, one in enumerate((facts, with_law(facts, law))):
        part = _part(progress, 1 + number, 4)
        if part is not None:
            part(0.0)
        errors.append(_fly(one, mount, hardware, heard))
    replayed = replay(recording, build, choice=choice, progress=_part(progress, 3, 4))
    return WhatIf(replayed, errors[0], errors[1], words)


def _part(
    progress: Callable[[float], None] | None, number: int, count: int
) -> Callable[[float], None] | None:
    return None if progress is None else lambda share: progress((number + share) / count)


def fitted_mount(run: Trace, facts: RunFacts) -> tuple[MountProfile, SimulatorProfile, str]:
    """Return the mount of a recording, and how to simulate it and its link, with that in words."""
    ra, dec = fit_axes(run, facts.profile)
    changes: dict[str, float] = {}
    hardware: dict[str, Any] = {}
    words = []
    delays_s = []
    for name, fit in (("ra", ra), ("dec", dec)):
        if isinstance(fit, AxisFit):
            changes[f"{name}_rate_gain"] = fit.gain
            words.append(f"{name} gain {fit.gain:.5f}")
            delays_s += [] if fit.delay_s is None else [fit.delay_s]
    if delays_s:
        hardware["command_delay_s"] = max(0.0, float(np.mean(delays_s)) - WAITS_S)
        words.append(f"commands {hardware['command_delay_s'] * 1000.0:.1f} ms late")
    if len(run.utc_s) > 1:
        late_s = run.arrival_utc_s - run.utc_s
        low, middle, high = np.quantile(late_s, QUANTILES)
        hardware["status_delay_s"] = max(0.0, float(middle))
        hardware["status_jitter_s"] = max(0.0, float(high - low) / 2.0)
        words.append(f"statuses {middle * 1000.0:.1f} ± {(high - low) * 500.0:.1f} ms late")
    profile = msgspec.structs.replace(facts.profile, **changes)
    return profile, SimulatorProfile(**hardware), ", ".join(words) or "nothing"


def _fly(
    facts: RunFacts,
    profile: MountProfile,
    hardware: SimulatorProfile,
    heard: tuple[tuple[float, Message], ...],
) -> Figures:
    mount = SimulatedMount(profile, simulated_site(facts.site), demo_pass.START, hardware)
    engine = build_engine(facts)
    VirtualRun(engine, mount, facts.started_utc_s, NoRecording(), heard).run()
    return Figures(engine.reported.rms_arcsec, engine.reported.peak_arcsec)
