"""`sattrack track --mount antenna:...`: a pass followed by trajectory designations."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import click

from sattrack.cli.common import renew, tell
from sattrack.cli.running import finish
from sattrack.core.errors import BadInputError
from sattrack.runtime.system import StopRequest
from sattrack.servers.antenna.door import parse_antenna_url
from sattrack.servers.antenna.track import AntennaFlight, prepare_pass
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.cli.common import CommandContext
    from sattrack.runtime.facts import RunRequest
    from sattrack.servers.antenna.antcn_run import AntcnRun

NOT_WITH_ANTENNA = ("stream", "control", "observations", "profile", "learn_profile")


def follow(context: CommandContext, request: RunRequest, options: dict[str, Any]) -> int:
    """Follow a pass with an antenna's controller; return the exit code."""
    for name in NOT_WITH_ANTENNA:
        if options.get(name):
            option = name.replace("_", "-")
            raise BadInputError(f"--{option} does not go with an antenna's controller; leave it out")
    assert request.mount_url is not None
    url = parse_antenna_url(request.mount_url)
    ready = prepare_pass(request, url, context.settings.safety.limits())
    plan = ready.plan
    start, end = (Utc(s).isoformat("seconds") for s in (plan.start_utc_s, plan.end_utc_s))
    label = ready.propagator.elements.label
    tell(f"{label} from {start} to {end[11:]}, {ready.max_alt_deg:.1f}° high")
    stop, progress = StopRequest(), AntennaProgress(label)
    flight = AntennaFlight(ready, stop, progress.show)
    summary = flight.fly()
    progress.end()
    for words in flight.warnings():
        tell(words)
    return finish(summary, stop.asked, context.json)


class AntennaProgress:
    """A line that renews itself on a terminal, once a second."""

    def __init__(self, label: str) -> None:
        self._label = label
        self._told_utc_s = float("-inf")

    def show(self, run: AntcnRun, now_utc_s: float) -> None:
        """Take one state."""
        if not sys.stderr.isatty() or now_utc_s - self._told_utc_s < 1.0:
            return
        self._told_utc_s = now_utc_s
        clock = Utc(now_utc_s).isoformat("seconds")[11:]
        error = "" if run.error_arcsec is None else f"  error {run.error_arcsec:.1f}″"
        renew(f"{clock}  {self._label}  {run.phase.value}{error}")

    def end(self) -> None:
        """Leave the renewed line."""
        if sys.stderr.isatty() and self._told_utc_s > 0.0:
            click.echo(err=True)
