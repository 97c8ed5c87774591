"""How our own programs are called from one another."""

from __future__ import annotations

import sys
from pathlib import Path


def own_program(module: str = "sattrack") -> list[str]:
    """Return the beginning of a command that runs a module of ours as a program.

    What lies in the current folder is not imported, unless we lie there: a user's `json.py` would else
    stand in for Python's, in the guardian as well.
    """
    safe = () if Path(__file__).parents[1] == Path.cwd() else ("-P",)
    return [sys.executable, *safe, "-m", module]
