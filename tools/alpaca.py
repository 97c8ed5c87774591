"""Write the table of docs/alpaca.md: `python -m tools.alpaca`, from the repository's root.

With `--check` nothing is written; the exit code is 1 where the document differs from the code.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from sattrack.alpaca.members import MEMBERS, Member
from tools.protocol.regions import RegionError, replace_region

ROOT = Path(__file__).resolve().parents[1]
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


def main() -> int:
    """Write or compare; returns the exit code."""
    parser = argparse.ArgumentParser(prog=COMMAND, description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, compare")
    parser.add_argument("--root", type=Path, default=ROOT, help="the folder that holds docs/")
    options = parser.parse_args()
    path = options.root / DOCUMENT
    try:
        text = path.read_text(encoding="utf-8")
        wanted = replace_region(text, "members", table())
    except (RegionError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    if not options.check:
        path.write_text(wanted, encoding="utf-8")
    elif text != wanted:
        sys.stderr.write(f"{DOCUMENT} is not what the code says; run {COMMAND}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
