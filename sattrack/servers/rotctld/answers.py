"""What is done about a request, and what is answered, byte for byte as Hamlib's rotctld 4.5.4 answers.

After the answer comes `RPRT` and a code: for every failure, for what has no answer of its own, and at the end
of every extended response.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sattrack.servers.antenna.trajectory import NS
from sattrack.servers.rotctld.calculations import (
    CALCULATIONS,
    LocatorError,
    scan_double,
    scan_integer,
    scan_single,
)
from sattrack.servers.rotctld.reader import (
    Code,
    FailedError,
    Reader,
    Request,
    Said,
    done,
    given,
    need,
    report,
    usage,
    words_of,
)
from sattrack.servers.rotctld.rotator import MOVE_RATE_DEG_S, Direction, Rotator

if TYPE_CHECKING:
    from collections.abc import Callable

PROTOCOL = 1
MODEL = 1
"""No rotator of Hamlib's is this mount; 1 is the one that Hamlib tests clients with."""
LONGEST_PAUSE_S = 60
LEVELS = "SPEED "
DIRECTIONS: dict[int, Direction] = {2: "up", 4: "down", 8: "left", 16: "right"}
DIRECTION_WORDS: dict[str, Direction] = {
    "UP": "up",
    "DOWN": "down",
    "LEFT": "left",
    "CCW": "left",
    "RIGHT": "right",
    "CW": "right",
}
BOUNDS = {name: f"{name}_deg" for name in ("min_az", "max_az", "min_el", "max_el")}
WITHOUT_MEANING = frozenset({"write_delay", "post_write_delay", "timeout", "retry"})
"""Numbers of a rotator's line, which a mount here has none of: taken, and left alone."""


@dataclass(slots=True)
class Client:
    """One client's end: what it says in, answers out. `pause_until_s` is when it wants to be heard again."""

    number: int
    rotator: Rotator
    info: str = "sattrack"
    pause_until_s: float = 0.0
    refused: int = 0
    """Requests that were answered with a failure."""
    left: bool = False
    """Whether it has asked to be hung up on."""
    _reader: Reader = field(default_factory=Reader)
    _after_pause: str = ""

    @property
    def paused(self) -> bool:
        """Whether it has asked for a pause that is not over."""
        return self._after_pause != ""

    def receive(self, data: bytes) -> None:
        """Take bytes; what they say is answered by `answer`."""
        self._reader.feed(data)

    def answer(self, now_ns: int, most: int) -> tuple[bytes, int]:
        """Answer what has come, so many requests at most; return the answers and how many there were."""
        answers: list[str] = []
        count = 0
        while count < most and not self.left and now_ns / NS >= self.pause_until_s:
            answers.append(self._after_pause)
            self._after_pause = ""
            said = self._reader.next()
            if said is None:
                break
            count += 1
            self.rotator.heard(self.number, now_ns / NS)
            answers.append(self._answer(said, now_ns))
        return "".join(answers).encode("latin-1"), count

    def _answer(self, said: Request | Said, now_ns: int) -> str:
        if isinstance(said, Request):
            return self._obey(said, now_ns)
        self.left = said is Said.QUIT
        if said is Said.TOO_LONG:
            self.refused += 1
            return report(Code.INVALID)
        return usage() if said is Said.HELP else ""

    def _obey(self, request: Request, now_ns: int) -> str:
        command = request.command
        echoed = "".join(f" {word}" for word in request.words)
        text = f"{command.name}:{echoed}{request.mark}" if request.extended else ""
        try:
            reckons = CALCULATIONS.get(command.name)
            text += reckons(request) if reckons else _HANDLERS[command.name](self, request, now_ns)
        except (FailedError, LocatorError) as error:
            code = error.code if isinstance(error, FailedError) else Code.INVALID
            self.refused += 1
            return text + report(code)
        if request.extended or not command.answers:
            text += report(Code.OK)
        if self.pause_until_s > now_ns / NS:
            self._after_pause, text = text, ""
        return text

    # Each of these obeys one command and returns its answer.

    def _set_position(self, request: Request, now_ns: int) -> str:
        # A comma may stand for the point, as in many languages.
        az, el = (need(scan_single(word.replace(",", ".", 1))) for word in words_of(request))
        return done(self.rotator.point(self.number, az, el, now_ns / NS))

    def _get_position(self, request: Request, now_ns: int) -> str:
        here = self.rotator.where(now_ns)
        if here is None:
            raise FailedError(Code.IO)
        return given(request, f"{here.az_deg:.2f}", f"{here.el_deg:.2f}")

    def _stop(self, request: Request, now_ns: int) -> str:
        del request, now_ns
        return done(self.rotator.stop())

    def _park(self, request: Request, now_ns: int) -> str:
        del request
        return done(self.rotator.go_to_park(self.number, now_ns / NS))

    def _reset(self, request: Request, now_ns: int) -> str:
        del now_ns
        need(scan_integer(request.words[0]))
        return done(self.rotator.reset())

    def _move(self, request: Request, now_ns: int) -> str:
        first, second = words_of(request)
        direction = DIRECTION_WORDS.get(first)
        number = None if direction is not None else need(scan_integer(first))
        speed = need(scan_integer(second))
        if number is not None:
            direction = DIRECTIONS.get(number)
        if direction is None:
            raise FailedError(Code.INVALID)
        return done(self.rotator.move(self.number, direction, speed, now_ns / NS))

    def _set_level(self, request: Request, now_ns: int) -> str:
        del now_ns
        name, value = words_of(request)
        if name == "?":
            return LEVELS + "\n"
        if name != LEVELS.strip():
            raise FailedError(Code.NOT_AVAILABLE)
        self.rotator.speed_level = need(scan_integer(value))
        return ""

    def _get_level(self, request: Request, now_ns: int) -> str:
        del now_ns
        name = request.words[0]
        if name == "?":
            return LEVELS + "\n"
        if name != LEVELS.strip():
            raise FailedError(Code.INVALID)
        return f"{self.rotator.speed_level}\n"

    def _set_function(self, request: Request, now_ns: int) -> str:
        del now_ns
        if request.words[0] == "?":
            return "\n"
        raise FailedError(Code.NOT_AVAILABLE)

    def _no_such_name(self, request: Request, now_ns: int) -> str:
        del now_ns
        if request.words[0] == "?":
            return "\n"
        raise FailedError(Code.INVALID)

    def _set_configuration(self, request: Request, now_ns: int) -> str:
        del now_ns
        name, value = words_of(request)
        if not value:
            raise FailedError(Code.INVALID)
        rest = f"{name}={value}"
        while rest:
            name, equals, rest = rest.partition("=")
            if not equals:
                raise FailedError(Code.MALFORMED)
            value, _, rest = rest.partition(",")
            done(self._configure(name, value))
        return ""

    def _configure(self, name: str, value: str) -> Code:
        if name in BOUNDS:
            return self.rotator.narrow(BOUNDS[name], need(scan_double(value)))
        if name == "south_zero":
            return Code.OK if scan_integer(value) == 0 else Code.INVALID
        if name in WITHOUT_MEANING:
            return Code.INVALID if scan_integer(value) is None else Code.OK
        return Code.OK if name == "rot_pathname" else Code.INVALID

    def _get_info(self, request: Request, now_ns: int) -> str:
        del now_ns
        return given(request, self.info)

    def _get_status(self, request: Request, now_ns: int) -> str:
        flags = self.rotator.flags(now_ns)
        if flags is None:
            raise FailedError(Code.IO)
        return given(request, "".join(f"{flag} " for flag in flags))

    def _send_command(self, request: Request, now_ns: int) -> str:
        del request, now_ns
        raise FailedError(Code.IO)

    def _dump_state(self, request: Request, now_ns: int) -> str:
        del now_ns
        reach, long = self.rotator.reach, request.extended
        lines = [
            ("rotctld Protocol Ver: " if long else "") + str(PROTOCOL),
            ("Rotor Model: " if long else "") + str(MODEL),
            ("Minimum Azimuth: " if long else "min_az=") + f"{reach.min_az_deg:f}",
            ("Maximum Azimuth: " if long else "max_az=") + f"{reach.max_az_deg:f}",
            ("Minimum Elevation: " if long else "min_el=") + f"{reach.min_el_deg:f}",
            ("Maximum Elevation: " if long else "max_el=") + f"{reach.max_el_deg:f}",
            ("South Zero: " if long else "south_zero=") + "0",
            "rot_type=AzEl",
            "done",
        ]
        return "".join(line + request.mark for line in lines)

    def _dump_capabilities(self, request: Request, now_ns: int) -> str:
        del request, now_ns
        reach = self.rotator.reach
        lines = [
            f"Caps dump for model:\t{MODEL}",
            f"Model name:\t\t{self.info}",
            "Mfg name:\t\tsattrack",
            "Rot type:\t\tAz-El",
            "Port type:\t\tNone",
            "Status flags: MOVING MOVING_AZ MOVING_LEFT MOVING_RIGHT MOVING_EL MOVING_UP MOVING_DOWN ",
            "Get functions: ",
            "Set functions: ",
            "Get level: SPEED(1..4/1) ",
            "Set level: SPEED(1..4/1) ",
            "Get parameters: ",
            "Set parameters: ",
            f"Min Azimuth:\t\t{reach.min_az_deg:.2f}",
            f"Max Azimuth:\t\t{reach.max_az_deg:.2f}",
            f"Min Elevation:\t\t{reach.min_el_deg:.2f}",
            f"Max Elevation:\t\t{reach.max_el_deg:.2f}",
            f"Move at speed 100:\t{MOVE_RATE_DEG_S:.2f}",
            f"Can Park:\t\t{'N' if self.rotator.park is None else 'Y'}",
            *(f"Can {what}:\t\tY" for what in ("set Conf", "set Position", "get Position", "Stop")),
            *(f"Can {what}:\t\tY" for what in ("Reset", "Move", "get Info", "get Status")),
        ]
        return "".join(line + "\n" for line in lines)

    def _pause(self, request: Request, now_ns: int) -> str:
        seconds = need(scan_integer(request.words[0]))
        self.pause_until_s = now_ns / NS + max(0, min(LONGEST_PAUSE_S, seconds))
        return ""


_HANDLERS: dict[str, Callable[[Client, Request, int], str]] = {
    "set_pos": Client._set_position,
    "get_pos": Client._get_position,
    "park": Client._park,
    "stop": Client._stop,
    "reset": Client._reset,
    "move": Client._move,
    "set_level": Client._set_level,
    "get_level": Client._get_level,
    "set_func": Client._set_function,
    "get_func": Client._no_such_name,
    "set_parm": Client._no_such_name,
    "get_parm": Client._no_such_name,
    "set_conf": Client._set_configuration,
    "get_info": Client._get_info,
    "get_status": Client._get_status,
    "send_cmd": Client._send_command,
    "dump_caps": Client._dump_capabilities,
    "dump_state": Client._dump_state,
    "pause": Client._pause,
}
