"""What a run takes from the bias memory before it begins, and what it leaves there once it is over.

None of this delays following: a memory that cannot be used is reported in a line.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

from sattrack.control.biases import ALONG, CROSS
from sattrack.core.errors import SattrackError
from sattrack.recording.bias_memory import BiasMemory, KeptBias, memory_file, told, worth_keeping
from sattrack.runtime.facts import SIMULATED
from sattrack.views.run import RememberedView

if TYPE_CHECKING:
    from sattrack.control.engine import Engine
    from sattrack.recording.smoothing import BiasFit
    from sattrack.runtime.facts import RunFacts
    from tle.elements import Elements

MemoryMode = Literal["auto", "on", "nudge", "off"]
SAME_S, SAME_DEG = 1e-6, 1e-6


class Recalled(NamedTuple):
    """The bias to begin with, if there is one, and notes about the memory."""

    bias: RememberedView | None
    notes: tuple[str, ...]


def uses_memory(mode: MemoryMode, simulated: bool) -> bool:
    """Tell whether a run has to do with the memory: one of a simulated mount only where that is asked for."""
    return mode in {"on", "nudge"} or (mode == "auto" and not simulated)


def recall(elements: Elements, at_utc_s: float, mode: MemoryMode, given: bool) -> Recalled:
    """Return what earlier passes found, for a pass about an instant; UTC as POSIX seconds.

    A fit is what the run begins with; a nudge only with the mode "nudge", and else a note. Where `given`,
    the user gave a bias, which is taken instead.
    """
    memory = BiasMemory(memory_file())
    try:
        fit = memory.recall(elements, at_utc_s, "observations")
        nudge = memory.recall(elements, at_utc_s, "nudge")
    except SattrackError as error:
        return Recalled(None, (f"{error}; nothing is recalled",))
    if mode == "nudge" and nudge is not None and (fit is None or nudge.utc_s > fit.utc_s):
        fit = nudge
    if fit is not None and given:
        return Recalled(None, (f"a remembered bias is left aside for the one given: {told(fit, at_utc_s)}",))
    if fit is not None:
        words = f"begins with the bias remembered: {told(fit, at_utc_s)}; --bias-memory off leaves it out"
        return Recalled(_view(fit), (words,))
    if nudge is not None and not given:
        words = f"remembered, but not used: {told(nudge, at_utc_s)}; --bias-memory nudge begins with it"
        return Recalled(None, (words,))
    return Recalled(None, ())


def _view(bias: KeptBias) -> RememberedView:
    return RememberedView(
        source=bias.source,
        utc_s=bias.utc_s,
        along_s=bias.along_s,
        along_sigma_s=bias.along_sigma_s,
        cross_km=bias.cross_km,
        cross_sigma_km=bias.cross_sigma_km,
        cross_deg=bias.cross_deg,
        observations=bias.observations,
        entry=bias.entry,
    )


def keep(engine: Engine, facts: RunFacts, ended_utc_s: float, mode: MemoryMode) -> str | None:
    """Leave in the memory what a run found, drop there what was dropped; return in words what was done."""
    if facts.elements is None or not uses_memory(mode, facts.mount_name == SIMULATED):
        return None
    memory, words = BiasMemory(memory_file()), []
    try:
        remembered = engine.tracker.steering.remembered
        if remembered is not None and remembered.state == "dropped" and memory.drop(remembered.entry):
            words.append("the bias that was dropped is not offered again")
        found = _found(engine, facts, ended_utc_s)
        if found is not None and worth_keeping(found):
            memory.keep(found, facts.elements, run_name(facts))
            words.append(f"kept for these elements: {told(found, ended_utc_s)}")
    except SattrackError as error:
        words.append(f"{error}; the bias of this pass is not kept")
    return "; ".join(words) or None


def keep_fit(fit: BiasFit, facts: RunFacts, mode: MemoryMode) -> str | None:
    """Keep what a report fitted to the observations of a run; return in words what was done."""
    if facts.elements is None or not uses_memory(mode, facts.mount_name == SIMULATED):
        return None
    found = KeptBias(
        source="observations",
        utc_s=fit.utc_s,
        along_s=fit.along.value,
        along_sigma_s=fit.along.sigma,
        cross_km=fit.cross.value,
        cross_sigma_km=fit.cross.sigma,
        observations=fit.taken,
        made_by="report",
        mount=facts.mount_name,
    )
    if not worth_keeping(found):
        return None
    try:
        BiasMemory(memory_file()).keep(found, facts.elements, run_name(facts))
    except SattrackError as error:
        return f"{error}; the fit is not kept"
    return f"kept for these elements: {told(found, fit.utc_s)}"


def run_name(facts: RunFacts) -> str:
    """Return the name of a run: its mount and its beginning."""
    return f"{facts.mount_name} {facts.started_utc_s!r}"


def _found(engine: Engine, facts: RunFacts, ended_utc_s: float) -> KeptBias | None:
    """Return what observations said, else the operator's nudges as they stood in the end, or None."""
    steering = engine.tracker.steering
    known, seen_utc_s = steering.estimator.filter, steering.estimator.last_utc_s
    if known is not None and seen_utc_s is not None:
        return KeptBias(
            source="observations",
            utc_s=seen_utc_s,
            along_s=known.along_s,
            along_sigma_s=known.along_sigma_s,
            cross_km=known.cross_km,
            cross_sigma_km=known.cross_sigma_km,
            observations=known.accepted,
            mount=facts.mount_name,
        )
    offsets = (steering.biases.offsets[what].total_at(ended_utc_s) for what in (ALONG, CROSS))
    began = (facts.bias_along_s, facts.bias_cross_deg)
    moved = [abs(one - first) for one, first in zip(offsets, began, strict=True)]
    if moved[0] < SAME_S and moved[1] < SAME_DEG:
        return None
    along_s, cross_deg = steering.biases.totals(ended_utc_s)
    if abs(along_s) < SAME_S and abs(cross_deg) < SAME_DEG:
        return None
    return KeptBias(
        source="nudge",
        utc_s=ended_utc_s,
        along_s=along_s,
        cross_deg=cross_deg,
        mount=facts.mount_name,
    )
