"""What the runner of a night does with each order in real time, and which end it comes to."""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import msgspec
import pytest

from sattrack.cli.common import CommandContext
from sattrack.cli.run_night import NightPlans
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.mount.geometry import AxisGeometry
from sattrack.mount.model import AxisLimits, MountProfile, SitePlace
from sattrack.mount.profiles import ProfileFile
from sattrack.runtime import demo_pass
from sattrack.schedule import night_executor, night_processes, weather
from sattrack.schedule.file import load_schedule
from sattrack.schedule.night import (
    AskWeather,
    ClockSet,
    DoStep,
    Due,
    Follow,
    Followed,
    MakePlan,
    Mount,
    NightPass,
    NotPlanned,
    Order,
    Parked,
    ParkMount,
    PassPrepared,
    Planned,
    Prepare,
    Reread,
    Result,
    Run,
    RunSettings,
    RunState,
    StepDone,
    StopAsked,
    SummedUp,
    SumUp,
    Wait,
    WeatherReported,
)
from sattrack.schedule.night_executor import LiveExecutor, NightContext
from sattrack.schedule.night_folder import Heartbeat, Journal, NightFiles
from sattrack.schedule.night_processes import BackgroundTasks, Service
from sattrack.schedule.night_stop import NightRequests, keep_stop, stop_of
from sattrack.schedule.schema import CommandAction, SlewAction, Terms, WebhookAction
from sattrack.settings import Settings
from tle.errors import TleError
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sattrack.runtime.mounts import MountAddress
    from tle.elements import Elements

BEGIN = 1_790_942_520.0
PLAIN = '[[passes]]\nsatellite = "ISS"\n'
ONE = NightPass(
    key="25544@x",
    number=1,
    elements=demo_pass.elements(),
    start_utc_s=BEGIN + 20.0,
    culminate_utc_s=BEGIN + 200.0,
    end_utc_s=BEGIN + 400.0,
    leave_utc_s=BEGIN,
    max_alt_deg=81.3,
    priority=2.0,
    useful_s=380.0,
    terms=Terms(),
    asked_by="a test",
    renewable=True,
)
DONE = Result("done", on_target_s=370.0)
SETTINGS = RunSettings(BEGIN, BEGIN + 86400.0, 0.0)
VIEW = {"type": "view", "utc_s": BEGIN + 20.0, "phase": "tracking", "target_alt_deg": 40.0, "warnings": []}


UNFORESEEN = [ValueError("too long\nmore"), RecursionError("too deep"), MemoryError(), SattrackError()]


def failing(error: Exception) -> Callable[..., Any]:
    """Return what raises an error, whatever it is given."""

    def fails(*_: Any) -> Any:
        raise error

    return fails


def told(error: Exception) -> str:
    """Return how an error that nobody foresaw is told: in one line, with its type."""
    return ": ".join([type(error).__name__, *str(error).splitlines()[:1]])


@dataclass
class Night:
    """A runner's executor whose commands are a stand-in's, at an instant that the test sets."""

    folder: Path
    text: str = PLAIN
    utc_s: float = BEGIN
    script: str = "pass"
    """What a command of ours does, in Python; its arguments are in `sys.argv`."""
    executable: str = sys.executable
    troubles: dict[str, str | None] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    progress: list[str] = field(default_factory=list)
    commands: list[tuple[str, ...]] = field(default_factory=list)
    plan: Callable[[float, float, float], Planned] | None = None
    renew: Callable[[NightPass], Elements | None] | None = None

    def __post_init__(self) -> None:
        file = self.folder / "night.toml"
        file.write_text(self.text)
        self.files = NightFiles(self.folder, "night.toml")
        self.journal = Journal(self.folder / "journal")
        self.requests = NightRequests(self.folder)
        self.tasks = BackgroundTasks(self.said.append)
        self.context = NightContext(
            schedule=load_schedule(file),
            site=demo_pass.SITE.place(),
            profile=MountProfile(),
            address=None,
            folder=self.folder,
            command=self._command,
            now=lambda: self.utc_s,
            speed=1.0,
            plan=self.plan or (lambda begin, end, now: Planned(utc_s=now, passes=(), words=f"{begin} {end}")),
            renew=self.renew or (lambda _: None),
            report_waiting=lambda _: None,
            report_progress=lambda utc_s, on_target_s, line, silent_s: self.progress.append(line),
            tell=self.said.append,
            report_trouble=self.troubles.__setitem__,
            read_again=lambda: (load_schedule(file), SETTINGS),
            tasks=self.tasks,
            requests=self.requests,
            service=Service({}),
        )
        self.executor = LiveExecutor(self.context, self.files, self.journal)

    def _command(self, *words: str) -> list[str]:
        self.commands.append(words)
        return [self.executable, "-c", self.script, *words]

    def perform(
        self,
        order: Order,
        one: NightPass = ONE,
        state: RunState = RunState.WAITING,
        result: Result = DONE,
    ) -> Any:
        run = Run(
            settings=SETTINGS,
            state=state,
            night=1,
            night_from_utc_s=BEGIN - 600.0,
            night_to_utc_s=BEGIN + 3600.0,
            passes=(one,),
            results=(result,),
        )
        return self.executor.perform(order, run)


@pytest.fixture
def night(tmp_path: Path) -> Night:
    return Night(tmp_path)


class TestWaiting:
    def test_an_instant_that_has_come_is_due(self, night: Night) -> None:
        assert night.perform(Wait(until_utc_s=BEGIN)) == Due(utc_s=BEGIN)

    def test_a_clock_that_is_set_meanwhile_is_told(self, night: Night) -> None:
        readings = iter([BEGIN, BEGIN + 3600.0])
        night.context.now = lambda: next(readings)
        found = night.perform(Wait(until_utc_s=BEGIN + 10.0))
        assert isinstance(found, ClockSet)
        assert (found.seconds, found.slept) == (pytest.approx(3600.0, abs=1.0), False)

    def test_it_shows_that_it_lives(self, night: Night) -> None:
        shown: list[float] = []
        readings = iter([BEGIN, BEGIN, BEGIN + 1.0])
        night.context.now = lambda: next(readings)
        night.context.report_waiting = shown.append
        assert isinstance(night.perform(Wait(until_utc_s=BEGIN + 0.1)), Due)
        assert shown == [BEGIN]
        assert night.journal.last_heartbeat() == Heartbeat(BEGIN, None, 0.0, None)

    def test_a_schedule_that_was_read_again_ends_it_where_a_plan_can_be_made(self, night: Night) -> None:
        night.requests.reload = True
        again = Wait(until_utc_s=BEGIN + 60.0)
        assert night.perform(again) == Reread(utc_s=BEGIN, settings=SETTINGS)
        assert night.requests.reload is False
        assert night.troubles["schedule"] is None
        # Before a pass it is read, but waits until there is time for a plan.
        night.requests.reload = True
        assert isinstance(night.perform(Wait(until_utc_s=BEGIN), state=RunState.PREPARING), Due)
        assert isinstance(night.perform(again), Reread)

    def test_a_wrong_schedule_leaves_the_one_in_force(self, night: Night) -> None:
        before = night.context.schedule
        (night.folder / "night.toml").write_text("passes = 3\n")
        night.requests.reload = True
        assert isinstance(night.perform(Wait(until_utc_s=BEGIN)), Due)
        assert night.context.schedule is before
        assert str(night.troubles["schedule"]).startswith("not read again, the schedule in force stays: ")
        assert "night.toml:1:10: passes is 3" in str(night.troubles["schedule"])

    @pytest.mark.parametrize("error", UNFORESEEN)
    def test_no_error_of_reading_it_again_ends_the_night(self, night: Night, error: Exception) -> None:
        night.context.read_again = failing(error)
        night.requests.reload = True
        assert isinstance(night.perform(Wait(until_utc_s=BEGIN)), Due)
        assert night.troubles["schedule"] == f"not read again, the schedule in force stays: {told(error)}"


class TestEnds:
    def test_a_person_at_the_terminal_ends_it(self, night: Night) -> None:
        night.requests.interrupted = True
        assert night.perform(Wait(until_utc_s=BEGIN + 60.0)) == StopAsked(utc_s=BEGIN, words="interrupted")
        assert night.perform(ParkMount(power_off=True)) == StopAsked(utc_s=BEGIN, words="interrupted")
        assert night.commands == []

    def test_an_operators_stop_ends_it_in_its_words(self, night: Night) -> None:
        keep_stop(night.folder, "by the night assistant")
        found = night.perform(MakePlan())
        assert isinstance(found, StopAsked)
        assert "by the night assistant" in found.words

    def test_a_system_that_ends_it_keeps_what_is_done_and_nothing_else(self, tmp_path: Path) -> None:
        night = Night(tmp_path)
        night.requests.terminated = True
        assert night.perform(Wait(until_utc_s=BEGIN + 60.0)) is None

        def ending(then: Any) -> Any:
            def do(*_: Any) -> Any:
                night.requests.terminated = True
                return then

            return do

        planned = Planned(utc_s=BEGIN, passes=())
        orders: list[tuple[Order, type | None]] = [
            (MakePlan(), Planned),
            (Prepare(index=0, wake=False), PassPrepared),
            (ParkMount(power_off=True), Parked),
        ]
        night.context.plan, night.context.renew = ending(planned), ending(None)
        night.context.command = ending([sys.executable, "-c", ""])
        for order, kept in orders:
            night.requests.terminated = False
            assert isinstance(night.perform(order), kept or type(None)), order
        # A park that was cut short is begun again.
        night.requests.terminated = False
        night.context.command = ending([sys.executable, "-c", "raise SystemExit(1)"])
        assert night.perform(ParkMount(power_off=True)) is None

    def test_in_a_pause_before_a_pass_nothing_is_followed_any_more(self, night: Night) -> None:
        asked = iter([BEGIN, BEGIN, BEGIN + 1.0])

        def now() -> float:
            night.requests.interrupted = True
            return next(asked, BEGIN + 2.0)

        night.context.now = now
        found = night.perform(Follow(index=0, part=1, from_utc_s=BEGIN, pause_s=60.0))
        assert isinstance(found, Followed)
        assert found.attempt.ended_by == "stopped"
        assert night.commands == []


class TestPlans:
    def test_a_night_that_has_begun_is_planned_from_now_on(self, night: Night) -> None:
        found = night.perform(MakePlan())
        assert found == Planned(utc_s=BEGIN, passes=(), words=f"{BEGIN} {BEGIN + 3600.0}")

    @pytest.mark.parametrize("error", [BadInputError("no such file\nmore"), TleError("no such file\nmore")])
    def test_why_there_is_none_is_said_in_one_line(self, tmp_path: Path, error: Exception) -> None:
        def fails(*_: float) -> Planned:
            raise error

        assert Night(tmp_path, plan=fails).perform(MakePlan()) == NotPlanned(
            utc_s=BEGIN, words="no such file"
        )

    def test_the_night_goes_by_the_schedule_that_was_planned(self, tmp_path: Path) -> None:
        night, file = Night(tmp_path), tmp_path / "night.toml"
        before = night.context.schedule
        night.troubles["schedule"] = "not read again"
        night.context.planned = lambda: load_schedule(file)
        file.write_text('[weather]\ncommand = ["false"]\n' + PLAIN)
        # A plan that could not be made leaves what is in force.
        makes, night.context.plan = night.context.plan, failing(TleError("x"))
        night.perform(MakePlan())
        assert night.context.schedule is before
        night.context.plan = makes
        night.perform(MakePlan())
        assert night.context.schedule.weather is not None
        assert night.perform(AskWeather()).safe is False
        assert night.troubles["schedule"] is None

    def test_a_night_that_needed_no_plan_goes_by_the_schedule_before(self, night: Night) -> None:
        before = night.context.schedule
        night.perform(MakePlan())
        assert night.context.schedule is before

    @pytest.mark.parametrize("error", UNFORESEEN)
    def test_no_error_of_a_plan_costs_more_than_the_plan(self, tmp_path: Path, error: Exception) -> None:
        night = Night(tmp_path, plan=failing(error))
        assert night.perform(MakePlan()) == NotPlanned(utc_s=BEGIN, words=told(error))

    def test_the_nights_summary_is_written_or_what_keeps_it_from_that_is_said(self, night: Night) -> None:
        found = night.perform(SumUp())
        assert isinstance(found, SummedUp)
        assert found.file is not None
        assert (
            (night.folder / found.file).read_text().startswith("night 1: 1 of 1 passes done; 370 s on target")
        )
        folder = night.folder / "summaries"
        for file in folder.iterdir():
            file.unlink()
        folder.rmdir()
        folder.write_text("no folder")
        again = night.perform(SumUp())
        assert again.file is None
        assert "; no summary: cannot write " in str(again.words)


class TestPreparation:
    @pytest.mark.parametrize(
        ("wake", "cause", "words"),
        [
            ("", "power", "the drives are parked, and no [wake] says how to wake them"),
            ('[wake]\nrun = ["sh", "-c", "exit 3"]\n', "power", "sh: ended with 3"),
            ('[wake]\nrun = ["sh", "-c", "echo $SATTRACK_WHEN > woken"]\n', None, None),
        ],
    )
    def test_drives_without_power_are_woken_or_the_pass_is_lost(
        self, tmp_path: Path, wake: str, cause: str | None, words: str | None
    ) -> None:
        night = Night(tmp_path, wake + PLAIN)
        found = night.perform(Prepare(index=0, wake=True))
        assert (found.cause, found.words, found.woken) == (cause, words, cause is None)
        assert (tmp_path / "woken").exists() is (cause is None)

    def test_elements_are_renewed_and_a_provider_that_fails_costs_no_pass(self, tmp_path: Path) -> None:
        newer = replace(demo_pass.elements(), name="NEWER")
        night = Night(tmp_path, renew=lambda _: newer)
        assert night.perform(Prepare(index=0, wake=False)) == PassPrepared(utc_s=BEGIN, elements=newer)

        def fails(_: NightPass) -> None:
            raise TleError("the provider is silent\nmore")

        night.context.renew = fails
        found = night.perform(Prepare(index=0, wake=False))
        assert (found.cause, found.elements) == (None, None)
        assert found.words == "ISS (ZARYA): elements are not renewed: the provider is silent"

    @pytest.mark.parametrize("error", UNFORESEEN)
    def test_no_error_of_renewing_elements_costs_the_pass(self, tmp_path: Path, error: Exception) -> None:
        found = Night(tmp_path, renew=failing(error)).perform(Prepare(index=0, wake=False))
        assert (found.cause, found.elements) == (None, None)
        assert found.words == f"ISS (ZARYA): elements are not renewed: {told(error)}"

    @pytest.mark.parametrize(("rule", "cause"), [("skip", "elements too old"), ("run", None)])
    def test_old_elements_are_treated_as_the_schedule_says(
        self, tmp_path: Path, rule: str, cause: str | None
    ) -> None:
        old = replace(demo_pass.elements(), epoch=Utc(ONE.start_utc_s - 9.5 * 86400.0))
        terms = msgspec.structs.replace(ONE.terms, if_elements_old=rule)
        one = msgspec.structs.replace(ONE, elements=old, renewable=False, terms=terms)
        found = Night(tmp_path).perform(Prepare(index=0, wake=False), one)
        assert found.cause == cause
        if cause is not None:
            assert found.words == "9.5 days old at the pass, 7 are allowed"


class TestWeather:
    def test_without_a_source_nothing_is_known(self, night: Night) -> None:
        assert night.perform(AskWeather()) == WeatherReported(utc_s=BEGIN, safe=None)

    def test_a_source_is_asked(self, tmp_path: Path) -> None:
        night = Night(tmp_path, '[weather]\ncommand = ["sh", "-c", "exit 1"]\n' + PLAIN)
        assert night.perform(AskWeather()) == WeatherReported(
            utc_s=BEGIN, safe=False, words="sh: ended with 1"
        )

    @pytest.mark.parametrize("restarts", [True, False])
    def test_a_stop_does_not_wait_for_a_source_that_hangs(self, tmp_path: Path, restarts: bool) -> None:
        hangs = "touch asked; until [ -e over ]; do sleep 0.05; done"
        text = f'[weather]\ncommand = ["sh", "-c", "{hangs}"]\ntimeout_s = 30\n'
        night = Night(tmp_path, text + PLAIN)

        def stop() -> None:
            while not (tmp_path / "asked").exists():
                time.sleep(0.01)
            night.requests.terminated, night.requests.interrupted = restarts, not restarts

        threading.Thread(target=stop, daemon=True).start()
        begun_s = time.monotonic()
        found = night.perform(AskWeather())
        (tmp_path / "over").touch()
        assert time.monotonic() - begun_s < 25.0
        # The weather that was not waited for is not known: a restart asks again.
        assert found == (None if restarts else StopAsked(utc_s=BEGIN, words="interrupted"))


RAINS_ONCE_WET = """\
[weather]
command = ["sh", "-c", "echo x >> asked; test ! -e wet"]
every_s = {every_s}
"""


def in_any_weather(one: NightPass) -> NightPass:
    terms = msgspec.structs.replace(one.terms, if_weather_unsafe="run")
    return msgspec.structs.replace(one, terms=terms)


def with_actions(*actions: Any, after: bool = False) -> NightPass:
    given = {"after": actions} if after else {"before": actions}
    return msgspec.structs.replace(ONE, terms=Terms(**given))


class TestSteps:
    def do(self, night: Night, action: Any, when: str = "before", result: Result = DONE) -> Any:
        one = with_actions(action, after=when == "after")
        return night.perform(DoStep(index=0, when=when, step=0), one, result=result)

    def test_a_program_that_is_waited_for(self, night: Night) -> None:
        writes = CommandAction(("sh", "-c", "echo $SATTRACK_WHEN $SATTRACK_RESULT > said"))
        assert self.do(night, writes, "after") == StepDone(utc_s=BEGIN, done=True)
        assert (night.folder / "said").read_text() == "after done\n"
        failed = self.do(night, CommandAction(("sh", "-c", "exit 4")))
        assert (failed.done, failed.words) == (False, "ended with 4")

    def test_what_is_not_waited_for_complains_later(self, night: Night) -> None:
        before = set(threading.enumerate())
        assert self.do(night, CommandAction(("sh", "-c", "exit 5"), wait=False)).done
        assert self.do(night, WebhookAction("http://127.0.0.1:9/", 5.0)).done
        for thread in set(threading.enumerate()) - before:
            thread.join()
        program, address = sorted(night.said, reverse=True)
        assert program == "run sh -c exit 5, not waited for: ended with 5"
        assert address.startswith("post to 127.0.0.1: cannot be posted to: ")

    def test_a_slew_is_the_mounts_own_verb(self, night: Night) -> None:
        night.script = "import sys; assert sys.argv[1:3] == ['mount', 'slew'], sys.argv"
        assert self.do(night, SlewAction(ra_deg=100.0, dec_deg=20.0)) == StepDone(utc_s=BEGIN, done=True)
        ((_, _, ra, dec),) = night.commands
        # Of date: precession since J2000 is a third of a degree.
        assert 0.1 < abs(float(ra) - 100.0) < 0.6
        assert abs(float(dec) - 20.0) < 0.3

    def test_a_slew_that_is_refused_says_why(self, night: Night) -> None:
        night.script = "import sys; sys.stderr.write('x\\nsattrack: below the floor\\n'); sys.exit(2)"
        found = self.do(night, SlewAction(ra_deg=100.0, dec_deg=20.0))
        assert (found.done, found.words) == (False, "below the floor")
        night.script = "raise SystemExit(7)"
        assert self.do(night, SlewAction(alt_deg=50.0, az_deg=20.0)).words == "mount slew ended with 7"

    def test_no_action_before_a_pass_is_begun_in_unsafe_weather(self, tmp_path: Path) -> None:
        """A restart, or an action that took long, leads to no question of the machine's."""
        text = RAINS_ONCE_WET.replace("{every_s}", "3600") + PLAIN
        opens = CommandAction(("touch", "opened"))
        assert self.do(Night(tmp_path, text), opens).done
        (tmp_path / "opened").unlink()
        (tmp_path / "wet").touch()
        night = Night(tmp_path, text)
        rain = WeatherReported(utc_s=BEGIN, safe=False, words="sh: ended with 1")
        slew = SlewAction(ra_deg=100.0, dec_deg=20.0)
        unwaited = CommandAction(("touch", "opened"), wait=False)
        for action in (opens, slew, unwaited, WebhookAction("http://127.0.0.1:9/", 1.0)):
            assert self.do(night, action) == rain
        assert night.commands == []
        assert not (tmp_path / "opened").exists()
        assert self.do(night, opens, "after").done
        assert (tmp_path / "opened").exists()
        for action in (opens, slew):
            one = in_any_weather(with_actions(action))
            assert night.perform(DoStep(index=0, when="before", step=0), one).done
        assert len(night.commands) == 1

    def test_a_slew_after_a_pass_is_left_out_in_unsafe_weather(self, tmp_path: Path) -> None:
        night = Night(tmp_path, RAINS_ONCE_WET.replace("{every_s}", "3600") + PLAIN)
        (tmp_path / "wet").touch()
        words = "not done: the weather is unsafe: sh: ended with 1"
        slew = SlewAction(ra_deg=100.0, dec_deg=20.0)
        assert self.do(night, slew, "after") == StepDone(utc_s=BEGIN, done=False, words=words)
        assert night.commands == []

    @pytest.mark.parametrize("restarts", [True, False])
    def test_a_stop_while_the_weather_is_asked_about_begins_no_action(
        self, tmp_path: Path, restarts: bool, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        night = Night(tmp_path, RAINS_ONCE_WET.replace("{every_s}", "3600") + PLAIN)
        asks = night_executor.WeatherSource.ask

        def stop(*given: Any) -> Any:
            night.requests.terminated, night.requests.interrupted = restarts, not restarts
            return asks(*given)

        monkeypatch.setattr(night_executor.WeatherSource, "ask", stop)
        found = self.do(night, CommandAction(("touch", "opened")))
        assert found == (None if restarts else StopAsked(utc_s=BEGIN, words="interrupted"))
        assert not (tmp_path / "opened").exists()

    def test_after_a_pass_that_the_weather_ended_a_dome_is_closed_and_nothing_slews(
        self, night: Night
    ) -> None:
        lost = Result("partly", "weather", "rain", on_target_s=100.0)
        slew = SlewAction(ra_deg=100.0, dec_deg=20.0)
        words = "not done: the weather ended the pass"
        assert self.do(night, slew, "after", lost) == StepDone(utc_s=BEGIN, done=False, words=words)
        assert night.commands == []
        close = CommandAction(("sh", "-c", "echo $SATTRACK_CAUSE > closed"))
        assert self.do(night, close, "after", lost).done
        assert (night.folder / "closed").read_text() == "weather\n"
        # The weather that ended a pass says nothing of the next.
        assert self.do(night, slew, "before", lost).done

    def test_a_slow_mount_is_given_the_time_that_it_takes(
        self, night: Night, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        given_s: list[float] = []

        def run_verb(command: Any, timeout_s: float, stop_requested: Any) -> tuple[int, str | None]:
            given_s.append(timeout_s)
            return 0, None

        monkeypatch.setattr(night_executor, "run_verb", run_verb)
        slow, fast = AxisLimits(max_rate_deg_s=0.2, slew_rate_deg_s=0.2), AxisLimits(slew_rate_deg_s=0.2)
        led = AxisGeometry(pole_azimuth_deg=0.0, pole_altitude_deg=90.0)
        for profile in (
            MountProfile(),
            MountProfile(ra=fast),
            MountProfile(ra=slow, geometry=led, stands_at=SitePlace(52.0, 4.5)),
        ):
            night.context.profile = profile
            assert self.do(night, SlewAction(ra_deg=100.0, dec_deg=20.0)).done
        # 200° either way of the meridian at 0.2 °/s are 2000 s.
        assert given_s[0] == 600.0
        assert min(given_s[1:]) > 2000.0

    def test_a_step_that_is_cut_off_is_begun_again_and_one_that_is_done_is_not(self, night: Night) -> None:
        readings = iter([BEGIN, BEGIN])

        def now() -> float:
            night.requests.terminated = True
            return next(readings, BEGIN)

        night.context.now = now
        found = self.do(night, CommandAction(("true",)))
        assert found == StepDone(utc_s=BEGIN, done=True)
        night.requests.terminated = False
        assert self.do(night, CommandAction(("false",))) is None


class TestParking:
    @pytest.mark.parametrize(
        ("power_off", "words", "mount"),
        [(True, ("mount", "park"), Mount.PARKED), (False, ("mount", "park", "--drives-on"), Mount.AT_PARK)],
    )
    def test_with_its_drives_on_or_off(
        self, night: Night, power_off: bool, words: tuple[str, ...], mount: Mount
    ) -> None:
        assert night.perform(ParkMount(power_off=power_off)) == Parked(utc_s=BEGIN, mount=mount)
        assert night.commands == [words]

    def test_one_that_fails_is_taken_to_be_at_rest_only(self, night: Night) -> None:
        night.script = "import sys; sys.exit('sattrack: the mount is silent')"
        found = night.perform(ParkMount(power_off=True))
        assert (found.mount, found.words) == (Mount.AT_REST, "the mount is silent")
        night.executable = str(night.folder / "gone")
        again = night.perform(ParkMount(power_off=True))
        assert (again.mount, again.words) == (
            Mount.AT_REST,
            "mount park cannot be run: No such file or directory",
        )


class TestSignsOfLife:
    """Whoever asks for the status must not hear that the run is silent, while it is only busy."""

    @pytest.fixture
    def shown(self, night: Night, monkeypatch: pytest.MonkeyPatch) -> list[float]:
        monkeypatch.setattr(night_executor, "SHOW_EVERY_S", 0.02)
        monkeypatch.setattr(night_executor, "POLL_S", 0.01)
        monkeypatch.setattr(night_processes, "LOOK_EVERY_S", 0.01)
        seen: list[float] = []
        night.context.report_waiting = seen.append
        return seen

    def test_while_the_mount_is_parked(self, night: Night, shown: list[float]) -> None:
        night.script = "import time; time.sleep(0.2)"
        assert night.perform(ParkMount(power_off=True)).mount is Mount.PARKED
        # Not at each look: the status is a file.
        assert 2 <= len(shown) <= 20
        assert set(shown) == {BEGIN}
        assert night.journal.last_heartbeat() == Heartbeat(BEGIN)

    def test_in_a_pause(self, night: Night, shown: list[float]) -> None:
        began_s = time.monotonic()
        night.context.now = lambda: BEGIN + time.monotonic() - began_s
        night.script = ""
        with_pause = with_actions(SlewAction(ra_deg=100.0, dec_deg=20.0, wait_s=0.2))
        assert night.perform(DoStep(index=0, when="before", step=0), with_pause).done
        assert len(shown) >= 2

    def test_before_a_session_that_was_left_behind_has_ended(
        self, night: Night, shown: list[float], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(night_executor, "wait_until_free", lambda _, waiting: waiting())
        night.context.address = cast("MountAddress", "a mount")
        night.script = ""
        assert night.perform(ParkMount(power_off=True)).mount is Mount.PARKED
        assert shown[:1] == [BEGIN]

    def test_while_a_plan_is_made(self, night: Night, shown: list[float]) -> None:
        context = CommandContext(Settings(), "52.1541,4.4908,0", (), None, False, False)
        plans = NightPlans(context, night.folder / "night.toml", ProfileFile("m"), rehearse=False)
        plans._progress()("searched", 1, 2)
        assert shown == []
        plans.show_life = night.executor.show_life
        plans._progress()("searched", 1, 2)
        assert shown == [BEGIN]


SAYS = "import json, sys\nfor line in {lines!r}: print(json.dumps(line), flush=True)\nsys.exit({code})"
FOLLOW = Follow(index=0, part=1, from_utc_s=BEGIN)


class TestFollowing:
    def summary(self, ended_by: str, **more: Any) -> dict[str, Any]:
        return {"summary": {"ended_by": ended_by, "on_target_s": 370.0, "message": None, **more}}

    def test_a_session_that_ends_by_itself(self, night: Night) -> None:
        later = {**VIEW, "utc_s": BEGIN + 21.0, "error": {"total_arcsec": 0.31}}
        summary = self.summary("set", reported_rms_arcsec=0.2, held_s={"altitude": 1.5})
        night.script = SAYS.format(lines=[VIEW, later, summary], code=0)
        attempt = night.perform(FOLLOW).attempt
        assert (attempt.ended_by, attempt.on_target_s, attempt.rms_arcsec) == ("set", 370.0, 0.2)
        assert attempt.held_s == {"altitude": 1.5}
        assert attempt.recording == "recordings/20261002T120220Z-25544-1.mcap"
        assert night.progress[-1] == "tracking  alt 40.0°  error 0.31″"
        (command,) = night.commands
        assert command[:2] == ("track", "25544")
        assert command[command.index("--from") + 1] == Utc(ONE.start_utc_s).isoformat("milliseconds")
        assert command[command.index("--record") + 1] == str(night.folder / str(attempt.recording))
        beat = night.journal.last_heartbeat()
        assert beat is not None
        assert (beat.attempt, beat.recording) == ("25544@x#1", attempt.recording)

    def test_one_that_dies_without_a_word(self, night: Night) -> None:
        night.script = "import sys; sys.stderr.write('sattrack: out of memory\\n'); sys.exit(9)"
        attempt = night.perform(FOLLOW).attempt
        assert (attempt.ended_by, attempt.words) == ("crash", "out of memory")
        night.executable = str(night.folder / "gone")
        assert night.perform(FOLLOW).attempt.ended_by == "crash"

    def test_an_operators_stop_at_its_screen_outlives_the_runner(self, night: Night) -> None:
        night.script = SAYS.format(lines=[VIEW, self.summary("operator")], code=0)
        found = night.perform(FOLLOW)
        assert isinstance(found, Followed)
        assert found.attempt.ended_by == "operator"
        assert "at the session's screen" in str(stop_of(night.folder))

    def test_weather_that_turns_ends_it_and_what_it_has_reached_is_kept(self, tmp_path: Path) -> None:
        night = Night(tmp_path, RAINS_ONCE_WET.replace("{every_s}", "0.1") + PLAIN)
        later = {**VIEW, "utc_s": BEGIN + 20.5}
        # It goes on until it is told to stop, as a session does.
        night.script = SAYS.format(lines=[VIEW, later], code=0).replace(
            "sys.exit", f"open({str(tmp_path / 'wet')!r}, 'w'); sys.stdin.read(1); sys.exit"
        )
        attempt = night.perform(FOLLOW).attempt
        assert (attempt.ended_by, attempt.on_target_s) == ("weather", 0.5)
        # Why, in the words of the weather.
        assert str(attempt.words).startswith("sh: ended with 1")
        # Whoever does not care for the weather is not asked about it.
        night.script = SAYS.format(lines=[VIEW, self.summary("set")], code=0)
        assert night.perform(FOLLOW, in_any_weather(ONE)).attempt.ended_by == "set"

    def test_in_unsafe_weather_what_is_left_of_a_pass_is_not_begun(self, tmp_path: Path) -> None:
        night = Night(tmp_path, RAINS_ONCE_WET.replace("{every_s}", "3600") + PLAIN)
        (tmp_path / "wet").touch()
        # As after a restart of the runner, which leads to no question of the machine's.
        attempt = night.perform(Follow(index=0, part=2, from_utc_s=BEGIN)).attempt
        assert (attempt.ended_by, attempt.words, attempt.recording) == ("weather", "sh: ended with 1", None)
        assert night.commands == []

    def test_weather_that_was_just_asked_about_is_not_asked_about_again(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        for module in (night_executor, weather):
            # A busy machine takes its time.
            monkeypatch.setattr(module, "FRESH_S", 3600.0)
        night = Night(tmp_path, RAINS_ONCE_WET.replace("{every_s}", "3600") + PLAIN)
        night.script = SAYS.format(lines=[VIEW, self.summary("set")], code=0)
        assert night.perform(AskWeather()).safe
        assert night.perform(FOLLOW).attempt.ended_by == "set"
        assert (tmp_path / "asked").read_text() == "x\n"

    def test_a_stop_while_the_weather_is_asked_about_begins_nothing(self, tmp_path: Path) -> None:
        night = Night(tmp_path, RAINS_ONCE_WET.replace("{every_s}", "3600") + PLAIN)
        (tmp_path / "wet").touch()
        asks = night_executor.WeatherSource.ask

        def stop(*given: Any) -> Any:
            night.requests.interrupted = True
            return asks(*given)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(night_executor.WeatherSource, "ask", stop)
            assert night.perform(FOLLOW).attempt.ended_by == "stopped"
        assert night.commands == []

    def test_the_system_that_ends_the_runner_ends_the_session_and_leaves_a_sign_of_life(
        self, night: Night
    ) -> None:
        def tell(*_: Any) -> None:
            night.requests.terminated = True

        night.context.report_progress = tell
        night.script = SAYS.format(lines=[VIEW], code=0).replace("sys.exit", "sys.stdin.read(1); sys.exit")
        # A restart goes on with the pass.
        assert night.perform(FOLLOW) is None
        beat = night.journal.last_heartbeat()
        assert beat is not None
        assert beat.attempt == "25544@x#1"

    def test_without_room_a_pass_is_followed_and_not_recorded(self, night: Night) -> None:
        (night.folder / "recordings").write_text("no folder")
        night.script = SAYS.format(lines=[VIEW, self.summary("set")], code=0)
        attempt = night.perform(FOLLOW).attempt
        assert (attempt.ended_by, attempt.recording) == ("set", None)
        assert str(night.troubles["recording"]).endswith("; passes go unrecorded")
        assert "--record" not in night.commands[0]
