"""What the commands of the focus do, and what comes back.

"Ideal Field System Antenna Interface", section 6.0. None acknowledges, a Nak refuses, text answers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.servers.antenna.trajectory import second_of_day
from sattrack.servers.antenna.transactions import OMITTED, Nak, Request

if TYPE_CHECKING:
    from sattrack.servers.antenna.focuser import Focuser


def obey(focuser: Focuser | None, request: Request, now_ns: int) -> str | Nak | None:
    """Obey one command of the focus, where there is one."""
    if focuser is None:
        return Nak.NOT_AVAILABLE
    word = request.command.word
    if word == "FOCPS":
        return _position(focuser, now_ns)
    if word == "FOCSTOP":
        focuser.stop(now_ns)
        return None
    return _move(focuser, request, now_ns) if word == "FOCUS" else _sweep(focuser, request, now_ns)


def _move(focuser: Focuser, request: Request, now_ns: int) -> Nak | None:
    places = [None if value is None else float(value) for value in request.values.values()]
    if any(place is not None for place in places[focuser.count :]):
        return Nak.NOT_AVAILABLE
    if not focuser.heard(now_ns):
        return Nak.STATE
    for place, (least_mm, most_mm) in zip(places, focuser.reach_mm, strict=False):
        if place is not None and not least_mm <= place <= most_mm:
            return Nak.RANGE
    focuser.move(places[: focuser.count], now_ns)
    return None


def _sweep(focuser: Focuser, request: Request, now_ns: int) -> Nak | None:
    axis = int(request.number("axis"))
    if axis > focuser.count:
        return Nak.NOT_AVAILABLE
    if not focuser.heard(now_ns):
        return Nak.STATE
    focuser.sweep(axis - 1, request.number("rate"), now_ns)
    return None


def _position(focuser: Focuser, now_ns: int) -> str:
    report = focuser.report(now_ns)
    fields = ["FOCPS"]
    for place in report.axes:
        fields += [OMITTED if mm is None else f"{mm:.4f}" for mm in place]
    fields += [f"{second_of_day(report.epoch_ns):.6f}", "MOVING" if report.moving else "STOPPED"]
    return " ".join(fields)
