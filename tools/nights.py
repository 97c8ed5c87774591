"""Write the table of docs/nights.md: `python -m tools.nights`, from the repository's root.

With `--check` nothing is written; the exit code is 1 where the document differs from the code.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from sattrack.schedule.machine import TABLE, Row, words_of
from sattrack.schedule.night import State, StopAsked
from tools.protocol.regions import RegionError, replace_region

ROOT = Path(__file__).resolve().parents[1]
DOCUMENT = "docs/nights.md"
COMMAND = "python -m tools.nights"


def table() -> str:
    """Return the machine as a Markdown table, without what holds in every state."""
    lines = ["| state | event | if | then | next state |", "|---|---|---|---|---|"]
    before: State | None = None
    for row in sorted(TABLE, key=lambda row: list(State).index(row.state)):
        if row.event is StopAsked:
            continue
        lines.append(_line(row, row.state is not before))
        before = row.state
    return "\n".join(lines)


def _line(row: Row, new: bool) -> str:
    event = re.sub(r"(?<!^)(?=[A-Z])", " ", row.event.__name__).lower()
    then = words_of(row.action)
    cells = (row.state.value if new else "", event, words_of(row.condition), then, row.next_state.value)
    return "| " + " | ".join(cells) + " |"


def generated(root: Path) -> str:
    """Return what the document should hold. Raises RegionError, OSError."""
    return replace_region((root / DOCUMENT).read_text(encoding="utf-8"), "machine", table())


def main() -> int:
    """Write or compare; returns the exit code."""
    parser = argparse.ArgumentParser(prog=COMMAND, description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, compare")
    parser.add_argument("--root", type=Path, default=ROOT, help="the folder that holds docs/")
    options = parser.parse_args()
    path = options.root / DOCUMENT
    try:
        wanted = generated(options.root)
    except (RegionError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    if options.check:
        same = path.read_text(encoding="utf-8") == wanted
        if not same:
            sys.stderr.write(f"{DOCUMENT} is not what the code says; run {COMMAND}\n")
        return 0 if same else 1
    path.write_text(wanted, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
