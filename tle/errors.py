"""The exceptions that elements, instants and directions can raise, each told in words a user can act on."""

from __future__ import annotations


class TleError(Exception):
    """Base of everything that `tle` raises on purpose; `exit_code` is what a command line should end with."""

    exit_code = 2
