"""Write the table of docs/nights.md: `python -m tools.nights`, from the repository's root.

With `--check` nothing is written; the exit code is 1 where the document differs from the code.
"""

from __future__ import annotations

import re
import sys
from typing import TYPE_CHECKING

from sattrack.schedule.machine import TABLE, TableRow, text_of
from sattrack.schedule.night import RunState, StopAsked
from tools.protocol.regions import replace_region
from tools.writing import write_or_compare

if TYPE_CHECKING:
    from pathlib import Path

DOCUMENT = "docs/nights.md"
COMMAND = "python -m tools.nights"


def table() -> str:
    """Return the machine as a Markdown table, without what holds in every state."""
    lines = ["| state | event | if | then | next state |", "|---|---|---|---|---|"]
    before: RunState | None = None
    for row in sorted(TABLE, key=lambda row: list(RunState).index(row.state)):
        if row.event is StopAsked:
            continue
        lines.append(_line(row, row.state is not before))
        before = row.state
    return "\n".join(lines)


def _line(row: TableRow, new: bool) -> str:
    event = re.sub(r"(?<!^)(?=[A-Z])", " ", row.event.__name__).lower()
    then = text_of(row.action)
    cells = (row.state.value if new else "", event, text_of(row.condition), then, row.next_state.value)
    return "| " + " | ".join(cells) + " |"


def generated(root: Path) -> str:
    """Return what the document should hold. Raises RegionError, OSError."""
    return replace_region((root / DOCUMENT).read_text(encoding="utf-8"), "machine", table())


def main() -> int:
    """Write or compare; returns the exit code."""
    return write_or_compare(COMMAND, __doc__, DOCUMENT, generated)


if __name__ == "__main__":
    sys.exit(main())
