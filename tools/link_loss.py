"""Write the table of docs/link-loss.md: `python -m tools.link_loss`, from the repository's root.

With `--check` nothing is written; the exit code is 1 where the document differs from the code.
"""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING

from sattrack.mount.link_loss import CONTRACT, Loss, standstill_after_s, standstill_s
from sattrack.mount.model import MountProfile
from tools.protocol.regions import replace_region
from tools.writing import write_or_compare

if TYPE_CHECKING:
    from pathlib import Path

DOCUMENT = "docs/link-loss.md"
COMMAND = "python -m tools.link_loss"
WATCHDOG_S = 5.0
RATES_DEG_S = (1.0, 6.0)
"""A fast pass, and the default profile's largest."""


def table() -> str:
    """Return the contract as a Markdown table, with times for the default profile and a watchdog of 5 s."""
    lines = [
        "| what is lost | watchdog | our side | the mount | at rest after | after its end | way out |",
        "|---|---|---|---|---|---|---|",
    ]
    return "\n".join([*lines, *(_line(row) for row in CONTRACT)])


def _line(row: Loss) -> str:
    profile = MountProfile(watchdog_s=WATCHDOG_S if row.by_watchdog else None)
    during = _times([standstill_s(row, profile, rate) for rate in RATES_DEG_S])
    after = _times([standstill_after_s(row, profile, rate) for rate in RATES_DEG_S])
    if row.after_s is None:
        after = ""
    cells = (
        row.fault,
        {True: "with", False: "without", None: "either"}[row.watchdog],
        row.ours,
        row.mounts,
        during,
        after,
        row.way_out,
    )
    return "| " + " | ".join(cells) + " |"


def _times(seconds: list[float]) -> str:
    if any(math.isinf(time_s) for time_s in seconds):
        return "**never**"
    return " / ".join(f"{time_s:.1f} s" for time_s in seconds)


def generated(root: Path) -> str:
    """Return what the document should hold. Raises RegionError, OSError."""
    document = (root / DOCUMENT).read_text(encoding="utf-8")
    return replace_region(document, "contract", table())


def main() -> int:
    """Write or compare; returns the exit code."""
    return write_or_compare(COMMAND, __doc__, DOCUMENT, generated)


if __name__ == "__main__":
    sys.exit(main())
