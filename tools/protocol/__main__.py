"""Write the generated parts: `python -m tools.protocol`, from the repository's root.

With `--check` nothing is written; what differs from the code is named, and the exit code is 1.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tools.protocol import examples, fields, figures, slew, states
from tools.protocol.regions import RegionError, replace_region

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = "docs/xerxes-protocol.md"
DISSECTOR = "extras/wireshark/xerxes.lua"
COMMAND = "python -m tools.protocol"


def generated(root: Path) -> dict[str, str]:
    """Return what each file should hold, by its path; raises RegionError where one lacks a region."""
    turns = slew.run()
    regions = {
        "command fields": fields.field_table("command"),
        "status fields": fields.field_table("status"),
        "readings": figures.readings_table(),
        "rates": figures.rates_table(),
        "patience": figures.patience_table(),
        "slew": slew.slew_table(turns),
        "command example": examples.command_example(),
        "status example": examples.status_example(),
    }
    regions |= {
        f"{diagram.name} transitions": states.transition_table(diagram) for diagram in states.DIAGRAMS
    }
    document = (root / DOCUMENT).read_text(encoding="utf-8")
    for name, body in regions.items():
        document = replace_region(document, name, body)
    dissector = (root / DISSECTOR).read_text(encoding="utf-8")
    files = {
        DOCUMENT: document,
        DISSECTOR: replace_region(dissector, "fields", fields.lua_tables(), ("-- ", "")),
        "docs/xerxes-slew.svg": slew.draw(turns),
    }
    files |= {f"docs/xerxes-{diagram.name}-states.svg": states.draw(diagram) for diagram in states.DIAGRAMS}
    return files


def main() -> int:
    """Write or compare; returns the exit code."""
    parser = argparse.ArgumentParser(prog=COMMAND, description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing, compare")
    parser.add_argument("--root", type=Path, default=ROOT, help="the folder that holds docs/ and extras/")
    options = parser.parse_args()
    try:
        files = generated(options.root)
    except (RegionError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    differ = []
    for name, text in files.items():
        path = options.root / name
        if path.is_file() and path.read_text(encoding="utf-8") == text:
            continue
        differ.append(name)
        if not options.check:
            path.write_text(text, encoding="utf-8")
    for name in differ:
        sys.stdout.write(f"{name}: " + (f"differs; run `{COMMAND}`\n" if options.check else "written\n"))
    return 1 if differ and options.check else 0


if __name__ == "__main__":
    sys.exit(main())
