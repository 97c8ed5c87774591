"""Draw docs/architecture.svg: `python -m tools.architecture`, from the repository's root.

The layers are those of the import contract in pyproject.toml, which the linter holds; what a folder is for
is the first sentence of its docstring. With `--check` nothing is written; the exit code is 1 where the
picture differs from the code.
"""

from __future__ import annotations

import ast
import sys
import textwrap
import tomllib
from typing import TYPE_CHECKING

from tools.protocol.svg import FAINT, INK, picture, text
from tools.writing import ROOT, write_or_compare

if TYPE_CHECKING:
    from pathlib import Path

DOCUMENT = "docs/architecture.svg"
COMMAND = "python -m tools.architecture"
CONTRACT = "imports run one way"
WIDTH, MARGIN, GAP = 960.0, 16.0, 8.0
CHARACTER, LINE = 6.4, 15.0
"""Size of the small letters, pixels."""


def layers() -> list[list[str]]:
    """Return the folders of the package, layer by layer: each may import what comes after it."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (found,) = [one["layers"] for one in contracts if one["name"] == CONTRACT]
    return [[f"sattrack/{name.strip()}" for name in layer.split(":")] for layer in found] + [["tle"]]


def parts(folder: str) -> list[str]:
    """Return a folder, and the folders in it that are packages of their own; nothing for a single file."""
    inside = sorted((ROOT / folder).glob("*/__init__.py"))
    return [folder, *(f"{folder}/{one.parent.name}" for one in inside)] if (ROOT / folder).is_dir() else []


def purpose(folder: str) -> str:
    """Return the first sentence of a package's docstring."""
    tree = ast.parse((ROOT / folder / "__init__.py").read_text(encoding="utf-8"))
    return (ast.get_docstring(tree) or "").partition("\n")[0].replace("`", "")


def drawn() -> str:
    """Return the picture: a row a layer, a box a folder."""
    shapes: list[str] = []
    top = MARGIN
    for layer in layers():
        folders = [part for folder in layer for part in parts(folder)]
        if not folders:
            continue
        wide = (WIDTH - 2.0 * MARGIN - GAP * (len(folders) - 1)) / len(folders)
        texts = [textwrap.wrap(purpose(folder), int((wide - 12.0) / CHARACTER)) for folder in folders]
        high = 26.0 + LINE * max(map(len, texts))
        for number, (folder, lines) in enumerate(zip(folders, texts, strict=True)):
            left = MARGIN + number * (wide + GAP)
            shapes.append(
                f'<rect x="{left:.1f}" y="{top:.1f}" width="{wide:.1f}" height="{high:.1f}" rx="4" '
                f'fill="none" stroke="{INK if folder in layer else FAINT}"/>'
            )
            name = folder.removeprefix("sattrack/") if folder.count("/") > 1 else folder
            shapes.append(text(left + 6.0, top + 16.0, name, 13, "start", ' font-weight="bold"'))
            for line, words in enumerate(lines):
                shapes.append(text(left + 6.0, top + 32.0 + LINE * line, words, 11, "start"))
        top += high + GAP
    return picture(WIDTH, top - GAP + MARGIN, "Folders; each imports only those below it", shapes)


def generated(_root: Path) -> str:
    """Return the picture; raises OSError."""
    return drawn()


def main() -> int:
    """Write or compare; returns the exit code."""
    return write_or_compare(COMMAND, __doc__, DOCUMENT, generated)


if __name__ == "__main__":
    sys.exit(main())
