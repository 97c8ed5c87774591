"""docs/alpaca-mount.md says what the code does."""

from __future__ import annotations

import re
from pathlib import Path

import alpaca_mount
import pytest

from sattrack.mount.alpaca import bridge, link, warden
from sattrack.mount.alpaca.link import parse_alpaca
from sattrack.mount.model import AxisLimits, MountProfile
from sattrack.runtime import connection

PAGE = (Path(__file__).parents[2] / "docs" / "alpaca-mount.md").read_text()


def test_every_key_of_the_page_is_one_of_the_profiles() -> None:
    (table,) = re.findall(r"\| key of the profile .*?\n\n", PAGE, re.DOTALL)
    keys = [
        key
        for row in table.splitlines()[2:]
        if row
        for key in re.findall(r"`([a-z_.…]+)`", row.split("|")[1])
    ]
    assert len(keys) > 10
    for key in keys:
        first, _, second = key.partition(".")
        if first == "…_beyond_pole":
            continue
        assert first in MountProfile.__struct_fields__
        assert not second or second in AxisLimits.__struct_fields__


def test_the_usual_profile_is_what_the_page_says() -> None:
    usual = parse_alpaca("alpaca://127.0.0.1:11111/0").usual_profile()
    assert parse_alpaca("alpaca://127.0.0.1").device == 0
    assert parse_alpaca("alpaca://127.0.0.1").port == 11111
    assert usual.period_s == 0.1
    assert usual.clock_offset_s == 0.0
    assert usual.additive is False
    assert f"{link.SLOWEST_HZ:g} to {link.FASTEST_HZ:g}, {link.DEFAULT_HZ:g} by default" in PAGE
    for hz in (link.SLOWEST_HZ, link.FASTEST_HZ):
        assert parse_alpaca(f"alpaca://127.0.0.1:11111/0?hz={hz}").usual_profile().period_s == 1.0 / hz


@pytest.mark.parametrize(
    ("words", "seconds"),
    [
        ("the session is killed, or hangs for {:g} s", connection.HANG_AFTER_S),
        ("after {:g} s without a word of theirs", bridge.DEADMAN_S),
        ("the gateway is killed, or hangs for {:g} s", warden.HANG_AFTER_S),
        ("then the warden for {:g} s more", warden.STOPS_SENT_S),
    ],
)
def test_the_times_of_the_page_are_in_force(words: str, seconds: float) -> None:
    assert words.format(seconds) in PAGE


def test_every_variant_of_the_bench_is_on_the_page() -> None:
    for name in alpaca_mount.VARIANTS:
        assert name in PAGE
