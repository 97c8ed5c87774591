"""What a telescope can be told, as PUTs of Alpaca's members."""

from __future__ import annotations

from typing import Literal, NamedTuple

NORTH, SOUTH, EAST, WEST = range(4)
"""Alpaca's GuideDirections."""

Lane = Literal["ra", "dec", "rest"]
AXIS_LANES: tuple[Lane, Lane] = ("ra", "dec")


class Order(NamedTuple):
    """Something to tell the telescope: a PUT of one member.

    On the lanes `ra` and `dec` a newer order takes the place of one that waits; on `rest` they queue up.
    """

    lane: Lane
    member: str
    fields: tuple[tuple[str, str], ...] = ()
    rate_deg_s: float = 0.0
    """Of a MoveAxis."""


def move_order(axis: int, rate_deg_s: float) -> Order:
    """Return the MoveAxis of one axis, 0 right ascension, 1 declination; degrees a second."""
    told = ("Axis", str(axis)), ("Rate", f"{rate_deg_s:.9f}")
    return Order(AXIS_LANES[axis], "moveaxis", told, rate_deg_s)


def tracking_order(on: bool) -> Order:
    """Return the order that puts tracking on or off."""
    return Order("rest", "tracking", (("Tracking", "true" if on else "false"),))


def pulse_orders(ra_ms: int, dec_ms: int) -> list[Order]:
    """Return the guide pulses of so many milliseconds; negative is east, and south."""
    orders = []
    for milliseconds, onward, back in ((ra_ms, WEST, EAST), (dec_ms, NORTH, SOUTH)):
        if milliseconds:
            direction = onward if milliseconds > 0 else back
            told = ("Direction", str(direction)), ("Duration", str(abs(milliseconds)))
            orders.append(Order("rest", "pulseguide", told))
    return orders
