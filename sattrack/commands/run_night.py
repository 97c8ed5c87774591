"""`sattrack run FILE`: the schedule carried out, night after night, with a mount or in virtual time."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sattrack import practice
from sattrack.commands.common import tell
from sattrack.commands.run_plan import (
    loader,
    progress,
    said_utc_s,
    situation_of,
    why_left,
    within_half_a_turn,
)
from sattrack.commands.run_told import Told
from sattrack.errors import BadInputError, InterruptedRunError
from sattrack.runtime.mounts import is_antenna, mount_address
from sattrack.runtime.night_commands import Errands, Notifier
from sattrack.runtime.night_drive import drive
from sattrack.runtime.night_files import NightFiles
from sattrack.runtime.night_flight import Airspace
from sattrack.runtime.night_journal import FILE_NAME, Journal, locked
from sattrack.runtime.night_troubles import Troubles
from sattrack.runtime.night_virtual import VirtualHands
from sattrack.runtime.signals import StopRequest, stopping
from sattrack.schedule.file import load_schedule
from sattrack.schedule.making import make_plan_and_choice
from sattrack.schedule.night import End, NightPass, Planned, Ways
from sattrack.schedule.search import named_by
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sattrack.commands.common import CommandContext
    from sattrack.profiles import ProfileFile
    from sattrack.runtime.mounts import MountAddress
    from sattrack.runtime.night_drive import Hands
    from sattrack.schedule.candidates import Loaded
    from sattrack.schedule.file import Schedule
    from sattrack.schedule.making import Chosen
    from sattrack.schedule.night import Run

NOON_S, S_PER_DEG = 43200.0, 240.0
VIRTUAL_DAYS = 1.0
ERRANDS_WITHIN_S = 30.0
"""How long those who are notified are waited for at the end."""


@dataclass(slots=True)
class NightPlans:
    """Makes the plan of each night anew, of the schedule's file as it is then."""

    context: CommandContext
    file: Path
    profile: ProfileFile
    rehearse: bool

    def make(self, begin_utc_s: float, end_utc_s: float, now_utc_s: float) -> Planned:
        """Return the plan of a night. Raises BadInputError, SattrackError, TleError."""
        schedule = load_schedule(self.file)
        situation = situation_of(self.context, schedule, self.profile, (begin_utc_s, end_utc_s), now_utc_s)
        rehearse = None
        if self.rehearse:
            from sattrack.commands.run_rehearse import rehearser

            rehearse = rehearser(self.context, self.profile, schedule)
        load = loader(self.context, schedule)
        plan, chosen = make_plan_and_choice(schedule, situation, load, rehearse, progress())
        passes = tuple(_night_pass(k + 1, one, schedule, load) for k, one in enumerate(chosen))
        others = Counter(one.reason for one in plan.lost)
        return Planned(utc_s=now_utc_s, passes=passes, others=dict(sorted(others.items())))


def _night_pass(
    number: int, one: Chosen, schedule: Schedule, load: Callable[[str | None], Loaded]
) -> NightPass:
    candidate = one.candidate
    entry = schedule.entries[candidate.entry]
    top = Utc(candidate.culminate_utc_s).isoformat("seconds")
    return NightPass(
        key=f"{candidate.elements.catalog_number}@{top}",
        number=number,
        elements=candidate.elements,
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
        renewable=load(entry.source).renewable,
    )


def folder_of(file: Path, given: Path | None) -> Path:
    """Return where a schedule's run keeps its journal, status, summaries and recordings."""
    return file.with_suffix(".run") if given is None else given


def run_schedule(context: CommandContext, file: Path, options: dict[str, Any]) -> int:
    """Run a schedule, or run it on, to its end. Raises the error whose exit code it ends with."""
    schedule = load_schedule(file)
    mount_url = _mount_url(context, options)
    profile = within_half_a_turn(context.profile(options["profile"], mount_url))
    ways = _ways(context, schedule, profile, mount_address(mount_url), options)
    # What is wrong with the schedule or its elements is told now, and not in the evening.
    situation_of(context, schedule, profile, (ways.from_utc_s, ways.from_utc_s + 1.0), ways.from_utc_s)
    load = loader(context, schedule)
    for entry in schedule.entries:
        named_by(entry, load(entry.source))
    plans = NightPlans(context, file, profile, options["rehearse"])
    folder, stop = folder_of(file, options["folder"]), StopRequest()
    with locked(folder), stopping(stop):
        files = NightFiles(folder, str(file))
        journal = Journal(folder / FILE_NAME, durable=not options["virtual"])
        told = Told(files, str(file), context.json)
        errands: Errands | None = None
        try:
            hands: Hands
            if options["virtual"]:
                hands = _virtual_hands(context, schedule, (plans, files, journal, stop), options["seed"])
                hands.now_utc_s = ways.from_utc_s
            else:
                from sattrack.commands.run_live import live_hands

                hands = live_hands(context, schedule, profile, mount_url, (plans, files, journal, told, stop))
                errands = hands.kit.errands
                told.notifier = Notifier(schedule.notify, file.absolute().parent, errands)
            run, end = drive(journal, hands, ways, told.event)
        finally:
            told.close()
            if errands is not None:
                errands.finish(ERRANDS_WITHIN_S)
            journal.close()
    return _finish(run, end, told)


def _mount_url(context: CommandContext, options: dict[str, Any]) -> str:
    """Return which mount is meant. Raises BadInputError where it cannot be, or does not go with the rest."""
    url = options["mount_url"] or context.settings.mount.url
    if is_antenna(url):
        raise BadInputError(
            f"--mount {url}: an antenna's controller runs no schedules; give its mount's address"
        )
    real = mount_address(url) is not None
    if options["virtual"] and real:
        raise BadInputError("--virtual goes with --mount sim only; a real mount needs real time")
    if options["seed"] is not None and not options["virtual"]:
        raise BadInputError("--seed draws troubles for --virtual only; a real mount has its own")
    if real and context.clock_option is not None:
        raise BadInputError("--clock is for simulated mounts only; a real mount follows the real sky")
    return str(url)


def _virtual_hands(
    context: CommandContext,
    schedule: Schedule,
    parts: tuple[NightPlans, NightFiles, Journal, StopRequest],
    seed: int | None,
) -> VirtualHands:
    plans, files, journal, stop = parts
    start = practice.START
    limits = context.settings.safety.limits()
    air = Airspace(context.site(), plans.profile, limits, start.hour_angle_deg, start.dec_deg)
    return VirtualHands(
        air,
        plans.make,
        files.sum_up,
        journal,
        Troubles(seed),
        weather_asked=schedule.weather is not None,
        stop=stop,
    )


def _ways(
    context: CommandContext,
    schedule: Schedule,
    profile: ProfileFile,
    address: MountAddress | None,
    options: dict[str, Any],
) -> Ways:
    virtual = options["virtual"]
    begin = said_utc_s(options["start"], schedule.from_utc_s)
    if begin is None:
        begin = float(context.now().unix_s)
    end = said_utc_s(options["end"], schedule.to_utc_s)
    if end is None and virtual:
        end = begin + VIRTUAL_DAYS * 86400.0
    if end is not None and end <= begin:
        raise BadInputError(
            f"the run goes from {Utc(begin).isoformat('seconds')} to {Utc(end).isoformat('seconds')}: "
            "give --from and --to in order"
        )
    now = float(context.now().unix_s)
    if end is not None and not virtual and end <= now:
        raise BadInputError(
            f"the run would end at {Utc(end).isoformat('seconds')}, which is over: give another --to"
        )
    park = schedule.park_at_end
    left = why_left(schedule, profile, address)
    if left is not None:
        tell(left)
        park = False
    return Ways(
        from_utc_s=round(begin, 3),
        to_utc_s=None if end is None else round(end, 3),
        noon_s=(NOON_S - S_PER_DEG * context.site().longitude_deg) % 86400.0,
        park=park,
        weather_every_s=30.0 if schedule.weather is None else schedule.weather.every_s,
    )


def _finish(run: Run, end: End, told: Told) -> int:
    if end.interrupted:
        raise InterruptedRunError(f"{end.why}; run it again to go on with the passes to come")
    told.end(run)
    return 0
