"""`sattrack biases`: what is remembered from earlier passes, and dropping of it."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import click
import msgspec

from sattrack.cli.common import CommandContext, common_options, tell
from sattrack.core.errors import BadInputError
from sattrack.runtime.bias_memory import BiasMemory, KeptBias, describe, memory_file
from tle.instants import Utc

if TYPE_CHECKING:
    from collections.abc import Sequence


@click.command("biases")
@click.option("--drop", "dropped", type=int, multiple=True, metavar="ENTRY", help="Offer this one no more.")
@common_options
def command(context: CommandContext, dropped: tuple[int, ...]) -> int:
    """Show the biases remembered from earlier passes, the newest first, as they were found.

    Each is offered for passes of its object with the very elements that it was found with.
    """
    memory = BiasMemory(memory_file())
    for entry in dropped:
        if not memory.drop(entry):
            raise BadInputError(f"--drop {entry}: there is no such entry; sattrack biases lists them")
    entries = memory.entries()
    if context.json:
        click.echo(msgspec.json.encode(entries).decode())
    elif entries:
        click.echo("\n".join(_lines(entries, time.time())))
    else:
        tell(f"nothing is remembered in {memory.path}")
    return 0


def _lines(entries: Sequence[KeptBias], now_utc_s: float) -> list[str]:
    lines = []
    for one in entries:
        epoch = Utc(one.elements_epoch_utc_s).isoformat("seconds")
        state = "  DROPPED" if one.dropped else ""
        name = one.name or str(one.catalog_number)
        lines.append(f"{one.entry:4d}  {name} ({one.catalog_number}), elements of {epoch}{state}")
        lines.append(f"      {describe(one, now_utc_s)}; by the {one.made_by}, {one.mount}")
    return lines
