"""`sattrack run FILE`: the schedule carried out, night after night, with a mount or in virtual time."""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.common import given_utc_s
from sattrack.cli.output import say, tell
from sattrack.cli.run_plan import (
    check_park,
    loader,
    progress,
    rehearser,
    situation_of,
    why_left,
    within_half_a_turn,
)
from sattrack.cli.run_report import RunReporter
from sattrack.core.clock import SimulatedClock
from sattrack.core.errors import BadInputError, InterruptedRunError, SattrackError, TerminatedRunError
from sattrack.core.process import self_command
from sattrack.runtime import demo_pass
from sattrack.runtime.mounts import is_antenna, mount_address
from sattrack.runtime.target_facts import target_facts
from sattrack.schedule.candidates import named_by
from sattrack.schedule.file import load_schedule
from sattrack.schedule.machine import REVISION
from sattrack.schedule.making import make_plan
from sattrack.schedule.night import End, Mount, NightPass, Planned, RunSettings, RunState, mean_noon_s
from sattrack.schedule.night_executor import LiveExecutor, NightContext, drive
from sattrack.schedule.night_folder import NightFiles, open_run, read_status
from sattrack.schedule.night_processes import BackgroundTasks, Notifier, Service
from sattrack.schedule.night_stop import (
    NightRequests,
    handling_signals,
    list_night,
    locked,
    resume_command,
    stop_of,
    take_back_stop,
    unlist_night,
)
from sattrack.schedule.virtual_executor import SimulatedStation, Troubles, VirtualExecutor
from sattrack.views.formatting import iso_unix_s
from tle.elements import Elements
from tle.errors import TleError
from tle.instants import Utc
from tle.sources import same_object

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.cli.common import CommandContext
    from sattrack.mount.profiles import ProfileFile
    from sattrack.runtime.mounts import MountAddress
    from sattrack.schedule.candidates import Loaded
    from sattrack.schedule.file import Schedule
    from sattrack.schedule.making import Chosen
    from sattrack.schedule.night import Run
    from sattrack.schedule.night_executor import Executor
    from sattrack.schedule.night_folder import Journal
    from sattrack.schedule.night_stop import OperatorStop


VIRTUAL_DAYS = 1.0
KEPT_BEFORE_S = 600.0
"""How long before the mount must set out at the latest a pass may be begun."""
TASKS_WITHIN_S = 30.0
"""How long those who are notified are waited for at the end."""


@dataclass(slots=True)
class NightPlans:
    """Makes the plan of each night from the schedule's file as it is then."""

    context: CommandContext
    file: Path
    profile: ProfileFile
    rehearse: bool
    journal: Journal | None = None
    schedule: Schedule | None = None
    """The schedule that the last plan was made from; None where none could be made, or was needed."""
    settled: Schedule | None = None
    """The schedule that the run's settings are from."""
    to_is_given: bool = False
    """Whether the run's end is that of an option, whatever the schedule says."""
    run_to_utc_s: float = math.inf
    """The end of the last night."""
    show_life: Callable[[], None] | None = None
    """Is called again and again while a plan is made."""

    def take(self, settings: RunSettings) -> None:
        """Take what a run's settings say of its end."""
        self.run_to_utc_s = math.inf if settings.to_utc_s is None else settings.to_utc_s

    def make(self, begin_utc_s: float, end_utc_s: float, now_utc_s: float) -> Planned:
        """Return the plan of a night, empty for one that is over.

        Raises BadInputError, SattrackError, TleError.
        """
        self.schedule = None
        if end_utc_s <= begin_utc_s:
            return Planned(utc_s=now_utc_s, passes=(), words="the night was over before it could begin")
        schedule = load_schedule(self.file)
        situation = situation_of(self.context, schedule, self.profile, (begin_utc_s, end_utc_s), now_utc_s)
        # Another night follows, which could not begin with a pass that this one ends within.
        situation = replace(situation, whole_until_utc_s=max(end_utc_s, self.run_to_utc_s))
        asked = (entry.conditions for entry in schedule.entries)
        counts = any(c.once_a_run or c.once_a_night or c.most_an_hour is not None for c in asked)
        if counts and self.journal is not None:
            situation = replace(situation, followed=self.journal.followed())
        rehearse = rehearser(self.context, self.profile, schedule) if self.rehearse else None
        load = loader(self.context, schedule)
        plan, chosen = make_plan(schedule, situation, load, rehearse, self._progress())
        for note in plan.notes:
            tell(note)
        passes = tuple(_night_pass(k + 1, one, schedule, load) for k, one in enumerate(chosen))
        others = Counter(one.reason for one in plan.lost)
        self.schedule = schedule
        return Planned(utc_s=now_utc_s, passes=passes, others=dict(sorted(others.items())))

    def unsettled(self, schedule: Schedule) -> str | None:
        """Return what a schedule changes that only a reload changes in a run; None for nothing."""
        if self.settled is None:
            return None
        old, new = _settled_by(self.settled), _settled_by(schedule)
        keys = [key for key in new if new[key] != old[key] and not (key == "to" and self.to_is_given)]
        if not keys:
            return None
        how = "(SIGHUP, `systemctl reload`)"
        return f"{self.file}: THE OLD VALUES HOLD until a reload {how} of what was changed: {', '.join(keys)}"

    def _progress(self) -> Callable[[str, int, int], None]:
        show = progress()

        def tell_progress(what: str, done: int, total: int) -> None:
            if self.show_life is not None:
                self.show_life()
            if show is not None:
                show(what, done, total)

        return tell_progress


def _settled_by(schedule: Schedule) -> dict[str, object]:
    """Return what a schedule says of a run's settings, by key, as `_settings` takes it."""
    return {
        "to": schedule.to_utc_s,
        "park_at_end": schedule.park_at_end,
        "[weather] every_s": _weather_every_s(schedule),
        "[wake] timeout_s": _wake_s(schedule),
    }


def _weather_every_s(schedule: Schedule) -> float:
    return 30.0 if schedule.weather is None else schedule.weather.every_s


def _wake_s(schedule: Schedule) -> float:
    return 0.0 if schedule.wake is None else schedule.wake.timeout_s


def _night_pass(
    number: int, one: Chosen, schedule: Schedule, load: Callable[[str | None], Loaded]
) -> NightPass:
    candidate = one.candidate
    target, entry = candidate.elements, schedule.entries[candidate.entry]
    file = Path(entry.source or "").name
    is_satellite = isinstance(target, Elements)
    top = Utc(candidate.culminate_utc_s).isoformat("seconds")
    return NightPass(
        key=f"{target.catalog_number or target.label}@{top}",
        number=number,
        elements=replace(target, source=file) if isinstance(target, Elements) else None,
        start_utc_s=round(one.start_utc_s, 3),
        culminate_utc_s=round(candidate.culminate_utc_s, 3),
        end_utc_s=round(one.end_utc_s, 3),
        leave_utc_s=round(one.leave_utc_s, 3),
        max_alt_deg=round(candidate.max_alt_deg, 3),
        priority=candidate.priority,
        useful_s=round(candidate.useful_within(one.start_utc_s, one.end_utc_s), 3),
        terms=entry.terms,
        asked_by=entry.label,
        source=entry.source,
        renewable=is_satellite and load(entry.source).renewable,
        lost_to=one.lost_to,
        followed=None
        if isinstance(target, Elements)
        else target_facts(target, one.leave_utc_s - KEPT_BEFORE_S, one.end_utc_s),
        asked=candidate.asked,
        ephemeris=candidate.file,
    )


@dataclass(frozen=True, slots=True)
class Checked:
    """A schedule with all that a run of it needs, read and found good."""

    schedule: Schedule
    mount_url: str
    profile: ProfileFile
    settings: RunSettings
    left_out: tuple[str, ...]
    """Files and elements of entries that have not the object."""


def check_schedule(
    context: CommandContext, file: Path, options: dict[str, Any], folder: Path | None = None
) -> Checked:
    """Read a schedule, its settings, the mount's address and the elements; nothing is moved.

    A run that was left off in `folder` is continued after its end too: it parks the mount, and sums up.
    What is wrong is reported now, and not in the evening. Raises BadInputError, SattrackError, TleError.
    """
    schedule = load_schedule(file)
    mount_url = _mount_url(context, options)
    profile = within_half_a_turn(context.profile(options["profile"], mount_url))
    settings = _settings(context, schedule, profile, mount_address(mount_url), options, folder)
    situation = situation_of(
        context, schedule, profile, (settings.from_utc_s, settings.from_utc_s + 1.0), settings.from_utc_s
    )
    load = loader(context, schedule)
    left_out: list[str] = []
    for entry in schedule.entries:
        if not entry.satellites:
            load(entry.source)
        notes: list[str] = []
        named_by(entry, load, situation, notes.append)
        left_out += [f"{entry.origin}: {entry.label}: {words}" for words in notes]
    return Checked(schedule, mount_url, profile, settings, tuple(left_out))


def show_check(context: CommandContext, file: Path, folder: Path, options: dict[str, Any]) -> int:
    """Check a schedule, and say in one line that it can be run. Raises BadInputError."""
    try:
        checked = check_schedule(context, file, options, folder)
    except (SattrackError, TleError) as error:
        raise BadInputError(str(error).splitlines()[0]) from error
    for words in checked.left_out:
        tell(words)
    count = len(checked.schedule.entries)
    if context.json:
        click.echo(json.dumps({"schedule": str(file), "entries": count, "mount": checked.mount_url}))
        return 0
    say(f"{file}: {count} {'entry' if count == 1 else 'entries'}, mount {checked.mount_url}: can be run")
    return 0


def run_schedule(context: CommandContext, file: Path, folder: Path, options: dict[str, Any]) -> int:
    """Run a schedule, or run it on, to its end. Raises the error whose exit code it ends with.

    An end with the mount not parked is such an error: whoever started the run may look at nothing else.
    """
    checked = check_schedule(context, file, options, folder)
    requests = NightRequests(folder)
    with locked(folder), handling_signals(requests):
        if options["resume"]:
            take_back(folder)
        refuse_stopped(file, folder)
        if not options["virtual"]:
            address = mount_address(checked.mount_url)
            wrong = list_night(folder, file, None if address is None else address.name)
            if wrong is not None:
                tell(wrong)
        run, end, reporter = _driven(context, file, checked, requests, options)
        if not requests.restarts:
            unlist_night(folder)
    return _finish(run, end, reporter, requests, file)


def take_back(folder: Path) -> OperatorStop | None:
    """Take an operator's stop back, and tell of it; None where none stood. Raises SattrackError."""
    stop = take_back_stop(folder)
    tell("there is no operator's stop to cancel" if stop is None else f"{stop}: taken back")
    return stop


def refuse_stopped(file: Path, folder: Path) -> None:
    """Raise InterruptedRunError where an operator's stop stands."""
    stop = stop_of(folder)
    if stop is not None:
        raise InterruptedRunError(f"{file}: {stop}; `{resume_command(str(file), folder)}` resumes")


def _driven(
    context: CommandContext, file: Path, checked: Checked, requests: NightRequests, options: dict[str, Any]
) -> tuple[Run, End | None, RunReporter]:
    """Take the journal up and carry the schedule out; return how that ended."""
    folder, schedule = requests.folder, checked.schedule
    plans = NightPlans(context, file, checked.profile, options["rehearse"])
    plans.take(checked.settings)
    plans.settled, plans.to_is_given = schedule, options["end"] is not None
    files = NightFiles(folder, str(file))
    taken = open_run(folder, float(context.now().unix_s), durable=not options["virtual"])
    plans.journal = taken.journal
    reporter = RunReporter(files, str(file), context.json, taken.journal, Service())
    tasks: BackgroundTasks | None = None

    def in_force(schedule: Schedule) -> Schedule:
        """Renew what goes by the schedule, but is not the executor's."""
        if reporter.notifier is not None and tasks is not None:
            reporter.notifier = Notifier(schedule.notify, file.absolute().parent, tasks)
        reporter.report_trouble("reload", plans.unsettled(schedule))
        return schedule

    def read_again() -> tuple[Schedule, RunSettings]:
        again = check_schedule(context, file, options)
        plans.take(again.settings)
        plans.settled = again.schedule
        return in_force(again.schedule), again.settings

    def planned() -> Schedule | None:
        return None if plans.schedule is None else in_force(plans.schedule)

    try:
        executor: Executor
        if options["virtual"]:
            parts = (plans, files, taken.journal, requests)
            executor = _virtual_executor(context, schedule, parts, options["seed"])
            executor.now_utc_s = checked.settings.from_utc_s
        else:
            executor = live_executor(
                *(context, schedule, checked.profile, checked.mount_url),
                (plans, files, taken.journal, reporter, requests),
                read_again,
                planned,
            )
            plans.show_life = executor.show_life
            tasks = executor.context.tasks
            reporter.notifier = Notifier(schedule.notify, file.absolute().parent, tasks)
        reporter.service.tell("READY=1")
        run, end = drive(taken, executor, checked.settings, reporter.event)
        reporter.service.tell("STOPPING=1")
    finally:
        reporter.close()
        if tasks is not None:
            tasks.finish(TASKS_WITHIN_S)
        files.clear_memory()
        taken.journal.close()
    return run, end, reporter


def _mount_url(context: CommandContext, options: dict[str, Any]) -> str:
    """Return which mount is meant. Raises BadInputError where it cannot be, or does not go with the rest."""
    url = options["mount_url"] or context.settings.mount.url
    if is_antenna(url):
        raise BadInputError(
            f"--mount {url}: an antenna's controller runs no schedules; give its mount's address"
        )
    _, address = context.mount(url)
    if options["virtual"] and address is not None:
        raise BadInputError("--virtual needs --mount sim; a real mount needs real time")
    if options["seed"] is not None and not options["virtual"]:
        raise BadInputError("--seed needs --virtual; a real mount has its own troubles")
    return str(url)


def _virtual_executor(
    context: CommandContext,
    schedule: Schedule,
    parts: tuple[NightPlans, NightFiles, Journal, NightRequests],
    seed: int | None,
) -> VirtualExecutor:
    plans, files, journal, requests = parts
    start = demo_pass.START
    limits = context.settings.safety.limits()
    station = SimulatedStation(context.site(), plans.profile, limits, start.hour_angle_deg, start.dec_deg)
    return VirtualExecutor(
        station,
        plans.make,
        files.sum_up,
        journal,
        Troubles(seed),
        weather_asked=schedule.weather is not None,
        requests=requests,
    )


def _settings(
    context: CommandContext,
    schedule: Schedule,
    profile: ProfileFile,
    address: MountAddress | None,
    options: dict[str, Any],
    folder: Path | None,
) -> RunSettings:
    virtual = options["virtual"]
    begin = given_utc_s("--from", options["start"], schedule.from_utc_s)
    if begin is None:
        begin = float(context.now().unix_s)
    end = given_utc_s("--to", options["end"], schedule.to_utc_s)
    if end is None and virtual:
        end = begin + VIRTUAL_DAYS * 86400.0
    now = float(context.now().unix_s)
    if end is not None and not virtual and end <= now:
        left_off_s = None if folder is None else _left_off_utc_s(folder)
        if left_off_s is None or left_off_s >= end:
            raise BadInputError(
                f"the run would end at {Utc(end).isoformat('seconds')}, which is over: give another --to"
            )
        begin = min(begin, left_off_s)
    if end is not None and end <= begin:
        raise BadInputError(
            f"the run goes from {Utc(begin).isoformat('seconds')} to {Utc(end).isoformat('seconds')}: "
            "give --from and --to in order"
        )
    park = schedule.park_at_end
    left = why_left(schedule, profile, address)
    if left is not None:
        tell(left)
        park = False
    if park:
        check_park(profile.mount, context.site(), context.settings.safety.limits())
    return RunSettings(
        from_utc_s=round(begin, 3),
        to_utc_s=None if end is None else round(end, 3),
        noon_s=mean_noon_s(context.site().longitude_deg),
        park=park,
        weather_every_s=_weather_every_s(schedule),
        wake_s=_wake_s(schedule),
        revision=REVISION,
    )


def _left_off_utc_s(folder: Path) -> float | None:
    """Return when the night of a run that was left off began, POSIX seconds; None where none was."""
    try:
        view = read_status(folder)
        return None if view is None or view.state == RunState.ENDED else iso_unix_s(view.from_utc)
    except (SattrackError, TleError):
        return None


def _finish(run: Run, end: End | None, reporter: RunReporter, requests: NightRequests, file: Path) -> int:
    if end is None:
        how = f" while {run.state}: no pass was followed just then"
        if run.state is RunState.FOLLOWING:
            how = ": its session was asked to stop the mount, see sessions.log"
        raise TerminatedRunError(f"terminated{how}; a restart continues here")
    if end.interrupted:
        refuse_stopped(file, requests.folder)
        raise InterruptedRunError(f"{end.why}; run it again to continue with the coming passes")
    reporter.end(run)
    why = why_not_parked(run)
    if why is not None:
        raise SattrackError(
            f"THE MOUNT IS NOT PARKED: {why}; look at it, then `sattrack mount park`, or park it by hand"
        )
    return 0


def why_not_parked(run: Run) -> str | None:
    """Return why a mount that its schedule parks is not parked; None where it is, or was never moved."""
    moved = run.mount is not Mount.UNKNOWN or run.parked_utc_s > 0.0
    if not run.settings.park or not moved or run.mount in (Mount.AT_PARK, Mount.PARKED):
        return None
    told = (note.partition("NOT PARKED: ")[2] for note in reversed(run.notes))
    return next((why for why in told if why), "it was not sent there, or did not get there")


def live_executor(
    context: CommandContext,
    schedule: Schedule,
    profile: ProfileFile,
    mount_url: str,
    parts: tuple[NightPlans, NightFiles, Journal, RunReporter, NightRequests],
    read_again: Callable[[], tuple[Schedule, RunSettings]],
    planned: Callable[[], Schedule | None],
) -> LiveExecutor:
    """Return what carries a schedule out in real time."""
    plans, files, journal, reporter, requests = parts
    clock = context.clock()
    simulated = clock if isinstance(clock, SimulatedClock) else None

    def now() -> float:
        return time.time() if simulated is None else simulated.utc_s(time.monotonic())

    options = _common(context, mount_url, files.profile(profile))

    def command(*text: str) -> list[str]:
        clock: tuple[str, ...] = ()
        if simulated is not None:
            clock = ("--clock", f"{Utc(now()).isoformat('milliseconds')}x{simulated.speed:g}")
        return [*self_command(), *text, *options, *clock]

    night = NightContext(
        schedule=schedule,
        site=context.site(),
        profile=profile.mount,
        address=mount_address(mount_url),
        folder=plans.file.absolute().parent,
        command=command,
        now=now,
        speed=1.0 if simulated is None else simulated.speed,
        plan=plans.make,
        renew=renewer(context, lambda: night.schedule),
        report_waiting=reporter.report_waiting,
        report_progress=reporter.report_progress,
        tell=tell,
        report_trouble=reporter.report_trouble,
        read_again=read_again,
        tasks=BackgroundTasks(tell),
        requests=requests,
        service=reporter.service,
        planned=planned,
    )
    return LiveExecutor(night, files, journal)


def _common(context: CommandContext, mount_url: str, profile: Path) -> tuple[str, ...]:
    """Return the options of every command of ours: this one's mount, site, settings and profile."""
    site = context.site()
    options = ["--mount", mount_url, "--site", f"{site.latitude_deg},{site.longitude_deg},{site.height_m}"]
    if context.settings_file is not None:
        options += ["--config", str(context.settings_file)]
    return (*options, "--profile", str(profile))


def renewer(
    context: CommandContext, schedule: Callable[[], Schedule]
) -> Callable[[NightPass], Elements | None]:
    """Return what gives a pass' satellite's newest elements, by the providers' rules; None where none are.

    `schedule` gives the schedule in force.
    """

    def renew(one: NightPass) -> Elements | None:
        sources = (*context.sources(), *schedule().elements) if one.source is None else (one.source,)
        old = one.elements
        assert old is not None
        same = [each for each in context.load(sources).accepted if same_object(each, old)]
        now_s = float(context.now().unix_s)
        nearest = min(same, key=lambda each: abs(float(each.epoch.unix_s) - now_s), default=old)
        return nearest if nearest.epoch.unix_s > old.epoch.unix_s else None

    return renew
