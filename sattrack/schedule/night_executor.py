"""The runner of a schedule in real time: it carries out the machine's orders and keeps what comes of them."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Protocol

from msgspec import structs

from sattrack.core.errors import SattrackError
from sattrack.runtime.console import wait_until_free
from sattrack.schedule import machine
from sattrack.schedule.night import (
    AskWeather,
    ClockSet,
    DoStep,
    Due,
    End,
    Follow,
    Followed,
    MakePlan,
    Mount,
    NotPlanned,
    Parked,
    ParkMount,
    PassAttempt,
    PassPrepared,
    Planned,
    Prepare,
    Reread,
    RunState,
    Started,
    StepDone,
    StopAsked,
    SummedUp,
    SumUp,
    Wait,
    WeatherReported,
)
from sattrack.schedule.night_folder import Heartbeat, attempt_name
from sattrack.schedule.night_processes import (
    PassSession,
    facts_of,
    post,
    run_program,
    run_verb,
)
from sattrack.schedule.night_stop import keep_stop
from sattrack.schedule.schema import CommandAction, SlewAction, WebhookAction
from sattrack.schedule.summary import headline
from sattrack.schedule.transitions import slew_of
from sattrack.schedule.weather import FRESH_S, WeatherSource, WeatherWatch
from tle.errors import TleError
from tle.instants import DAY_S, Utc

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sattrack.mount.model import MountProfile
    from sattrack.runtime.mounts import MountAddress
    from sattrack.schedule.file import Schedule
    from sattrack.schedule.night import Event, NightPass, Order, Result, Run, RunSettings
    from sattrack.schedule.night_folder import Journal, NightFiles, OpenedRun
    from sattrack.schedule.night_processes import BackgroundTasks, Service
    from sattrack.schedule.night_stop import NightRequests
    from tle.elements import Elements
    from tle.site import Site


POLL_S = 0.25
SHOW_EVERY_S = 1.0
BEAT_EVERY_S, IDLE_BEAT_EVERY_S = 1.0, 10.0
JUMP_S = 2.0
"""A clock that differs by more from the time elapsed was set."""
VERB_WITHIN_S, VERB_WAYS = 600.0, 2.0
"""How long a verb of the mount may take at least, and for how many ways of a slow mount: one may go round."""
TURNS_WITHIN_S, PLANS_WITHIN_S = 120.0, 1200.0
"""For a watchdog: how long one turn of ours may take at most, and what may take long."""
MOST_WORDS = 500
"""Characters of an error that are kept and told: it may quote a file."""
REREADS = (RunState.WAITING, RunState.PLANLESS, RunState.RESTING)
"""Where a schedule that was read again can be planned anew."""


@dataclass(frozen=True, slots=True)
class ClockReadings:
    """What the machine's clocks read at one moment: UTC, and two that are never set; seconds.

    The first of these stands still while the machine sleeps.
    """

    utc_s: float
    awake_s: float
    since_boot_s: float


def read_clocks(utc_s: float) -> ClockReadings:
    """Read them."""
    boot = getattr(time, "CLOCK_BOOTTIME", None)
    awake = time.monotonic()
    return ClockReadings(utc_s, awake, awake if boot is None else time.clock_gettime(boot))


def jump_between(
    before: ClockReadings, after: ClockReadings, speed: float = 1.0
) -> tuple[float, bool] | None:
    """Return how far UTC jumped between two readings, and whether the machine slept; None for no jump."""
    jumped = (after.utc_s - before.utc_s) - speed * (after.awake_s - before.awake_s)
    if abs(jumped) < JUMP_S * max(1.0, speed):
        return None
    slept = (after.since_boot_s - before.since_boot_s) - (after.awake_s - before.awake_s)
    return jumped, slept > 0.5 * abs(jumped)


def _why(error: Exception) -> str:
    """Return an error in one line; one that nobody foresaw, or without words, with its type."""
    words = next(iter(str(error).splitlines()), "")[:MOST_WORDS]
    if words and isinstance(error, SattrackError | TleError):
        return words
    return ": ".join([type(error).__name__, *([words] if words else [])])


@dataclass(slots=True)
class NightContext:
    """What the executor works with."""

    schedule: Schedule
    site: Site
    profile: MountProfile
    address: MountAddress | None
    folder: Path
    """Where the schedule's programs run."""
    command: Callable[..., list[str]]
    """Completes a command of ours: the program before it; the mount, site, settings and clock after it."""
    now: Callable[[], float]
    speed: float
    plan: Callable[[float, float, float], Planned]
    renew: Callable[[NightPass], Elements | None]
    report_waiting: Callable[[float], None]
    report_progress: Callable[[float, float, str, float], None]
    """Reports the progress of a pass: the instant, the seconds on target, a text, seconds of silence."""
    tell: Callable[[str], None]
    report_trouble: Callable[[str, str | None], None]
    """Reports what is wrong with something; None once nothing is."""
    read_again: Callable[[], tuple[Schedule, RunSettings]]
    """Reads the schedule's file again. Raises SattrackError, TleError."""
    tasks: BackgroundTasks
    requests: NightRequests
    service: Service
    planned: Callable[[], Schedule | None] = lambda: None
    """Returns the schedule that the last plan was made from; None for that in force."""


@dataclass(slots=True)
class LiveExecutor:
    """Waits in real time; sessions that move the mount are processes of their own."""

    context: NightContext
    files: NightFiles
    journal: Journal
    _source: WeatherSource | None = None
    _watch: WeatherWatch | None = None
    _beaten_s: float = field(default=float("-inf"))
    _shown_s: float = float("-inf")
    _attempt: str | None = None
    _recording: str | None = None
    _settings: RunSettings | None = None
    """The settings of a schedule that was read again, until its plan is made."""

    def begin(self, beat: Heartbeat | None) -> float:
        """See Executor."""
        del beat
        return self.context.now()

    def now_utc_s(self) -> float:
        """Return the instant that is now, POSIX seconds of UTC."""
        return self.context.now()

    def perform(self, order: Order, run: Run) -> Event | None:
        """See Executor."""
        requests = self.context.requests
        self.context.report_trouble("journal", self.journal.trouble)
        found = None if requests.asked else self._perform(order, run)
        if found is not None and not requests.asked:
            return found
        if requests.restarts:
            # What is done and over is kept; what was cut off is begun again.
            done = isinstance(found, Planned | PassPrepared | WeatherReported | SummedUp)
            done = done or (isinstance(found, StepDone) and found.done)
            done = done or (isinstance(found, Parked) and found.mount is not Mount.AT_REST)
            done = done or (isinstance(found, Followed) and found.attempt.ended_by != "stopped")
            return found if done else None
        if isinstance(found, Followed):
            return found
        return StopAsked(utc_s=self.context.now(), words=requests.words)

    def _perform(self, order: Order, run: Run) -> Event | None:
        """Carry out an order; None where a stop was asked for before there was an event."""
        now = self.context.now
        found: Event | None
        match order:
            case Wait():
                found = self._wait(order.until_utc_s, run.state in REREADS)
            case MakePlan():
                found = self._make_plan(run)
            case Prepare():
                found = self._prepare(run.passes[order.index], order.wake)
            case AskWeather():
                found = self._ask_weather()
            case DoStep():
                found = self._do(order, run)
            case Follow():
                attempt = self._follow(order, run)
                found = Followed(utc_s=now(), attempt=attempt)
            case ParkMount():
                found = self._park(order.power_off)
            case SumUp():
                found = self._sum_up(run)
            case End():
                raise ValueError("an end is not performed")
        return found

    def _wait(self, until_utc_s: float, rereads: bool) -> Event:
        """Wait; with `rereads`, a schedule that was read again ends that."""
        context = self.context
        before = read_clocks(context.now())
        self._shown_s = float("-inf")
        while True:
            clocks = read_clocks(context.now())
            jump = jump_between(before, clocks, context.speed)
            before = clocks
            context.service.promise(TURNS_WITHIN_S)
            if context.requests.asked:
                return StopAsked(utc_s=clocks.utc_s, words=context.requests.words)
            self._read_again()
            if rereads and self._settings is not None:
                settings, self._settings = self._settings, None
                return Reread(utc_s=clocks.utc_s, settings=settings)
            if jump is not None:
                return ClockSet(utc_s=clocks.utc_s, seconds=round(jump[0], 1), slept=jump[1])
            left_s = until_utc_s - clocks.utc_s
            if left_s <= 0.0:
                return Due(utc_s=clocks.utc_s)
            self.show_life(clocks.utc_s)
            time.sleep(min(POLL_S, left_s / context.speed))

    def _beat(self, utc_s: float, on_target_s: float) -> None:
        every_s = IDLE_BEAT_EVERY_S if self._attempt is None else BEAT_EVERY_S
        if time.monotonic() - self._beaten_s >= every_s:
            self._beaten_s = time.monotonic()
            self.journal.beat(Heartbeat(utc_s, self._attempt, round(on_target_s, 3), self._recording))
            self.context.report_trouble("journal", self.journal.trouble)

    def _read_again(self) -> None:
        """Read the schedule's file again on request; a wrong one changes nothing."""
        context = self.context
        if not context.requests.reload:
            return
        context.requests.reload = False
        try:
            schedule, self._settings = context.read_again()
        except Exception as error:  # noqa: BLE001 - no file is worth the end of the night
            words = f"not read again, the schedule in force stays: {_why(error)}"
            context.report_trouble("schedule", words)
        else:
            self._put_in_force(schedule)

    def _put_in_force(self, schedule: Schedule) -> None:
        """Go by a schedule that was read: by its weather, wake, recordings and elements."""
        self.context.schedule = schedule
        self.context.report_trouble("schedule", None)

    def _make_plan(self, run: Run) -> Event:
        now = self.context.now()
        self.context.service.promise(PLANS_WITHIN_S)
        try:
            found = self.context.plan(max(now, run.night_from_utc_s), run.night_to_utc_s, now)
            schedule = self.context.planned()
        except Exception as error:  # noqa: BLE001 - no file is worth more than a plan
            return NotPlanned(utc_s=now, words=_why(error))
        if schedule is not None:
            self._put_in_force(schedule)
        return found

    def _prepare(self, one: NightPass, wake: bool) -> PassPrepared:
        context, how = self.context, self.context.schedule.wake
        words = None
        if wake and how is None:
            return PassPrepared(
                utc_s=context.now(),
                cause="power",
                words="the drives are parked, and no [wake] says how to wake them",
            )
        context.service.promise(PLANS_WITHIN_S + (0.0 if how is None else how.timeout_s))
        if wake and how is not None:
            failed = run_program(
                how.run, how.timeout_s, context.folder, facts_of(one, self.files.schedule, "wake")
            )
            if failed is not None:
                return PassPrepared(utc_s=context.now(), cause="power", words=f"{how.run[0]}: {failed}")
        elements = None
        if one.renewable:
            try:
                elements = context.renew(one)
            except Exception as error:  # noqa: BLE001 - no provider is worth a pass
                words = f"{one.name}: elements are not renewed: {_why(error)}"
        used = elements or one.elements
        age_days = 0.0 if used is None else (one.start_utc_s - float(used.epoch.unix_s)) / DAY_S
        if age_days > one.terms.elements_oldest_days and one.terms.if_elements_old == "skip":
            old = f"{age_days:.1f} days old at the pass, {one.terms.elements_oldest_days:g} are allowed"
            return PassPrepared(utc_s=context.now(), cause="elements too old", words=old, woken=wake)
        return PassPrepared(utc_s=context.now(), words=words, elements=elements, woken=wake)

    def _ask_weather(self, fresh_s: float = 0.0) -> WeatherReported | None:
        """Ask it, or take a fresh answer; None where a stop was asked for before it had answered."""
        context, source = self.context, self._weather_source()
        if source is None:
            return WeatherReported(utc_s=context.now(), safe=None)
        answer = source.ask(self._must_end, fresh_s)
        if context.requests.asked and not answer.safe:
            return None
        return WeatherReported(utc_s=context.now(), safe=answer.safe, words=answer.words)

    def _weather_source(self) -> WeatherSource | None:
        """Return the source that the schedule in force names; None where it names none."""
        weather = self.context.schedule.weather
        if weather is None:
            return None
        if self._source is None or self._source.weather != weather:
            self._source = WeatherSource(weather, self.context.folder)
        return self._source

    def _unsafe(self, one: NightPass) -> str | None:
        """Return why the mount must not move for a pass now: the weather's words; None where it may.

        The machine's own question may be long ago: a restart, a broken session, an action that took long.
        """
        source = self._weather_source()
        if source is None or one.terms.if_weather_unsafe == "run":
            return None
        answer = source.ask(self._must_end, FRESH_S)
        return None if answer.safe else answer.words or "unsafe"

    def _do(self, order: DoStep, run: Run) -> StepDone | WeatherReported | None:
        """Carry out an action; None where a stop was asked for before it was begun.

        An action before it may have taken long, or the runner was restarted: a dome is not opened by what
        the weather was then.
        """
        one = run.passes[order.index]
        if order.asks_weather(one):
            report = self._ask_weather(FRESH_S)
            if report is None or report.safe is False:
                return report
        words = self._carry_out(order, run, one)
        return StepDone(utc_s=self.context.now(), done=words is None, words=words)

    def _carry_out(self, order: DoStep, run: Run, one: NightPass) -> str | None:
        """Carry out an action; return what went wrong, None where nothing."""
        context, action = self.context, order.action_of(one)
        result = run.results[order.index] if order.when == "after" else None
        facts = facts_of(one, self.files.schedule, order.when, result)
        if isinstance(action, CommandAction):
            if action.wait:
                context.service.promise(TURNS_WITHIN_S + action.timeout_s)
                return run_program(action.run, action.timeout_s, context.folder, facts)
            program = partial(run_program, action.run, action.timeout_s, context.folder, facts)
            context.tasks.begin(action.words, program)
        elif isinstance(action, WebhookAction):
            context.tasks.begin(action.words, partial(post, action.url, facts, action.timeout_s))
        elif isinstance(action, SlewAction):
            kept = None if result is None else self._kept_from_slew(one, result)
            return kept or self._slew(action)
        return None

    def _kept_from_slew(self, one: NightPass, result: Result) -> str | None:
        """Return why the mount must not slew after a pass; None where it may."""
        if result.cause == "weather":
            # It need not be unsafe any more: the mount stays where it was brought to rest.
            return "not done: the weather ended the pass"
        unsafe = self._unsafe(one)
        return None if unsafe is None else f"not done: the weather is unsafe: {unsafe}"

    def _slew(self, action: SlewAction) -> str | None:
        slew = slew_of(action, self.context.now(), self.context.site, self.context.profile)
        wrong = self._verb("slew", f"{slew.ra_deg:.6f}", f"{slew.dec_deg:.6f}")
        if wrong is None:
            self._pause(action.wait_s)
        return wrong

    def _pause(self, seconds: float) -> None:
        """Wait, or until a stop is requested."""
        until = self.context.now() + seconds
        while self.context.now() < until and not self.context.requests.asked:
            self.context.service.promise(TURNS_WITHIN_S)
            self.show_life()
            time.sleep(POLL_S)

    def _verb(self, *verb: str) -> str | None:
        """Run a verb of `sattrack mount`; return what went wrong, None where nothing."""
        context = self.context
        try:
            self._wait_until_free()
            goes_within_s = context.profile.goes_within_s(by_rates=context.profile.geometry is not None)
            within_s = max(VERB_WITHIN_S, VERB_WAYS * goes_within_s)
            code, words = run_verb(context.command("mount", *verb), within_s, self._must_end)
        except SattrackError as error:
            return str(error)
        except OSError as error:
            return f"mount {verb[0]} cannot be run: {error.strerror}"
        return None if code == 0 else words or f"mount {verb[0]} ended with {code}"

    def _must_end(self) -> bool:
        self.context.service.promise(TURNS_WITHIN_S)
        self.show_life()
        return self.context.requests.asked

    def show_life(self, utc_s: float | None = None) -> None:
        """Show once a second that the run is alive, while it follows no pass; as of now, or an instant."""
        if time.monotonic() - self._shown_s >= SHOW_EVERY_S:
            self._shown_s = time.monotonic()
            utc_s = self.context.now() if utc_s is None else utc_s
            self.context.report_waiting(utc_s)
            self._beat(utc_s, 0.0)

    def _wait_until_free(self) -> None:
        """Wait for the end of a session that a runner before this one left behind."""
        self.context.service.promise(TURNS_WITHIN_S)
        if self.context.address is not None:
            wait_until_free(self.context.address, self.show_life)

    def _sum_up(self, run: Run) -> SummedUp:
        try:
            return SummedUp(utc_s=self.context.now(), file=self.files.sum_up(run), words=headline(run))
        except SattrackError as error:
            return SummedUp(utc_s=self.context.now(), words=f"{headline(run)}; no summary: {error}")

    def _park(self, power_off: bool) -> Parked:
        wrong = self._verb("park", *(() if power_off else ("--drives-on",)))
        if wrong is not None:
            return Parked(utc_s=self.context.now(), mount=Mount.AT_REST, words=wrong)
        return Parked(utc_s=self.context.now(), mount=Mount.PARKED if power_off else Mount.AT_PARK)

    def _follow(self, order: Follow, run: Run) -> PassAttempt:
        context, source, one = self.context, self._weather_source(), run.passes[order.index]
        self._pause(order.pause_s)
        if context.requests.asked:
            return PassAttempt("stopped", context.now())
        try:
            self._wait_until_free()
            kept = self._kept_from(one)
            if kept is not None:
                return kept
            self._recording = self._recording_of(one, order.part, run.night_from_utc_s)
            self._attempt = attempt_name(one, order.part)
            if source is not None and one.terms.if_weather_unsafe != "run":
                self._watch = WeatherWatch(source)
            session = PassSession(
                self._track_command(one, self._recording),
                one,
                self._recording,
                self.files.folder / "sessions.log",
                self,
            )
            attempt = session.run()
            self._keep_end(attempt)
            return attempt
        except (OSError, SattrackError) as error:
            return PassAttempt("crash", context.now(), words=str(error))
        finally:
            self._attempt = self._recording = None
            if self._watch is not None:
                self._watch.close()
                self._watch = None

    def _kept_from(self, one: NightPass) -> PassAttempt | None:
        """Return the attempt at a pass that a stop or the weather lets nobody begin; None for neither."""
        unsafe = self._unsafe(one)
        if self.context.requests.asked:
            return PassAttempt("stopped", self.context.now())
        return None if unsafe is None else PassAttempt("weather", self.context.now(), words=unsafe)

    def _recording_of(self, one: NightPass, part: int, night_from_utc_s: float) -> str | None:
        """Make room by the schedule's rule; return a new recording's name, None where there is no room."""
        context, rule = self.context, self.context.schedule.recordings
        gone = self.files.make_room(self.journal.recordings(), rule, context.now(), night_from_utc_s)
        if gone:
            context.tell(f"{len(gone)} old recordings deleted by [recordings], from {gone[0]} to {gone[-1]}")
        wrong, name = self.files.no_room(), None
        if wrong is None:
            try:
                name = self.files.recording(one, part)
            except SattrackError as error:
                wrong = f"{error}; passes go unrecorded"
        context.report_trouble("recording", wrong)
        return name

    def _keep_end(self, attempt: PassAttempt) -> None:
        """Keep what a restart needs: an operator's stop at a screen, and the progress of a pass."""
        if attempt.ended_by == "operator":
            try:
                keep_stop(self.files.folder, "at the session's screen")
            except OSError as error:
                self.context.report_trouble("stop", f"the operator's stop cannot be kept: {error.strerror}")
        elif attempt.ended_by == "stopped":
            self.journal.beat(
                Heartbeat(attempt.ended_utc_s, self._attempt, attempt.on_target_s, self._recording)
            )

    def _track_command(self, one: NightPass, recording: str | None) -> list[str]:
        context, terms = self.context, one.terms
        iso = [Utc(utc_s).isoformat("milliseconds") for utc_s in (one.start_utc_s, one.end_utc_s)]
        target, ephemeris = one.asked, () if one.ephemeris is None else ("--ephemeris", one.ephemeris)
        if one.elements is not None:
            target = str(one.elements.catalog_number)
            ephemeris = ("--elements", str(self.files.elements(one)))
        return context.command(
            *("track", target, "--headless", "--stream", "--control"),
            # The schedule has its own rule for old elements, and it was asked already.
            "--old-elements",
            *(() if recording is None else ("--record", str((self.files.folder / recording).absolute()))),
            *ephemeris,
            *("--from", iso[0], "--to", iso[1]),
            *("--min-alt", f"{terms.min_altitude_deg:g}"),
            *("--bias-along", f"{terms.bias_along_s:g}", "--bias-cross", f"{terms.bias_cross_deg:g}"),
        )

    def end_reason(self) -> str | None:
        """See SessionListener."""
        self.context.service.promise(TURNS_WITHIN_S)
        if self.context.requests.asked:
            return "stopped" if self.context.requests.operator is None else "operator"
        self._read_again()
        return "weather" if self._watch is not None and self._watch.unsafe is not None else None

    def weather_words(self) -> str | None:
        """See SessionListener."""
        return None if self._watch is None else self._watch.unsafe

    def report_progress(self, utc_s: float, on_target_s: float, line: str, silent_s: float = 0.0) -> None:
        """See SessionListener."""
        self.context.report_progress(utc_s, on_target_s, line, silent_s)
        self._beat(utc_s, on_target_s)

    def report_trouble(self, words: str | None) -> None:
        """See SessionListener."""
        if self._recording is not None:
            self.context.report_trouble("recording", words)


class Executor(Protocol):
    """Whoever carries orders out, with a real mount or with a simulated one."""

    def begin(self, beat: Heartbeat | None) -> float:
        """Take up where the last sign of life was; return the instant that is now, POSIX seconds of UTC."""

    def perform(self, order: Order, run: Run) -> Event | None:
        """Carry out an order; return the event that it ended with.

        None where the system ends the runner in the midst of it: a restart begins with it again.
        """


def drive(
    taken: OpenedRun, executor: Executor, settings: RunSettings, report: Callable[[Run, Event, Order], None]
) -> tuple[Run, End | None]:
    """Run, or run on, until nothing is left to do; return what is known then, and why it ended.

    None where the system ended the runner. `report` is called with every event once it is kept.
    """
    journal, run = taken.journal, taken.run
    beat = journal.last_heartbeat()
    event: Event | None
    event = Started(
        utc_s=executor.begin(beat), settings=settings, recovered=taken.recovered, words=taken.words
    )
    if beat is not None:
        event = structs.replace(event, last_utc_s=beat.utc_s)
        if run.at is not None and beat.attempt == attempt_name(run.at, run.part):
            event = structs.replace(event, on_target_s=beat.on_target_s, recording=beat.recording)
    while event is not None:
        run, order = machine.step(run, event)
        journal.append(event, run, order)
        report(run, event, order)
        if isinstance(order, End):
            return run, order
        event = executor.perform(order, run)
    return run, None
