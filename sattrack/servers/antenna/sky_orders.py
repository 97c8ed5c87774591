"""What the commands do that have the controller reduce coordinates: sources, offsets, models, satellites.

"Ideal Field System Antenna Interface", sections 7.0 and 8.0. None acknowledges, a Nak refuses, text answers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sattrack.servers.antenna.celestial import Satellite, SkyPath, Target
from sattrack.servers.antenna.element_store import StoreError
from sattrack.servers.antenna.trajectory import NS, Straight, second_of_day
from sattrack.servers.antenna.transactions import OMITTED, Nak
from tle.bias import Bias

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.servers.antenna.controller import Controller
    from sattrack.servers.antenna.transactions import Request


def follow_source(controller: Controller, request: Request, now_ns: int) -> Nak | None:
    """Follow a source by its coordinates."""
    return _follow(controller, controller.reckoning.source(request), request, now_ns)


def _follow(controller: Controller, target: Target, request: Request, now_ns: int) -> Nak | None:
    path = controller.reckoning.path(target)
    path.turn_by(controller.turns_asked(request, path.at(now_ns).first_deg, now_ns))
    return controller.take_up(path)


def stand_on_sky(controller: Controller, request: Request, now_ns: int) -> Nak | None:
    """Stand where a source is at an instant."""
    epoch_ns = controller.epoch_asked(request, now_ns)
    if isinstance(epoch_ns, Nak):
        return epoch_ns
    reckoning = controller.reckoning
    there = reckoning.path(reckoning.source(request)).at(epoch_ns)
    stands = Straight.standing(there.first_deg, there.second_deg, epoch_ns)
    return controller.take_up(stands.turned(controller.turns_asked(request, there.first_deg, now_ns)))


def offset(controller: Controller, request: Request, now_ns: int) -> None:
    """Set the offsets of one kind, for what is being followed too."""
    del now_ns
    controller.reckoning.offset(request)
    _reduce(controller)


def pointing(controller: Controller, request: Request, now_ns: int) -> Nak | None:
    """Set the pointing model, for what is being followed too."""
    del now_ns
    if controller.antenna.axes != "hadec":
        return Nak.NOT_AVAILABLE
    controller.reckoning.model(request)
    _reduce(controller)
    return None


def _reduce(controller: Controller) -> None:
    """Have what is followed go by what has been sent since."""
    reduction = controller.reckoning.reduction
    if isinstance(controller.path, SkyPath):
        controller.path = controller.path.reduced_by(reduction)
    if controller.held is not None:
        controller.held = controller.held.reduced_by(reduction)


def tell_sky(controller: Controller, request: Request, now_ns: int) -> str:
    """Tell where on the sky the axes point: the pointing model turned round."""
    actual = controller.feedback.actual(now_ns)
    places = [OMITTED] * 4
    if actual is not None:
        seen = controller.reckoning.pointed_at(actual, now_ns / NS)
        places = [f"{place_deg:.8f}" for place_deg in seen]
    return " ".join((request.command.word, *places, f"{second_of_day(now_ns):.6f}"))


def take_elements(controller: Controller, request: Request, now_ns: int) -> Nak | None:
    """Take a line or a value of a satellite's elements."""
    del now_ns
    store, number = controller.reckoning.elements, int(request.number("number"))
    try:
        if request.command.word == "TLE":
            store.take_line(int(request.text("line")), number, request.text("text"))
        else:
            store.take_value(number, request.text("keyword"), request.text("value"))
    except StoreError as error:
        return error.why
    return None


def follow_satellite(controller: Controller, request: Request, now_ns: int) -> Nak | None:
    """Follow the satellite whose elements were sent, or stand where it is while SATOFF holds."""
    mode = controller.antenna.refraction
    refracted = mode == "on" or (mode == "auto" and not controller.feedback.does_refraction)
    reckoning = controller.reckoning
    try:
        satellite = reckoning.satellite(int(request.number("number")), refracted)
    except StoreError as error:
        return error.why
    refusal = _follow(controller, satellite, request, now_ns)
    if refusal is None and reckoning.hold and isinstance(controller.path, SkyPath):
        _hold(controller, controller.path, now_ns)
    return refusal


def bias_satellite(controller: Controller, request: Request, now_ns: int) -> None:
    """Set a satellite's biases and whether it is tracked or held, for the one that is followed too."""
    reckoning = controller.reckoning
    following = controller.held or controller.path
    bias = Bias(request.number("along"), request.number("cross"))
    hold = request.text("mode", "TRACK") == "HOLD"
    if isinstance(following, SkyPath) and isinstance(following.target, Satellite):
        near_deg = following.at(now_ns).first_deg
        way = reckoning.path(Satellite(following.target.propagator, bias), near_deg)
        if hold:
            _hold(controller, way, now_ns)
        else:
            controller.path, controller.held = way, None
    reckoning.bias, reckoning.hold = bias, hold


def _hold(controller: Controller, way: SkyPath, now_ns: int) -> None:
    there = way.at(now_ns)
    controller.path = Straight.standing(there.first_deg, there.second_deg, now_ns)
    controller.held = way


HANDLERS: dict[str, Callable[[Controller, Request, int], str | Nak | None]] = {
    "RADEC": follow_source,
    "FIXSKY": stand_on_sky,
    "OFFSET": offset,
    "POINTING": pointing,
    "SKY": tell_sky,
    "TLE": take_elements,
    "OMM": take_elements,
    "SAT": follow_satellite,
    "SATOFF": bias_satellite,
}
"""What obeys each of them."""
