"""`sattrack mount calibrate`: find out what a mount does with commands, and write its profile."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack import __version__
from sattrack.cli.camera import camera_options, solving_camera
from sattrack.cli.common import (
    CommandContext,
    OutputFile,
    RenamedOption,
    common_options,
    load_simulator_profile,
    mount_option,
)
from sattrack.cli.output import renew, renew_at_once, show, table, tell, write_found
from sattrack.core.errors import BadInputError, InterruptedRunError, SattrackError
from sattrack.runtime import demo_pass
from sattrack.settings import NO_SITE

if TYPE_CHECKING:
    from sattrack.calibration.axes_in_space import AxesFinder, FoundAxes
    from sattrack.calibration.calibrator import Calibrator
    from sattrack.calibration.findings import ClockTruth, Findings
    from sattrack.core.clock import Clock
    from sattrack.mount.model import MountProfile
    from sattrack.mount.profiles import ProfileFile
    from sattrack.runtime.mounts import MountAddress
    from sattrack.safety import SafetyLimits
    from tle.site import Site

LARGEST_UNCERTAINTY_S = 1.0
RESTS = {
    None: "nothing was moved",
    True: "the mount was stopped and seen at rest",
    False: "the mount was NOT seen at rest: look after it, and stop it by its own console",
}
MEANINGS = {
    "sky": "right ascension and declination of the sky",
    "horizon": "azimuth and altitude",
    "axes": "angles of the axes",
}


@click.command("calibrate")
@mount_option
@click.option(
    "--output",
    "--out",
    "out",
    cls=RenamedOption,
    type=OutputFile(),
    metavar="FILE",
    help="The mount profile to write; what is not measured is that of the settings' profile.",
)
@click.option(
    "--update",
    type=OutputFile(),
    metavar="FILE",
    help="A profile to update with the findings; its other values stay.",
)
@click.option("--name", metavar="NAME", help="The mount's name in the profile.")
@click.option("--force", is_flag=True, help="Let --output overwrite a file.")
@click.option("--yes", is_flag=True, help="Move without asking.")
@click.option(
    "--clock-true",
    type=float,
    metavar="SECONDS",
    help="Uncertainty of the mount's clock and ours, seconds; with it, the delays are separated.",
)
@click.option(
    "--sim-profile",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="With --mount sim: the profile of the simulated mount.",
)
@click.option(
    "--axes",
    is_flag=True,
    help="Find how the axes lie, and nothing else: for mounts that are not equatorial.",
)
@camera_options
@common_options("site", "clock", "json")
def command(context: CommandContext, **options: Any) -> int:
    """Measure how a mount answers commands, by small bounded motions, and write its profile.

    Measured are signs, gains, additive or absolute rates, held or edge, round trip, acceleration, and the
    mount's clock. The mount must stand clear, 20° high or more, and away from the Sun. Any key stops it.

    \b
    Examples:
      sattrack mount calibrate --mount sim --output measured.toml
      sattrack mount calibrate --mount alpaca://192.0.2.9/0 --axes --output a.toml
      sattrack mount calibrate --axes --camera v4l:/dev/video0 --output a.toml
    """
    from sattrack.calibration.profile import bounded, german
    from sattrack.runtime.calibrate import ending_error

    url, address = context.mount(options["mount_url"])
    _check(options, address)
    target = _target(options)
    base = _base(context, options, url)
    site = context.site() if context.has_site() else None
    if site is None:
        if address is not None:
            raise BadInputError(NO_SITE)
        site = demo_pass.SITE.place()
    if address is not None:
        address = address.seen_from(site)
    limits = context.settings.safety.limits()
    if options["axes"]:
        return _find_axes(context, options, (base, limits, site), address, target)
    _ask(options["yes"], "sim" if address is None else str(address), limits)
    calibrator = _fly(context.clock(), site, (base.mount, limits), address, options["sim_profile"])
    assert calibrator.ending is not None
    error = ending_error(calibrator.ending)
    if error is not None:
        raise error
    dated = address is None or address.dates_itself
    found = _conclude(calibrator, site, options["clock_true"], dated)
    told = german(bounded(base, calibrator.largest_rates_deg_s), calibrator.alignment_mode)
    profile = _write(target, told, found, options)
    if profile.pier_rule != base.pier_rule:
        tell('this is a German telescope: pier_rule is written as "ascom", by which it slews beyond the pole')
    _tell(found, profile, target, context.json)
    return 0


def _find_axes(
    context: CommandContext,
    options: dict[str, Any],
    described: tuple[ProfileFile, SafetyLimits, Site],
    address: MountAddress | None,
    target: Path,
) -> int:
    """Find how the axes lie, and with a camera what the mount reports; write the profile."""
    from sattrack.calibration.axes_in_space import LEG_DEG, REACH_DEG, STOP_DEG, find_axes, kind_of, with_axes
    from sattrack.mount.model import SitePlace
    from sattrack.mount.profiles import profile_text

    base, limits, site = described
    known, seen = base.mount.geometry, options["camera"] is not None
    if known is not None and known.reports == "axes" and not seen:
        raise BadInputError(
            f'geometry.reports of the profile {base.name!r} is "axes": such reports are the same wherever '
            "the axes point; give --camera SOURCE, which sees where"
        )
    if known is not None and (known.reports != "sky" or known.has_zeros) and not seen:
        raise BadInputError(
            f"[geometry] of the profile {base.name!r} says that the mount reports other directions than "
            "those in which it looks, which only a camera sees: give --camera SOURCE"
        )
    name = "sim" if address is None else str(address)
    lasts = "about two minutes, or as long as fields take" if seen else "about a minute"
    tell(f"each axis will turn by {LEG_DEG:g}° at a time, {2.0 * LEG_DEG:g}° at most, for {lasts}")
    tell(f"{name} must stand clear wherever it may come within {REACH_DEG + STOP_DEG:g}°; any key stops it")
    _consent(options["yes"])
    finder, alignment = _turn_axes(context, options, (base.mount, limits, site), address)
    rest = RESTS[finder.mount_stopped]
    if finder.trouble is not None:
        raise type(finder.trouble)(f"{finder.trouble}; nothing was written; {rest}")
    if not finder.mount_stopped:
        raise SattrackError(f"the motions are made; nothing was written; {rest}")
    try:
        found = find_axes(finder.legs, site.latitude_deg, finder.stood)
    except SattrackError as error:
        raise SattrackError(f"{error}; nothing was written; {rest}") from error
    profile = with_axes(base, found, SitePlace(site.latitude_deg, site.longitude_deg))
    profile = msgspec.structs.replace(profile, name=options["name"] or profile.name)
    write_found(target, profile_text(profile, options["update"], base))
    kind = kind_of(found.geometry, site.latitude_deg)
    stated = {0: "alt-azimuth", 1: "equatorial", 2: "equatorial"}.get(-1 if alignment is None else alignment)
    notes = []
    if stated is not None and stated != kind:
        notes.append(f"AlignmentMode says {stated}, the motions do not: the profile has what they say")
    if kind == "equatorial":
        notes.append("this mount is equatorial: without --axes more is measured, and servers can use it")
        if not seen:
            notes.append("a mount that reports the angles of its axes looks equatorial too: --camera tells")
    stale = [f"[{name}]" for name in ("pointing", "periodic", "sky") if getattr(base, name) is not None]
    if stale:
        notes.append(f"{', '.join(stale)} of the profile left out, learnt of the axes as they were before")
    notes.append(
        f"the first axis may turn {profile.hour_angle_limit_deg:g}° either way of its zero, cables counted: "
        "set hour_angle_limit_deg to what the cables bear"
    )
    for note in notes:
        tell(note)
    if context.json:
        document = {
            "geometry": profile.geometry,
            "kind": kind,
            "left_arcsec": round(3600.0 * found.left_deg, 2),
            "reports_left_arcsec": found.reports_left_arcsec,
            "out": str(target),
            "notes": notes,
        }
        click.echo(msgspec.json.encode({"axes": document}).decode())
        return 0
    _show_axes(profile, found, kind)
    tell(f"written to {target}")
    return 0


def _turn_axes(
    context: CommandContext,
    options: dict[str, Any],
    described: tuple[MountProfile, SafetyLimits, Site],
    address: MountAddress | None,
) -> tuple[AxesFinder, int | None]:
    """Make the motions that show how the axes lie; return them, and a telescope's AlignmentMode."""
    from sattrack.runtime.calibrate import find_axes_live, start_practice_mount, surroundings

    mount, limits, site = described
    clock = context.clock()
    plain = msgspec.structs.replace(
        mount,
        geometry=None,
        additive=False,
        ra_rate_sign=1,
        dec_rate_sign=1,
        ra_rate_gain=1.0,
        dec_rate_gain=1.0,
    )
    with ExitStack() as stack:
        owned_as = camera = None
        if address is None:
            around = surroundings(site, plain, clock.utc_s(time.monotonic()), limits)
            simulated = start_practice_mount(around, site, clock, options["sim_profile"])
            stack.callback(simulated.close)
            address, owned_as = simulated.address, "sim"
        if options["camera"] is not None:
            camera = solving_camera(context, options)
            stack.callback(camera.close)
        stack.callback(renew)
        return find_axes_live(address, clock, _show, (plain, limits, site), owned_as, camera)


def _show_axes(profile: MountProfile, found: FoundAxes, kind: str) -> None:
    own, reports = profile.geometry, []
    assert own is not None
    if found.reports_left_arcsec is not None:
        zeros = f"zero points {own.first_zero_deg:.3f}°, {own.second_zero_deg:.3f}°"
        senses = f", senses {own.first_sense:+d}, {own.second_sense:+d}" if own.reports == "axes" else ""
        meaning = f"{MEANINGS[own.reports]}; {zeros}{senses}"
        reports = [("reports", meaning), ("reports left", f"{found.reports_left_arcsec:.1f}″")]
    show(
        table(
            "",
            "",
            rows=[
                (
                    "first axis",
                    f"azimuth {own.pole_azimuth_deg:.3f}°, altitude {own.pole_altitude_deg:.3f}°: {kind}",
                ),
                ("between the axes", f"{own.axes_deg:.3f}°"),
                ("cone", f"{own.cone_deg:.3f}°"),
                ("positive rates", f"{profile.ra_rate_sign:+d} first, {profile.dec_rate_sign:+d} second"),
                ("gains", f"{abs(found.gains[0]):.2f} first, {abs(found.gains[1]):.2f} second"),
                ("places left", f"{3600.0 * found.left_deg:.1f}″"),
                *reports,
            ],
        )
    )


def _check(options: dict[str, Any], address: MountAddress | None) -> None:
    if options["camera"] is not None and not options["axes"]:
        raise BadInputError("--camera needs --axes: without, the camera has nothing to tell")
    if options["camera"] is not None and address is None:
        raise BadInputError(
            "--camera needs a mount that it is on: --mount sim has none; see `sattrack sim --camera`"
        )
    if address is not None and options["sim_profile"] is not None:
        raise BadInputError("--sim-profile needs --mount sim")
    if options["sim_profile"] is not None:
        # Refused here, where its lines are known, and before anybody is asked for consent.
        load_simulator_profile(options["sim_profile"])
    stated = options["clock_true"]
    if stated is not None and not 0.0 <= stated <= LARGEST_UNCERTAINTY_S:
        raise BadInputError(
            f"--clock-true {stated:g}: give the uncertainty in seconds, 0 to {LARGEST_UNCERTAINTY_S:g}"
        )


def _target(options: dict[str, Any]) -> Path:
    """Return the file to write; raises BadInputError, before anything moves, where it could not be."""
    out, update = options["out"], options["update"]
    target: Path | None = out or update
    if target is None:
        raise BadInputError("no output file: give --output FILE, or --update FILE for an existing profile")
    if target.exists() and target != update and not options["force"]:
        raise BadInputError(f"--output {target}: the file exists; give --force to overwrite it, or --update")
    return target


def _base(context: CommandContext, options: dict[str, Any], url: str | None) -> ProfileFile:
    """Return the profile whose values stay where nothing is found; raises BadInputError.

    That is the one to update, else the one of the settings, whose limits hold for this mount, too.
    """
    from sattrack.mount.profiles import load_profile_file, profile_file
    from sattrack.runtime.mounts import usual_profile

    if options["update"] is not None:
        return load_profile_file(options["update"])
    out, configured = Path(options["out"]), context.settings.mount.profile
    if configured is None or (not out.exists() and out.resolve() == Path(configured).resolve()):
        base = profile_file(usual_profile(url))
    else:
        base = context.profile(None, url)
        tell(f"what is not measured, such as limits, stays as in {configured}, the settings' profile")
    return msgspec.structs.replace(base, name=out.stem)


def _ask(consented: bool, mount_name: str, limits: SafetyLimits) -> None:
    """Tell what will move, and go on only with the operator's consent."""
    from sattrack.calibration.guard import BOX_DEG, FLOOR_ALTITUDE_DEG, Plan
    from sattrack.safety.limits import SUN_CONE_DEG

    for text in Plan().words():
        tell(text)
    tell(
        f"{mount_name} must stand clear, {max(FLOOR_ALTITUDE_DEG, limits.floor_altitude_deg):g}° high and "
        f"{max(SUN_CONE_DEG, limits.sun_deg):g}° from the Sun wherever it may come within {BOX_DEG:g}°; any "
        "key stops it"
    )
    _consent(consented)


def _consent(consented: bool) -> None:
    if consented:
        return
    if not sys.stdin.isatty():
        raise BadInputError("no consent: there is no terminal to ask on; give --yes if the mount may move")
    if not click.confirm("May it move?", err=True):
        raise InterruptedRunError("not started; nothing was moved")


def _fly(
    clock: Clock,
    site: Site,
    described: tuple[MountProfile, SafetyLimits],
    address: MountAddress | None,
    sim_profile: Path | None,
) -> Calibrator:
    """Run the calibration, beside a simulated mount of its own where there is no other."""
    from sattrack.runtime.calibrate import calibrate_live, surroundings

    profile, limits = described
    around = surroundings(site, profile, clock.utc_s(time.monotonic()), limits)
    with ExitStack() as stack:
        owned_as = None
        if address is None:
            from sattrack.runtime.calibrate import start_practice_mount

            simulated = start_practice_mount(around, site, clock, sim_profile)
            stack.callback(simulated.close)
            address, owned_as = simulated.address, "sim"
        stack.callback(renew)
        return calibrate_live(around, address, clock, _show, profile=profile, owned_as=owned_as)


def _show(phase: str, part_done: float) -> None:
    renew_at_once(f"{part_done:4.0%}  {phase}")


def _conclude(calibrator: Calibrator, site: Site, stated_s: float | None, dates_itself: bool) -> Findings:
    """Return the findings; raises SattrackError where the run contradicts itself."""
    from sattrack.calibration.findings import conclude, dated_by_requests
    from sattrack.calibration.guard import CalibrationEndedError

    try:
        truth = (
            _clock_truth(calibrator, site, stated_s) if dates_itself else dated_by_requests(calibrator.seen)
        )
        return conclude(calibrator.seen, site.longitude_deg, truth)
    except CalibrationEndedError as ended:
        raise SattrackError(f"{ended.words}; nothing was written, the mount is at rest") from ended


def _clock_truth(calibrator: Calibrator, site: Site, stated_s: float | None) -> ClockTruth | None:
    from sattrack.calibration.findings import ClockTruth
    from sattrack.calibration.guard import true_clocks

    last = calibrator.seen.log.last
    if stated_s is None or last is None:
        return None
    return ClockTruth(stated_s, true_clocks(last.arrival_utc_s, site))


def _write(target: Path, base: ProfileFile, found: Findings, options: dict[str, Any]) -> MountProfile:
    """Write the profile, whole or not at all."""
    from sattrack.calibration.profile import calibrated
    from sattrack.mount.profiles import profile_text

    profile = calibrated(base, found, options["name"], f"sattrack {__version__}")
    write_found(target, profile_text(profile, options["update"], base))
    return profile


def _tell(found: Findings, profile: MountProfile, target: Path, as_json: bool) -> None:
    from sattrack.calibration.profile import found_rows

    for note in found.notes:
        tell(note)
    if as_json:
        document = {"profile": profile, "out": str(target), "notes": found.notes}
        click.echo(msgspec.json.encode({"calibration": document}).decode())
        return
    show(table("", "", rows=found_rows(found)))
    tell(f"written to {target}")
