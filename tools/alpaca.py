"""Write the table of docs/alpaca.md: `python -m tools.alpaca`, from the repository's root.

With `--check` nothing is written; the exit code is 1 where the document differs from the code.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from sattrack.servers.alpaca.protocol import MEMBERS, Member
from tools.protocol.regions import replace_region
from tools.writing import write_or_compare

if TYPE_CHECKING:
    from pathlib import Path

DOCUMENT = "docs/alpaca.md"
COMMAND = "python -m tools.alpaca"
ACCESS = {"yes": "yes", "absent": "0x400", "no": ""}


def table() -> str:
    """Return the members as a Markdown table."""
    lines = ["| member | GET | PUT | parameters | what it is or does here |", "|---|---|---|---|---|"]
    return "\n".join([*lines, *(_line(member) for member in MEMBERS)])


def _line(member: Member) -> str:
    takes = ", ".join(f"`{one.name}`" for one in member.takes)
    cells = (f"`{member.name}`", ACCESS[member.read], ACCESS[member.write], takes, member.does)
    return "| " + " | ".join(cells) + " |"


def generated(root: Path) -> str:
    """Return what the document should hold. Raises RegionError, OSError."""
    return replace_region((root / DOCUMENT).read_text(encoding="utf-8"), "members", table())


def main() -> int:
    """Write or compare; returns the exit code."""
    return write_or_compare(COMMAND, __doc__, DOCUMENT, generated)


if __name__ == "__main__":
    sys.exit(main())
