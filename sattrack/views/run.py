"""Immutable states for the terminal UI, JSON and recordings. No logic.

A run and its summary, a manual console, the people before a run, and the antenna behind its interface.
"""

from __future__ import annotations

import msgspec

from sattrack.mount.model import LinkView, Readings, SkyTerms, Status

SAME_PASS_S = 120.0
"""Passes of one satellite that culminate within so long of one another are the same."""


class ErrorView(msgspec.Struct, frozen=True, gc=False):
    """Mount minus target on the sky, arcseconds, at the instant of one status (UTC, POSIX seconds).

    Total, per axis, and along and across the motion: along is positive where the mount leads, across to the
    left as one faces the motion.
    """

    utc_s: float
    total_arcsec: float
    ra_arcsec: float
    dec_arcsec: float
    along_arcsec: float
    across_arcsec: float


class OffsetView(msgspec.Struct, frozen=True):
    """One of the operator's offsets: `what` names it and its unit; the rate is a second."""

    what: str
    total: float
    """What was asked for."""
    applied: float
    """What is in force."""
    rate: float


class SearchView(msgspec.Struct, frozen=True):
    """The search that runs: how, since when, and where it is of its centre."""

    how: str
    elapsed_s: float
    along_s: float
    cross_deg: float


class EstimateView(msgspec.Struct, frozen=True):
    """What observations say of the biases, each with one sigma, and the outcome of the observations.

    The biases are those of the view's instant, None before the first was taken; `last_utc_s` is the instant
    of the newest that was.
    """

    along_s: float | None
    along_sigma_s: float | None
    cross_deg: float | None
    cross_sigma_deg: float | None
    accepted: int
    rejected: int
    """Those that contradict the elements or the estimate."""
    refused: int
    """Those that cannot be of this pass, and lines that are none."""
    last_utc_s: float | None
    drift_s_min: float | None = None
    """How fast the bias along the track changes."""
    begun_anew: int = 0
    """How often what was rejected took the place of the estimate."""


class CameraView(msgspec.Struct, frozen=True):
    """A camera whose offsets were taken: how its image was assumed to lie, and what was found beyond that.

    Each found term has one sigma; `clock_s` is positive where its dates are ahead by its offsets alone: what
    the correction by the stars (`ClockView`) leaves.
    """

    name: str
    kind: str
    rotation_deg: float
    flipped: bool
    scale_arcsec_px: float | None
    found_rotation_deg: float
    found_rotation_sigma_deg: float
    found_scale: float
    """A share: 0.01 where pixels are 1 % larger than assumed."""
    found_scale_sigma: float
    clock_s: float
    clock_sigma_s: float
    found_mirrored: bool = False
    """Whether its image is mirrored otherwise than assumed."""


class TwoAxesView(msgspec.Struct, frozen=True):
    """How the axes of a mount with a geometry stand, by its last status: degrees, degrees a second.

    `field_angle_deg` is the position angle on the sky, north through east, in which growing second angles
    lead: a camera on the tube turns with it, at `field_rate_deg_s`.
    """

    first_deg: float
    second_deg: float
    first_rate_deg_s: float
    second_rate_deg_s: float
    field_angle_deg: float
    field_rate_deg_s: float


class ClockView(msgspec.Struct, frozen=True):
    """What the stars in a camera's frames say of its clock, with one sigma; positive where it is ahead."""

    camera: str
    clock_s: float
    sigma_s: float
    frames: int
    """How many solved fields that is from."""
    corrected_s: float
    """What is taken off its dates; 0 where the clock is not known to be off."""


class LoopView(msgspec.Struct, frozen=True):
    """What closes the loop on the sky: "elements" alone, a "camera" (or plate solutions), or it is "lost".

    Lost, the target is predicted by what was learnt, for `predicted_s` since the last observation.
    """

    state: str
    predicted_s: float | None = None
    sigma_arcsec: float | None = None
    """How well it is known where the mount must point, one sigma in the worst direction."""
    cameras: tuple[CameraView, ...] = ()
    guided: bool = True
    """Whether observations correct the target; else they are only shown."""
    last: str | None = None
    """The outcome of the last observation: "taken", "held" while nothing is guided by them, or why not."""
    clocks: tuple[ClockView, ...] = ()
    """Of the cameras whose fields were solved while the mount followed."""


class RememberedView(msgspec.Struct, frozen=True):
    """The bias of an earlier pass with which this one began: what it is from, and its outcome.

    `source` is "observations", with the distance across the track and sigmas grown by age, or "nudge", an
    operator's, with an angle and none. `state` is "in force", "replaced" (by this pass' observations),
    "dropped" or "cleared" (by the operator).
    """

    source: str
    utc_s: float
    """As of which instant it was found; UTC, POSIX seconds."""
    along_s: float
    along_sigma_s: float | None
    cross_km: float | None
    cross_sigma_km: float | None
    cross_deg: float | None
    observations: int
    entry: int
    """Its number in the memory."""
    state: str = "in force"


class PauseView(msgspec.Struct, frozen=True):
    """A run that is paused: since when (UTC, POSIX seconds), and what its mount does."""

    since_utc_s: float
    at_rest: bool
    """Whether the mount was seen at rest; false while it comes to rest, and while it is jogged."""
    jogging: bool
    going_on: bool = False
    """Whether the run resumes as soon as the mount is at rest."""


class LearntView(msgspec.Struct, frozen=True):
    """What the run has learnt of the mount while it followed, each with one sigma.

    Gains are as in a profile: what comes of a commanded rate, divided by it; None before they are known. A
    lag is beyond `command_delay_s` and the mount's turn.
    """

    ra_lag_s: float
    ra_lag_sigma_s: float
    ra_gain: float | None
    ra_gain_sigma: float | None
    dec_lag_s: float
    dec_lag_sigma_s: float
    dec_gain: float | None
    dec_gain_sigma: float | None
    command_delay_s: float
    """As assumed: the profile's, or another one by acknowledgements and motion. It is against the instants of
    samples: where those are dated too early it is less, down to below 0."""
    settling_s: float
    """Time constant with which an error is taken out, of the slower axis."""
    restarts: int
    """How often the axes' filters contradicted what was seen, and restarted."""
    sky: SkyTerms | None = None
    """What cameras have shown of the mount and of themselves; None where none has."""
    command_delay_sigma_s: float = 0.0
    """How surely acknowledgements tell the command delay, the profile's own uncertainty included."""


class StageView(msgspec.Struct, frozen=True):
    """What the run does from a status on, by its instant (POSIX seconds of UTC), until the next stage.

    `doing` is "following" where the error counts in the pass' figures; else "acquiring", "held" (by the limit
    `held_by`), "paused", "rejoining" or "other".
    """

    utc_s: float
    doing: str
    held_by: str | None = None


class TrackView(msgspec.Struct, frozen=True, tag="view"):
    """Everything about a run at one instant. Directions in degrees, true of date; UTC as POSIX seconds."""

    utc_s: float
    phase: str
    name: str
    catalog_number: int | None
    mount: str
    start_utc_s: float
    culminate_utc_s: float
    end_utc_s: float
    max_alt_deg: float
    elements_age_s: float | None
    """How old the elements are, or what an ephemeris was made of; None for bodies."""
    target_ra_deg: float
    target_dec_deg: float
    target_alt_deg: float
    target_az_deg: float
    range_km: float | None
    mount_ra_deg: float | None
    mount_dec_deg: float | None
    error: ErrorView | None
    rms_10s_arcsec: float | None
    rms_pass_arcsec: float | None
    ra_rate_deg_s: float
    dec_rate_deg_s: float
    max_ra_rate_deg_s: float
    max_dec_rate_deg_s: float
    bias_along_s: float
    bias_cross_deg: float
    bias_along_goal_s: float
    bias_cross_goal_deg: float
    link: LinkView
    recording: str | None
    ended_by: str | None
    warnings: tuple[str, ...] = ()
    offsets: tuple[OffsetView, ...] = ()
    """The operator's offsets that are not nothing."""
    search: SearchView | None = None
    estimate: EstimateView | None = None
    """None while no observation has come."""
    remembered: RememberedView | None = None
    ra_rate_reached_deg_s: float | None = None
    """Rates that the drives report, as rates of the reported right ascension and declination."""
    dec_rate_reached_deg_s: float | None = None
    pause: PauseView | None = None
    """None where the run is not paused."""
    calibrated: bool | None = None
    """Whether the mount's profile was measured; None where that was not recorded."""
    learnt: LearntView | None = None
    """None before the mount was followed with."""
    stages: tuple[StageView, ...] = ()
    """The last stages, the newest at the end."""
    loop: LoopView | None = None
    """None where no camera is set and no observation has come."""
    t0_utc_s: float | None = None
    """T0 of a launch, as it stands; None for anything else."""
    source: str | None = None
    """What gives the target's places."""
    source_file: str | None = None
    """The name of its file or download, without folders; None where it has none, or that is not known."""
    expected_error_m: float | None = None
    """By how much they miss it, typically; None where nothing tells."""
    axes: TwoAxesView | None = None
    """How the axes stand; None for an equatorial mount, of which hour angle and declination tell it."""
    periodic_arcsec: tuple[float, float] | None = None
    """By how much the axes stand past what is fed, on the sky, along the first and the second: the profile's
    periodic errors, which are fed; None where none are."""


class SkyPoint(msgspec.Struct, frozen=True, array_like=True):
    """A direction over the site at an instant: POSIX seconds of UTC; degrees, azimuth from north by east."""

    utc_s: float
    alt_deg: float
    az_deg: float


class PathPoint(SkyPoint, frozen=True, array_like=True):
    """A point of the satellite's path, and how far a second of time bias moves it on the sky there."""

    along_deg_s: float


class PassView(msgspec.Struct, frozen=True, tag="pass"):
    """What does not change during a pass and is sent once, before it: the sky over the site, what to expect.

    Degrees, UTC as POSIX seconds. `path` is what is fed without offsets, from the beginning of the following
    to its end.
    """

    latitude_deg: float
    longitude_deg: float
    path: tuple[PathPoint, ...]
    rises: bool
    """Whether the path begins with the rise, and not by a late start."""
    sets: bool
    culminate_utc_s: float
    sun: tuple[SkyPoint, ...]
    moon: tuple[SkyPoint, ...]
    sun_cone_deg: float
    """Half angle of the cone that is not pointed into, 0 for none."""
    moon_cone_deg: float
    floor_altitude_deg: float
    horizon: tuple[tuple[float, float], ...]
    """Azimuth and altitude of the skyline; empty for none."""
    keyhole_deg: float | None
    """Distance from the mount's pole within which its first axis is too slow for this satellite."""
    command_delay_s: float
    delays_measured: bool
    along_arcsec: float | None
    """The error to expect at its worst, one sigma, before anything is observed; None where it is unknown."""
    across_arcsec: float | None
    fov_deg: float | None
    """Diameter of the camera's field of view."""
    can_park: bool = False
    """Whether the mount's profile has a park position."""
    mount_pole_deg: tuple[float, float] | None = None
    """Altitude and azimuth to which the first axis points; None for an equatorial mount."""
    lost_s: float = 0.0
    """About how much of the pass the mount will lose to its limits and rates, seconds."""
    lost_to: str | None = None
    """To which limit most of that."""
    lost_from_utc_s: float | None = None
    """From when on that is lost."""


class PeriodView(msgspec.Struct, frozen=True):
    """How regularly datagrams were sent, milliseconds of the run's clock."""

    p50: float
    p99: float
    p999: float
    max: float


class DatagramsView(msgspec.Struct, frozen=True):
    """Datagrams counted over a run."""

    sent: int
    received: int
    lost: int
    late: int
    duplicate: int
    rejected: int
    unsent: int = 0


class CameraSummary(msgspec.Struct, frozen=True):
    """What the cameras that were started with a run came to.

    `used` and `rejected` are the run's counts of all observations: other sources' count with them.
    """

    frames: int
    detected: int
    used: int
    rejected: int
    first_utc: str | None
    """The middle of the first exposure in which the satellite was detected."""


class Summary(msgspec.Struct, frozen=True):
    """What a run came to; the fields that scripts rely on, null where not available."""

    name: str
    catalog_number: int | None
    mount: str
    started_utc: str
    ended_utc: str
    ended_by: str
    samples: int
    on_target_s: float
    acquired_after_s: float | None
    reported_rms_arcsec: float | None
    reported_peak_arcsec: float | None
    true_rms_arcsec: float | None
    true_peak_arcsec: float | None
    period_ms: PeriodView | None
    datagrams: DatagramsView
    bias_along_s: float
    bias_cross_deg: float
    recording: str | None
    mount_stopped: bool | None
    """Whether the mount acknowledged the last stop and was seen at rest; null where it was never heard."""
    message: str | None = None
    """Why the run ended, in words, where it did not end as planned."""
    recording_trouble: str | None = None
    """Why the recording is not whole."""
    offsets: tuple[OffsetView, ...] = ()
    """The operator's offsets at the end."""
    estimate: EstimateView | None = None
    loop: LoopView | None = None
    """How the loop on the sky stood at the end; null without cameras and observations."""
    remembered: RememberedView | None = None
    bias_memory: str | None = None
    """What was kept for the next pass with the same elements, or why nothing was; null where nothing is."""
    held_s: dict[str, float] = {}
    """Seconds for which each limit kept the mount off its target while it followed: limits of place, and
    "keyhole" or "rate" where the target was faster than an axis can turn."""
    paused_s: float = 0.0
    """Seconds for which the operator had the run paused; they are in no other figure."""
    rejoining_s: float = 0.0
    """Seconds that it took to be on the target again after pauses and limits; nor are they."""
    lost_peak_arcsec: float | None = None
    """Largest error while limits held the mount and on the way back; null where none did."""
    realtime_priority: bool | None = None
    """Whether the loop ran with real-time priority; null in virtual time."""
    calibrated: bool | None = None
    """Whether the mount's profile was measured; null for an antenna, which has no profile."""
    learnt: LearntView | None = None
    """What was learnt of the mount; null where it was never followed with."""
    why_not_acquired: str | None = None
    """Why the mount was never on target, and what to do; null where it was, or where nobody can tell."""
    elements_age_days: float | None = None
    """How old the elements were when the run began; negative where they are of a later epoch."""
    camera: CameraSummary | None = None
    """Null where no camera was started with the run."""
    source: str | None = None
    """What gave the target's place: elements, a file or a body."""
    source_file: str | None = None
    """The name of its file or download, without folders; null where it has none, or that is not known."""
    source_age_s: float | None = None
    """How old that was when the pass was highest; negative where it is of a later epoch, null for a body."""
    expected_error_m: float | None = None
    """By how much it missed the target then, typically; null where it states no error."""


class SummaryLine(msgspec.Struct, frozen=True):
    """The last object of a run's JSON."""

    summary: Summary


class AskedView(msgspec.Struct, frozen=True):
    """One thing that was asked of the mount, and how far it has come."""

    number: int
    what: str
    state: str
    acknowledged: bool
    settled: bool
    reason: str | None
    utc_s: float
    """When it was asked."""


class ConsoleView(msgspec.Struct, frozen=True, tag="console"):
    """A mount under manual operation at one instant; UTC as POSIX seconds, directions in degrees of date."""

    utc_s: float
    mount: str
    profile: str
    move_axis: str
    """How the profile has MoveAxis rates read: "held" or "edge"."""
    doing: str
    """What is under way, in words; "idle" where nothing of ours is."""
    motion: str
    """The motion that is wanted: "none", "slew", "move" or "stop"."""
    at_rest: bool
    """Whether the mount stands, sidereal tracking counted as standing."""
    status: Status | None
    """The last one, every field by the name and in the unit of the protocol's table."""
    readings: Readings
    hour_angle_deg: float | None
    clock_offset_s: float | None
    """The mount's sidereal clock ahead of local mean sidereal time by our UTC; null without a site."""
    ra_rate_deg_s: float
    dec_rate_deg_s: float
    """What MoveAxis is asked for: rates of the reported direction, right ascension not times cos Dec."""
    max_ra_rate_deg_s: float
    max_dec_rate_deg_s: float
    guide_rate_deg_s: float | None
    floor_altitude_deg: float
    can_park: bool
    link: LinkView
    stranger_hosts: tuple[str, ...]
    asked: tuple[AskedView, ...]
    """The last ones, the newest last."""
    refusal: str | None
    """Why the last thing that the operator wanted was not done."""
    tripped: str | None
    """The safety limit that stopped the mount."""
    warnings: tuple[str, ...]
    looks_at_deg: tuple[float, float] | None = None
    """Right ascension and declination of date in which the telescope looks, by geometry and pointing model;
    null where the profile has neither."""


STARTER = 0
"""The number of the starter, who speaks to the run directly."""


class Watcher(msgspec.Struct, frozen=True):
    """Somebody who watches: a number of this run's own, and a description."""

    number: int
    name: str


class Armed(msgspec.Struct, frozen=True):
    """A pass that will be followed after this one: whose, and when it culminates (UTC, POSIX seconds)."""

    catalog_number: int
    culminate_utc_s: float
    name: str


class SessionView(msgspec.Struct, frozen=True, tag="session"):
    """The people before a run. Whoever has control moves the target; a stop is obeyed from anybody."""

    controller: int | None
    """The number of the one in control; None if nobody is."""
    watchers: tuple[Watcher, ...]
    """Those who look on, the first ones; the starter is none of them."""
    watching: int
    """How many look on in all."""
    left_running: bool = False
    """Whether the starter of the run has left, and let it continue."""
    said: str | None = None
    """The last that happened among them, in words."""
    queue: tuple[Armed, ...] = ()
    """What will be followed next, in this order."""
    takes_others: bool = False
    """Whether other satellites can be followed after this one."""

    def name_of(self, number: int | None) -> str:
        """Return who that is, in words."""
        if number is None:
            return "nobody"
        if number == STARTER:
            return "where it was started"
        return next((one.name for one in self.watchers if one.number == number), f"watcher {number}")


class Welcome(msgspec.Struct, frozen=True, tag="welcome"):
    """The first message to a new watcher: their own number, and whose run it is."""

    you: int
    pid: int
    command: str
    since_utc: str
    mount: str
    name: str
    """The satellite's."""


class Farewell(msgspec.Struct, frozen=True, tag="farewell"):
    """Why a watcher is sent away."""

    why: str


SHOWN_EXCHANGES = 10
SHOWN_REFUSALS = 4
LONGEST_SHOWN = 100
"""Characters of one line: a view has to go through a pipe in one piece."""


class ExchangeView(msgspec.Struct, frozen=True, array_like=True):
    """One line from antcn and its answer, as much of them as is shown; UTC as POSIX seconds."""

    utc_s: float
    received: str
    answered: str


class RefusalView(msgspec.Struct, frozen=True, array_like=True):
    """One line from antcn that was refused, and why, in words; UTC as POSIX seconds."""

    utc_s: float
    received: str
    why: str


class FocusView(msgspec.Struct, frozen=True, array_like=True):
    """Where the focuser's axes are, mm, None where that is not known, and whether any of them moves."""

    axes_mm: tuple[float | None, ...]
    moving: bool


class AxesView(msgspec.Struct, frozen=True, array_like=True):
    """Positions of both axes, degrees, the first with its turns."""

    first_deg: float
    second_deg: float


class AntennaView(msgspec.Struct, frozen=True):
    """One state; `commanded` and `actual` are None without a trajectory, or where the mount is not heard."""

    utc_s: float
    door: str
    caller: bool
    """Whether antcn is connected; always so on a serial line."""
    axes: str
    mount: str
    link_up: bool
    remote: bool
    doing: str
    servo: str
    outside_limits: bool
    tripped: str | None
    commanded: AxesView | None
    actual: AxesView | None
    refused: int
    exchanges: tuple[ExchangeView, ...] = ()
    """The last ones, the newest first."""
    refusals: tuple[RefusalView, ...] = ()
    """The last ones, the newest first."""
    focus: FocusView | None = None
