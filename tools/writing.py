"""Write one document whose parts come from the code, or tell whether it is what the code says."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tools.protocol.regions import RegionError

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).resolve().parents[1]


def write_or_compare(
    command: str, description: str | None, document: str, generated: Callable[[Path], str]
) -> int:
    """Run a command that writes a document, or compares it with `--check`; return the exit code.

    `generated` makes of the folder that holds docs/ what the document should hold; it raises RegionError or
    OSError.
    """
    parser = argparse.ArgumentParser(prog=command, description=description)
    parser.add_argument("--check", action="store_true", help="write nothing, compare")
    parser.add_argument("--root", type=Path, default=ROOT, help="the folder that holds docs/")
    options = parser.parse_args()
    path = options.root / document
    try:
        wanted = generated(options.root)
    except (RegionError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    if not options.check:
        path.write_text(wanted, encoding="utf-8")
    elif path.read_text(encoding="utf-8") != wanted:
        sys.stderr.write(f"{document} is not what the code says; run {command}\n")
        return 1
    return 0
