"""The run that `sattrack track` asks for, without a screen."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sattrack.calibration.profile import learnt_text, with_learnt
from sattrack.cli.common import tell
from sattrack.cli.running import (
    Progress,
    Stream,
    announcement,
    check_observations,
    finish,
    fly_and_tell,
    tell_malformed,
)
from sattrack.cli.targets import find_target
from sattrack.core.errors import BadInputError
from sattrack.mount.profiles import write_profile
from sattrack.runtime.fly import fly_virtual
from sattrack.runtime.mounts import is_antenna
from sattrack.runtime.observers import read_all
from sattrack.runtime.prepare import RunRequest, prepare
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.cli.common import CommandContext
    from sattrack.mount.profiles import ProfileFile
    from sattrack.runtime.prepare import Prepared
    from sattrack.views.run import Armed, Summary


def follow(context: CommandContext, satellite: str, options: dict[str, Any]) -> int:
    """Follow a satellite by what the command line says; return the exit code. Raises what that may."""
    elements = context.elements() if context.sources() else None
    request = RunRequest(
        satellite=satellite,
        mount_url=options["mount_url"] or context.settings.mount.url,
        elements=elements,
        site=context.site() if context.has_site() else None,
        clock_option=context.clock_option,
        min_alt_deg=context.settings.min_altitude_deg if options["min_alt"] is None else options["min_alt"],
        refraction=options["refraction"],
        bias_along_s=options["bias_along"],
        bias_cross_deg=options["bias_cross"],
        camera_rotation_deg=options["camera_rotation"],
        fov_deg=context.settings.camera.fov_deg if options["fov_deg"] is None else options["fov_deg"],
        virtual=options["virtual"],
        record=options["record"],
        profile=context.profile(options["profile"], options["mount_url"] or context.settings.mount.url),
        limits=context.settings.safety.limits(),
        memory=options["bias_memory"],
        between=(_utc_s(options["begin"]), _utc_s(options["end"])),
        target=find_target(context, satellite, options["ephemeris"], elements),
    )
    if is_antenna(request.mount_url):
        from sattrack.cli.track_antenna import follow as follow_by_antenna

        if request.target is not None:
            raise BadInputError(
                f"{request.target.label}: an antenna's controller is fed from element sets only"
            )
        if request.memory not in {"auto", "off"}:
            raise BadInputError("--bias-memory does not go with an antenna's controller; leave it out")
        return follow_by_antenna(context, request, options)
    check_new_profile(options["learn_profile"])
    if request.virtual and (options["stream"] or options["control"]):
        raise BadInputError("--stream and --control go with real time; leave --virtual out")
    observations = options["observations"]
    check_observations(observations, options["control"], context.sources())
    if request.virtual and observations not in {None, "stdin"}:
        raise BadInputError(f"--observations {observations}: in virtual time they come from stdin")
    prepared = prepare(request)
    check_new_profile(options["learn_profile"], prepared.clock.speed)
    if prepared.practising:
        words = "no elements or site set: practising with the built-in ISS pass over Leiden"
        tell(words)
    for words in (*announcement(prepared.facts), *prepared.notes):
        tell(words)
    output = (
        Stream(tells_session=options["scene"]) if options["stream"] else Progress(quiet_off_terminal=True)
    )
    if isinstance(output, Stream) and options["scene"]:
        output.tell_scene(prepared.facts)
    if request.virtual:
        observers = None if observations is None else read_all(sys.stdin.buffer)
        summary, interrupted = fly_virtual(prepared, output.show, observers=observers), False
        output.end()
        if observers is not None:
            tell_malformed(observers)
    else:
        summary, interrupted = fly_and_tell(
            prepared,
            output,
            options["control"],
            observations=observations,
            again=lambda armed, before: prepare(_next_request(request, armed, before)),
        )
    learn_profile(options["learn_profile"], request.profile, summary)
    return finish(summary, interrupted, context.json or options["stream"])


def check_new_profile(target: Path | None, speed: float = 1.0) -> None:
    """Raise BadInputError where a profile cannot be learnt, or not be written as a new file."""
    if target is None:
        return
    if speed != 1.0:
        raise BadInputError(
            f"--learn-profile: a clock of {speed:g} times the speed makes other delays; leave one of them out"
        )
    if target.exists():
        raise BadInputError(f"--learn-profile {target}: there is such a file; give a new name")
    if not target.parent.is_dir():
        raise BadInputError(f"--learn-profile {target}: there is no folder {target.parent}; make it first")


def learn_profile(target: Path | None, base: ProfileFile, summary: Summary) -> None:
    """Write what a run has learnt of its mount, where that is asked for, and tell what was done."""
    if target is None:
        return
    if summary.acquired_after_s is None or summary.learnt is None:
        tell(f"{target} was not written: the mount was never on target, and nothing was learnt")
        return
    profile, learnt = with_learnt(base, summary.learnt, target.stem)
    if not learnt:
        tell(f"{target} was not written: the pass was too short, or too rough, to learn from")
        return
    check_new_profile(target)
    write_profile(target, learnt_text(profile, learnt, base.name, f"{summary.name} on {summary.ended_utc}"))
    tell(f"learnt, and written to {target}: {', '.join(learnt)}")


def _utc_s(text: str | None) -> float | None:
    return None if text is None else float(Utc.parse(text).unix_s)


def _next_request(request: RunRequest, armed: Armed, before: Prepared) -> RunRequest:
    """Return what is asked for by a pass that was armed: the same by the same clock, its record apart."""
    recording = before.facts.recording
    return replace(
        request,
        satellite=str(armed.catalog_number),
        target=None,
        between=(None, None),
        culminate_utc_s=armed.culminate_utc_s,
        clock=before.clock,
        record=None if recording is None else next_file(Path(recording)),
    )


def next_file(path: Path) -> Path:
    """Return the first name like `path` that is free: pass.mcap, pass-2.mcap, pass-3.mcap."""
    stem, number = re.sub(r"-[0-9]+$", "", path.stem), 2
    while (other := path.with_stem(f"{stem}-{number}")).exists():
        number += 1
    return other
