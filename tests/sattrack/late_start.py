"""Runs in virtual time that begin shortly before their pass."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    from sattrack.runtime.facts import RunFacts

APPROACH_S, LEAD_S = 25.0, 3.0
"""From a run's beginning to its pass: enough for any slew of the simulated mount, and little of waiting."""


def late(facts: RunFacts, approach_s: float = APPROACH_S) -> RunFacts:
    """Return a run that begins 28 s before its pass, and not a minute and more; later for a shorter slew."""
    plan = msgspec.structs.replace(facts.plan, approach_s=approach_s)
    return msgspec.structs.replace(facts, plan=plan, started_utc_s=plan.start_utc_s - approach_s - LEAD_S)
