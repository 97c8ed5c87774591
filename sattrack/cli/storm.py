"""`sattrack storm`: run one storm of faults again, with a trace of what happened."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

import sattrack
from sattrack.cli.common import CommandContext, common_options
from sattrack.core.errors import SattrackError

if TYPE_CHECKING:
    from collections.abc import Iterable

BENCH = Path(sattrack.__file__).parents[1] / "bench"
"""Of the source tree: the mounts of the storms are no part of the installed program."""


@click.command("storm")
@click.option("--seed", type=int, required=True, metavar="N", help="Which storm.")
@click.option("--fair", is_flag=True, help="The same run without its faults.")
@click.option("--statuses", is_flag=True, help="Every status in the trace, not only what changes.")
@common_options("json")
def command(context: CommandContext, seed: int, fair: bool, statuses: bool) -> int:
    """Run the whole program in a virtual world with the faults of a seed, and print what happened.

    No mount is moved. A seed gives a pass, a mount, limits, faults of the link, the mount and the machine,
    and what people do. The invariants are judged by the true axes. This needs the source tree. Exit code 1
    where an invariant was violated.

    \b
    Examples:
      sattrack storm --seed 17
      sattrack storm --seed 17 --json
    """
    if not (BENCH / "storm").is_dir():
        raise SattrackError(f"storms need the source tree, and {BENCH} has none: run this from a clone")
    sys.path.insert(0, str(BENCH))
    draws = importlib.import_module("storm.draws")
    invariants = importlib.import_module("storm.invariants")
    storm = draws.draw(seed)
    verdict, ended = invariants.judged(storm.fair() if fair else storm, True)
    trace = [one for one in ended.trace if statuses or one.what != "status"]
    if context.json:
        document = {"verdict": verdict, "storm": _facts(storm), "trace": trace}
        click.echo(msgspec.json.encode(document).decode())
    else:
        click.echo("\n".join(_lines(storm, verdict, trace)))
    return 1 if verdict.violations else 0


def _facts(storm: Any) -> dict[str, Any]:
    return {
        "seed": storm.seed,
        "begin_utc_s": storm.begin_s,
        "hardware": storm.hardware,
        "unlike": None if storm.other is None else storm.other.what,
        "parameters": storm.parameters,
        "profile": storm.facts.profile,
        "limits": storm.facts.limits,
        "commands": storm.commands,
        "statuses": storm.statuses,
        "faults": storm.faults,
    }


def _lines(storm: Any, verdict: Any, trace: Iterable[Any]) -> Iterable[str]:
    hard = storm.hardware
    unlike = "" if storm.other is None else f" ({storm.other.what})"
    yield f"storm {storm.seed}: {hard.kind}{unlike}, MoveAxis {hard.move_axis}, longest fault " + (
        f"{storm.facts.limits.longest_fault_s:g} s"
    )
    yield f"commands {storm.commands}"
    yield f"statuses {storm.statuses}"
    for one in trace:
        yield f"{one.at_s:8.2f} s  {one.what:9} {one.text}"
    yield f"ended by {verdict.ended_by} after {verdict.seconds:.1f} s" + (verdict.why and f": {verdict.why}")
    yield from (f"VIOLATED {one}" for one in verdict.violations)
    if not verdict.violations:
        yield "all invariants held"
