"""The controller's log against lines as the Field System writes them."""

from __future__ import annotations

from antenna_setup import NOON_NS, exchange, make_controller

from sattrack.servers.antenna.protocol import refused, spoken, stamp, typed


def test_an_instant_is_year_day_and_time_to_a_hundredth() -> None:
    # The second of October is the 275th day.
    assert stamp(NOON_NS / 1e9 + 0.719) == "2026.275.12:00:00.71"


def test_each_kind_of_line_has_its_sign() -> None:
    assert spoken("the mount is heard") == "#antenna#the mount is heard"
    assert typed("local") == ";local"


def test_a_refusal_is_an_error_with_its_number() -> None:
    controller = make_controller()
    exchange(controller, b"STOW\x00 00\n")
    exchange(controller, b"PINS IN 11\n")
    first, second = controller.refusals
    assert first.refused is not None
    assert second.refused is not None
    assert refused(second, second.refused) == "?ERROR AN   -9 this antenna does not have that: PINS IN"
    assert refused(first, first.refused).startswith("?ERROR AN   -1 transmission error")
    assert refused(first, first.refused).endswith(": STOW? 00")
