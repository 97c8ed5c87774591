"""Every row of the paper, against the controller without a line."""

from __future__ import annotations

import pytest
from antenna_setup import NOON_NS, exchange, make_controller
from conformance_rows import ROWS, Row


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.section} {row.claim}")
def test_the_controller_answers_as_the_row_says(row: Row) -> None:
    controller = make_controller()
    controller.switch(not row.local, NOON_NS)
    for step in row.steps:
        assert exchange(controller, step.sent, step.at_s) == step.received


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.section} {row.claim}")
def test_a_byte_at_a_time_makes_no_difference(row: Row) -> None:
    if not row.on_a_line:
        return
    controller = make_controller()
    controller.switch(not row.local, NOON_NS)
    for step in row.steps:
        parts = [exchange(controller, bytes([byte]), step.at_s) for byte in step.sent]
        assert b"".join(parts) == step.received


def test_every_section_from_three_to_eight_has_rows() -> None:
    assert {row.section[0] for row in ROWS} == set("345678")
