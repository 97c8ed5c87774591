"""What a test gets that runs a module of tools/ in its own process."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


class Ran(NamedTuple):
    """What came of a program."""

    returncode: int
    stdout: str
    stderr: str


Tool = Callable[..., Ran]
"""Runs a module of tools/, by its name, with options."""
