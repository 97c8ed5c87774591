"""Storms over `sattrack run`: a night's runner, its sessions and verbs, a mount, and who ends which of them.

The state machine, the executor, the journal, the sessions' loops, the mount's verbs and the guardian are the
program's own. What starts programs is the world's: a session or a verb runs as if its process had been begun.
Of two passes of one satellite the second begins after a pause; the mount is parked at the end.
"""

from __future__ import annotations

import math
import random
import tempfile
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import msgspec

from sattrack.control.console import Console
from sattrack.control.manual_operation import ManualOperation
from sattrack.control.procedures import DONE, ParkThere
from sattrack.core.clock import SystemClock
from sattrack.mount.model import AxesPosition
from sattrack.recording.recorder import NoRecording
from sattrack.runtime.connection import Connection
from sattrack.runtime.console import FREE_WITHIN_S, LOOK_AGAIN_S, ConsoleLoop
from sattrack.runtime.control_arbiter import ControlArbiter, Observers, SessionInbox
from sattrack.runtime.facts import build_engine
from sattrack.runtime.flight import LiveLoop, summarise
from sattrack.runtime.guardian import SIZE
from sattrack.runtime.mounts import Taken
from sattrack.runtime.system import StopRequest
from sattrack.schedule.file import load_schedule
from sattrack.schedule.machine import REVISION
from sattrack.schedule.night import End, NightPass, PassAttempt, Planned, Run, RunSettings
from sattrack.schedule.night_executor import LiveExecutor, NightContext, drive
from sattrack.schedule.night_folder import NightFiles, open_run
from sattrack.schedule.night_processes import Service
from sattrack.schedule.night_stop import NightRequests, keep_stop
from sattrack.schedule.schema import CommandAction, Terms
from sattrack.schedule.weather import WeatherReport
from sattrack.views.messages import StopNow, encode_message
from storm.draws import Person
from storm.world import RAISED, Ended, Guard, Killed, Lines, Link, Time, World
from tle.elements import Elements
from tle.instants import DAY_S

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sattrack.core.errors import SattrackError

SCHEDULE = '[weather]\ncommand = ["weather"]\nevery_s = 5\n[[passes]]\nsatellite = "drawn"\n'
FIRST_UNTIL, SECOND_FROM = 0.45, 0.6
"""Shares of the satellite's way: the end of the first pass, and the begin of the second."""
PROGRAM_FAILS, MOST_PROGRAM_S = 0.15, 3.0
UNSAFE, MOST_UNSAFE_S = 0.25, 25.0
ENDS_RUNNER, ENDS_SESSION, RELOADS = 0.5, 0.25, 0.2
"""In how many nights the runner is ended, a session is killed, and the schedule is read again."""
BACK_AFTER_S = (0.5, 20.0)
"""How long it takes until a runner that was ended is up again."""
VERB_WITHIN_S = 300.0
LONGEST_NIGHT_S = 1200.0


class RunnerKilled(BaseException):
    """The runner's process has ended: its sessions hear the end of their standard input."""


class RunnerTime(Time):
    """`time` of the runner."""

    def __init__(self, world: NightWorld) -> None:
        super().__init__(world, feeder=False)
        self._night = world

    def sleep(self, seconds: float) -> None:
        self._night.pass_time(seconds)


class Session:
    """A session's process; stands in for `sattrack.schedule.night_processes.PassSession`."""

    def __init__(self, world: NightWorld, one: NightPass, listener: Any) -> None:
        self._world, self._one, self._listener = world, one, listener
        self._why: str | None = None

    def run(self) -> PassAttempt:
        """Follow the pass; return how that ended. Raises RunnerKilled where the runner ends meanwhile."""
        world, now_s = self._world, self._world.machine_utc_s
        plan = msgspec.structs.replace(
            world.storm.facts.plan,
            start_utc_s=max(self._one.start_utc_s, now_s),
            end_utc_s=self._one.end_utc_s,
        )
        facts = msgspec.structs.replace(
            world.storm.facts, profile=world.profile, plan=plan, started_utc_s=now_s
        )
        engine = build_engine(facts)
        arbiter, observers = ControlArbiter(with_starter=True), Observers()
        self._lines = Lines(observers)
        inbox = SessionInbox(arbiter, self._lines, self._lines, observers)  # type: ignore[arg-type]
        screen: Any = SimpleNamespace(show=lambda view: self._show(view, engine))
        on_target_s, words = 0.0, None
        summary = None

        def follow(connection: Connection, stop: StopRequest) -> None:
            nonlocal summary
            loop = LiveLoop(connection, stop, engine, NoRecording(), screen, inbox, math.inf, observers)
            ended_utc_s = loop.run()
            summary = summarise(engine, loop.statistics, ended_utc_s)

        error = world.as_process(follow)
        on_target_s = engine.on_target_s
        if world.runner_ended:
            raise RunnerKilled
        if summary is None:
            words = None if error is None else str(error)
            return PassAttempt(self._why or "crash", world.machine_utc_s, on_target_s, words=words)
        return PassAttempt(
            ended_by=self._why or summary.ended_by,
            ended_utc_s=world.machine_utc_s,
            on_target_s=summary.on_target_s,
            words=summary.message,
        )

    def _show(self, view: Any, engine: Any) -> None:
        self._world.judge.period(self._world, engine, engine.tracker.ended_by)
        if self._world.runner_ended:
            self._lines.ended = True
            return
        self._listener.report_progress(view.utc_s, engine.on_target_s, str(view.phase))
        why = self._listener.end_reason()
        if why is not None and self._why is None:
            self._why = why
            self._lines.put(Person(0.0, encode_message(StopNow()).decode()))


class NightWorld(World):
    """A world whose program is a night's runner."""

    def run(self) -> Ended:
        """Run the night to its end; its folder outlives it, as `sattrack stop` may come later."""
        with tempfile.TemporaryDirectory() as folder:
            self._folder = Path(folder)
            return super().run()

    def _feed(self, observers: Observers) -> None:
        del observers
        facts, self._chances = self.storm.facts, random.Random(f"night {self.storm.seed}")
        self.profile = msgspec.structs.replace(facts.profile, park=AxesPosition(*self.storm.stands))
        self.runner_ended = False
        self._in_process = False
        # Nobody watches a mount that nobody moves.
        self.guardian, self.feeder_lives = None, False
        begin_s, end_s = self.now_s, facts.plan.end_utc_s
        spans = (
            (facts.plan.start_utc_s, begin_s + FIRST_UNTIL * (end_s - begin_s)),
            (begin_s + SECOND_FROM * (end_s - begin_s), end_s),
        )
        self._passes = tuple(self._night_pass(number, *span) for number, span in enumerate(spans, start=1))
        self._settings = RunSettings(
            begin_s, end_s + 5.0, (begin_s + 0.5 * DAY_S) % DAY_S, weather_every_s=5.0, revision=REVISION
        )
        self._unsafe = (math.inf, math.inf)
        if self._chances.random() < UNSAFE:
            from_s = begin_s + self._chances.uniform(0.0, end_s - begin_s)
            self._unsafe = from_s, from_s + self._chances.uniform(1.0, MOST_UNSAFE_S)
        self._ends_to_come(begin_s, end_s)
        with self._processes():
            self._night()

    def _ends_to_come(self, begin_s: float, end_s: float) -> None:
        """Draw who ends the runner or a session, and when."""
        dice = self._chances

        def when() -> float:
            return begin_s + dice.uniform(0.0, end_s - begin_s + 10.0)

        if dice.random() < ENDS_RUNNER:
            self.at(when(), self._end_runner, dice.choice(("killed", "terminated")))
        if dice.random() < ENDS_SESSION:
            self.at(when(), self._kill_session)
        if dice.random() < RELOADS:
            self.at(when(), self._reload)

    def _night_pass(self, number: int, start_s: float, end_s: float) -> NightPass:
        target = self.storm.facts.target
        assert isinstance(target, Elements)
        action = CommandAction(("dome",), if_it_fails=self._chances.choice(("go_on", "skip")))
        terms = Terms(before=(action,), after=(action,), least_s=5.0, settle_s=2.0, elements_oldest_days=1e6)
        return NightPass(
            key=f"drawn@{number}",
            number=number,
            elements=target,
            start_utc_s=start_s,
            culminate_utc_s=0.5 * (start_s + end_s),
            end_utc_s=end_s,
            leave_utc_s=start_s - 5.0,
            max_alt_deg=60.0,
            priority=1.0,
            useful_s=end_s - start_s,
            terms=terms,
            asked_by="a storm",
        )

    def _night(self) -> None:
        """Run the night, again after each end of the runner that a restart takes up."""
        folder = self._folder
        (folder / "night.toml").write_text(SCHEDULE)
        while True:
            self.runner_ended, self._requests = False, NightRequests(folder)
            taken = open_run(folder, self.machine_utc_s, durable=False)
            try:
                run, end = drive(taken, self._executor(taken), self._settings, self._report)
            except RunnerKilled:
                end = None
            except RAISED as error:
                self.ended.error = error
                self.trace("program", f"raised {error!r}")
                return
            finally:
                again = taken.journal.fold(Run())
                taken.journal.close()
            if end is not None:
                self._judge_night(run, end, again)
                return
            self.trace("program", "the runner has ended, and will be back")
            self.run_until(self.now_s + self._chances.uniform(*BACK_AFTER_S))

    def _judge_night(self, run: Run, end: End, again: Run) -> None:
        self.trace("program", f"{end.why}; {len(run.results)} results, the mount is {run.mount.value}")
        self.ended_by = "operator" if end.interrupted else "set"
        if again != run:
            self.judge.violated("replay", self, "the journal gives another night than was run")
        if not end.interrupted and len(run.results) != len(run.passes):
            self.judge.violated("once", self, f"{len(run.results)} of {len(run.passes)} passes have ended")
        if end.interrupted and self.stopped_by_person_s is None:
            self.judge.violated("once", self, f"the night ended without anybody's wish: {end.why}")

    def _executor(self, taken: Any) -> LiveExecutor:
        files = NightFiles(self._folder, "night.toml")
        tasks: Any = SimpleNamespace()
        schedule = load_schedule(self._folder / "night.toml")
        address: Any = "storm"
        context = NightContext(
            schedule=schedule,
            site=self.storm.facts.site.place(),
            profile=self.profile,
            address=address,
            folder=self._folder,
            command=lambda *words: list(words),
            now=lambda: self.machine_utc_s,
            speed=1.0,
            plan=self._plan,
            renew=lambda _: None,
            report_waiting=lambda _: None,
            report_progress=lambda *_: None,
            tell=lambda words: self.trace("log", words),
            report_trouble=lambda *_: None,
            read_again=lambda: (load_schedule(self._folder / "night.toml"), self._settings),
            tasks=tasks,
            requests=self._requests,
            service=Service({}),
        )
        return LiveExecutor(context, files, taken.journal)

    def _plan(self, begin_s: float, end_s: float, now_s: float) -> Planned:
        del begin_s, end_s
        self.pass_time(self._chances.uniform(0.0, 0.5))
        return Planned(utc_s=now_s, passes=tuple(one for one in self._passes if one.end_utc_s > now_s))

    def _report(self, run: Run, event: Any, order: Any) -> None:
        del event
        self.trace("log", f"{run.state.value}: {run.message or ''} -> {type(order).__name__}")
        # A clock that was set back makes a night longer.
        if self.at_s + min(0.0, self.host_offset_s) > LONGEST_NIGHT_S:
            raise ValueError("the night does not end")

    # the machine

    @property
    def machine_utc_s(self) -> float:
        """UTC by the machine's clock."""
        return self.now_s + self.host_offset_s

    def pass_time(self, seconds: float) -> None:
        """Have the runner wait. Raises RunnerKilled."""
        self.run_until(self.now_s + seconds)
        # A machine that stands still lets it wait longer.
        self.run_until(self._feeder_from_s)
        if self.runner_ended:
            raise RunnerKilled

    def as_process(self, work: Callable[[Connection, StopRequest], None]) -> SattrackError | None:
        """Have the mount's own process work, with its guardian; return by what it ended, None for by itself.

        One that is killed leaves the mount to its guardian.
        """
        self.page = memoryview(bytearray(SIZE)).cast("Q")
        self._arrived, self._kill = [], False
        self.feeder_lives, self.abandoned, self._in_process = True, False, True
        self.start_guardian()
        self.judge.begins(self)
        link: Any = Link(self, "feeder")
        error: SattrackError | None = None
        try:
            work(Connection(link, SystemClock(), None, Guard(self, link)), StopRequest())
        except Killed:
            self.trace("program", "killed")
            self.abandoned = self.guardian is None
        except RAISED as raised:
            error = raised  # type: ignore[assignment]
            self.trace("program", f"raised {raised!r}")
        self._kill = self.feeder_lives = self._in_process = False
        if self.guardian is not None:
            self.guardian.feeder_gone()
            self._schedule_guardian(0.0)
        return error

    def _wait_until_free(self, address: Any, waiting: Callable[[], None]) -> None:
        """Stand in for `sattrack.runtime.console.wait_until_free`."""
        del address, waiting
        until_s = self.monotonic_s + FREE_WITHIN_S
        while self.guardian is not None:
            if self.monotonic_s > until_s:
                raise Taken("the mount has an owner still")
            self.pass_time(LOOK_AGAIN_S)

    def _run_verb(
        self, command: list[str], timeout_s: float, stop_requested: Callable[[], bool]
    ) -> tuple[int, str | None]:
        """Stand in for `run_verb`: the only one that a night needs is the park."""
        del timeout_s
        assert command[:2] == ["mount", "park"]
        facts = self.storm.facts
        console = Console(self.profile, facts.limits, facts.site.place(), "storm")
        procedure = ParkThere(self.profile, power_off="--drives-on" not in command)
        part = ManualOperation(console, procedure, self.machine_utc_s, VERB_WITHIN_S)

        def work(connection: Connection, stop: StopRequest) -> None:
            def look(_: float) -> None:
                if not self.runner_ended and stop_requested():
                    stop.ask()

            ConsoleLoop(connection, stop, part, lambda _: None, look).run()

        error = self.as_process(work)
        if self.runner_ended:
            raise RunnerKilled
        if error is not None:
            return 1, str(error)
        outcome = part.outcome
        self.trace("program", f"park: {part.ended_by}, {outcome}")
        if outcome is None:
            return 1, "without a word"
        return (0, None) if outcome.state in DONE else (1, outcome.reason or outcome.state.value)

    def _run_program(self, *_: Any) -> str | None:
        """Stand in for `run_program`."""
        self.pass_time(self._chances.uniform(0.0, MOST_PROGRAM_S))
        return "ended with 1" if self._chances.random() < PROGRAM_FAILS else None

    @property
    def weather(self) -> WeatherReport:
        """What the weather's program says."""
        from_s, until_s = self._unsafe
        safe = not from_s <= self.now_s < until_s
        return WeatherReport(safe, None if safe else "clouds")

    @contextmanager
    def _processes(self) -> Iterator[None]:
        """Put the world in the place of what starts programs."""
        world = self

        class Watch:
            def __init__(self, *_: Any) -> None:
                pass

            @property
            def unsafe(self) -> str | None:
                return world.weather.words

            def close(self) -> None:
                pass

        stands_in = {
            "time": RunnerTime(self),
            "PassSession": lambda _command, one, _recording, _log, listener: Session(self, one, listener),
            "WeatherWatch": Watch,
            "WeatherSource": lambda weather, _: SimpleNamespace(weather=weather, ask=lambda *_: self.weather),
            "run_program": self._run_program,
            "run_verb": self._run_verb,
            "wait_until_free": self._wait_until_free,
        }
        with ExitStack() as stack:
            for name, one in stands_in.items():
                stack.enter_context(patch(f"sattrack.schedule.night_executor.{name}", one))
            yield

    # who ends what

    def _end_runner(self, how: str) -> None:
        self.trace("fault", f"the runner is {how}")
        if how == "terminated":
            self._requests.terminated = True
        else:
            self.runner_ended = True

    def _kill_session(self, _: Any) -> None:
        if self._in_process:
            self.trace("fault", "the session is killed")
            self._kill = True

    def _reload(self, _: Any) -> None:
        self._requests.reload = True

    def _befall(self, fault: Any) -> None:
        if fault.kind == "kill":
            self._kill_session(None)
        else:
            super()._befall(fault)

    def _ask_stop(self) -> None:
        """`sattrack stop`: the night ends with its session, and stays ended until a person resumes it."""
        super()._ask_stop()
        keep_stop(self._folder, "by a person")
        self.judge.stopping(self)
