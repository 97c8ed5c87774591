"""The antenna's controller: antcn's messages in, answers and the antenna's path out. No I/O, no clock.

"Ideal Field System Antenna Interface", sections 4.0 to 8.0. The controller sends only responses, one to each
command, and does not wait until a command is carried out. A command is acknowledged, answered with text, or
refused by a Nak. `AntennaStation` joins it with the driver of the mount.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from decimal import Decimal
from enum import StrEnum
from typing import TYPE_CHECKING, Literal

from sattrack.pointing.terms import PointingModel
from sattrack.servers.antenna.equipment import Antenna, Feedback, handle_focus
from sattrack.servers.antenna.led_mount import PathDriver
from sattrack.servers.antenna.protocol import (
    MOST_EPOCH_DISTANCE_S,
    NS,
    OMITTED,
    AntennaRequest,
    Exchange,
    Framer,
    LineFault,
    Nak,
    ReceivedLine,
    RefusedCommand,
    Synchronised,
    acknowledge,
    day_start_ns,
    encode,
    parse,
    resolve_epoch,
    second_of_day,
    to_ns,
    word_of,
)
from sattrack.servers.antenna.trajectory import (
    AxisState,
    ElementsTarget,
    ExactState,
    Path,
    ProfileModel,
    SkyPath,
    SkyTarget,
    SkyTargets,
    StoreError,
    Straight,
)
from tle.bias import Bias
from tle.errors import TleError

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.mount.model import MountProfile
    from sattrack.safety import SafetyLimits
    from sattrack.servers.antenna.trajectory import AxisRange

REMEMBERED_LINES = 50
REMEMBERED_REFUSALS = 20
MOST_TIME_STEP_S = 86400
STOPS = ("STOP", "FOCSTOP")
STREAMS_NS = 10 * NS
"""Designations that come no farther apart than this are one program's that goes on, with no person at it."""


class AntennaAction(StrEnum):
    """The last command for the antenna's motion."""

    IDLE = "IDLE"
    FOLLOWING = "FOLLOWING"
    STOW = "STOW"
    SERVICE = "SERVICE"


class AntennaStation(PathDriver):
    """One mount behind one controller, until `end` is called and the mount is seen at rest."""

    def __init__(self, antenna: Antenna, profile: MountProfile, limits: SafetyLimits) -> None:
        self.antenna = antenna
        self.controller = Controller(antenna, self)
        if profile.pointing is not None and antenna.axes == "hadec":
            targets = self.controller.sky_targets
            model = ProfileModel(PointingModel.of(profile.pointing))
            targets.reduction = replace(targets.reduction, model=model)
        super().__init__(self.controller, antenna.sky, antenna.axes, profile, limits)

    def receive_command(self, data: bytes, now_utc_s: float) -> tuple[bytes, bool]:
        """Take bytes from antcn; return the response, and whether to drop unsent output."""
        answer = self.controller.receive(data, to_ns(now_utc_s + self.clock_ahead_s))
        if self.controller.time_step_ns:
            self._set_clock(self.controller.time_step_ns / 1e9)
            self.controller.time_step_ns = 0
        return answer

    def end(self, now_utc_s: float) -> None:
        """See PathDriver."""
        super().end(now_utc_s)
        self.controller.end()

    def _set_clock(self, step_s: float) -> None:
        """Restart what depends on the clock; the cables' winding is kept."""
        self.clock_ahead_s += step_s
        self.session.clock_set(step_s)
        self._follower = self._make_follower()
        if self.safety.tripped is None:
            before, self.safety = self.safety, self._make_safety(self.profile)
            self.safety.follow_on(before)


@dataclass(slots=True)
class Controller:
    """One antenna's controller; `path` is the trajectory in force, None where there is none."""

    antenna: Antenna
    feedback: Feedback = field(default_factory=Feedback)
    remote: bool = True
    doing: AntennaAction = AntennaAction.IDLE
    path: Path | None = None
    ending: bool = False
    """Whether the service ends: nothing sets the antenna going any more."""
    reset_asked: bool = False
    """Set by RESET; the owner of the interlocks clears it."""
    time_step_ns: int = 0
    """The step by which TIME has set the controller's clock; the owner of the clock clears it."""
    refused: int = 0
    last_refusal: Nak | None = None
    exchanges: deque[Exchange] = field(default_factory=lambda: deque(maxlen=REMEMBERED_LINES))
    refusals: deque[Exchange] = field(default_factory=lambda: deque(maxlen=REMEMBERED_REFUSALS))
    """The refused lines, kept longer."""
    _framer: Framer = field(init=False)
    sky_targets: SkyTargets = field(init=False)
    held: SkyPath | None = None
    """The satellite's path, while SATOFF holds the antenna."""
    _stop_holds: bool = False
    """Whether the operator has stopped the antenna: designations that only go on do not undo that."""
    _designated_ns: int | None = None
    """When the last one came, obeyed or refused."""

    def __post_init__(self) -> None:
        """Begin with no offsets."""
        self._framer = Framer(self.antenna.check)
        self.sky_targets = SkyTargets(self.antenna.sky, self.antenna.axes)

    def receive(self, data: bytes, now_ns: int) -> tuple[bytes, bool]:
        """Take bytes that came at an instant; return the responses, and whether to drop unsent output.

        A position status is latched at `now_ns`, the arrival of the line-feed; what comes after a TIME is
        by the time that this sets.
        """
        answers: list[bytes] = []
        before_ns = now_ns - self.time_step_ns
        synchronised = False
        for event in self._framer.receive(data):
            if isinstance(event, Synchronised):
                answers.clear()
                synchronised = True
            else:
                answers.append(self._answer(event, before_ns + self.time_step_ns))
        return b"".join(answers), synchronised

    def hang_up(self) -> None:
        """Forget an unfinished line: its sender is gone. The trajectory stays in force."""
        self._framer.reset()

    def switch(self, remote: bool, now_ns: int) -> None:
        """Put the controller in remote or in local; local ends the trajectory and stops the focus."""
        self.remote, self._stop_holds = remote, False
        if not remote:
            self.stop(now_ns)

    def stop(self, now_ns: int) -> None:
        """End the trajectory and stop the focus, for the operator at the controller.

        It holds for a program that only goes on to designate, until that has been silent for a while, or the
        operator says remote or reset. STOP, RESET and what it asks for by any other command end it, too.
        """
        self._rest()
        self._stop_holds = True
        if self.antenna.focuser is not None:
            self.antenna.focuser.stop(now_ns)

    def end(self) -> None:
        """End the trajectory, and take no other."""
        self.ending = True
        self._rest()

    def reset(self) -> None:
        """Make ready again an antenna that an interlock has stopped, as RESET does."""
        self._rest()
        self.reset_asked, self._stop_holds = True, False

    def _answer(self, line: ReceivedLine, now_ns: int) -> bytes:
        if line.fault is not None:
            fault = Nak.TRANSMISSION if line.fault is LineFault.TRANSMISSION else Nak.TOO_LONG
            result: str | RefusedCommand = RefusedCommand(word_of(line.message), fault)
        else:
            result = self._handle(line.message, now_ns)
        why = None
        if isinstance(result, RefusedCommand):
            self.refused += 1
            why = self.last_refusal = result.why
            result = result.message
        exchange = Exchange(now_ns, line.message, result, why)
        self.exchanges.append(exchange)
        if why is not None:
            self.refusals.append(exchange)
        return encode(result, self.antenna.check)

    def _handle(self, message: str, now_ns: int) -> str | RefusedCommand:
        request = parse(message)
        if isinstance(request, RefusedCommand):
            return request
        word = request.command.word
        refused = not self.remote or (self.ending and word not in STOPS)
        if request.command.commands_antenna and refused:
            return RefusedCommand(word, Nak.LOCAL)
        handler = _HANDLERS.get(word)
        try:
            answer = Nak.NOT_AVAILABLE if handler is None else handler(self, request, now_ns)
        except TleError:
            # The elements of the satellite, followed or to come, have ended.
            answer = Nak.ELEMENTS_USELESS
        if answer is None:
            return acknowledge(word)
        return RefusedCommand(word, answer) if isinstance(answer, Nak) else answer

    # Each of these handles one command: None acknowledges, a Nak refuses, text answers.

    def _designate(self, request: AntennaRequest, now_ns: int) -> Nak | None:
        before_ns, self._designated_ns = self._designated_ns, now_ns
        if self._stop_holds and before_ns is not None and 0 <= now_ns - before_ns <= STREAMS_NS:
            return Nak.LOCAL
        epoch_ns = self.requested_epoch(request, now_ns)
        if isinstance(epoch_ns, Nak):
            return epoch_ns
        names = ("first", "second", "first_rate", "second_rate")
        straight = Straight(ExactState(*(request.exact(name) for name in names)), epoch_ns)
        # A wrap is that of the position at its epoch; the shortest way is from here to where it is by now.
        shortest = request.text("wrap", "S") == "S"
        first_deg = straight.at(now_ns if shortest else epoch_ns).first_deg
        return self.take_up(straight.turned(self.requested_turns(request, first_deg, now_ns)))

    def requested_epoch(self, request: AntennaRequest, now_ns: int) -> int | Nak:
        """Return the instant that a command names, or the line-feed's."""
        seconds = request.values["epoch"]
        if seconds is None or isinstance(seconds, str):
            return now_ns
        try:
            epoch_ns = resolve_epoch(seconds, now_ns)
        except ValueError:
            return Nak.RANGE
        return epoch_ns if abs(epoch_ns - now_ns) <= MOST_EPOCH_DISTANCE_S * NS else Nak.EPOCH

    def requested_turns(self, request: AntennaRequest, first_deg: float, now_ns: int) -> int:
        """Return the turns that move a position of the first axis into the requested wrap."""
        wrap = request.text("wrap", "S")
        if wrap != "S":
            return self.antenna.range.turns_to(first_deg, int(wrap))
        return self.antenna.range.shortest_turns(first_deg, self._where(now_ns))

    def _where(self, now_ns: int) -> float:
        """Return the position of the first axis, now or as last heard, else that of its trajectory."""
        actual, heard_deg = self.feedback.actual(now_ns), self.feedback.first_deg
        if actual is not None:
            return actual.first_deg
        if heard_deg is not None:
            return heard_deg
        return 0.0 if self.path is None else self.path.at(now_ns).first_deg

    def take_up(self, path: Path, doing: AntennaAction = AntennaAction.FOLLOWING) -> Nak | None:
        """Put a trajectory in force, unless the antenna is stowed."""
        if self.doing is AntennaAction.STOW and doing is not AntennaAction.STOW:
            return Nak.STATE
        self.path, self.doing, self.held, self._stop_holds = path, doing, None, False
        return None

    def _rest(self) -> None:
        self.path = self.held = None
        if self.doing is not AntennaAction.STOW:
            self.doing = AntennaAction.IDLE

    def _stop(self, request: AntennaRequest, now_ns: int) -> None:
        del request, now_ns
        self._stop_holds = False
        self._rest()

    def _reset(self, request: AntennaRequest, now_ns: int) -> None:
        del request, now_ns
        self.reset()

    def commanded(self, utc_ns: int) -> AxisState | None:
        """Return where the trajectory is at an instant; None without one. A satellite that ends ends it."""
        if self.path is None:
            return None
        try:
            return self.path.at(utc_ns)
        except TleError:
            self._rest()
            return None

    @property
    def servo(self) -> Literal["IDLE", "SLEWING", "TRACKING"]:
        """The servo's state, as in a position status."""
        if self.path is None or self.feedback.tripped is not None:
            return "IDLE"
        return "TRACKING" if self.feedback.on_trajectory else "SLEWING"

    def _position(self, request: AntennaRequest, now_ns: int) -> str:
        del request
        commanded: AxisState | ExactState | None = self.commanded(now_ns)
        if isinstance(self.path, Straight):
            commanded = self.path.exact(now_ns)
        status = PositionStatus(
            commanded, self.feedback.actual(now_ns), second_of_day(now_ns), self.remote, self.servo
        )
        return position_message(status, self.antenna.range)

    def _status(self, request: AntennaRequest, now_ns: int) -> str:
        del request, now_ns
        feedback = self.feedback
        return " ".join(
            (
                "STATUS",
                "REMOTE" if self.remote else "LOCAL",
                self.doing.value,
                "LINK-UP" if feedback.link_up else "LINK-DOWN",
                "OK" if feedback.tripped is None else feedback.tripped,
                "1" if feedback.outside_limits else "0",
                str(0 if self.last_refusal is None else self.last_refusal.value),
            )
        )

    def _sensors(self, request: AntennaRequest, now_ns: int) -> str | Nak:
        sensors = self.feedback.sensors
        if sensors is None:
            return Nak.NOT_AVAILABLE
        values = (OMITTED if value is None else f"{value:.4f}" for value in sensors)
        return " ".join((request.command.word, *values, f"{second_of_day(now_ns):.6f}"))

    def _time(self, request: AntennaRequest, now_ns: int) -> str | Nak | None:
        given = [value is not None for value in request.values.values()]
        if any(given):
            return self._set_time(request, now_ns) if all(given) else Nak.FIELDS
        days = day_start_ns(now_ns) // (86400 * NS)
        return f"TIME {days} {second_of_day(now_ns):.6f}"

    def _set_time(self, request: AntennaRequest, now_ns: int) -> Nak | None:
        if not self.remote or self.ending:
            return Nak.LOCAL
        if self.path is not None:
            return Nak.STATE
        day, seconds = request.values["day"], request.values["seconds"]
        assert isinstance(day, Decimal)
        assert isinstance(seconds, Decimal)
        step_ns = int(((day * 86400 + seconds) * NS).to_integral_value()) - now_ns
        if abs(step_ns) > MOST_TIME_STEP_S * NS:
            return Nak.RANGE
        self.time_step_ns += step_ns
        return None

    def _stow(self, request: AntennaRequest, now_ns: int) -> Nak | None:
        del request
        return self._stand(self.antenna.stow, AntennaAction.STOW, now_ns)

    def _service(self, request: AntennaRequest, now_ns: int) -> Nak | None:
        del request
        return self._stand(self.antenna.service, AntennaAction.SERVICE, now_ns)

    def _stand(self, place: tuple[float, float] | None, doing: AntennaAction, now_ns: int) -> Nak | None:
        if place is None:
            return Nak.NOT_AVAILABLE
        return self.take_up(Straight.standing(*place, now_ns), doing)

    def _unstow(self, request: AntennaRequest, now_ns: int) -> Nak | None:
        del request, now_ns
        if self.antenna.stow is None:
            return Nak.NOT_AVAILABLE
        if self.doing is AntennaAction.STOW:
            self.doing = AntennaAction.IDLE
            self._rest()
        return None

    def _fixed(self, request: AntennaRequest, now_ns: int) -> Nak | None:
        zero = Decimal(0)
        there = Straight(ExactState(request.exact("first"), request.exact("second"), zero, zero), now_ns)
        return self.take_up(there.turned(self.requested_turns(request, request.number("first"), now_ns)))

    def _focus(self, request: AntennaRequest, now_ns: int) -> str | Nak | None:
        return handle_focus(self.antenna.focuser, request, now_ns)


@dataclass(frozen=True, slots=True)
class PositionStatus:
    """The contents of a position status; None where there is no trajectory, or the axes are not heard."""

    commanded: AxisState | ExactState | None
    actual: AxisState | None
    epoch_s: Decimal
    """Seconds of the UTC day."""
    remote: bool
    servo: Literal["IDLE", "SLEWING", "TRACKING"]


def position_message(position: PositionStatus, axes: AxisRange) -> str:
    """Return the response to PS: positions to 1e-8°, rates to 1e-10 °/s, the epoch to 1 µs."""
    commanded, commanded_wrap = _state_fields(position.commanded, axes)
    actual, actual_wrap = _state_fields(position.actual, axes)
    return " ".join(
        (
            "PS",
            *commanded[:2],
            *actual[:2],
            *commanded[2:],
            *actual[2:],
            commanded_wrap,
            actual_wrap,
            f"{position.epoch_s:.6f}",
            "REMOTE" if position.remote else "LOCAL",
            position.servo,
        )
    )


def _state_fields(state: AxisState | ExactState | None, axes: AxisRange) -> tuple[list[str], str]:
    if state is None:
        return [OMITTED] * 4, OMITTED
    _, wrap = axes.wrap_of(float(state.first_deg))
    return [
        f"{state.first_deg - 360 * wrap:.8f}",
        f"{state.second_deg:.8f}",
        f"{state.first_rate_deg_s:.10f}",
        f"{state.second_rate_deg_s:.10f}",
    ], str(wrap)


def follow_source(controller: Controller, request: AntennaRequest, now_ns: int) -> Nak | None:
    """Follow a source by its coordinates."""
    return _follow(controller, controller.sky_targets.source(request), request, now_ns)


def _follow(controller: Controller, target: SkyTarget, request: AntennaRequest, now_ns: int) -> Nak | None:
    path = controller.sky_targets.path(target)
    path.turn_by(controller.requested_turns(request, path.at(now_ns).first_deg, now_ns))
    return controller.take_up(path)


def stand_on_sky(controller: Controller, request: AntennaRequest, now_ns: int) -> Nak | None:
    """Stand where a source is at an instant."""
    epoch_ns = controller.requested_epoch(request, now_ns)
    if isinstance(epoch_ns, Nak):
        return epoch_ns
    sky_targets = controller.sky_targets
    there = sky_targets.path(sky_targets.source(request)).at(epoch_ns)
    stands = Straight.standing(there.first_deg, there.second_deg, epoch_ns)
    return controller.take_up(stands.turned(controller.requested_turns(request, there.first_deg, now_ns)))


def offset(controller: Controller, request: AntennaRequest, now_ns: int) -> None:
    """Set the offsets of one kind, also for the target that is followed."""
    del now_ns
    controller.sky_targets.offset(request)
    _reduce(controller)


def pointing(controller: Controller, request: AntennaRequest, now_ns: int) -> Nak | None:
    """Set the pointing model, also for the target that is followed."""
    del now_ns
    if controller.antenna.axes != "hadec":
        return Nak.NOT_AVAILABLE
    controller.sky_targets.model(request)
    _reduce(controller)
    return None


def _reduce(controller: Controller) -> None:
    """Apply new offsets and models to the target that is followed."""
    reduction = controller.sky_targets.reduction
    if isinstance(controller.path, SkyPath):
        controller.path = controller.path.reduced_by(reduction)
    if controller.held is not None:
        controller.held = controller.held.reduced_by(reduction)


def sky_position(controller: Controller, request: AntennaRequest, now_ns: int) -> str:
    """Return where on the sky the axes point, by the inverse pointing model."""
    actual = controller.feedback.actual(now_ns)
    places = [OMITTED] * 4
    if actual is not None:
        seen = controller.sky_targets.pointed_at(actual, now_ns / NS)
        places = [f"{place_deg:.8f}" for place_deg in seen]
    return " ".join((request.command.word, *places, f"{second_of_day(now_ns):.6f}"))


def take_elements(controller: Controller, request: AntennaRequest, now_ns: int) -> Nak | None:
    """Take a line or a value of a satellite's elements."""
    del now_ns
    store, number = controller.sky_targets.elements, int(request.number("number"))
    try:
        if request.command.word == "TLE":
            store.take_line(int(request.text("line")), number, request.text("text"))
        else:
            store.take_value(number, request.text("keyword"), request.text("value"))
    except StoreError as error:
        return error.why
    return None


def follow_satellite(controller: Controller, request: AntennaRequest, now_ns: int) -> Nak | None:
    """Follow the satellite whose elements were sent, or stand where it is while SATOFF holds."""
    mode = controller.antenna.refraction
    refracted = mode == "on" or (mode == "auto" and not controller.feedback.does_refraction)
    sky_targets = controller.sky_targets
    try:
        satellite = sky_targets.satellite(int(request.number("number")), refracted)
    except StoreError as error:
        return error.why
    refusal = _follow(controller, satellite, request, now_ns)
    if refusal is None and sky_targets.hold and isinstance(controller.path, SkyPath):
        _hold(controller, controller.path, now_ns)
    return refusal


def bias_satellite(controller: Controller, request: AntennaRequest, now_ns: int) -> None:
    """Set a satellite's biases and whether it is tracked or held, for the one that is followed too."""
    sky_targets = controller.sky_targets
    following = controller.held or controller.path
    bias = Bias(request.number("along"), request.number("cross"))
    hold = request.text("mode", "TRACK") == "HOLD"
    if isinstance(following, SkyPath) and isinstance(following.target, ElementsTarget):
        near_deg = following.at(now_ns).first_deg
        path = sky_targets.path(ElementsTarget(following.target.propagator, bias), near_deg)
        if hold:
            _hold(controller, path, now_ns)
        else:
            controller.path, controller.held = path, None
    sky_targets.bias, sky_targets.hold = bias, hold


def _hold(controller: Controller, path: SkyPath, now_ns: int) -> None:
    there = path.at(now_ns)
    controller.path = Straight.standing(there.first_deg, there.second_deg, now_ns)
    controller.held = path


_HANDLERS: dict[str, Callable[[Controller, AntennaRequest, int], str | Nak | None]] = {
    "TD": Controller._designate,
    "PS": Controller._position,
    "STATUS": Controller._status,
    "STOP": Controller._stop,
    "STOW": Controller._stow,
    "UNSTOW": Controller._unstow,
    "SERVICE": Controller._service,
    "RESET": Controller._reset,
    "SENSORS": Controller._sensors,
    "TIME": Controller._time,
    "FOCUS": Controller._focus,
    "FOCSWEEP": Controller._focus,
    "FOCSTOP": Controller._focus,
    "FOCPS": Controller._focus,
    "FIXED": Controller._fixed,
    "RADEC": follow_source,
    "FIXSKY": stand_on_sky,
    "OFFSET": offset,
    "POINTING": pointing,
    "SKY": sky_position,
    "TLE": take_elements,
    "OMM": take_elements,
    "SAT": follow_satellite,
    "SATOFF": bias_satellite,
}
"""The handler of each command; pins and brakes have none and are not available."""
