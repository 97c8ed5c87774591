"""Random passes with random limits, mounts and faults: what the true axes do, by a judge of its own."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest
import safety_run
from safety_draws import Judged, draw, fly

from sattrack.safety import bounds, rate_limit

SHORT_S = 45.0
RUNS = 10
FEW = (1, 3, 4)
FOUND_BY = {"hour_angle": 1, "sun": 13}
"""A run, of those, in which a row that is left out shows."""


def flown(seed: int, longest_s: float = SHORT_S) -> tuple[str, Judged]:
    drawn = draw(seed, longest_s)
    return drawn.words, fly(drawn)


@pytest.mark.parametrize(
    "seed", [n if n in FEW else pytest.param(n, marks=pytest.mark.soak) for n in range(RUNS)]
)
def test_no_limit_is_passed_and_every_run_ends_at_rest(seed: int) -> None:
    words, judged = flown(seed)
    assert not judged.violated, (words, judged.nearest_deg)
    assert judged.at_rest, words


def test_a_mount_gets_out_of_a_corner_between_a_skyline_and_the_suns_cone_that_closes_on_it() -> None:
    drawn = draw(1_000_171, 600.0)
    # After three minutes in the corner it is on the satellite, which goes ever further from both.
    plan = msgspec.structs.replace(drawn.facts.plan, end_utc_s=drawn.facts.plan.start_utc_s + 190.0)
    judged = fly(replace(drawn, facts=msgspec.structs.replace(drawn.facts, plan=plan)))
    assert not judged.violated, (drawn.words, judged.nearest_deg)
    assert min(judged.nearest_deg[name] for name in ("horizon", "sun")) < 0.5, "it was in the corner"
    assert judged.held_s > 100.0
    assert judged.ended_by == "set"
    assert judged.at_rest


@pytest.mark.soak
def test_no_limit_is_passed_in_two_thousand_runs_of_up_to_ten_minutes() -> None:
    for seed in range(1_000_000, 1_002_000):
        words, judged = flown(seed, 600.0)
        assert not judged.violated, (words, judged.nearest_deg)
        assert judged.at_rest, words


@pytest.mark.parametrize("row", FOUND_BY)
def test_a_row_that_is_left_out_is_missed(row: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for module, name in ((bounds, "fixed_regions"), (rate_limit, "AxisReach"), (bounds.Bounds, "look")):
        monkeypatch.setattr(module, name, getattr(module, name))
    safety_run.without(row)
    assert any(row in flown(seed)[1].violated for seed in (FOUND_BY[row], *range(RUNS)))
