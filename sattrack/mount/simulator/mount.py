"""The simulated mount's logic: mailbox, flags, two axes, its own clock; a status at each turn of its loop.

Source: "Xerxes Mount Control Protocol", Theory of Operation. A loop of about 50 ms reads the latest command
in the mailbox, services one flag of it (see `FlagWatch`) and packs a snapshot of everything.
Where the paper is silent:

* MoveAxis *held*: the latest rates act while the flag is up; its fall gives the axis back to the sky.
  *Edge*: each axis' rate is read as its flag rises and stays in force after its fall, until a new edge or an
  abort; an edge with rate 0 gives the axis back to sidereal tracking. An unchanged rate keeps its axis going
  the same way where it passes a pole; signs are those of the side on which a rate first came.
* Slewing is reported during a slew and while any axis is in MoveAxis. A slew, sync, home or pulse that comes
  then, or in the loop in which that ends, is ignored.
* Fine rates add to sidereal tracking, and so to MoveAxis where that is additive.
* A pulse adds 3500 (tics/s x 10) to its axis for its duration, exactly; negative is east and south, in the
  sky. Both axes' timers start anew with a new pulse, and end with a slew, an abort, a park or a home.
* A sync shifts the reported coordinates; axes, altitude, azimuth and cable wrap stay with the encoders.
* A slew that ends past either axis' travel is ignored. At the end of its travel and a margin an axis brakes
  to rest in any case, and moves away again when commanded to.
* An abort ends everything and leaves the axes at rest, drives on, until a slew, home or MoveAxis.
* Park cuts the drives' power: the axes coast until friction stops them, and obey nothing until a restart.
* Home is a slew to the profile's home position, which is the encoders' and needs no sidereal time; the axes
  rest there. Without one in the profile, it does nothing.
* After `watchdog_s` without a command the mailbox counts as empty, and both axes come to rest.
* A drive fault cuts the power of its axis alone. After a restart the mount tracks the sky, its counter begins
  anew, syncs are forgotten, and encoders read within half a turn of their zero: cable wrap by them may
  be a turn off.
* With a geometry that reports the sky, an axis at rest stands, and what is reported, rates too, is the sky
  direction to which both axes point. With one that reports the axes' angles, nothing differs but the profile.
* Refraction, where the mount does it: axes point to where the air bends the light to, reported coordinates
  are those without air. MoveAxis rates are the axes'.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from sattrack.mount.model import SIDEREAL_RATE_DEG_S, MountProfile
from sattrack.mount.simulator.axis import Axis
from sattrack.mount.simulator.drives import DTICS_S_PER_DEG_S, GUIDE_RATE_DTICS_S, DrivenAxis, Encoder, Mode
from sattrack.mount.simulator.profile import SimulatorProfile
from sattrack.mount.simulator.sky import SimulatedSky, direction, horizontal, is_beyond_pole

if TYPE_CHECKING:
    from sattrack.mount.geometry import AxisFrame

COMMAND_HEADER = 0x5555AAAA
STATUS_HEADER = b"XERXESxx"
_COMMAND = struct.Struct("<Qq4d2q2iB9?")
_STATUS = struct.Struct("<8s3d8sd8s6d8s8s8s2i24s")
DOUBTFUL_TYPES = {
    "dec_rate_dtics_s": "int64",
    "ra_rate_dtics_s": "int64",
    "counter": "int64",
    "dec_guide_rate_dtics_s": "double",
    "ra_guide_rate_dtics_s": "double",
}
"""The types of fields that the paper leaves open, as Appendix A packs them."""
AT_PLACE_DEG = 0.001
BUSY = (Mode.GOING, Mode.MOVING)
_numbers = attrgetter("move_ra_rate_deg_s", "move_dec_rate_deg_s", "target_ra_h", "target_dec_deg")


class MailboxCommand(NamedTuple):
    """A command as the mount reads it, in the order of the paper's table; all zero asks for nothing."""

    counter: int = 0
    target_dec_deg: float = 0.0
    target_ra_h: float = 0.0
    move_dec_rate_deg_s: float = 0.0
    move_ra_rate_deg_s: float = 0.0
    dec_fine_rate_dtics_s: int = 0
    ra_fine_rate_dtics_s: int = 0
    pulse_ra_ms: int = 0
    pulse_dec_ms: int = 0
    tracking_rate: int = 0
    abort: bool = False
    find_home: bool = False
    move_ra: bool = False
    move_dec: bool = False
    park: bool = False
    pulse_guide: bool = False
    slew: bool = False
    sync: bool = False
    spare: bool = False

    @classmethod
    def read(cls, data: bytes) -> MailboxCommand | None:
        """Return the command of a datagram; None for one of another length or header."""
        if len(data) != _COMMAND.size:
            return None
        header, *values = _COMMAND.unpack(data)
        return cls(*values) if header == COMMAND_HEADER else None


class SimulatedSite(msgspec.Struct, frozen=True):
    """Where the simulated mount believes it stands, degrees and metres."""

    latitude_deg: float
    longitude_deg: float
    height_m: float = 0.0


class StartPosition(msgspec.Struct, frozen=True):
    """Where the axes are at power-up, degrees: of the axes, cables counted, so 190 is not -170."""

    hour_angle_deg: float = -30.0
    dec_deg: float = 20.0


class Truth(msgspec.Struct, frozen=True, gc=False, array_like=True):
    """Where the axes really were when a status was packed, in the frame that the mount reports.

    The axes' own angles have their cables' turns counted; `at_limit` tells that a hard limit holds an axis.
    """

    counter: int
    utc_s: float
    ra_deg: float
    dec_deg: float
    ra_rate_deg_s: float
    dec_rate_deg_s: float
    hour_angle_axis_deg: float
    dec_axis_deg: float
    beyond_pole: bool
    at_limit: bool


FLAGS = ("abort", "park", "slew", "sync", "find_home", "move_ra", "move_dec", "pulse_guide")
_levels = attrgetter(*FLAGS)
_GROUPS = {"move_ra": "move", "move_dec": "move"}


@dataclass(slots=True)
class FlagWatch:
    """What the mount remembers of the flags: which are up and dealt with, and which are acknowledged.

    "Xerxes Mount Control Protocol", Details: "All active commands are examined and the highest priority
    command is serviced and acknowledged"; the mount "only acts on the rising edge", and removes the
    acknowledgement when it sees the command removed. Where the paper is silent:

    * The order is abort, park, slew, sync, find home, MoveAxis (both flags as one), pulse guide.
    * A flag whose turn does not come, because a higher one is up, has not been seen: if it is still up when
      the higher one has fallen, that is its rising edge.
    * An acknowledgement says that the edge was received and serviced ("it knows that the command has been
      received"); where a slew, sync or pulse is ignored, because the mount is slewing, that is all it says.
    * MoveAxis flags that rise during a slew are not serviced before its end.
    """

    seen: set[str] = field(default_factory=set)
    acknowledged: set[str] = field(default_factory=set)

    def release(self, command: MailboxCommand) -> set[str]:
        """Forget the flags that are down, with their acknowledgements; return those that have just fallen."""
        if not self.seen:
            return set()
        fallen = {name for name in self.seen if not getattr(command, name)}
        self.seen -= fallen
        self.acknowledged -= fallen
        return fallen

    def rises(self, command: MailboxCommand, name: str) -> bool:
        """Tell whether a flag that is serviced has risen; from then on it is seen."""
        if not getattr(command, name) or name in self.seen:
            return False
        self.seen.add(name)
        return True

    def acknowledge(self, name: str) -> None:
        """Set the acknowledgement of a flag that was serviced."""
        self.acknowledged.add(name)


def highest(command: MailboxCommand) -> str | None:
    """Return the name of what this turn of the loop services, "move" for either axis; None without a flag."""
    levels = _levels(command)
    if True not in levels:
        return None
    name = FLAGS[levels.index(True)]
    return _GROUPS.get(name, name)


@dataclass(slots=True)
class SimulatedMount:
    """A mount with two axes; `receive` fills its mailbox, `tick` runs its loop once.

    Time is an argument, UTC as POSIX seconds; the same calls give the same bytes.
    """

    profile: MountProfile
    site: SimulatedSite
    start: StartPosition = field(default_factory=StartPosition)
    hardware: SimulatorProfile = field(default_factory=SimulatorProfile)
    counter: int = 0
    refused: int = 0
    """Command datagrams that were no such thing."""
    _ra: DrivenAxis = field(init=False)
    _dec: DrivenAxis = field(init=False)
    _sky: SimulatedSky = field(init=False)
    _frame: AxisFrame | None = field(init=False)
    _types: dict[str, str] = field(init=False)
    _flags: FlagWatch = field(default_factory=FlagWatch)
    _mailbox: MailboxCommand = field(default_factory=MailboxCommand)
    _heard: bool = False
    _heard_s: float | None = None
    _now_s: float | None = None
    _target: tuple[float, float] = (0.0, 0.0)
    _parked: bool = False
    _going_home: bool = False

    def __post_init__(self) -> None:
        """Power up: the axes at their start position, tracking the sky."""
        profile, hardware = self.profile, self.hardware
        self._types = DOUBTFUL_TYPES | profile.readings
        offset_s = hardware.clock_offset_s
        offset_s = (profile.clock_offset_s or 0.0) if offset_s is None else offset_s
        self._sky = SimulatedSky(self.site.latitude_deg, self.site.longitude_deg, hardware, offset_s)
        frame = self.profile.frame
        self._frame = frame if frame is not None and frame.geometry.reports != "axes" else None
        sky_rate_deg_s = 0.0 if self._frame is not None else SIDEREAL_RATE_DEG_S
        self._ra, self._dec = (
            DrivenAxis(
                Axis(
                    limits,
                    hardware,
                    (low_deg - hardware.hard_margin_deg, high_deg + hardware.hard_margin_deg),
                ),
                Encoder(
                    profile.encoder_tics, zero_deg, hardware.encoder_noise_tics, f"{name} {hardware.seed}"
                ),
                rest_deg_s,
                profile.additive,
                limits.slew_rate_deg_s,
            )
            for name, limits, (low_deg, high_deg), zero_deg, rest_deg_s in (
                ("ra", profile.ra, self._ha_travel_deg, hardware.ra_encoder_zero_deg, sky_rate_deg_s),
                ("dec", profile.dec, profile.dec_axis_limits_deg, hardware.dec_encoder_zero_deg, 0.0),
            )
        )
        self._ra.power_up(self.start.hour_angle_deg)
        self._dec.power_up(self.start.dec_deg)

    @property
    def _ha_travel_deg(self) -> tuple[float, float]:
        return -self.profile.hour_angle_limit_deg, self.profile.hour_angle_limit_deg

    @property
    def slewing(self) -> bool:
        """Whether a slew, a home or MoveAxis goes on."""
        return self._ra.mode in BUSY or self._dec.mode in BUSY

    def receive(self, data: bytes) -> bool:
        """Put a command datagram into the mailbox, in place of the one there. False where it is refused."""
        command = MailboxCommand.read(data)
        if command is None:
            self.refused += 1
            return False
        aimed = not (command.slew or command.sync)
        aimed = aimed or _is_direction(command.target_ra_h, command.target_dec_deg)
        if not aimed or not all(map(math.isfinite, _numbers(command))):
            if not command.abort:
                self.refused += 1
                return False
            # Whatever else it says, a stop is a stop.
            command = MailboxCommand(command.counter, abort=True)
        self._mailbox = command
        self._heard = True
        return True

    def tick(self, now_utc_s: float) -> tuple[bytes, Truth]:
        """Run the loop once at an instant: let the axes move up to it, obey the mailbox, pack a status."""
        self.tick_silently(now_utc_s)
        return self._pack(), self._truth(now_utc_s)

    def tick_silently(self, now_utc_s: float) -> None:
        """Run the loop once as `tick` does, where nobody is to hear the status."""
        self._advance(now_utc_s)
        self.counter += 1
        self._watch_silence(now_utc_s)
        self._obey(self._mailbox, now_utc_s)

    def crash(self, now_utc_s: float) -> None:
        """Let the mount's program end, to be restarted; the drives do as `hardware` says."""
        self._advance(now_utc_s)
        if self.hardware.crashed_drives == "stop":
            self._rest()
            self._ra.obey()
            self._dec.obey()

    def restart(self, now_utc_s: float) -> None:
        """Start the program and the drives anew, wherever the axes are."""
        self._advance(now_utc_s)
        self.counter = 0
        self._flags = FlagWatch()
        self._mailbox = MailboxCommand()
        self._heard, self._heard_s = False, None
        self._target = (0.0, 0.0)
        self._parked = self._going_home = False
        self._sky.forget_sync()
        for driven in (self._ra, self._dec):
            driven.restart()

    def fail_drives(self, names: tuple[str, ...], now_utc_s: float) -> None:
        """Let drives, "ra" or "dec", lose their power until a restart."""
        self._advance(now_utc_s)
        for name in names:
            (self._ra if name == "ra" else self._dec).power_off()

    def step_clock(self, seconds: float) -> None:
        """Set the mount's clock ahead, or back, by so much."""
        self._sky.offset_s += seconds

    def _advance(self, now_utc_s: float) -> None:
        if self._now_s is not None and now_utc_s > self._now_s:
            self._ra.advance(self._now_s, now_utc_s)
            self._dec.advance(self._now_s, now_utc_s)
        self._now_s = now_utc_s
        self._sky.set_clock(now_utc_s)

    def _watch_silence(self, now_utc_s: float) -> None:
        if self._heard:
            self._heard, self._heard_s = False, now_utc_s
        watchdog_s = self.profile.watchdog_s
        if watchdog_s is None or self._heard_s is None or now_utc_s - self._heard_s < watchdog_s:
            return
        self._heard_s = None
        self._mailbox = MailboxCommand()
        self._rest()

    def _obey(self, command: MailboxCommand, now_utc_s: float) -> None:
        slewing = self.slewing
        for name in self._flags.release(command):
            if self.profile.move_axis == "held" and name in ("move_ra", "move_dec"):
                self._give_back(self._ra if name == "move_ra" else self._dec)
        if not self._parked:
            self._ra.fine_deg_s = command.ra_fine_rate_dtics_s / DTICS_S_PER_DEG_S
            self._dec.fine_deg_s = command.dec_fine_rate_dtics_s / DTICS_S_PER_DEG_S
        what = highest(command)
        if what == "move":
            self._move(command)
        elif what is not None and self._flags.rises(command, what):
            self._flags.acknowledge(what)
            self._launch(what, command, now_utc_s, slewing)
        self._ra.obey()
        self._dec.obey()
        self._arrive()

    def _launch(self, what: str, command: MailboxCommand, now_utc_s: float, slewing: bool) -> None:
        """Act on a rising edge, or ignore it."""
        match what:
            case "abort":
                self._rest()
            case "park":
                self._park()
            case "sync" if not slewing:
                self._sync(command)
            case _ if slewing or self._parked:
                return
            case "slew":
                self._start_slew(command)
            case "find_home":
                self._go_home()
            case "pulse_guide":
                side = -1 if is_beyond_pole(self._dec.axis.position_deg) else 1
                self._ra.pulse(command.pulse_ra_ms, 1, now_utc_s)
                self._dec.pulse(command.pulse_dec_ms, side, now_utc_s)

    def _rest(self) -> None:
        """Brake both axes to rest; axes without power stay without."""
        for driven in (self._ra, self._dec):
            driven.end_pulse()
            if driven.mode is not Mode.OFF:
                driven.mode = Mode.RESTING

    def _park(self) -> None:
        self._parked = True
        for driven in (self._ra, self._dec):
            driven.power_off()

    def _start_slew(self, command: MailboxCommand) -> None:
        hour_angle_deg, dec_deg = self._sky.axes(command.target_ra_h * 15.0, command.target_dec_deg)
        axes = ((hour_angle_deg, self._ha_travel_deg), (dec_deg, self.profile.dec_axis_limits_deg))
        if not all(low <= axis_deg <= high for axis_deg, (low, high) in axes):
            return
        self._target = (command.target_ra_h, command.target_dec_deg)
        self._ra.go(hour_angle_deg, SIDEREAL_RATE_DEG_S)
        self._dec.go(dec_deg, 0.0)
        self._going_home = False

    def _go_home(self) -> None:
        home = self.profile.home
        if home is None:
            return
        self._ra.go(home.hour_angle_deg, 0.0)
        self._dec.go(home.dec_deg, 0.0)
        self._going_home = True

    def _sync(self, command: MailboxCommand) -> None:
        self._target = (command.target_ra_h, command.target_dec_deg)
        self._sky.sync(
            command.target_ra_h * 15.0, command.target_dec_deg, self._ra.known_deg(), self._dec.known_deg()
        )

    def _move(self, command: MailboxCommand) -> None:
        if self._parked or Mode.GOING in (self._ra.mode, self._dec.mode):
            return
        beyond = is_beyond_pole(self._dec.axis.position_deg)
        ra_sign, dec_sign = self.profile.signs(beyond)
        # Signs are those of the direction; past a pole, the declination axis turns the other way for it.
        dec_sense = -dec_sign if beyond else dec_sign
        for name, driven, sense, gain, rate_deg_s in (
            ("move_ra", self._ra, ra_sign, self.profile.ra_rate_gain, command.move_ra_rate_deg_s),
            ("move_dec", self._dec, dec_sense, self.profile.dec_rate_gain, command.move_dec_rate_deg_s),
        ):
            risen = self._flags.rises(command, name)
            if driven.mode is Mode.RESTING and (risen or not getattr(command, name)):
                # MoveAxis on either axis puts both under way.
                driven.mode = Mode.TRACKING
            if risen:
                self._flags.acknowledge(name)
            self._set_rate(driven, rate_deg_s, sense * gain, name in self._flags.acknowledged, risen)

    def _set_rate(self, driven: DrivenAxis, rate_deg_s: float, gain: float, up: bool, risen: bool) -> None:
        if driven.mode is Mode.OFF:
            return
        if self.profile.move_axis == "held":
            if risen or (up and driven.mode is Mode.MOVING):
                driven.move(rate_deg_s, rate_deg_s * gain)
        elif risen and rate_deg_s:
            driven.move(rate_deg_s, rate_deg_s * gain)
        elif risen:
            driven.mode = Mode.TRACKING

    def _give_back(self, driven: DrivenAxis) -> None:
        if driven.mode is Mode.MOVING:
            driven.mode = Mode.TRACKING

    def _arrive(self) -> None:
        going = [driven for driven in (self._ra, self._dec) if driven.mode is Mode.GOING]
        if going and not any(driven.axis.going for driven in going):
            for driven in going:
                driven.mode = Mode.RESTING if self._going_home else Mode.TRACKING

    def _truth(self, now_utc_s: float) -> Truth:
        ra, dec = self._ra.axis, self._dec.axis
        ra_axis_deg, dec_axis_deg, dec_rate_deg_s = ra.position_deg, dec.position_deg, dec.velocity_deg_s
        beyond = is_beyond_pole(dec_axis_deg)
        ra_deg, dec_deg = self._sky.reported(ra_axis_deg + ra.swing_deg, dec_axis_deg + dec.swing_deg)
        return Truth(
            counter=self.counter,
            utc_s=now_utc_s,
            ra_deg=ra_deg,
            dec_deg=dec_deg,
            ra_rate_deg_s=SIDEREAL_RATE_DEG_S - ra.velocity_deg_s,
            dec_rate_deg_s=-dec_rate_deg_s if beyond else dec_rate_deg_s,
            hour_angle_axis_deg=ra_axis_deg + ra.swing_deg + self._ra.turns_deg,
            dec_axis_deg=dec_axis_deg + dec.swing_deg + self._dec.turns_deg,
            beyond_pole=beyond,
            at_limit=ra.reference.limited or dec.reference.limited,
        )

    def _at_home(self, ra_axis_deg: float, dec_axis_deg: float) -> bool:
        home = self.profile.home
        if home is None or self._ra.turns or self._dec.turns:
            return False
        off_deg = (ra_axis_deg - home.hour_angle_deg, dec_axis_deg - home.dec_deg)
        return all(abs(math.remainder(off, 360.0)) < AT_PLACE_DEG for off in off_deg)

    def _pack(self) -> bytes:
        ra_axis_deg, dec_axis_deg = self._ra.known_deg(), self._dec.known_deg()
        hour_angle_deg, dec_deg = direction(ra_axis_deg, dec_axis_deg)
        altitude_deg, azimuth_deg = horizontal(hour_angle_deg, dec_deg, self.site.latitude_deg)
        ra_deg, dec_deg = self._sky.reported(ra_axis_deg, dec_axis_deg)
        ra_rate, dec_rate = self._ra.axis.velocity_deg_s, self._dec.axis.velocity_deg_s
        if self._frame is not None:
            own = self._frame.geometry
            hour_angle_deg, dec_deg, ra_rate, dec_rate = self._frame.sky(
                ra_axis_deg + own.first_zero_deg, dec_axis_deg + own.second_zero_deg, ra_rate, dec_rate
            )
            ra_deg = (self._sky.sidereal_deg - hour_angle_deg) % 360.0
            altitude_deg, azimuth_deg = horizontal(hour_angle_deg, dec_deg, self.site.latitude_deg)
        acks, slewing = self._flags.acknowledged, self.slewing
        tells_places = self.hardware.reports_home_and_park
        flags = (
            tells_places and self._at_home(ra_axis_deg, dec_axis_deg),
            tells_places and self._parked and not (self._ra.turns or self._dec.turns),
            True,  # connected
            self.hardware.does_refraction,
            False,  # equatorial system JNow
            self._ra.pulsing or self._dec.pulsing,
            is_beyond_pole(dec_axis_deg),
            slewing,
            not slewing,
            False,  # tracking rate sidereal
            *(name in acks for name in ("move_dec", "move_ra")),
            *(False,) * 7,  # for the future
            *(name in acks for name in ("abort", "sync", "pulse_guide", "slew")),
            False,
        )
        return _STATUS.pack(
            STATUS_HEADER,
            altitude_deg,
            azimuth_deg,
            dec_deg,
            self._eight("dec_rate_dtics_s", round(dec_rate * DTICS_S_PER_DEG_S)),
            ra_deg / 15.0,
            self._eight("ra_rate_dtics_s", round(ra_rate * DTICS_S_PER_DEG_S)),
            self._sky.sidereal_deg / 15.0,
            self.site.height_m,
            self.site.latitude_deg,
            self.site.longitude_deg,
            self._target[1],
            self._target[0],
            self._eight("counter", self.counter),
            self._eight("dec_guide_rate_dtics_s", GUIDE_RATE_DTICS_S),
            self._eight("ra_guide_rate_dtics_s", GUIDE_RATE_DTICS_S),
            round(self._dec.axis.current_a * 100.0),
            round(self._ra.axis.current_a * 100.0),
            bytes(0xFF if flag else 0 for flag in flags),
        )

    def _eight(self, name: str, value: int) -> bytes:
        """Return the bytes of a field whose type the paper leaves open."""
        return struct.pack("<d" if self._types[name] == "double" else "<q", value)


def _is_direction(ra_h: float, dec_deg: float) -> bool:
    """Tell whether a target is one: "verify RA is 0 to 24 and dec is -90 to 90"."""
    return 0.0 <= ra_h <= 24.0 and -90.0 <= dec_deg <= 90.0
