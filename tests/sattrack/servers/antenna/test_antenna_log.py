"""The controller's log against lines as the Field System writes them."""

from __future__ import annotations

from antenna_setup import NOON_NS, exchange, make_controller

from sattrack.servers.antenna.protocol import log_stamp, operator_line, program_line, refusal_line


def test_an_instant_is_year_day_and_time_to_a_hundredth() -> None:
    # The second of October is the 275th day.
    assert log_stamp(NOON_NS / 1e9 + 0.719) == "2026.275.12:00:00.71"


def test_each_kind_of_line_has_its_sign() -> None:
    assert program_line("the mount is heard") == "#antenna#the mount is heard"
    assert operator_line("local") == ";local"


def test_a_refusal_is_an_error_with_its_number() -> None:
    controller = make_controller()
    exchange(controller, b"STOW\x00 00\n")
    exchange(controller, b"PINS IN 11\n")
    first, second = controller.refusals
    assert first.refused is not None
    assert second.refused is not None
    assert refusal_line(second, second.refused) == "?ERROR AN   -9 this antenna does not have that: PINS IN"
    assert refusal_line(first, first.refused).startswith("?ERROR AN   -1 transmission error")
    assert refusal_line(first, first.refused).endswith(": STOW? 00")
