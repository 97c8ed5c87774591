"""Runs of `track` and `demo` without a screen: one after another, progress, the summary, the exit code."""

from __future__ import annotations

import math
import os
import sys
import time
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack.cli.common import given_utc_s, how_to_renew
from sattrack.cli.output import JsonLines, can_draw_lines_anew, renew, say, tell, write_found
from sattrack.control.camera_image import Camera
from sattrack.core import local_time
from sattrack.core.errors import UNHEARD, BadInputError, LinkLostError, SattrackError
from sattrack.mount.alpaca.link import AlpacaAddress, check_server
from sattrack.runtime.control_arbiter import (
    ControlArbiter,
    Observers,
    SessionInbox,
    StdinInbox,
    check_source,
    open_observers,
    read_all,
)
from sattrack.runtime.facts import RunRequest, prepare
from sattrack.runtime.flight import failure, fly_live, fly_virtual
from sattrack.runtime.mounts import is_antenna, mount_address
from sattrack.runtime.system import StopRequest, stopping
from sattrack.runtime.view_server import ViewServerLink, open_view_server
from sattrack.views.formatting import OLD_ELEMENTS_DAYS, file_error, loop_text, phase_text, summary_lines
from sattrack.views.run import CameraSummary, Summary, SummaryLine, TrackView
from tle.elements import Elements, expected_along_arcsec
from tle.errors import TleError
from tle.instants import DAY_S, Utc

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from sattrack.cli.camera import CamerasSeen
    from sattrack.cli.common import CommandContext
    from sattrack.mount.profiles import ProfileFile
    from sattrack.runtime.facts import Prepared, RunFacts
    from sattrack.runtime.mounts import MountAddress
    from sattrack.servers.antenna.antcn import AntcnRun
    from sattrack.settings import Settings
    from sattrack.views.run import Armed, SessionView


SECONDS_BETWEEN_LINES = 5.0
OLDEST_DAYS = 14.0
TELLING_DELAY_S = 0.0005
IDLE_S = 0.05


@dataclass(slots=True)
class RunProgress:
    """Tells on standard error how a run goes: a line that renews itself on a terminal, else one now and then.

    With `quiet_off_terminal`, nothing is shown but on a terminal.
    """

    quiet_off_terminal: bool
    _phase: str = ""
    _shown_utc_s: float = float("-inf")

    def show(self, view: TrackView) -> None:
        """Take one state."""
        self.tell(view.utc_s, phase_text(view), lambda: progress_line(view))

    def tell(self, utc_s: float, phase: str, words: Callable[[], str]) -> None:
        """Take one state, as a phase and words."""
        terminal = can_draw_lines_anew()
        if self.quiet_off_terminal and not sys.stderr.isatty():
            return
        due = utc_s - self._shown_utc_s >= (1.0 if terminal else SECONDS_BETWEEN_LINES)
        if phase == self._phase and not due:
            return
        self._phase, self._shown_utc_s = phase, utc_s
        if terminal:
            renew(words())
        else:
            say(words(), err=True)

    def end(self) -> None:
        """Leave the renewed line."""
        if can_draw_lines_anew() and self._phase:
            click.echo(err=True)


def announcement(facts: RunFacts) -> list[str]:
    """Return the announcement of a run: which pass, when, and what the elements' age means."""
    plan = facts.plan
    target = facts.target
    lines = [f"{target.label} {_when(facts)}"]
    if facts.followed is not None:
        known = facts.followed
        stated = "" if known.body is not None else f", {file_error(known.sigma_km)}"
        lines.append(f"by {target.provenance}{stated}")
    age_days = (plan.start_utc_s - float(target.epoch.unix_s)) / 86400.0
    if facts.elements is not None and abs(age_days) > OLD_ELEMENTS_DAYS:
        lines.append(f"the elements are {abs(age_days):.1f} days off the pass: expect it early or late")
    off_s = facts.profile.dated_within_s
    if off_s is not None and off_s > TELLING_DELAY_S:
        what = "delays are" if facts.profile.clock_offset_s is None else "clock is"
        lines.append(
            f"the mount's {what} known to {math.ceil(off_s * 1000.0)} ms: at 1 °/s, up to "
            f"{math.ceil(off_s * 3600.0)}″ along the track that the reported error does not show"
        )
    from sattrack.runtime.pass_scene import foretold, uncalibrated

    return [*lines, *(words for words in (foretold(facts), uncalibrated(facts)) if words is not None)]


def _when(facts: RunFacts) -> str:
    """Return from when to when a pass lasts, and how high it comes."""
    # With its facts; the screen's own process has none, and needs nothing of what made them.
    from sattrack.runtime.facts import SEARCH_HOURS

    plan, now_s, high = facts.plan, facts.started_utc_s, f"{facts.max_alt_deg:.1f}° high"
    begins_s = plan.start_utc_s - now_s
    if not max(now_s, plan.start_utc_s) <= facts.culminate_utc_s <= plan.end_utc_s:
        high = f"{high} at {local_time.clock(facts.culminate_utc_s)}"
    if begins_s > 0.0:
        times = local_time.span(plan.start_utc_s, plan.end_utc_s)
        return f"from {times}, {high}, begins {local_time.until(begins_s)}"
    if plan.end_utc_s >= now_s + SEARCH_HOURS * 3600.0 - 1.0:
        return f"is up, and stays up for the next {SEARCH_HOURS:g} h and longer, {high}"
    return f"is up now, until {local_time.clock(plan.end_utc_s)} {local_time.zone_name(now_s)}, {high}"


def progress_line(view: TrackView) -> str:
    """Return one line about a state."""
    clock = local_time.clock(view.utc_s)
    error = "" if view.error is None else f"  error {view.error.total_arcsec:.2f}″"
    rms = "" if view.rms_10s_arcsec is None else f"  rms {view.rms_10s_arcsec:.2f}″"
    if view.phase not in {"acquiring", "tracking"}:
        error = rms = ""
    loop = f"  {loop_text(view.loop)}" if view.loop is not None else ""
    return (
        f"{clock}  {view.name}  {phase_text(view):<9} "
        f"alt {view.target_alt_deg:5.1f}°  az {view.target_az_deg:5.1f}°{error}{rms}{loop}  "
        f"link {view.link.state}"
    )


class Stream(JsonLines):
    """Writes views as JSON lines; with `tells_session`, who has control of the run as well."""

    def __init__(self, tells_session: bool = False) -> None:
        super().__init__()
        self.tells_session = tells_session

    def tell_scene(self, facts: RunFacts) -> None:
        """Say what does not change during a pass, before it."""
        from sattrack.runtime.pass_scene import pass_scene
        from sattrack.runtime.system import read_kernel_clock

        clock = read_kernel_clock()
        known = clock is not None and clock.synchronised
        self.write_whole(pass_scene(facts, clock.estimated_error_s if clock is not None and known else None))

    def tell_session(self, session: SessionView) -> None:
        """Say who has control."""
        if self.tells_session:
            self.write(session)

    def show(self, view: TrackView) -> None:
        """Take one state."""
        self.write(view)


def tell_malformed(observers: Observers) -> None:
    """Say how many lines were no observations, what was wrong with the last, and how many were dropped."""
    if observers.malformed:
        text = f"{observers.malformed} lines were no observations; the last: {observers.complaint}"
        tell(text)
    if observers.dropped:
        text = f"{observers.dropped} observations came faster than they can be used, and were dropped"
        tell(text)


def check_observations(source: str | None, control: bool, elements: tuple[str, ...]) -> None:
    """Refuse an `--observations` that cannot be, or that wants a standard input that is taken."""
    check_source(source)
    if source == "stdin" and control:
        raise BadInputError("--observations stdin: with --control, observations come with the messages")
    if source == "stdin" and "-" in elements:
        raise BadInputError("--observations stdin: the elements come from there; give them as a file")


def finish(summary: Summary, interrupted: bool, as_json: bool, address: MountAddress | None = None) -> int:
    """Tell the summary; raises the error whose exit code the run ends with, else returns 0.

    Where a mount at an address was never heard, the error says what to check.
    """
    if as_json:
        click.echo(msgspec.json.encode(SummaryLine(summary)).decode())
    else:
        say("\n".join(summary_lines(summary)))
    error = failure(summary, interrupted)
    if isinstance(error, LinkLostError) and summary.mount_stopped is None and address is not None:
        heard = str(error).removesuffix(f"; {UNHEARD}")
        raise LinkLostError(f"{heard}; {address.silence_advice}")
    if error is not None:
        raise error
    return 0


class Public:
    """Everybody to whom runs are shown: their starter, and those who watch."""

    def __init__(
        self, output: RunProgress | Stream, desk: ControlArbiter, gallery: ViewServerLink | None
    ) -> None:
        self._output, self._desk, self._gallery = output, desk, gallery
        self._version = -1
        self.left = False
        """Whether the starter of the runs has gone, and nobody reads what is written."""

    @property
    def screened(self) -> bool:
        """Whether the starter of the runs shows them on a screen, and is there."""
        return isinstance(self._output, Stream) and self._output.tells_session and not self.left

    def begin(self, facts: RunFacts) -> None:
        """Say what does not change during a run, before it, where it is not the first."""
        if isinstance(self._output, Stream) and self.screened:
            self._output.tell_scene(facts)
        if self._gallery is not None:
            self._gallery.begin(facts)

    def show(self, view: TrackView) -> None:
        """Take one state, and say who has control where that has changed."""
        self.look()
        self._output.show(view)
        if self._gallery is not None:
            self._gallery.show(view)

    def look(self) -> None:
        """Say who has control where that has changed."""
        version = self._desk.version
        if version != self._version and self._tell_session():
            self._version = version

    def end(self, summary: Summary) -> None:
        """Say what the run came to."""
        self.look()
        if isinstance(self._output, Stream) and self.screened:
            self._output.write_whole(SummaryLine(summary))
        if self._gallery is not None:
            self._gallery.tell_end(summary)

    def _tell_session(self) -> bool:
        if self._gallery is None:
            return True
        session = self._desk.view()
        if isinstance(self._output, Stream) and not self.left:
            self._tell_starter(self._output, session)
        return self._gallery.tell(session)

    def _tell_starter(self, output: Stream, session: SessionView) -> None:
        output.tell_session(session)
        if session.left_running:
            # Whoever started the run goes at this word: nothing must be written to nobody.
            self.left = True
            _write_nowhere()


def _write_nowhere() -> None:
    """Send standard output nowhere from now on, so that nobody is waited for."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def fly_and_tell(
    prepared: Prepared,
    output: RunProgress | Stream,
    control: bool,
    deadline_s: float = float("inf"),
    observations: str | None = None,
    again: Callable[[Armed, Prepared], Prepared] | None = None,
) -> tuple[Summary, bool]:
    """Fly a run in real time, and what is armed after it; return the last summary, and whether a signal came.

    With `control`, messages come on standard input; those that did nothing are reported at the end. With
    `observations`, what `--observations` takes, observations come from there. `again` prepares a pass that
    was armed during the one before; None where that cannot be. A screen on it is waited for after a run, as
    long as it is there: what is armed then begins at once.
    """
    stop = StopRequest()
    observers = open_observers(observations)
    stdin = StdinInbox(observers) if control else None
    gallery = open_view_server(prepared.facts)
    listening = observers if control or observations or gallery is not None else None
    desk = ControlArbiter(control, again is not None)
    public = Public(output, desk, gallery)
    inbox = SessionInbox(desk, stdin, gallery, observers)
    # What closes is closed whatever signals come: the outcome of the stop is told after that.
    with stopping(stop):
        try:
            summary = fly_live(prepared, public.show, stop, inbox, deadline_s, listening)
            public.end(summary)
            while again is not None and (following := _next(prepared, again, stop, public, inbox, desk)):
                prepared = following
                public.begin(prepared.facts)
                summary = fly_live(prepared, public.show, stop, inbox, deadline_s, listening)
                public.end(summary)
        finally:
            observers.close()
            if gallery is not None:
                gallery.close()
        output.end()
    for text in () if stdin is None else stdin.ignored:
        tell(text)
    tell_malformed(observers)
    return summary, stop.asked


def _next(
    before: Prepared,
    again: Callable[[Armed, Prepared], Prepared],
    stop: StopRequest,
    public: Public,
    inbox: SessionInbox,
    desk: ControlArbiter,
) -> Prepared | None:
    """Return the run that is armed, prepared; where none is, wait for one while there is a screen."""
    while not stop.asked:
        armed = desk.take_next()
        if armed is not None:
            try:
                return again(armed, before)
            except (SattrackError, TleError) as error:
                desk.say(f"{armed.name or armed.catalog_number} cannot be followed: {error}")
        elif not public.screened or _left(inbox):
            return None
        public.look()
        if armed is None:
            time.sleep(IDLE_S)
    return None


def _left(inbox: SessionInbox) -> bool:
    """Read the messages after a run; return whether its starter has gone.

    A stop has taken back what was armed; there is nothing else to stop.
    """
    inbox.messages()
    return inbox.ended


def camera_fields(settings: Settings, options: dict[str, Any]) -> dict[str, Any]:
    """Return what a run's request has of cameras: by the options, else the settings, else upright ones."""
    general = settings.camera
    rotation_deg = options["camera_rotation"]
    if rotation_deg is None:
        rotation_deg = general.rotation_deg or 0.0
    flip = options["camera_flip"] or bool(general.flipped)
    cameras = {
        name: Camera(
            rotation_deg if one.rotation_deg is None else one.rotation_deg,
            flip if one.flipped is None else one.flipped,
            one.scale_arcsec_px or general.scale_arcsec_px,
            one.kind,
            one.fov_deg or general.fov_deg,
        )
        for name, one in settings.cameras.items()
    }
    if general.scale_arcsec_px is not None or general.kind != "fine":
        any_other = Camera(rotation_deg, flip, general.scale_arcsec_px, general.kind, general.fov_deg)
        cameras[""] = any_other
    fine = [one.fov_deg for one in cameras.values() if one.kind == "fine" and one.fov_deg is not None]
    fov_deg = options["fov_deg"]
    if fov_deg is None:
        fov_deg = general.fov_deg or min(fine, default=None)
    return {
        "camera_rotation_deg": rotation_deg,
        "camera_flip": flip,
        "cameras": cameras,
        "fov_deg": fov_deg,
        "search_when_lost": options["search_lost"],
    }


def follow(context: CommandContext, satellite: str, options: dict[str, Any]) -> int:
    """Follow a satellite by what the command line says; return the exit code. Raises what that may."""
    from sattrack.cli.targets import Wanted, followed

    url = options["mount_url"] or context.settings.mount.url
    _check_options(context, url, {**options, "target": satellite})
    min_alt_deg = context.settings.min_altitude_deg if options["min_alt"] is None else options["min_alt"]
    between = (given_utc_s("--from", options["begin"]), given_utc_s("--to", options["end"]))
    now = context.now()
    begin = now if between[0] is None else max(now, Utc(between[0]))
    if between[0] is not None and between[0] < float(now.unix_s) - 1.0:
        tell(f"--from {options['begin']} is past: the pass in progress now, or the next, is followed")
    elements, site, target, _ = followed(
        context, satellite, url, options["ephemeris"], Wanted(begin, min_alt_deg)
    )
    request = RunRequest(
        satellite=satellite,
        mount_url=url,
        elements=elements,
        site=site,
        clock_option=context.clock_option,
        min_alt_deg=min_alt_deg,
        refraction=options["refraction"],
        bias_along_s=options["bias_along"],
        bias_cross_deg=options["bias_cross"],
        **camera_fields(context.settings, options),
        virtual=options["virtual"],
        record=options["record"],
        profile=context.profile(options["profile"], url),
        limits=context.settings.safety.limits(),
        memory=options["bias_memory"],
        between=between,
        target=target,
    )
    if is_antenna(url):
        if target is not None:
            raise BadInputError(f"{target.label}: an antenna's controller is fed from element sets only")
        return follow_by_antenna(context, request, options["old_elements"])
    # What is followed by its own reports is heard where observations come from.
    observations = satellite if satellite.startswith("adsb:") else options["observations"]
    prepared = prepare(request)
    known = prepared.facts.elements
    if known is not None and not (prepared.practising or options["old_elements"]):
        check_age(known, prepared.facts.plan.start_utc_s, request.fov_deg, context.sources())
    check_new_profile(options["learn_profile"], prepared.clock.speed)
    if prepared.practising:
        text = "no elements or site set: practising with the built-in ISS pass over Leiden"
        tell(text)
    for text in (*announcement(prepared.facts), *prepared.notes):
        tell(text)
    output = (
        Stream(tells_session=options["scene"]) if options["stream"] else RunProgress(quiet_off_terminal=True)
    )
    if isinstance(output, Stream) and options["scene"]:
        output.tell_scene(prepared.facts)
    summary, interrupted = _flown(context, request, prepared, output, options, observations)
    try:
        learn_profile(options["learn_profile"], request.profile, summary)
    finally:
        code = finish(summary, interrupted, context.json or options["stream"], prepared.address)
    return code


def _flown(
    context: CommandContext,
    request: RunRequest,
    prepared: Prepared,
    output: Stream | RunProgress,
    options: dict[str, Any],
    observations: str | None,
) -> tuple[Summary, bool]:
    """Return a run's summary, and whether it was interrupted."""
    if request.virtual:
        observers = None
        if observations is not None or options["cameras"]:
            observers = read_all(sys.stdin.buffer if observations is not None else ())
        if observers is not None and options["cameras"]:
            from sattrack.cli.camera import put_solved_frames

            seen = put_solved_frames(context, options, observers.put)
        summary, interrupted = fly_virtual(prepared, output.show, observers=observers), False
        output.end()
        if observers is not None:
            tell_malformed(observers)
    else:
        with ExitStack() as stack:
            if options["cameras"]:
                from sattrack.cli.camera import camera_processes

                seen = stack.enter_context(camera_processes(context, options))
            stack.enter_context(_served(context, options, prepared))
            summary, interrupted = fly_and_tell(
                prepared,
                output,
                options["control"],
                observations=observations,
                again=lambda armed, before: prepare(_next_request(request, armed, before)),
            )
    if options["cameras"]:
        summary = msgspec.structs.replace(summary, camera=_camera_summary(seen, summary))
    return summary, interrupted


def _served(
    context: CommandContext, options: dict[str, Any], prepared: Prepared
) -> AbstractContextManager[None]:
    """Serve the run to other programs meanwhile, where that is asked for."""
    if not options["serve"]:
        return nullcontext()
    from sattrack.cli.serve_alpaca import run_servers

    return run_servers(context, options["serve"], options, prepared)


def _camera_summary(seen: CamerasSeen, summary: Summary) -> CameraSummary:
    estimate = summary.estimate
    used, rejected = (0, 0) if estimate is None else (estimate.accepted, estimate.rejected + estimate.refused)
    return CameraSummary(seen.frames, seen.detected, used, rejected, seen.first_utc)


def _check_options(context: CommandContext, url: str | None, options: dict[str, Any]) -> None:
    """Raise BadInputError for a mount that cannot be, and for options that do not go together."""
    if is_antenna(url):
        for name in NOT_WITH_ANTENNA:
            if options[name] and options[name] not in {"auto", "off"}:
                option = name.replace("_", "-").replace("cameras", "camera")
                raise BadInputError(f"--{option} does not work with an antenna's controller; omit it")
        return
    address = mount_address(url)
    if isinstance(address, AlpacaAddress):
        check_server(address)
    check_new_profile(options["learn_profile"])
    virtual, observations = options["virtual"], options["observations"]
    if options["target"].startswith("adsb:") and (virtual or observations is not None):
        raise BadInputError("an aircraft is heard in real time, and alone: omit --virtual and --observations")
    if virtual and (options["stream"] or options["control"]):
        raise BadInputError("--stream and --control need real time; omit --virtual")
    if virtual and options["serve"]:
        raise BadInputError("--serve needs real time: clients live there; omit --virtual")
    if options["serve"]:
        # Imported before the run's clock is read, because that takes long.
        from sattrack.cli.serve_alpaca import run_ports

        run_ports(options["serve"])
    check_observations(observations, options["control"], context.sources())
    if options["cameras"]:
        from sattrack.cli.camera import check_cameras

        check_cameras(context, options)
    if virtual and observations not in {None, "stdin"}:
        raise BadInputError(f"--observations {observations}: in virtual time they come from stdin")


def check_age(elements: Elements, start_utc_s: float, fov_deg: float | None, sources: Sequence[str]) -> None:
    """Raise BadInputError where elements are too old to find the satellite with."""
    why = too_old(elements, start_utc_s, fov_deg, sources)
    if why is not None:
        raise BadInputError(f"{why}, or give --old-elements")


def too_old(
    elements: Elements, start_utc_s: float, fov_deg: float | None, sources: Sequence[str]
) -> str | None:
    """Return why elements of some sources are too old for a pass, and what to do; None where they are not.

    They are when they are more than OLDEST_DAYS off the pass, or when the error to expect along the track is
    larger than half the camera's field of view.
    """
    age_days = abs(start_utc_s - float(elements.epoch.unix_s)) / DAY_S
    what = f"the elements of {elements.label} are {age_days:.0f} days off the pass"
    do = how_to_renew(sources, elements.catalog_number)
    if age_days > OLDEST_DAYS:
        return f"{what}, {OLDEST_DAYS:g} are allowed: {do}"
    error_deg = expected_along_arcsec(elements, Utc(start_utc_s)) / 3600.0
    if fov_deg is not None and error_deg > fov_deg / 2.0:
        return f"{what}: expect it {error_deg:.2g}° off along its track, out of a field of {fov_deg:g}°: {do}"
    return None


def check_new_profile(target: Path | None, speed: float = 1.0) -> None:
    """Raise BadInputError where a profile cannot be learnt, or not be written as a new file."""
    if target is None:
        return
    if speed != 1.0:
        raise BadInputError(
            f"--learn-profile: a clock of {speed:g} times real speed changes the delays; omit one of them"
        )
    if target.exists():
        raise BadInputError(f"--learn-profile {target}: the file exists; give a new name")


def learn_profile(target: Path | None, base: ProfileFile, summary: Summary) -> None:
    """Write what a run has learnt of its mount, where that is asked for, and tell what was done."""
    if target is None:
        return
    if summary.acquired_after_s is None or summary.learnt is None:
        tell(f"{target} was not written: the mount was never on target, and nothing was learnt")
        return
    from sattrack.calibration.profile import learnt_text, with_learnt

    profile, learnt = with_learnt(base, summary.learnt, target.stem)
    if not learnt:
        tell(f"{target} was not written: the pass was too short, or too rough, to learn from")
        return
    check_new_profile(target)
    write_found(target, learnt_text(profile, learnt, base.name, f"{summary.name} on {summary.ended_utc}"))
    tell(f"learnt, and written to {target}: {', '.join(learnt)}")


def _next_request(request: RunRequest, armed: Armed, before: Prepared) -> RunRequest:
    """Return what is asked for by a pass that was armed: the same by the same clock, its record apart."""
    return replace(
        request,
        satellite=str(armed.catalog_number),
        target=None,
        between=(None, None),
        culminate_utc_s=armed.culminate_utc_s,
        clock=before.clock,
        record=None if request.record is None else next_file(request.record),
    )


def next_file(path: Path) -> Path:
    """Return the first name after `path` that is free: of pass.mcap pass-2.mcap, pass-3.mcap."""
    number = 2
    while (other := path.with_stem(f"{path.stem}-{number}")).exists():
        number += 1
    return other


NOT_WITH_ANTENNA = (
    "stream",
    "control",
    "observations",
    "cameras",
    "serve",
    "profile",
    "learn_profile",
    "bias_memory",
)


def follow_by_antenna(context: CommandContext, request: RunRequest, old_elements: bool) -> int:
    """Follow a pass with an antenna's controller; return the exit code."""
    from sattrack.servers.antenna.serve import parse_antenna_url
    from sattrack.servers.antenna.track import AntennaFlight, prepare_pass

    assert request.mount_url is not None
    url = parse_antenna_url(request.mount_url)
    ready = prepare_pass(request, url, context.settings.safety.limits())
    plan = ready.plan
    known = ready.propagator.elements
    if isinstance(known, Elements) and not old_elements:
        check_age(known, plan.start_utc_s, request.fov_deg, context.sources())
    times = local_time.span(plan.start_utc_s, plan.end_utc_s)
    label = ready.propagator.elements.label
    tell(f"{label} from {times}, {ready.max_alt_deg:.1f}° high")
    stop, progress = StopRequest(), RunProgress(quiet_off_terminal=True)

    def show(run: AntcnRun, now_utc_s: float) -> None:
        error = "" if run.error_arcsec is None else f"  error {run.error_arcsec:.1f}″"
        line = f"{local_time.clock(now_utc_s)}  {label}  {run.phase.value}{error}"
        progress.tell(now_utc_s, run.phase.value, lambda: line)

    flight = AntennaFlight(ready, stop, show)
    summary = flight.fly()
    progress.end()
    for text in flight.warnings():
        tell(text)
    return finish(summary, stop.asked, context.json)
