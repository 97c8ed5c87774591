"""Where the machine code of the compiled search is kept, and whether it is there.

numba looks only at the file that a function stands in to tell whether its machine code is still good, and
stumbles over what another version of this package left; so every version of the sources, of numba and of
Python has a folder of its own, within the user's cache folder or `NUMBA_CACHE_DIR`. Nothing is ever written
beside the sources, which may be read-only.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

# What is compiled, and what gives it constants.
_SOURCES = ("compiled*.py", "near_earth.py", "ground.py")
_DONE = "complete"


@lru_cache
def cache_folder() -> Path | None:
    """Return the folder for this version's machine code, made if need be; None where none can be written."""
    parts = [sys.version, version("numba"), version("llvmlite")]
    here = Path(__file__).parent
    parts += [path.read_text(encoding="utf-8") for source in _SOURCES for path in sorted(here.glob(source))]
    name = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    try:
        folder = (Path(base) if base else Path.home() / ".cache") / "sattrack" / f"compiled-{name}"
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError):
        return None


def is_complete() -> bool:
    """Tell whether everything was compiled once, and kept."""
    folder = cache_folder()
    return folder is not None and (folder / _DONE).exists()


def mark_complete() -> None:
    """Remember that everything is compiled and kept."""
    folder = cache_folder()
    if folder is not None:
        (folder / _DONE).touch()
