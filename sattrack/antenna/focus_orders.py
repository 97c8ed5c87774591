"""What the commands of the focus do, and what comes back.

"Ideal Field System Antenna Interface", section 6.0. None acknowledges, a Nak refuses, text answers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.antenna.trajectory import second_of_day
from sattrack.antenna.transactions import OMITTED, Nak, Request

if TYPE_CHECKING:
    from sattrack.antenna.focus import Focus


def obey(focus: Focus | None, request: Request, now_ns: int) -> str | Nak | None:
    """Obey one command of the focus, where there is one."""
    if focus is None:
        return Nak.NOT_AVAILABLE
    match request.command.word:
        case "FOCUS":
            places = [None if value is None else float(value) for value in request.values.values()]
            return None if focus.move(places, now_ns) else Nak.NOT_AVAILABLE
        case "FOCSWEEP":
            return _sweep(focus, request, now_ns)
        case "FOCSTOP":
            focus.stop(now_ns)
            return None
    return _position(focus, now_ns)


def _sweep(focus: Focus, request: Request, now_ns: int) -> Nak | None:
    axis = request.number("axis")
    if axis != int(axis):
        return Nak.VALUE
    if axis > len(focus.axes):
        return Nak.NOT_AVAILABLE
    focus.axes[int(axis) - 1].sweep(request.number("rate"), now_ns)
    return None


def _position(focus: Focus, now_ns: int) -> str:
    fields, moves = ["FOCPS"], False
    for axis in focus.axes:
        place_mm, moving = axis.at(now_ns)
        commanded = axis.commanded_mm
        fields += [OMITTED if commanded is None else f"{commanded:.4f}", f"{place_mm:.4f}"]
        moves = moves or moving
    fields += [f"{second_of_day(now_ns):.6f}", "MOVING" if moves else "STOPPED"]
    return " ".join(fields)
