"""`sattrack demo`: an embedded simulated mount follows a real pass over UDP on loopback."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import click

from sattrack.cli.common import (
    CommandContext,
    OutputFile,
    bias_options,
    common_options,
    fov_option,
    profile_option,
    stream_options,
)
from sattrack.cli.output import tell
from sattrack.cli.running import (
    RunProgress,
    Stream,
    camera_fields,
    check_observations,
    finish,
    fly_and_tell,
)
from sattrack.cli.screen import appearance, helper_options, screen_options, tui_possible, with_tui
from sattrack.core.errors import BadInputError
from sattrack.mount.profiles import ProfileFile
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import RunRequest, choose_pass, prepare
from tle.instants import Utc

STOPPING_TAKES_S = 0.7
SHORTEST_S = 5.0


@click.command("demo")
@profile_option
@click.option("--headless", is_flag=True, help="No terminal UI.")
@click.option("--seconds", type=float, metavar="N", help="End after this many real seconds in total.")
@click.option("--record", type=OutputFile(new=True), help="Write every input and output to a new MCAP file.")
@stream_options
@bias_options
@fov_option
@screen_options
@common_options("clock", "json", "utc")
def command(context: CommandContext, seconds: float | None, **options: Any) -> int:
    """Follow a real pass of the ISS with an embedded simulated mount, over UDP on loopback.

    \b
    Examples:
      sattrack demo
      sattrack demo --headless --seconds 5 --json
    """
    begun_s = time.monotonic() - time.process_time()
    if seconds is not None and not SHORTEST_S <= seconds < float("inf"):
        raise BadInputError(f"--seconds {seconds:g}: give {SHORTEST_S:g} or more")
    observations, control = options["observations"], options["control"]
    check_observations(observations, control, ())
    alone = options["headless"] or context.json or options["stream"] or control or observations == "stdin"
    if not alone and tui_possible():
        look = appearance(context, options["theme"], options["plain"])
        return with_tui(
            look, seconds is None, helper_options(context, options["profile"], None, practising=True)
        )
    request = replace(
        demo_request(context.clock_option, options["record"], context.profile(options["profile"])),
        **camera_fields(context.settings, options),
        memory=options["bias_memory"],
    )
    deadline_s = float("inf") if seconds is None else begun_s + seconds - STOPPING_TAKES_S
    output = (
        Stream(tells_session=options["scene"]) if options["stream"] else RunProgress(quiet_off_terminal=False)
    )
    prepared = prepare(request)
    for text in prepared.notes:
        tell(text)
    if isinstance(output, Stream) and options["scene"]:
        output.tell_scene(prepared.facts)
    summary, interrupted = fly_and_tell(prepared, output, control, deadline_s, observations)
    return finish(summary, interrupted, context.json or options["stream"])


def demo_request(
    clock_option: str | None, record: str | None, profile: ProfileFile | None = None
) -> RunRequest:
    """Return what the demonstration asks for; its clock starts shortly before the satellite is up."""
    from pathlib import Path

    elements, site = demo_pass.elements(), demo_pass.SITE.place()
    if clock_option is None:
        rise = choose_pass(elements, site, Utc.parse(demo_pass.BEFORE_PASS), 10.0).rise_utc
        assert rise is not None
        clock_option = rise.plus(-demo_pass.LEAD_S).isoformat()
    return RunRequest(
        satellite=str(elements.catalog_number),
        mount_url="sim",
        elements=[elements],
        site=site,
        clock_option=clock_option,
        min_alt_deg=10.0,
        record=None if record is None else Path(record),
        profile=profile or ProfileFile(),
    )
