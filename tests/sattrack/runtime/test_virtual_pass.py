"""Whole passes in virtual time: the same engine and mount as live, judged by the simulated axes' truth."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec
import pytest
from late_start import late

from sattrack.cli.main import run
from sattrack.runtime import demo_pass
from sattrack.runtime.facts import Prepared, RunRequest, prepare
from sattrack.runtime.flight import fly_virtual
from sattrack.views.messages import ClearBias, Message, Nudge, StopNow
from tle.elements import Elements
from tle.instants import Utc
from tle.site import Site

if TYPE_CHECKING:
    from sattrack.views.run import TrackView

CULMINATION_S = float(Utc.parse("2026-10-02T13:05:24Z").unix_s)
NEAR_S, FAR_S = 10.0, 25.0
"""The way from where the simulated mount stands at first to where the pass is high, or low."""
FROM_45 = ("--min-alt", "45", "--clock", "2026-10-02T13:04:00Z")
HIGH = ("--min-alt", "78", "--clock", "2026-10-02T13:05:15Z")


def prepared(min_alt_deg: float = 45.0, **changes: object) -> Prepared:
    """Prepare what is above an altitude of the pass: two minutes above 45°, seven above 10°."""
    request = RunRequest(
        satellite="25544",
        mount_url="sim",
        elements=None,
        site=None,
        clock_option=None,
        min_alt_deg=min_alt_deg,
        virtual=True,
        **changes,  # type: ignore[arg-type]
    )
    made = prepare(request)
    return replace(made, facts=late(made.facts, NEAR_S if min_alt_deg >= 45.0 else FAR_S))


def test_a_pass_is_followed_within_an_arcsecond(capsys: pytest.CaptureFixture[str]) -> None:
    """The whole one of seven minutes is followed in the README and in the tutorial."""
    assert run(["track", "25544", "--virtual", "--mount", "sim", "--json", *FROM_45]) == 0
    out = capsys.readouterr().out
    summary = json.loads(out)["summary"]
    assert summary["true_rms_arcsec"] <= 0.05
    assert summary["reported_rms_arcsec"] <= 0.05
    assert summary["true_peak_arcsec"] <= 0.5
    assert summary["acquired_after_s"] <= 2.0
    # From 45° to 45° the pass lasts 112 s (made with another library: 13:04:28.4 to 13:06:20.5 UTC).
    assert summary["on_target_s"] == pytest.approx(111.5, abs=1.0)
    assert summary["ended_by"] == "set"
    assert summary["mount_stopped"] is True
    assert summary["calibrated"] is False
    # 20 a second, from 28 s before the pass until the mount was seen at rest for two seconds.
    assert summary["datagrams"]["sent"] == pytest.approx(20 * (28.4 + 112.1 + 2.3), abs=4)


def test_the_same_command_prints_the_same_summary(capsys: pytest.CaptureFixture[str]) -> None:
    printed = []
    for _ in range(2):
        assert run(["track", "ISS", "--virtual", "--mount", "sim", "--json", *HIGH]) == 0
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1]


def test_nudges_move_the_target_and_are_followed() -> None:
    views: list[TrackView] = []
    messages: tuple[tuple[float, Message], ...] = (
        (CULMINATION_S - 50.0, Nudge(along_s=0.5)),
        (CULMINATION_S - 40.0, Nudge(cross_deg=0.1)),
        (CULMINATION_S - 20.0, ClearBias()),
        (CULMINATION_S - 5.0, StopNow()),
    )
    summary = fly_virtual(prepared(), views.append, messages)
    at = {round(view.utc_s - CULMINATION_S): view for view in views}
    assert at[-45].bias_along_s == pytest.approx(0.5, abs=1e-6)
    assert at[-35].bias_cross_deg == pytest.approx(0.1, abs=1e-6)
    assert at[-10].bias_along_s == pytest.approx(0.0, abs=1e-6)
    assert summary.true_rms_arcsec is not None
    assert summary.true_rms_arcsec < 1.0
    assert summary.true_peak_arcsec is not None
    assert summary.true_peak_arcsec < 60.0
    for seconds in (-47, -37, -17):
        error = at[seconds].error
        assert error is not None
        assert error.total_arcsec < 1.0


def test_a_bias_given_beforehand_is_where_the_mount_points() -> None:
    """A second along the track puts the mount where the unbiased satellite is seen a second later.

    Nearly: the observer stays, and the Earth's rotation in that second (up to 15″) is the difference.
    """
    views: list[TrackView] = []
    seen = ((CULMINATION_S + 2.5, StopNow()),)
    fly_virtual(prepared(75.0, bias_along_s=1.0), views.append, seen)
    plain: list[TrackView] = []
    fly_virtual(prepared(75.0), plain.append, seen)
    biased = next(v for v in views if v.utc_s >= CULMINATION_S)
    later = next(v for v in plain if v.utc_s >= CULMINATION_S + 1.0)
    assert biased.mount_dec_deg is not None
    assert later.mount_dec_deg is not None
    assert biased.mount_dec_deg == pytest.approx(later.mount_dec_deg, abs=60.0 / 3600.0)


def test_the_operators_stop_ends_the_run_at_once_with_the_mount_at_rest() -> None:
    views: list[TrackView] = []
    summary = fly_virtual(prepared(70.0), views.append, ((CULMINATION_S, StopNow()),))
    assert summary.ended_by == "operator"
    assert summary.mount_stopped is True
    assert Utc.parse(summary.ended_utc) - Utc(CULMINATION_S) < 3.0


def test_signs_turned_in_mount_and_profile_make_no_difference() -> None:
    plan = prepared(72.0)
    turned = msgspec.structs.replace(
        plan.facts, profile=msgspec.structs.replace(plan.facts.profile, ra_rate_sign=-1, dec_rate_sign=-1)
    )
    summary = fly_virtual(Prepared(turned, plan.clock, None, True))
    assert summary.true_rms_arcsec is not None
    assert summary.true_rms_arcsec < 0.05


def test_absolute_rates_are_followed_as_well() -> None:
    plan = prepared(72.0)
    absolute = msgspec.structs.replace(
        plan.facts, profile=msgspec.structs.replace(plan.facts.profile, additive=False)
    )
    summary = fly_virtual(Prepared(absolute, plan.clock, None, True))
    assert summary.true_rms_arcsec is not None
    assert summary.true_rms_arcsec < 0.05


@pytest.mark.parametrize("refraction", ["auto", "on", "off"])
def test_refraction_is_fed_where_the_mount_applies_none(refraction: str) -> None:
    """At 10° the air raises a direction by 5.3′ (Meeus, Astronomical Algorithms, chapter 16)."""
    views: list[TrackView] = []
    fly_virtual(prepared(10.0, refraction=refraction), views.append, ((CULMINATION_S - 190.0, StopNow()),))
    view = next(v for v in views if v.phase == "tracking")
    elements = Elements.from_tle(demo_pass.LINE_1, demo_pass.LINE_2)
    from tle.propagator import Propagator

    assert view.error is not None
    airless = Propagator(elements, Site(52.1541, 4.4908, 0.0)).at(Utc(view.error.utc_s))
    raised_arcmin = (view.target_alt_deg - float(airless.alt_deg)) * 60.0
    assert raised_arcmin == pytest.approx(0.0 if refraction == "off" else 5.3, abs=0.2)
    assert view.error.total_arcsec < 1.0


def test_a_pass_by_the_pole_of_the_mount_is_survived() -> None:
    """Near the celestial pole following takes more than the mount's rates: they are cut, and it is told."""
    elements = Elements.from_tle(
        "1 38707U 12039A   24247.82317651  .00138984  00000-0  16635-2 0  9998",
        "2 38707  97.4945 189.8924 0007050 108.0286 252.1739 15.60479551673427",
    )
    request = RunRequest(
        satellite="38707",
        mount_url="sim",
        elements=[elements],
        site=Site(60.0, -28.0, 0.0),
        clock_option="2024-09-05T04:25:00Z",
        min_alt_deg=30.0,
        virtual=True,
    )
    views: list[TrackView] = []
    made = prepare(request)
    summary = fly_virtual(replace(made, facts=late(made.facts)), views.append)
    assert max(abs(view.target_dec_deg) for view in views) > 87.0
    assert any("rate limit" in words for view in views for words in view.warnings)
    assert summary.ended_by == "set"
    assert summary.mount_stopped is True
    # What the rate limit took, and the way back onto the target, are counted apart from the error.
    assert summary.reported_peak_arcsec is not None
    assert summary.reported_peak_arcsec < 120.0
    assert summary.lost_peak_arcsec is not None
    assert summary.lost_peak_arcsec > 120.0
    assert summary.on_target_s > 120.0
