"""The facts of a run as plain data: what a recording keeps, and what an engine is built from."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import msgspec

from sattrack.control.engine import Engine, RunSpec
from sattrack.control.tracker import TrackPlan
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.core.utc_json import decode_utc, encode_utc
from sattrack.mount.model import MountProfile
from sattrack.runtime.target_facts import TargetFacts
from sattrack.safety import SafetyLimits
from sattrack.settings import SiteSettings
from sattrack.views.run import SAME_PASS_S, RememberedView
from tle.bias import Bias
from tle.elements import Elements
from tle.errors import EphemerisError, TleError
from tle.instants import Utc
from tle.passes import Pass, find_passes
from tle.propagator import Propagator
from tle.refraction import Refraction

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sattrack.recording.reading import Recording
    from tle.ephemeris import Ephemeris
    from tle.site import Site


SEARCH_HOURS = 48.0
SIMULATED = "sim"
"""The name of the simulated mount, as `--mount` has it."""
SETTLING_PERIODS = 2.0
REFRACTION_MODES = ("auto", "on", "off")


class RunFacts(msgspec.Struct, frozen=True):
    """Everything that makes a run besides its inputs; UTC as POSIX seconds."""

    elements: Elements | None
    """What is followed, by SGP4; None where `followed` says what is."""
    site: SiteSettings
    refraction: Literal["auto", "on", "off"]
    pressure_hpa: float
    temperature_c: float
    plan: TrackPlan
    culminate_utc_s: float
    max_alt_deg: float
    profile: MountProfile
    limits: SafetyLimits
    bias_along_s: float
    bias_cross_deg: float
    mount_name: str
    started_utc_s: float
    recording: str | None = None
    camera_rotation_deg: float = 0.0
    fov_deg: float | None = None
    """Diameter of the camera's field of view; nothing that is computed depends on it."""
    remembered: RememberedView | None = None
    """The bias of an earlier pass, in force from the beginning; a nudge is in the first biases as well."""
    followed: TargetFacts | None = None
    """What is followed where it has no elements: rows of an ephemeris, or a body."""

    @property
    def target(self) -> Elements | Ephemeris:
        """Give what is followed, made anew. Raises EphemerisError."""
        if self.elements is not None:
            return self.elements
        if self.followed is None:
            raise EphemerisError("the run's facts do not say what is followed")
        return self.followed.target()


def encode_facts(facts: RunFacts) -> bytes:
    """Return the facts as JSON; floats come back as they were."""
    return msgspec.json.encode(facts, enc_hook=encode_utc)


def decode_facts(data: bytes | msgspec.Raw) -> RunFacts:
    """Return the facts that JSON holds; raises msgspec.ValidationError."""
    return msgspec.json.decode(data, type=RunFacts, dec_hook=decode_utc)


def build_engine(facts: RunFacts) -> Engine:
    """Return a new engine for a run."""
    site = facts.site.place()
    air = Refraction(facts.pressure_hpa, facts.temperature_c)
    target = facts.target
    bent = Propagator(target, site, refraction=air)
    airless = Propagator(target, site)
    spec = RunSpec(
        propagator=airless if facts.refraction == "off" else bent,
        if_mount_refracts=bent if facts.refraction == "on" else airless,
        culminate_utc_s=facts.culminate_utc_s,
        max_alt_deg=facts.max_alt_deg,
        plan=facts.plan,
        profile=facts.profile,
        limits=facts.limits,
        bias=Bias(facts.bias_along_s, facts.bias_cross_deg),
        mount_name=facts.mount_name,
        started_utc_s=facts.started_utc_s,
        simulated=facts.mount_name == SIMULATED,
        recording=facts.recording,
        camera_rotation_deg=facts.camera_rotation_deg,
        remembered=facts.remembered,
    )
    return Engine(spec)


def first_bias(facts: RunFacts) -> Bias:
    """Return with which bias a run begins, the remembered one included, its angle that at culmination."""
    known = facts.remembered
    if known is None or known.cross_km is None:
        return Bias(facts.bias_along_s, facts.bias_cross_deg)
    along_s = facts.bias_along_s + known.along_s
    seen = Propagator(facts.target, facts.site.place()).at(Utc(facts.culminate_utc_s))
    angle_deg = math.degrees(math.atan(known.cross_km / float(seen.range_km)))
    return Bias(along_s, facts.bias_cross_deg + angle_deg)


def choose_pass(
    target: Elements | Ephemeris,
    site: Site,
    now: Utc,
    min_alt_deg: float,
    culminate_utc_s: float | None = None,
) -> Pass:
    """Return the pass in progress, else the next, or the one that culminates about `culminate_utc_s`.

    Raises SattrackError where there is none in two days, or not that one.
    """
    passes: Sequence[Pass] = find_passes(Propagator(target, site), now, SEARCH_HOURS, min_alt_deg)
    if not passes:
        raise SattrackError(
            f"{target.label} does not rise above {min_alt_deg:g}° at this site within "
            f"{SEARCH_HOURS:g} hours of {now.isoformat('seconds')}; "
            "try a lower --min-alt, or another satellite"
        )
    if culminate_utc_s is None:
        return passes[0]
    for one in passes:
        if abs(float(one.culminate_utc.unix_s) - culminate_utc_s) < SAME_PASS_S:
            return one
    if passes[0].rise_utc is None and culminate_utc_s < float(now.unix_s):
        # Past its highest, what is left of the pass in progress is highest now.
        return passes[0]
    when = Utc(culminate_utc_s).isoformat("seconds")
    raise SattrackError(f"{target.label} has no pass above {min_alt_deg:g}° that culminates about {when}")


def plan_for(satellite_pass: Pass, now: Utc, target: Elements | Ephemeris) -> TrackPlan:
    """Return when to follow a pass: from its rise to its set, or for as long as there are places."""
    rise = now if satellite_pass.rise_utc is None else satellite_pass.rise_utc
    end_s = float(now.unix_s) + SEARCH_HOURS * 3600.0
    if satellite_pass.set_utc is not None:
        end_s = float(satellite_pass.set_utc.unix_s)
    start_s, top_s = max(float(rise.unix_s), float(now.unix_s)), float(satellite_pass.culminate_utc.unix_s)
    for first, last in target.spans:
        if first.unix_s <= top_s <= last.unix_s:
            start_s, end_s = max(start_s, float(first.unix_s)), min(end_s, float(last.unix_s))
    return TrackPlan(start_utc_s=start_s, end_utc_s=end_s)


def suited_to(plan: TrackPlan, profile: MountProfile, on_target_arcsec: float) -> TrackPlan:
    """Return a plan for a mount that takes commands as rarely as its profile says, and is dated so well.

    An error that were taken out faster than in SETTLING_PERIODS would be overshot before that is seen.
    """
    law = plan.law
    settling_s = max(law.feeder.settling_s, SETTLING_PERIODS * profile.period_s)
    feeder = msgspec.structs.replace(law.feeder, settling_s=settling_s)
    law = msgspec.structs.replace(law, feeder=feeder)
    return msgspec.structs.replace(plan, law=law, on_target_arcsec=on_target_arcsec)


def open_recording(path: Path, part: int = 1) -> tuple[Recording, RunFacts]:
    """Return a recording and the facts of its run.

    Raises BadInputError where the file is none, or its facts cannot be read by this version.
    """
    from sattrack.recording.reading import Recording

    recording = Recording(path, part)
    try:
        facts = decode_facts(recording.header.spec)
    except (msgspec.MsgspecError, TleError) as error:
        raise BadInputError(
            f"{path}: the run's facts, written by sattrack {recording.header.program_version}, "
            f"cannot be read: {error}"
        ) from error
    return recording, facts


def engine_of(spec: msgspec.Raw) -> Engine:
    """Return a new engine for the facts that a recording holds; raises msgspec.MsgspecError, TleError."""
    return build_engine(decode_facts(spec))
