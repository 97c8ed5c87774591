"""A schedule's run: what the machine orders is carried out in real time, and what comes of it is kept."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from msgspec import structs

from sattrack.core.errors import SattrackError
from sattrack.runtime.stopping import wait_until_free
from sattrack.schedule import machine
from sattrack.schedule.night import (
    AskWeather,
    ClockSet,
    DoStep,
    Due,
    End,
    Follow,
    Followed,
    Go,
    Laid,
    LayDown,
    MakePlan,
    Mount,
    NotPlanned,
    Planned,
    Prepare,
    Prepared,
    Reread,
    Started,
    State,
    StepDone,
    StopAsked,
    SummedUp,
    SumUp,
    Wait,
    WeatherTold,
)
from sattrack.schedule.night_commands import WeatherWatch, ask_weather, facts_of, post, run_program
from sattrack.schedule.night_journal import Beat, go_name
from sattrack.schedule.night_session import Session, run_verb
from sattrack.schedule.night_stop import keep_stop
from sattrack.schedule.schema import CommandAction, SlewAction, WebhookAction
from sattrack.schedule.summary import headline
from sattrack.schedule.transitions import slew_of
from tle.errors import TleError
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sattrack.mount.model import MountProfile
    from sattrack.runtime.mounts import MountAddress
    from sattrack.schedule.file import Schedule
    from sattrack.schedule.night import Doing, Happening, NightPass, Run, Ways
    from sattrack.schedule.night_commands import Errands
    from sattrack.schedule.night_files import NightFiles, TakenUp
    from sattrack.schedule.night_journal import Journal
    from sattrack.schedule.night_stop import NightRequests
    from sattrack.schedule.service import Service
    from tle.elements import Elements
    from tle.site import Site


POLL_S = 0.25
SHOW_EVERY_S = 1.0
BEAT_EVERY_S, IDLE_BEAT_EVERY_S = 1.0, 10.0
JUMP_S = 2.0
"""A clock that went so much more, or less, than time did was set."""
VERB_WITHIN_S = 600.0
TURNS_WITHIN_S, PLANS_WITHIN_S = 120.0, 1200.0
"""For a watchdog: how long one turn of ours may take at most, and what may take long."""
REREADS = (State.WAITING, State.PLANLESS, State.RESTING)
"""Where a schedule that was read again can be planned anew."""
DAY_S = 86400.0


@dataclass(frozen=True, slots=True)
class Readings:
    """What the machine's clocks read at one moment: UTC, and two that are never set; seconds.

    The first of these stands still while the machine sleeps.
    """

    utc_s: float
    awake_s: float
    since_boot_s: float


def read_clocks(utc_s: float) -> Readings:
    """Read them."""
    boot = getattr(time, "CLOCK_BOOTTIME", None)
    awake = time.monotonic()
    return Readings(utc_s, awake, awake if boot is None else time.clock_gettime(boot))


def jump_between(before: Readings, after: Readings, speed: float = 1.0) -> tuple[float, bool] | None:
    """Return by how much UTC jumped between two readings, and whether the machine slept; None for no jump."""
    jumped = (after.utc_s - before.utc_s) - speed * (after.awake_s - before.awake_s)
    if abs(jumped) < JUMP_S * max(1.0, speed):
        return None
    slept = (after.since_boot_s - before.since_boot_s) - (after.awake_s - before.awake_s)
    return jumped, slept > 0.5 * abs(jumped)


@dataclass(slots=True)
class Kit:
    """What the hands work with."""

    schedule: Schedule
    site: Site
    profile: MountProfile
    address: MountAddress | None
    folder: Path
    """Where the schedule's programs run."""
    program: tuple[str, ...]
    """The beginning of every command of ours."""
    common: tuple[str, ...]
    """Options of every command: which mount, site, settings."""
    now: Callable[[], float]
    speed: float
    clock: Callable[[], tuple[str, ...]]
    """The option that sets a command's clock by ours; none by the machine's own."""
    plan: Callable[[float, float, float], Planned]
    renew: Callable[[NightPass], Elements | None]
    waits: Callable[[float], None]
    follows: Callable[[float, float, str, float], None]
    """Hears now and then how a pass goes: the instant, the seconds on target, words, seconds of silence."""
    tell: Callable[[str], None]
    troubled: Callable[[str, str | None], None]
    """Hears what is wrong with something, in words, or None: nothing any more."""
    read_again: Callable[[], tuple[Schedule, Ways]]
    """Reads the schedule's file again. Raises SattrackError, TleError."""
    errands: Errands
    requests: NightRequests
    service: Service


@dataclass(slots=True)
class LiveHands:
    """Waits in real time, and has a process of its own for whatever moves the mount."""

    kit: Kit
    files: NightFiles
    journal: Journal
    _watch: WeatherWatch | None = None
    _beaten_s: float = field(default=float("-inf"))
    _go: str | None = None
    _recording: str | None = None
    _ways: Ways | None = None
    """What a schedule that was read again says, until its plan is made."""

    def begin(self, beat: Beat | None) -> float:
        """See Hands."""
        del beat
        return self.kit.now()

    def now_utc_s(self) -> float:
        """Return the instant that is now, POSIX seconds of UTC."""
        return self.kit.now()

    def perform(self, doing: Doing, run: Run) -> Happening | None:
        """See Hands."""
        requests = self.kit.requests
        self.kit.troubled("journal", self.journal.trouble)
        found = None if requests.asked else self._perform(doing, run)
        if not requests.asked:
            return found
        if requests.restarts:
            # What is done and over is kept; what was cut off is begun again.
            done = isinstance(found, Planned | Prepared | WeatherTold | SummedUp)
            done = done or (isinstance(found, StepDone) and found.done)
            done = done or (isinstance(found, Laid) and found.mount is not Mount.AT_REST)
            done = done or (isinstance(found, Followed) and found.go.ended_by != "stopped")
            return found if done else None
        if isinstance(found, Followed):
            return found
        return StopAsked(utc_s=self.kit.now(), words=requests.words)

    def _perform(self, doing: Doing, run: Run) -> Happening:
        now = self.kit.now
        found: Happening
        match doing:
            case Wait():
                found = self._wait(doing.until_utc_s, run.state in REREADS)
            case MakePlan():
                found = self._make_plan(run)
            case Prepare():
                found = self._prepare(run.passes[doing.index], doing.wake)
            case AskWeather():
                found = self._ask_weather()
            case DoStep():
                words = self._do(doing, run)
                found = StepDone(utc_s=now(), done=words is None, words=words)
            case Follow():
                go = self._follow(doing, run)
                found = Followed(utc_s=now(), go=go)
            case LayDown():
                found = self._lay_down(doing.power_off)
            case SumUp():
                found = self._sum_up(run)
            case End():
                raise ValueError("an end is not performed")
        return found

    def _wait(self, until_utc_s: float, rereads: bool) -> Happening:
        """Wait; with `rereads`, a schedule that was read again ends that."""
        kit = self.kit
        before = read_clocks(kit.now())
        shown_s = float("-inf")
        while True:
            clocks = read_clocks(kit.now())
            jump = jump_between(before, clocks, kit.speed)
            before = clocks
            kit.service.promise(TURNS_WITHIN_S)
            if kit.requests.asked:
                return StopAsked(utc_s=clocks.utc_s, words=kit.requests.words)
            self._read_again()
            if rereads and self._ways is not None:
                ways, self._ways = self._ways, None
                return Reread(utc_s=clocks.utc_s, ways=ways)
            if jump is not None:
                return ClockSet(utc_s=clocks.utc_s, seconds=round(jump[0], 1), slept=jump[1])
            left_s = until_utc_s - clocks.utc_s
            if left_s <= 0.0:
                return Due(utc_s=clocks.utc_s)
            if clocks.awake_s - shown_s >= SHOW_EVERY_S:
                shown_s = clocks.awake_s
                kit.waits(clocks.utc_s)
                self._beat(clocks.utc_s, 0.0)
            time.sleep(min(POLL_S, left_s / kit.speed))

    def _beat(self, utc_s: float, on_target_s: float) -> None:
        every_s = IDLE_BEAT_EVERY_S if self._go is None else BEAT_EVERY_S
        if time.monotonic() - self._beaten_s >= every_s:
            self._beaten_s = time.monotonic()
            self.journal.beat(Beat(utc_s, self._go, round(on_target_s, 3), self._recording))
            self.kit.troubled("journal", self.journal.trouble)

    def _read_again(self) -> None:
        """Read the schedule's file again where somebody asks for it; one that is wrong changes nothing."""
        kit = self.kit
        if not kit.requests.reload:
            return
        kit.requests.reload = False
        try:
            kit.schedule, self._ways = kit.read_again()
        except (SattrackError, TleError) as error:
            words = str(error).splitlines()[0]
            kit.troubled("schedule", f"not read again, the schedule in force stays: {words}")
        else:
            kit.troubled("schedule", None)

    def _make_plan(self, run: Run) -> Happening:
        now = self.kit.now()
        self.kit.service.promise(PLANS_WITHIN_S)
        try:
            return self.kit.plan(max(now, run.night_from_utc_s), run.night_to_utc_s, now)
        except (SattrackError, TleError) as error:
            return NotPlanned(utc_s=now, words=str(error).splitlines()[0])

    def _prepare(self, one: NightPass, wake: bool) -> Prepared:
        kit, how = self.kit, self.kit.schedule.wake
        words = None
        if wake and how is None:
            return Prepared(
                utc_s=kit.now(),
                cause="power",
                words="the drives are parked, and no [wake] says how to wake them",
            )
        kit.service.promise(PLANS_WITHIN_S + (0.0 if how is None else how.timeout_s))
        if wake and how is not None:
            failed = run_program(
                how.run, how.timeout_s, kit.folder, facts_of(one, self.files.schedule, "wake")
            )
            if failed is not None:
                return Prepared(utc_s=kit.now(), cause="power", words=f"{how.run[0]}: {failed}")
        elements = None
        if one.renewable:
            try:
                elements = kit.renew(one)
            except (SattrackError, TleError) as error:
                words = f"{one.name}: elements are not renewed: {str(error).splitlines()[0]}"
        used = elements or one.elements
        age_days = (one.start_utc_s - float(used.epoch.unix_s)) / DAY_S
        if age_days > one.terms.elements_oldest_days and one.terms.if_elements_old == "skip":
            old = f"{age_days:.1f} days old at the pass, {one.terms.elements_oldest_days:g} are allowed"
            return Prepared(utc_s=kit.now(), cause="elements too old", words=old)
        return Prepared(utc_s=kit.now(), words=words, elements=elements, woken=wake)

    def _ask_weather(self) -> WeatherTold:
        weather = self.kit.schedule.weather
        if weather is None:
            return WeatherTold(utc_s=self.kit.now(), safe=None)
        self.kit.service.promise(TURNS_WITHIN_S + weather.timeout_s)
        told = ask_weather(weather, self.kit.folder)
        return WeatherTold(utc_s=self.kit.now(), safe=told.safe, words=told.words)

    def _do(self, doing: DoStep, run: Run) -> str | None:
        """Carry out an action; return what went wrong, None where nothing."""
        kit, one = self.kit, run.passes[doing.index]
        action = doing.action_of(one)
        result = run.results[doing.index] if doing.when == "after" else None
        facts = facts_of(one, self.files.schedule, doing.when, result)
        if isinstance(action, CommandAction):
            if action.wait:
                kit.service.promise(TURNS_WITHIN_S + action.timeout_s)
                return run_program(action.run, action.timeout_s, kit.folder, facts)
            kit.errands.begin(
                action.words, lambda: run_program(action.run, action.timeout_s, kit.folder, facts)
            )
        elif isinstance(action, WebhookAction):
            kit.errands.begin(action.words, lambda: post(action.url, facts, action.timeout_s))
        elif isinstance(action, SlewAction):
            return self._slew(action)
        return None

    def _slew(self, action: SlewAction) -> str | None:
        slew = slew_of(action, self.kit.now(), self.kit.site, self.kit.profile)
        wrong = self._verb("slew", f"{slew.ra_deg:.6f}", f"{slew.dec_deg:.6f}")
        if wrong is None:
            self._pause(action.wait_s)
        return wrong

    def _pause(self, seconds: float) -> None:
        """Wait so long, or until a stop is asked for."""
        until = self.kit.now() + seconds
        while self.kit.now() < until and not self.kit.requests.asked:
            self.kit.service.promise(TURNS_WITHIN_S)
            time.sleep(POLL_S)

    def _verb(self, *verb: str) -> str | None:
        """Run a verb of `sattrack mount`; return what went wrong, None where nothing."""
        kit = self.kit
        try:
            self._wait_until_free()
            command = [*kit.program, "mount", *verb, *kit.common, *kit.clock()]
            code, words = run_verb(command, VERB_WITHIN_S, self._verb_must_end)
        except SattrackError as error:
            return str(error)
        except OSError as error:
            return f"mount {verb[0]} cannot be run: {error.strerror}"
        return None if code == 0 else words or f"mount {verb[0]} ended with {code}"

    def _verb_must_end(self) -> bool:
        self.kit.service.promise(TURNS_WITHIN_S)
        return self.kit.requests.asked

    def _wait_until_free(self) -> None:
        """Wait for the end of a session that a runner before this one left behind."""
        self.kit.service.promise(TURNS_WITHIN_S)
        if self.kit.address is not None:
            wait_until_free(self.kit.address, lambda: None)

    def _sum_up(self, run: Run) -> SummedUp:
        try:
            return SummedUp(utc_s=self.kit.now(), file=self.files.sum_up(run), words=headline(run))
        except SattrackError as error:
            return SummedUp(utc_s=self.kit.now(), words=f"{headline(run)}; no summary: {error}")

    def _lay_down(self, power_off: bool) -> Laid:
        wrong = self._verb("park", *(() if power_off else ("--drives-on",)))
        if wrong is not None:
            return Laid(utc_s=self.kit.now(), mount=Mount.AT_REST, words=wrong)
        return Laid(utc_s=self.kit.now(), mount=Mount.PARKED if power_off else Mount.AT_PARK)

    def _follow(self, doing: Follow, run: Run) -> Go:
        kit, weather, one = self.kit, self.kit.schedule.weather, run.passes[doing.index]
        self._pause(doing.pause_s)
        if kit.requests.asked:
            return Go("stopped", kit.now())
        try:
            self._recording = self._recording_of(one, doing.part, run.night_from_utc_s)
            self._go = go_name(one, doing.part)
            if weather is not None and one.terms.if_weather_unsafe != "run":
                self._watch = WeatherWatch(weather, kit.folder)
            self._wait_until_free()
            session = Session(
                self._track_command(one, self._recording),
                one,
                self._recording,
                self.files.folder / "sessions.log",
                self,
            )
            go = session.run()
            self._heed_end(go)
            return go
        except (OSError, SattrackError) as error:
            return Go("crash", kit.now(), words=str(error))
        finally:
            self._go = self._recording = None
            if self._watch is not None:
                self._watch.close()
                self._watch = None

    def _recording_of(self, one: NightPass, part: int, night_from_utc_s: float) -> str | None:
        """Make room by the schedule's rule; return a new recording's name, None where there is no room."""
        kit, rule = self.kit, self.kit.schedule.recordings
        gone = self.files.make_room(self.journal.recordings(), rule, kit.now(), night_from_utc_s)
        if gone:
            kit.tell(f"{len(gone)} old recordings deleted by [recordings], from {gone[0]} to {gone[-1]}")
        wrong, name = self.files.no_room(), None
        if wrong is None:
            try:
                name = self.files.recording(one, part)
            except SattrackError as error:
                wrong = f"{error}; passes go unrecorded"
        kit.troubled("recording", wrong)
        return name

    def _heed_end(self, go: Go) -> None:
        """Keep what must survive us: a stop by somebody at a screen, how far a pass had come."""
        if go.ended_by == "operator":
            try:
                keep_stop(self.files.folder, "at the session's screen")
            except OSError as error:
                self.kit.troubled("stop", f"the operator's stop cannot be kept: {error.strerror}")
        elif go.ended_by == "stopped":
            self.journal.beat(Beat(go.ended_utc_s, self._go, go.on_target_s, self._recording))

    def _track_command(self, one: NightPass, recording: str | None) -> list[str]:
        kit, terms = self.kit, one.terms
        iso = [Utc(utc_s).isoformat("milliseconds") for utc_s in (one.start_utc_s, one.end_utc_s)]
        return [
            *kit.program,
            *("track", str(one.elements.catalog_number), "--headless", "--stream", "--control"),
            *(() if recording is None else ("--record", str((self.files.folder / recording).absolute()))),
            *("--elements", str(self.files.elements(one))),
            *("--from", iso[0], "--to", iso[1]),
            *("--min-alt", f"{terms.min_altitude_deg:g}"),
            *("--bias-along", f"{terms.bias_along_s:g}", "--bias-cross", f"{terms.bias_cross_deg:g}"),
            *kit.common,
            *kit.clock(),
        ]

    def why_end(self) -> str | None:
        """See Patient."""
        self.kit.service.promise(TURNS_WITHIN_S)
        if self.kit.requests.asked:
            return "stopped" if self.kit.requests.operator is None else "operator"
        self._read_again()
        return "weather" if self._watch is not None and self._watch.unsafe is not None else None

    def hears(self, utc_s: float, on_target_s: float, line: str, silent_s: float = 0.0) -> None:
        """See Patient."""
        self.kit.follows(utc_s, on_target_s, line, silent_s)
        self._beat(utc_s, on_target_s)

    def hears_trouble(self, words: str | None) -> None:
        """See Patient."""
        if self._recording is not None:
            self.kit.troubled("recording", words)


class Hands(Protocol):
    """Whoever carries orders out, with a real mount or with a simulated one."""

    def begin(self, beat: Beat | None) -> float:
        """Take up where the last sign of life was; return the instant that is now, POSIX seconds of UTC."""

    def perform(self, doing: Doing, run: Run) -> Happening | None:
        """Carry out an order; return the event that it ended with.

        None where the system ends the runner in the midst of it: a restart begins with it again.
        """


def drive(
    taken: TakenUp, hands: Hands, ways: Ways, told: Callable[[Run, Happening, Doing], None]
) -> tuple[Run, End | None]:
    """Run, or run on, until nothing is left to do; return what is known then, and why it ended.

    None where the system ended the runner. `told` hears of every event once it is kept.
    """
    journal, run = taken.journal, taken.run
    beat = journal.last_beat()
    event: Happening | None
    event = Started(utc_s=hands.begin(beat), ways=ways, recovered=taken.recovered, words=taken.words)
    if beat is not None:
        event = structs.replace(event, last_utc_s=beat.utc_s)
        if run.at is not None and beat.go == go_name(run.at, run.part):
            event = structs.replace(event, on_target_s=beat.on_target_s, recording=beat.recording)
    while event is not None:
        run, doing = machine.step(run, event)
        journal.append(event, run, doing)
        told(run, event, doing)
        if isinstance(doing, End):
            return run, doing
        event = hands.perform(doing, run)
    return run, None
