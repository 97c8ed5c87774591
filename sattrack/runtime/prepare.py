"""From what the user asked for to the facts of a run: the satellite, its pass, the mount, the instant."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from sattrack.control.orders import MOST_ALONG_S, MOST_CROSS_DEG
from sattrack.core.angles import wrap180
from sattrack.core.clock import Clock, make_clock
from sattrack.core.errors import BadInputError, SattrackError
from sattrack.mount.profiles import ProfileFile
from sattrack.runtime import practice
from sattrack.runtime.facts import (
    RunFacts,
    build_engine,
    choose_pass,
    first_bias,
    plan_for,
    suited_to,
)
from sattrack.runtime.mounts import mount_address
from sattrack.runtime.remembering import MemoryMode, recall, uses_memory
from sattrack.runtime.target_facts import target_facts
from sattrack.safety import SafetyLimits
from sattrack.settings import SiteSettings
from tle.bodies import Body
from tle.elements import Elements
from tle.instants import Utc
from tle.refraction import Refraction
from tle.sources import find

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.control.tracker import TrackPlan
    from sattrack.mount.model import MountProfile
    from sattrack.runtime.mounts import MountAddress
    from sattrack.views.run import RememberedView
    from tle.ephemeris import Ephemeris
    from tle.site import Site


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
    fov_deg: float | None = None
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
    """Whether the built-in pass stands in for elements and site that nobody set."""
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
    if address is not None and request.clock_option is not None:
        raise BadInputError("--clock is for simulated mounts only; a real mount follows the real sky")
    if address is not None and request.virtual:
        raise BadInputError("--virtual goes with --mount sim only; a real mount needs real time")
    _check_bias(request)
    floor_deg = request.limits.floor_altitude_deg
    if request.min_alt_deg < floor_deg:
        raise BadInputError(f"--min-alt {request.min_alt_deg:g}: the mount is kept above {floor_deg:g}°")
    nothing_set = request.elements is None and request.site is None and request.target is None
    practising = address is None and nothing_set
    elements, site = _object_and_site(request, practising)
    check_site(request.profile.mount, site)
    if address is not None:
        address = address.seen_from(site)
    clock_text = request.clock_option
    if clock_text is None and practising:
        clock_text = practice.BEFORE_PASS
    clock, now = make_clock(clock_text)
    if request.clock is not None:
        clock = request.clock
        now = Utc(clock.utc_s(time.monotonic()))
    target = request.target or find(elements, request.satellite)
    _check_sun(target, request)
    begin_s, end_s = request.between
    from_then = now if begin_s is None else Utc(max(begin_s, float(now.unix_s)))
    satellite_pass = choose_pass(target, site, from_then, request.min_alt_deg, request.culminate_utc_s)
    plan = _until(plan_for(satellite_pass, from_then, target), end_s, target.label)
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
        fov_deg=request.fov_deg,
        mount_name="sim" if address is None else str(address),
        started_utc_s=started_s,
        recording=None if request.record is None else str(request.record),
    )
    facts = with_followed(facts, target)
    notes: tuple[str, ...] = ()
    if isinstance(target, Elements) and uses_memory(request.memory, address is None):
        given = bool(request.bias_along_s or request.bias_cross_deg)
        recalled = recall(target, facts.culminate_utc_s, request.memory, given)
        facts, notes = _beginning_with(facts, recalled.bias), recalled.notes
    if address is not None and address.presumption is not None and facts.profile.calibration is None:
        notes = (*notes, address.presumption)
    facts = with_detours(facts)
    simulator = request.profile.simulator
    return Prepared(facts, clock, address, practising, simulator, request.memory, notes, target)


def _check_sun(target: Elements | Ephemeris, request: RunRequest) -> None:
    """Raise BadInputError where the Sun is to be followed without a filter that the profile states.

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


def _until(plan: TrackPlan, end_utc_s: float | None, name: str) -> TrackPlan:
    """Return a plan that ends no later than an instant. Raises SattrackError where it begins only then."""
    if end_utc_s is None:
        return plan
    if plan.start_utc_s >= end_utc_s:
        raise SattrackError(
            f"--to {Utc(end_utc_s).isoformat('seconds')}: {name} can be followed from "
            f"{Utc(plan.start_utc_s).isoformat('seconds')} on"
        )
    return msgspec.structs.replace(plan, end_utc_s=min(plan.end_utc_s, end_utc_s))


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
    from sattrack.planning.keyhole import detours_for

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


def _check_bias(request: RunRequest) -> None:
    if not abs(request.bias_along_s) <= MOST_ALONG_S:
        raise BadInputError(f"--bias-along {request.bias_along_s}: give seconds, {MOST_ALONG_S:g} at most")
    if not abs(request.bias_cross_deg) <= MOST_CROSS_DEG:
        raise BadInputError(
            f"--bias-cross {request.bias_cross_deg}: give degrees on the sky, {MOST_CROSS_DEG:g} at most"
        )
    if not abs(request.camera_rotation_deg) <= 360.0:
        raise BadInputError(f"--camera-rotation {request.camera_rotation_deg}: give degrees, -360 to 360")
    if request.fov_deg is not None and not 0.0 < request.fov_deg <= MOST_FIELD_DEG:
        raise BadInputError(f"--fov {request.fov_deg:g}: give the field's diameter in degrees, above 0")


def _object_and_site(request: RunRequest, practising: bool) -> tuple[list[Elements], Site]:
    if practising:
        return [practice.elements()], practice.SITE.place()
    if request.elements is None and request.target is None:
        raise BadInputError("no elements: give --elements FILE or set elements in sattrack.toml")
    if request.site is None:
        raise BadInputError("no site: give --site LAT,LON,HEIGHT or set [site] in sattrack.toml")
    return request.elements or [], request.site
