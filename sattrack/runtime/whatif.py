"""What another control law would have done with a recorded pass: through the same mount, simulated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from sattrack.control.following import ControlLaw
from sattrack.core.errors import BadInputError
from sattrack.core.toml_text import read_toml
from sattrack.mount.simulator.installation import SimulatorProfile
from sattrack.mount.simulator.mount import SimulatedMount, SimulatedSite
from sattrack.recording.format import OPERATOR
from sattrack.recording.mount_fit import AxisFit, fit_axes
from sattrack.recording.recorder import NoRecording
from sattrack.recording.replay import Figures, Replay, replay
from sattrack.recording.trace import trace
from sattrack.runtime import practice
from sattrack.runtime.facts import RunFacts, build_engine, decode_facts, engine_of
from sattrack.runtime.virtual import VirtualRun
from sattrack.views.messages import decode_message

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from sattrack.control.engine import Engine
    from sattrack.mount.model import MountProfile
    from sattrack.recording.reading import Recording
    from sattrack.recording.replay import Choice
    from sattrack.recording.trace import Trace
    from sattrack.views.messages import Message

QUANTILES = (0.01, 0.5, 0.99)


@dataclass(frozen=True, slots=True)
class WhatIf:
    """The recorded law and another one: the commands to the recorded samples, and the errors, simulated.

    `fitted` says what of the simulated mount came from the recording, in words.
    """

    replayed: Replay
    before: tuple[float, float]
    """RMS and peak with the recorded law, arcseconds, as the simulated mount reports them."""
    after: tuple[float, float]
    fitted: str


def read_law(path: Path | None, settings: Sequence[str], base: ControlLaw) -> ControlLaw:
    """Return a law: the file's, else `base`, changed by settings like feeder.settling_s=0.2.

    Raises BadInputError, naming the file, line and key, or the setting.
    """
    law = base if path is None else read_toml(path, ControlLaw, "the control law")
    values: dict[str, Any] = msgspec.to_builtins(law)
    for setting in settings:
        name, equals, number = setting.partition("=")
        group, _, key = name.strip().partition(".")
        if not equals or group not in values or key not in values[group]:
            known = ", ".join(f"{g}.{k}" for g, table in values.items() for k in table)
            raise BadInputError(f"--set {setting}: give one of {known}, = and a number")
        try:
            values[group][key] = float(number)
        except ValueError:
            raise BadInputError(f"--set {setting}: {number!r} is no number") from None
    try:
        return msgspec.convert(values, ControlLaw)
    except msgspec.ValidationError as error:
        raise BadInputError(f"--set: {error}") from error


def with_law(facts: RunFacts, law: ControlLaw) -> RunFacts:
    """Return a run's facts with another law."""
    return msgspec.structs.replace(facts, plan=msgspec.structs.replace(facts.plan, law=law))


def what_if(
    recording: Recording,
    facts: RunFacts,
    law: ControlLaw,
    choice: Choice,
    progress: Callable[[float], None] | None = None,
) -> WhatIf:
    """Return what another law would have commanded, and what the error would have been.

    The first is the recorded samples run through it. For the second both laws follow the pass with one and
    the same simulated mount, its gains, delays and noise as the recording shows them.
    """

    def build(spec: msgspec.Raw) -> Engine:
        return build_engine(with_law(decode_facts(spec), law))

    run = trace(recording, engine_of, _part(progress, 0, 4))
    mount, hardware, words = fitted_mount(run, facts)
    messages = tuple(_messages(recording, facts))
    errors = []
    for number, one in enumerate((facts, with_law(facts, law))):
        part = _part(progress, 1 + number, 4)
        if part is not None:
            part(0.0)
        figures = _fly(one, mount, hardware, messages)
        errors.append((figures.rms_arcsec or 0.0, figures.peak_arcsec or 0.0))
    replayed = replay(recording, build, choice=choice, progress=_part(progress, 3, 4))
    return WhatIf(replayed, errors[0], errors[1], words)


def _part(
    progress: Callable[[float], None] | None, number: int, count: int
) -> Callable[[float], None] | None:
    return None if progress is None else lambda share: progress((number + share) / count)


def fitted_mount(run: Trace, facts: RunFacts) -> tuple[MountProfile, SimulatorProfile, str]:
    """Return the mount of a recording, and how to simulate it and its link, with that in words."""
    ra, dec = fit_axes(run, facts.profile)
    changes: dict[str, float] = {}
    hardware: dict[str, Any] = {}
    words = []
    for name, fit in (("ra", ra), ("dec", dec)):
        if isinstance(fit, AxisFit):
            changes[f"{name}_rate_gain"] = fit.gain
            words.append(f"{name} gain {fit.gain:.5f}")
    if len(run.utc_s) > 1:
        late_s = run.arrival_utc_s - run.utc_s
        low, middle, high = np.quantile(late_s, QUANTILES)
        hardware["status_delay_s"] = max(0.0, float(middle))
        hardware["status_jitter_s"] = max(0.0, float(high - low) / 2.0)
        words.append(f"statuses {middle * 1000.0:.1f} ± {(high - low) * 500.0:.1f} ms late")
    profile = msgspec.structs.replace(facts.profile, **changes)
    return profile, SimulatorProfile(**hardware), ", ".join(words) or "nothing"


def _messages(recording: Recording, facts: RunFacts) -> list[tuple[float, Message]]:
    found = []
    for entry in recording.entries():
        if entry.topic == OPERATOR:
            found.append((max(entry.utc_s, facts.started_utc_s), decode_message(entry.data)))
    return found


def _fly(
    facts: RunFacts,
    profile: MountProfile,
    hardware: SimulatorProfile,
    messages: tuple[tuple[float, Message], ...],
) -> Figures:
    site = SimulatedSite(facts.site.latitude_deg, facts.site.longitude_deg, facts.site.height_m)
    mount = SimulatedMount(profile, site, practice.START, hardware)
    engine = build_engine(facts)
    VirtualRun(engine, mount, facts.started_utc_s, NoRecording(), messages).run()
    return Figures(engine.reported.rms_arcsec, engine.reported.peak_arcsec)
