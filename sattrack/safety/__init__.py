"""Limits and interlocks as one table, between everything that moves the mount and the wire.

`Safety.clear` and `Safety.clear_request` are the only makers of `Cleared` and `ClearedRequest`, and a session
takes motions in no other form.
"""

from sattrack.safety.gate import Cleared, ClearedRequest, Safety, Stance, park_objection
from sattrack.safety.geometry import altitude_deg, separation_deg
from sattrack.safety.limits import SUN_CONE_DEG, SafetyLimits
from sattrack.safety.table import INTERLOCKS, ROWS, Interlock, Reaction
from sattrack.safety.watch import Seen

__all__ = [
    "INTERLOCKS",
    "ROWS",
    "SUN_CONE_DEG",
    "Cleared",
    "ClearedRequest",
    "Interlock",
    "Reaction",
    "Safety",
    "SafetyLimits",
    "Seen",
    "Stance",
    "altitude_deg",
    "park_objection",
    "separation_deg",
]
