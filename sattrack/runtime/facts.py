"""The facts of a run as plain data, from what the user asked for: satellite, pass, mount and instant.

A recording keeps them, and an engine is built from them.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from sattrack.control.biases import MOST_ALONG_S, MOST_CROSS_DEG
from sattrack.control.camera_image import Camera, Cameras
from sattrack.control.engine import Engine, RunSpec
from sattrack.control.tracker import TrackPlan
from sattrack.core import local_time
from sattrack.core.angles import wrap180
from sattrack.core.clock import Clock, decode_utc, encode_utc, make_clock
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.mount.geometry import Pole
from sattrack.mount.model import MountProfile
from sattrack.mount.profiles import ProfileFile
from sattrack.pointing.terms import PointingModel, axes_moved
from sattrack.runtime import demo_pass
from sattrack.runtime.mounts import SIMULATED, mount_address
from sattrack.runtime.target_facts import TargetFacts, target_facts
from sattrack.runtime.turns import followed_axis_deg, noted_axis_deg
from sattrack.safety import SafetyLimits
from sattrack.settings import NO_ELEMENTS, NO_SITE, SiteSettings
from sattrack.views.run import SAME_PASS_S, RememberedView
from tle.bias import Bias
from tle.bodies import Body
from tle.elements import Elements
from tle.errors import EphemerisError, SatelliteNotFoundError, TleError
from tle.fixes import FIXES, PREDICTED_S
from tle.instants import Utc
from tle.passes import Pass, find_passes
from tle.propagator import Propagator
from tle.refraction import Refraction
from tle.sources import find

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sattrack.mount.model import PointingTerms
    from sattrack.recording.format import Recording
    from sattrack.runtime.bias_memory import MemoryMode
    from sattrack.runtime.mounts import MountAddress
    from tle.ephemeris import Ephemeris
    from tle.site import Site

SEARCH_HOURS = 48.0
SETTLING_PERIODS = 2.0
MODEL_SITE_DEG = 0.1
"""A pointing model that was found so far to the north or the south is another mount's."""


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
    camera_flip: bool = False
    cameras: dict[str, Camera] = {}
    """Cameras by their names; `""` is any other, of which without it the rotation and the flip above hold."""
    fov_deg: float | None = None
    """Diameter of the camera's field of view; searches depend on it, nothing else."""
    search_when_lost: bool = False
    remembered: RememberedView | None = None
    """The bias of an earlier pass, in force from the beginning; a nudge is in the first biases as well."""
    followed: TargetFacts | None = None
    """What is followed where it has no elements: rows of an ephemeris, or a body."""
    first_axis_deg: float | None = None
    """Where a session before left the first axis, turns counted; None for within half a turn of its zero."""
    followed_deg: float | None = None
    """Where the first axis is, turns counted, if it has followed the sky since; None: not known."""

    @property
    def target(self) -> Elements | Ephemeris:
        """Give what is followed, made anew. Raises EphemerisError."""
        if self.elements is not None:
            return self.elements
        if self.followed is None:
            raise EphemerisError("the run's facts do not say what is followed")
        return self.followed.target()


# Made once, under the lock of the import: msgspec's first look at a type is not safe in two threads.
_DECODER = msgspec.json.Decoder(RunFacts, dec_hook=decode_utc)


def encode_facts(facts: RunFacts) -> bytes:
    """Return the facts as JSON; floats come back as they were."""
    return msgspec.json.encode(facts, enc_hook=encode_utc)


def decode_facts(data: bytes | msgspec.Raw) -> RunFacts:
    """Return the facts that JSON holds; raises msgspec.ValidationError."""
    return _DECODER.decode(data)


def build_engine(facts: RunFacts) -> Engine:
    """Return a new engine for a run. Raises BadInputError for a pointing model that is another mount's."""
    site = facts.site.place()
    air = Refraction(facts.pressure_hpa, facts.temperature_c)
    target = facts.target
    pointing = pointing_of(facts.profile, site)
    bent = Propagator(target, site, refraction=air, pointing=pointing)
    airless = Propagator(target, site, pointing=pointing)
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
        cameras=Cameras(
            facts.cameras.get("", Camera(facts.camera_rotation_deg, facts.camera_flip)),
            facts.cameras,
            facts.fov_deg,
            facts.search_when_lost,
        ),
        remembered=facts.remembered,
        first_axis_deg=facts.first_axis_deg,
        followed_deg=facts.followed_deg,
    )
    return Engine(spec)


def pointing_of(profile: MountProfile, site: Site) -> PointingModel | None:
    """Return the pointing model of a profile, None where it has none.

    Raises BadInputError where it was found elsewhere, or with other axes than the profile's.
    """
    check_model_site(profile, site)
    known, geometry = profile.pointing, profile.geometry
    if known is None:
        return None
    words = _model_named(profile.name, known)
    if known.axes != "equatorial" and geometry is None:
        whose = "an azimuth mount's" if known.axes == "altaz" else "of a mount with a pole of its own"
        raise BadInputError(
            f"{words} is {whose}, and the profile has no geometry: `sattrack mount calibrate "
            "--axes` measures it"
        )
    if geometry is not None and isinstance(known.axes, Pole) and axes_moved(known.axes, geometry.pole):
        raise BadInputError(
            f"{words} is of axes that lay {known.axes.moved_deg(geometry.pole):.2f}° from those of its "
            "geometry: make one with this geometry by `sattrack star-run`, or refit its stars by --fit-only"
        )
    try:
        return PointingModel.of(known)
    except BadInputError as error:
        raise BadInputError(f"the profile {profile.name!r}: {error}") from None


def check_model_site(profile: MountProfile, site: Site) -> None:
    """Raise BadInputError where the pointing model of a profile was found at another latitude."""
    known = profile.pointing
    if known is not None and abs(known.latitude_deg - site.latitude_deg) > MODEL_SITE_DEG:
        raise BadInputError(
            f"{_model_named(profile.name, known)} is of a mount at latitude {known.latitude_deg:.2f}°, and "
            f"the site is at {site.latitude_deg:.2f}°: make one here with `sattrack star-run`, or give this "
            "mount's profile"
        )


def _model_named(profile: str, known: PointingTerms) -> str:
    return f"the pointing model of the profile {profile!r}, of {known.utc[:10]},"


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
            f"{SEARCH_HOURS:g} hours of {local_time.instant(float(now.unix_s))}; "
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
    when = local_time.instant(culminate_utc_s)
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
    from sattrack.recording.format import Recording

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


SAME_SITE_DEG = 0.1
VIRTUAL_LEAD_S = 5.0
MOST_FIELD_DEG = 180.0


@dataclass(frozen=True, slots=True)
class RunRequest:
    """What the user asked for; elements and site None where nothing was set anywhere."""

    satellite: str
    mount_url: str | None
    elements: list[Elements] | None
    site: Site | None
    clock_option: str | None
    min_alt_deg: float
    refraction: Literal["auto", "on", "off"] = "auto"
    bias_along_s: float = 0.0
    bias_cross_deg: float = 0.0
    camera_rotation_deg: float = 0.0
    camera_flip: bool = False
    cameras: dict[str, Camera] = field(default_factory=dict)
    fov_deg: float | None = None
    search_when_lost: bool = False
    virtual: bool = False
    record: Path | None = None
    profile: ProfileFile = field(default_factory=ProfileFile)
    limits: SafetyLimits = field(default_factory=SafetyLimits)
    memory: MemoryMode = "off"
    between: tuple[float | None, float | None] = (None, None)
    """From when, and until when, at most, the pass is followed: POSIX seconds of UTC."""
    clock: Clock | None = None
    """A clock that runs already, by which to go on."""
    target: Elements | Ephemeris | None = None
    """What to follow, where that is found already; else `satellite` is looked up in the elements."""
    culminate_utc_s: float | None = None
    """About when the pass that is meant culminates; None for the next."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """A run ready to begin; `address` is None for the simulated mount."""

    facts: RunFacts
    clock: Clock
    address: MountAddress | None
    practising: bool
    """Whether the built-in pass stands in for elements and a site that were not set."""
    simulator: dict[str, Any] = field(default_factory=dict)
    """What the profile's file says of the simulated mount alone."""
    memory: MemoryMode = "off"
    notes: tuple[str, ...] = ()
    """What to report before the run begins: of the bias memory, of a mount that is not calibrated."""
    target: Elements | Ephemeris | None = None
    """What is followed, whole, of which the facts keep what the run needs; None where they have it whole."""


def prepare(request: RunRequest) -> Prepared:
    """Resolve a request, moving nothing. Raises BadInputError, SattrackError or TleError."""
    address = mount_address(request.mount_url)
    _check_request(request, simulated=address is None)
    nothing_set = request.elements is None and request.site is None and request.target is None
    practising = address is None and nothing_set
    elements, site = _object_and_site(request, practising)
    check_site(request.profile.mount, site)
    if address is not None:
        address = address.seen_from(site)
    clock_text = request.clock_option
    if clock_text is None and practising:
        clock_text = demo_pass.BEFORE_PASS
    clock, now = make_clock(clock_text)
    if request.clock is not None:
        clock = request.clock
        now = Utc(clock.utc_s(time.monotonic()))
    target = request.target or find(elements, request.satellite)
    _check_sun(target, request)
    begin_s, end_s = request.between
    from_then = now if begin_s is None else Utc(max(begin_s, float(now.unix_s)))
    satellite_pass = choose_pass(target, site, from_then, request.min_alt_deg, request.culminate_utc_s)
    plan = _until(plan_for(satellite_pass, from_then, target), end_s, target)
    if address is not None:
        plan = suited_to(plan, request.profile.mount, address.on_target_arcsec)
    started_s = float(now.unix_s)
    if request.virtual:
        started_s = max(started_s, plan.start_utc_s - plan.approach_s - VIRTUAL_LEAD_S)
    air = Refraction.standard(site.height_m)
    facts = RunFacts(
        elements=target if isinstance(target, Elements) else None,
        site=SiteSettings(site.latitude_deg, site.longitude_deg, site.height_m),
        refraction=request.refraction,
        pressure_hpa=air.pressure_hpa,
        temperature_c=air.temperature_c,
        plan=plan,
        culminate_utc_s=float(satellite_pass.culminate_utc.unix_s),
        max_alt_deg=float(satellite_pass.max_alt_deg),
        profile=request.profile.mount,
        limits=request.limits,
        bias_along_s=request.bias_along_s,
        bias_cross_deg=request.bias_cross_deg,
        camera_rotation_deg=request.camera_rotation_deg,
        camera_flip=request.camera_flip,
        cameras=request.cameras,
        fov_deg=request.fov_deg,
        search_when_lost=request.search_when_lost,
        mount_name="sim" if address is None else str(address),
        started_utc_s=started_s,
        recording=None if request.record is None else str(request.record),
        first_axis_deg=None if address is None else noted_axis_deg(address.name),
        followed_deg=None if address is None else followed_axis_deg(address.name, time.time()),
    )
    facts = with_followed(facts, target)
    notes: tuple[str, ...] = ()
    from sattrack.runtime.bias_memory import recall, uses_memory  # brings SQLite, only needed here

    if isinstance(target, Elements) and uses_memory(request.memory, address is None):
        given = bool(request.bias_along_s or request.bias_cross_deg)
        recalled = recall(target, facts.culminate_utc_s, request.memory, given)
        facts, notes = _beginning_with(facts, recalled.bias), recalled.notes
    # A geometry is that of a mount whose signs are known, and that is not taken to be equatorial.
    measured = facts.profile.calibration is not None or facts.profile.geometry is not None
    if address is not None and address.presumption is not None and not measured:
        notes = (*notes, address.presumption)
    facts = with_detours(facts)
    simulator = request.profile.simulator
    return Prepared(facts, clock, address, practising, simulator, request.memory, notes, target)


def _check_sun(target: Elements | Ephemeris, request: RunRequest) -> None:
    """Raise BadInputError where the Sun is the target without a filter that the profile states.

    The cone that the limits keep about the Sun is not opened by that: its owner must.
    """
    if not (isinstance(target, Body) and target.name == "Sun"):
        return
    if not request.profile.mount.solar_filter:
        raise BadInputError(
            "the Sun is followed with a solar filter only: fit one, and state solar_filter = true in the "
            "mount's profile"
        )
    if request.limits.sun_deg > 0.0:
        raise BadInputError(
            f"the Sun: the limits keep the mount {request.limits.sun_deg:g}° from it: while the solar filter "
            "is on, set optical = false in [safety] of sattrack.toml"
        )


def _until(plan: TrackPlan, end_utc_s: float | None, target: Ephemeris) -> TrackPlan:
    """Return a plan that ends no later than an instant, or than what is flown on is believed.

    Raises SattrackError where it begins only then.
    """
    if target.provenance.startswith(FIXES):
        last_s = float(target.epoch.unix_s) + PREDICTED_S
        plan = msgspec.structs.replace(plan, end_utc_s=min(plan.end_utc_s, last_s))
    if end_utc_s is None:
        return plan
    if plan.start_utc_s >= end_utc_s:
        raise SattrackError(
            f"--to {Utc(end_utc_s).isoformat('seconds')}: {target.label} can be followed from "
            f"{Utc(plan.start_utc_s).isoformat('seconds')} on; give a later --to"
        )
    return msgspec.structs.replace(plan, end_utc_s=min(plan.end_utc_s, end_utc_s), latest_utc_s=end_utc_s)


def _beginning_with(facts: RunFacts, bias: RememberedView | None) -> RunFacts:
    """Return the facts with a remembered bias: a nudge as the operator's own, a fit as an estimate."""
    facts = msgspec.structs.replace(facts, remembered=bias)
    if bias is None or bias.cross_deg is None:
        return facts
    return msgspec.structs.replace(facts, bias_along_s=bias.along_s, bias_cross_deg=bias.cross_deg)


def with_followed(facts: RunFacts, target: Elements | Ephemeris) -> RunFacts:
    """Return the facts with what their run needs of a target that has no elements."""
    if isinstance(target, Elements):
        return facts
    begin_s = min(facts.started_utc_s, facts.plan.start_utc_s)
    return msgspec.structs.replace(facts, followed=target_facts(target, begin_s, facts.plan.end_utc_s))


def with_detours(facts: RunFacts) -> RunFacts:
    """Return the facts with the ways past the celestial pole in their plan, where the profile has it so."""
    if not facts.profile.through_pole:
        return facts
    from sattrack.planning.path import detours_for

    spec = build_engine(facts).spec
    detours = detours_for(spec.propagator, first_bias(facts), facts.plan, facts.profile)
    return msgspec.structs.replace(facts, plan=msgspec.structs.replace(facts.plan, detours=detours))


def check_site(profile: MountProfile, site: Site) -> None:
    """Raise BadInputError where a profile was made for a mount that stands elsewhere."""
    made = profile.stands_at
    if made is None:
        return
    east_deg = wrap180(made.longitude_deg - site.longitude_deg)
    if max(abs(made.latitude_deg - site.latitude_deg), abs(east_deg)) > SAME_SITE_DEG:
        raise BadInputError(
            f"the profile {profile.name!r} is of a mount at {made.latitude_deg:.2f}, "
            f"{made.longitude_deg:.2f} (stands_at), and the site is {site.latitude_deg:.2f}, "
            f"{site.longitude_deg:.2f}: give this mount's profile"
        )


def check_field(fov_deg: float | None) -> None:
    """Raise BadInputError where a field's diameter, in degrees, is none."""
    if fov_deg is not None and not 0.0 < fov_deg <= MOST_FIELD_DEG:
        raise BadInputError(
            f"--fov {fov_deg:g}: give the field's diameter in degrees, above 0 to {MOST_FIELD_DEG:g}"
        )


def _check_request(request: RunRequest, simulated: bool) -> None:
    if not simulated and request.clock_option is not None:
        raise BadInputError("--clock is for simulated mounts only; a real mount follows the real sky")
    if not simulated and request.virtual:
        raise BadInputError("--virtual goes with --mount sim only; a real mount needs real time")
    if not abs(request.bias_along_s) <= MOST_ALONG_S:
        raise BadInputError(f"--bias-along {request.bias_along_s}: give seconds, {MOST_ALONG_S:g} at most")
    if not abs(request.bias_cross_deg) <= MOST_CROSS_DEG:
        raise BadInputError(
            f"--bias-cross {request.bias_cross_deg}: give degrees on the sky, {MOST_CROSS_DEG:g} at most"
        )
    if not abs(request.camera_rotation_deg) <= 360.0:
        raise BadInputError(f"--rotation {request.camera_rotation_deg:g}: give degrees, -360 to 360")
    if request.search_when_lost and request.fov_deg is None:
        raise BadInputError("--search-lost needs the camera's field: give --fov, or fov_deg in [camera]")
    check_field(request.fov_deg)
    floor_deg = request.limits.floor_altitude_deg
    if request.min_alt_deg < floor_deg:
        raise BadInputError(f"--min-alt {request.min_alt_deg:g}: the mount is kept above {floor_deg:g}°")


def _object_and_site(request: RunRequest, practising: bool) -> tuple[list[Elements], Site]:
    if practising:
        known = [demo_pass.elements()]
        try:
            find(known, request.satellite)
        except SatelliteNotFoundError:
            raise BadInputError(
                f"{request.satellite}: neither elements nor site are set, and only the built-in pass of the "
                "ISS can be practised without: run `sattrack init`"
            ) from None
        return known, demo_pass.SITE.place()
    if request.elements is None and request.target is None:
        raise BadInputError(NO_ELEMENTS)
    if request.site is None:
        raise BadInputError(NO_SITE)
    return request.elements or [], request.site
