"""Position status against decimal arithmetic: what was designated comes back to the last digit."""

from __future__ import annotations

from decimal import Decimal, localcontext

from antenna_setup import exchange, make_controller
from hypothesis import given, settings
from hypothesis import strategies as st

from sattrack.servers.antenna.protocol import encode

NOON_S = 43200
positions = st.decimals("-170", "170", places=13)
rates = st.decimals("-0.05", "0.05", places=14)


@settings(deadline=None, max_examples=200)
@given(positions, st.decimals("-90", "180", places=14), rates, rates, st.integers(0, 120_000_000))
def test_commanded_is_the_designation_to_the_last_digit(
    first: Decimal, second: Decimal, first_rate: Decimal, second_rate: Decimal, after_us: int
) -> None:
    controller = make_controller()
    epoch = Decimal(NOON_S) + Decimal("30.123456")
    sent = f"TD {first:f} {second:f} {first_rate:f} {second_rate:f} {epoch} 0"
    assert exchange(controller, encode(sent)) == encode("TD ACK")
    told = exchange(controller, encode("PS"), after_us / 1e6).decode().split()
    with localcontext(prec=60):
        later_s = Decimal(after_us) / 1_000_000 + NOON_S - epoch
        places = (first + first_rate * later_s, second + second_rate * later_s)
    assert Decimal(told[11]) == Decimal(NOON_S) + Decimal(after_us) / 1_000_000
    for text, place in zip(told[1:3], places, strict=True):
        assert Decimal(text) == place.quantize(Decimal("1e-8"))
    for text, rate in zip(told[5:7], (first_rate, second_rate), strict=True):
        assert Decimal(text) == rate.quantize(Decimal("1e-10"))


def test_a_digit_that_binary_numbers_cannot_hold_is_rounded_as_decimals_are() -> None:
    controller = make_controller()
    # The nearest binary numbers lie above what was sent, and would be rounded up.
    for sent, told in (("12.345001005", b"12.34500100"), ("12.345003005", b"12.34500300")):
        exchange(controller, encode(f"TD {sent} 40"))
        assert exchange(controller, encode("PS")).split()[1] == told


TICS = 2**26
"""A turn of an encoder."""


@settings(deadline=None, max_examples=200)
@given(st.integers(-200 * TICS // 360, 200 * TICS // 360), st.integers(-89 * TICS // 360, 89 * TICS // 360))
def test_every_encoder_position_can_be_designated_and_comes_back(first: int, second: int) -> None:
    controller = make_controller()
    wrap = (first + TICS // 2) // TICS
    within = Decimal(first - wrap * TICS) * 360 / TICS
    sent = f"TD {within:.8f} {Decimal(second) * 360 / TICS:.8f} ,, ,, ,, {wrap}"
    assert exchange(controller, encode(sent)) == encode("TD ACK")
    told = exchange(controller, encode("PS")).split()
    assert round(Decimal(told[1].decode()) * TICS / 360) + int(told[9]) * TICS == first
    assert round(Decimal(told[2].decode()) * TICS / 360) == second
    assert controller.path is not None
    assert round(controller.path.at(0).first_deg * TICS / 360) == first
