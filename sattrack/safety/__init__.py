"""Limits and interlocks as one table, between everything that moves the mount and the wire.

`Safety.clear` and `Safety.clear_request` are the only makers of `mount.Cleared` and
`requests.ClearedRequest`, and a session takes motions in no other form. `ProbeSafety` is the one for motions
that find how axes lie.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sattrack.safety.gate import Safety
    from sattrack.safety.limits import SUN_CONE_DEG, SafetyLimits
    from sattrack.safety.table import INTERLOCKS, ROWS, Interlock, Reaction

__all__ = [
    "INTERLOCKS",
    "ROWS",
    "SUN_CONE_DEG",
    "Interlock",
    "Reaction",
    "Safety",
    "SafetyLimits",
]

_HOMES = {
    "INTERLOCKS": "table",
    "ROWS": "table",
    "SUN_CONE_DEG": "limits",
    "Interlock": "table",
    "Reaction": "table",
    "Safety": "gate",
    "SafetyLimits": "limits",
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use: settings hold limits, and most commands move nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module 'sattrack.safety' has no attribute {name!r}")
    return getattr(import_module(f"sattrack.safety.{_HOMES[name]}"), name)
