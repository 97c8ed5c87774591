"""Write the tables of docs/safety.md: `python -m tools.safety`, from the repository's root.

With `--check` nothing is written; the exit code is 1 where the document differs from the code.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from sattrack.mount.model import MountProfile
from sattrack.safety import INTERLOCKS, Interlock, SafetyLimits
from sattrack.safety.table import Reaction, closing_promise_s, promise_s
from tools import link_loss
from tools.protocol.regions import replace_region
from tools.writing import write_or_compare

if TYPE_CHECKING:
    from pathlib import Path

DOCUMENT = "docs/safety.md"
COMMAND = "python -m tools.safety"
RATES_DEG_S = link_loss.RATES_DEG_S


def table() -> str:
    """Return the interlocks as a Markdown table, with times for the default profile and longest fault."""
    lines = [
        "| row | what is watched | bound | margin | reaction | at rest after | way out |",
        "|---|---|---|---|---|---|---|",
    ]
    return "\n".join([*lines, *(_line(row) for row in INTERLOCKS)])


def _line(row: Interlock) -> str:
    profile, fault_s = MountProfile(), SafetyLimits().longest_fault_s
    stops = [promise_s(row, profile, fault_s, rate) for rate in RATES_DEG_S]
    after = "cut in the same datagram" if row.noticed_s is None else _times(stops)
    if row.reaction is Reaction.HOLD:
        closes = [closing_promise_s(profile, fault_s, rate) for rate in RATES_DEG_S]
        after = f"by hand {after}; a stream has closed up to it after {_times(closes)}"
    cells = (f"`{row.name}`", row.watches, row.bound, row.margin, row.reaction.value, after, row.way_out)
    return "| " + " | ".join(cells) + " |"


def _times(seconds: list[float]) -> str:
    return " / ".join(f"{time_s:.1f} s" for time_s in seconds)


def generated(root: Path) -> str:
    """Return what the document should hold. Raises RegionError, OSError."""
    document = (root / DOCUMENT).read_text(encoding="utf-8")
    document = replace_region(document, "interlocks", table())
    return replace_region(document, "contract", link_loss.table())


def main() -> int:
    """Write or compare; returns the exit code."""
    return write_or_compare(COMMAND, __doc__, DOCUMENT, generated)


if __name__ == "__main__":
    sys.exit(main())
