"""`sattrack star-run`: measure a mount's pointing errors by stars, and keep the model in its profile."""

from __future__ import annotations

import contextlib
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from sattrack.cli.camera import camera_options, solving_camera
from sattrack.cli.common import (
    PLOT,
    CommandContext,
    OutputFile,
    RenamedOption,
    check_writable,
    common_options,
    mount_option,
    profile_option,
)
from sattrack.cli.output import renew, renew_at_once, show, table, tell, write_file, write_found
from sattrack.core.errors import BadInputError, InterruptedRunError, SattrackError

if TYPE_CHECKING:
    from sattrack.cli.mount import MountCall
    from sattrack.control.manual_operation import ConsoleSession
    from sattrack.mount.model import MountProfile, PointingTerms
    from sattrack.mount.profiles import ProfileFile
    from sattrack.pointing.files import RunParameters
    from sattrack.pointing.fit import PointingFit, Star
    from sattrack.pointing.terms import Axes
    from sattrack.runtime.star_run import RunSky, StarRun
    from tle.refraction import Refraction
    from tle.site import Site

FILE = click.Path(path_type=Path, dir_okay=False)
MOST_STARS = 200
GEARS_TURNED = (
    "the periodic errors are left out: the zero points have moved, or may have, since they were learnt"
)
ANOTHER_MOUNT_ARCSEC, ANOTHER_MOUNT_TIMES = 60.0, 5.0
"""A model that misses by more than both is another mount's, or of this one before it was moved."""


@click.command("star-run")
@click.option("--stars", default=20, show_default=True, metavar="N", help="How many stars at most.")
@camera_options
@click.option("--by-hand", is_flag=True, help="Without a camera: centre each star by the arrow keys, Enter.")
@click.option(
    "--until",
    default=3.0,
    show_default=True,
    metavar="ARCSEC",
    help="End once the fit predicts no more than this over the sky.",
)
@click.option(
    "--data",
    type=FILE,
    default=Path("star-run.dat"),
    show_default=True,
    metavar="FILE",
    help="The stars as they are measured, in TPOINT's layout.",
)
@click.option(
    "--continue", "goes_on", is_flag=True, help="Go on with the run in --data that was cut off, and fit all."
)
@click.option("--force", is_flag=True, help="Overwrite --data and --output.")
@click.option("--output", type=FILE, metavar="FILE", help="The profile to write; default: --profile's own.")
@click.option("--model", type=OutputFile(), metavar="FILE", help="Write the model in TPOINT's layout, too.")
@click.option(
    "--plot",
    "--report",
    "report",
    cls=RenamedOption,
    type=PLOT,
    metavar="FILE",
    help="Draw the residuals before and after the fit there (PNG, SVG, PDF).",
)
@click.option("--verify", is_flag=True, help="Fit nothing: compare stars with the model in the profile.")
@click.option("--fit-only", is_flag=True, help="Move nothing: fit the stars in --data.")
@click.option("--yes", is_flag=True, help="Move without asking.")
@mount_option
@profile_option
@common_options("site", "json")
def command(context: CommandContext, **options: Any) -> int:
    """Measure a mount's pointing errors by stars all over the sky, and keep the model in its profile.

    The mount is slewed to each of N directions above floor and skyline. A camera's frames are solved among
    the stars, so no alignment is needed before; --by-hand names stars instead, for you to centre.

    \b
    Examples:
      sattrack star-run --camera alpaca://192.0.2.7/0 --scale 2.5 --output m.toml
      sattrack star-run --verify --camera v4l:/dev/video0 --scale 20 --stars 6
      sattrack star-run --fit-only --data star-run.dat --output mount.toml
    """
    from sattrack.cli.mount import resolve
    from sattrack.runtime.star_run import FEWEST_STARS

    call = resolve(context, {**options, "timeout": None}, uses_model=options["verify"])
    _check(options, call)
    site = call.site
    assert site is not None
    loaded, axes = call.described, call.described.own_axes
    known, mount = _known(options, site, axes, loaded.mount)
    call = _with_mount(call, mount)
    if options["fit_only"]:
        known = _since_bump(known, site, axes)
        return _conclude(context, options, (call.described, loaded), _fitted(known, site, axes), known)
    run = _ran(context, options, call, site, known)
    if options["verify"]:
        return _judge(context, options, call.described, run)
    call = _with_mount(call, run.sky.profile)
    if run.trouble is not None and not run.counting:
        raise run.trouble
    if run.trouble is None and run.stars:
        with options["data"].open("a", encoding="utf-8") as file:
            file.write("END\n")
    former = call.described.pointing
    if run.trouble is not None and former is not None and len(run.counting) < min(FEWEST_STARS, former.stars):
        raise type(run.trouble)(
            f"{run.trouble}; the model of {former.stars} stars is kept: {len(run.counting)} are too few for "
            f"another; --continue goes on"
        )
    found = _fitted(run.counting, site, axes)
    code = _conclude(context, options, (call.described, loaded), found, run.counting)
    if run.trouble is not None:
        raise type(run.trouble)(
            f"{run.trouble}; {len(run.counting)} stars were fitted, and --continue goes on"
        )
    return code


def _check(options: dict[str, Any], call: MountCall) -> None:
    """Raise BadInputError, before anything moves, for what cannot be done."""
    if not 1 <= options["stars"] <= MOST_STARS:
        raise BadInputError(f"--stars {options['stars']}: give 1 to {MOST_STARS}")
    if not options["until"] > 0.0:
        raise BadInputError(f"--until {options['until']:g}: give arcseconds, above 0")
    if not options["fit_only"]:
        if (options["camera"] is None) == (not options["by_hand"]):
            raise BadInputError("give --camera SOURCE, or --by-hand to centre the stars yourself")
        if options["by_hand"] and not sys.stdin.isatty():
            raise BadInputError("--by-hand: there is no terminal whose keys could centre a star")
    if options["verify"]:
        if call.described.pointing is None:
            raise BadInputError(
                f"--verify: the profile {call.described.name!r} has no pointing model; give --profile FILE"
            )
        return
    if not options["fit_only"]:
        check_writable(options["data"], f"--data {options['data']}")
    target = _target(options)
    if target is None:
        return
    if target.exists() and options["data"].exists() and target.samefile(options["data"]):
        raise BadInputError(f"--output {target}: that is the file of the stars; give another name")
    if options["output"] is not None and target.exists() and not options["force"]:
        raise BadInputError(f"--output {target}: the file exists; give --force to overwrite it")
    check_writable(target, f"--{'profile' if options['output'] is None else 'output'} {target}")


def _target(options: dict[str, Any]) -> Path | None:
    """Return the profile to write; None where only the figures are wanted."""
    found: Path | None = options["output"] or options["profile"]
    return found


def _with_mount(call: MountCall, mount: MountProfile) -> MountCall:
    """Return the call with what was found of the mount's zero points in its profile."""
    described = call.described
    if mount.geometry == described.geometry:
        return call
    if described.periodic is not None:
        tell(GEARS_TURNED)
    limits = mount.dec_axis_limits_deg
    aligned = msgspec.structs.replace(
        described, geometry=mount.geometry, dec_axis_limits_deg=limits, periodic=None
    )
    return replace(call, described=aligned)


def _known(
    options: dict[str, Any], site: Site, axes: Axes, mount: MountProfile
) -> tuple[list[Star], MountProfile]:
    """Return the stars of a run that goes on, and the mount's profile, with their zero points if far off.

    Raises BadInputError where stars would be lost, or are of another mount.
    """
    from sattrack.pointing.files import END, read_stars
    from sattrack.runtime.star_run import aligned_by, seen_with, without_zeros

    path = options["data"]
    wanted = options["goes_on"] or options["fit_only"]
    if options["verify"]:
        return [], mount
    if not path.exists():
        if wanted:
            raise BadInputError(f"--data {path}: there is no such file")
        return [], mount
    if not wanted and not options["force"]:
        raise BadInputError(
            f"--data {path}: stars are there already; give --continue to go on with them, or --force to "
            "begin anew"
        )
    if not wanted:
        # The first star of the run takes their place: without one they stay.
        return [], mount
    text = path.read_text(encoding="utf-8", errors="replace")
    whole, _, rest = text.rpartition("\n")
    if rest.strip() and rest.strip().upper() != END:
        tell(f"--data {path}: its last line has no end, as of a run that was cut off: it is left out")
        text = f"{whole}\n"
    run, stars = read_stars(text, str(path), axes)
    if abs(run.latitude_deg - site.latitude_deg) > 0.1:
        raise BadInputError(
            f"--data {path}: its stars were seen from latitude {run.latitude_deg:.2f}°, and the site is at "
            f"{site.latitude_deg:.2f}°: they are another mount's"
        )
    if options["goes_on"]:
        lines = [line for line in text.splitlines() if line.strip().upper() != END]
        write_file(path, "\n".join(lines) + "\n")
    found = aligned_by(stars, mount, site)
    return [seen_with(star, without_zeros(mount), found, site) for star in stars], found


def _ran(
    context: CommandContext, options: dict[str, Any], call: MountCall, site: Site, known: list[Star]
) -> StarRun:
    """Move the mount over the sky; return the run. Raises what ends it before anything was measured."""
    from sattrack.control.manual_operation import ConsoleSession
    from sattrack.runtime.calibrate import any_key
    from sattrack.runtime.facts import pointing_of
    from sattrack.runtime.star_run import StarRun
    from tle.bodies import find_body

    _ask(options, call)
    zero = find_body("0,0")
    assert zero is not None
    # The ephemeris is loaded before the loop begins, which it would hold up.
    _sky(context, call, site).seen(zero, call.clock.utc_s(time.monotonic()))
    with contextlib.ExitStack() as stack:
        camera = None
        if options["camera"] is not None:
            camera = solving_camera(context, options)
            stack.callback(camera.close)
        keys = stack.enter_context(any_key()) if options["by_hand"] else None
        stack.callback(renew)

        def one(call: MountCall, realigned: bool) -> StarRun:
            sky = _sky(context, call, site)
            judged = pointing_of(call.described.mount, site) if options["verify"] else None
            known_model = call.described.pointing
            if known_model is not None and judged is not None:
                sky = replace(sky, judged_axes=judged.axes).beside(known_model.stars)
            with call.connected() as connection:
                # What the mount reports is measured: the run itself feeds it by its model.
                own = msgspec.structs.replace(call.described, pointing=None)
                session = ConsoleSession(replace(call, described=own).console(), connection.now_utc_s())
                run = StarRun(
                    session,
                    sky,
                    camera,
                    options["stars"],
                    options["until"],
                    _say,
                    _keeper(options, sky, known),
                    stars=list(known),
                    judged=judged,
                    known=len(known),
                    realigned=realigned,
                )
                _attend(run, session, connection, keys, options)
            return run

        run = one(call, False)
        return run if run.alignment is None else one(_with_mount(call, run.alignment), True)


def _sky(context: CommandContext, call: MountCall, site: Site) -> RunSky:
    from sattrack.runtime.star_run import RunSky
    from tle.refraction import Refraction

    limits = context.settings.safety.limits()
    return RunSky(site, call.described.mount, limits, Refraction.standard(site.height_m))


def _attend(
    run: StarRun, session: ConsoleSession, connection: Any, keys: int | None, options: dict[str, Any]
) -> None:
    """Carry a run out to its end. Raises where it is interrupted, or the mount is not seen at rest."""
    from sattrack.runtime.console import attend
    from sattrack.runtime.star_run import read_keys

    def orders(now_utc_s: float) -> None:
        for key in [] if keys is None else read_keys(keys):
            run.key(key, now_utc_s)
        run.step(now_utc_s)

    def shown(now_utc_s: float) -> None:
        del now_utc_s
        if sys.stderr.isatty():
            renew_at_once(run.doing)

    if attend(session, connection, shown, orders):
        kept = f"; {options['data']} has what was measured: --continue goes on" if run.stars else ""
        raise InterruptedRunError(f"interrupted{kept}")
    if run.trouble is None and session.mount_stopped is False:
        raise SattrackError("the mount did not confirm the stop at the end: look after it")


def _say(words: str) -> None:
    renew()
    tell(words)


def _ask(options: dict[str, Any], call: MountCall) -> None:
    tell(f"{call.name} is slewed all over the sky above the floor; Ctrl-C stops it")
    if options["yes"] or call.address is None:
        return
    if not sys.stdin.isatty():
        raise BadInputError("no consent: there is no terminal to ask on; give --yes if the mount may move")
    if not click.confirm("May it move?", err=True):
        raise InterruptedRunError("not started; nothing was moved")


def _keeper(options: dict[str, Any], sky: RunSky, known: list[Star]) -> Any:
    """Return what writes each star to the file of the run, which it begins with the first."""
    from sattrack.pointing.files import at_date, read_stars, star_line, stars_head
    from sattrack.runtime.star_run import seen_with, without_zeros

    path, mount = options["data"], sky.profile
    begun = [bool(known)]
    before = read_stars(path.read_text(encoding="utf-8"), str(path), sky.axes)[0] if known else None

    def keep(star: Star) -> None:
        if options["verify"]:
            return
        now = _parameters(sky.site, sky.air)
        if before is not None and before.date != now.date:
            star = at_date(star, before, sky.axes)
        text = star_line(seen_with(star, mount, without_zeros(mount), sky.site), sky.axes)
        mode = "a" if begun[0] else "w"
        if not begun[0]:
            text = stars_head("sattrack star-run", now, sky.axes) + text
            begun[0] = True
        try:
            with path.open(mode, encoding="utf-8") as file:
                file.write(text)
        except OSError as error:
            raise SattrackError(f"{path}: cannot be written: {error.strerror or error}") from error

    return keep


def _parameters(site: Site, air: Refraction | None) -> RunParameters:
    from sattrack.pointing.files import RunParameters
    from sattrack.runtime.system import utc_now

    temperature, pressure = (10.0, 0.0) if air is None else (air.temperature_c, air.pressure_hpa)
    return RunParameters(site.latitude_deg, utc_now()[:10], temperature, pressure, site.height_m)


def _since_bump(stars: list[Star], site: Site, axes: Axes) -> list[Star]:
    """Return the stars after the mount was last moved beside its axes, and say what is left out."""
    from sattrack.pointing.fit import find_bump

    first = 0
    while (bump := find_bump(stars[first:], site.latitude_deg, axes)) is not None:
        tell(bump.text(first))
        first += bump.before_star
    return stars[first:]


def _fitted(stars: list[Star], site: Site, axes: Axes) -> PointingFit:
    from sattrack.pointing.fit import fit

    return fit(stars, site.latitude_deg, axes)


def _conclude(
    context: CommandContext,
    options: dict[str, Any],
    profiles: tuple[ProfileFile, ProfileFile],
    found: PointingFit,
    stars: list[Star],
) -> int:
    """Write profile, model and picture, and print what was found.

    `profiles` are that of the mount as it was found, and what its file said before.
    """
    from sattrack.control.estimate import begun_anew
    from sattrack.mount.profiles import profile_text
    from sattrack.pointing.files import model_text
    from sattrack.pointing.periodic import zeros_moved
    from sattrack.runtime.system import utc_now

    described, loaded = profiles
    terms = found.terms(utc_now())
    target = _target(options)
    if target is not None:
        left = terms.held_out_rms_arcsec or terms.rms_arcsec
        sky = begun_anew(described.sky, terms.utc, left)
        name = described.name if options["output"] is None else Path(options["output"]).stem
        periodic = described.periodic
        former = described.pointing
        if periodic is not None and former is not None and zeros_moved(periodic, former, terms):
            tell(GEARS_TURNED)
            periodic = None
        written = msgspec.structs.replace(described, name=name, pointing=terms, sky=sky, periodic=periodic)
        write_found(target, profile_text(written, target if options["output"] is None else None, loaded))
    if options["model"] is not None:
        write_file(options["model"], model_text(terms, described.name))
    if options["report"] is not None:
        from sattrack.recording.rendering import save_pointing

        save_pointing(options["report"], found, stars, described.name)
    wrong = len(stars) - found.stars
    if wrong:
        tell(f"{wrong} of {len(stars)} stars contradict the others and were left out: wrongly solved?")
    _print(context, terms)
    if target is None:
        again = f"`sattrack star-run --fit-only --data {options['data']}`"
        tell(f"the model is kept in no profile: {again} with --profile FILE, or --output FILE, keeps it")
    elif not context.json:
        tell(f"written to {target}")
    return 0


def _print(context: CommandContext, terms: PointingTerms, fitted: PointingTerms | None = None) -> None:
    """Print a model; with `fitted` as stars show it that this one was not fitted to."""
    if context.json:
        click.echo(msgspec.json.encode({"model": _document(terms)}).decode())
        return
    rows = [(name, f"{value:+.1f}″", f"± {sigma:.1f}″") for name, (value, sigma) in terms.terms.items()]
    show(table("term", ">value", ">sigma", rows=rows))
    held_out = terms.held_out_rms_arcsec
    if fitted is not None:
        click.echo(
            f"{terms.stars} other stars: missed by {held_out:.1f}″ RMS; {fitted.rms_arcsec:.1f}″ are left at "
            f"the {fitted.stars} that the model was fitted to"
        )
        return
    apart = "too few stars to hold any out" if held_out is None else f"held out {held_out:.1f}″"
    click.echo(f"{terms.stars} stars: {terms.rms_arcsec:.1f}″ RMS left, {apart}")


def _document(terms: PointingTerms) -> dict[str, Any]:
    return {
        "terms": {
            name: {"arcsec": value, "sigma_arcsec": sigma} for name, (value, sigma) in terms.terms.items()
        },
        "rms_arcsec": terms.rms_arcsec,
        "held_out_rms_arcsec": terms.held_out_rms_arcsec,
        "stars": terms.stars,
        "utc": terms.utc,
    }


def _judge(context: CommandContext, options: dict[str, Any], described: ProfileFile, run: StarRun) -> int:
    """Print how far the profile's model misses stars; raise SattrackError where it is another mount's."""
    from sattrack.pointing.fit import residuals_of

    terms = described.pointing
    assert terms is not None
    if not run.stars:
        raise run.trouble or SattrackError("no star was measured: there is nothing to verify the model with")
    found = residuals_of(run.stars, terms)
    missed = found.rms_arcsec
    judged = msgspec.structs.replace(terms, held_out_rms_arcsec=round(missed, 3), stars=len(run.stars))
    if options["report"] is not None:
        from sattrack.recording.rendering import save_pointing

        save_pointing(options["report"], found, run.stars, described.name)
    _print(context, judged, terms)
    if run.trouble is not None:
        raise type(run.trouble)(f"{run.trouble}; {len(run.stars)} stars were compared")
    usual = terms.held_out_rms_arcsec or terms.rms_arcsec
    if missed > max(ANOTHER_MOUNT_ARCSEC, ANOTHER_MOUNT_TIMES * usual):
        raise SattrackError(
            f"the model of {terms.utc[:10]} misses {len(run.stars)} stars by {missed:.0f}″, and its own by "
            f"{usual:.1f}″: it is another mount's, or this one was moved or synced since; make a new one"
        )
    return 0
