"""Calibrated tracking on simulated Alpaca telescopes in virtual time, held to the simulated axes' truth."""

from __future__ import annotations

import pytest
from alpaca_harness import calibrate, follow

from sattrack.alpaca_simulator.settings import TelescopeSettings
from sattrack.calibration.plan import Leg, Plan

BOUND_ARCSEC = 10.0
LASTS_S = 150.0
"""From the slew to a minute and a half into the pass."""
SHORT = Plan(
    toggles=10,
    most_toggles=14,
    toggles_after=4,
    legs=(Leg(-0.8, 2.4), Leg(0.8, 2.4), Leg(0.4, 3.6), Leg(-0.4, 3.6), Leg(0.2, 4.0)),
)
VARIANTS = {
    "as the standard": TelescopeSettings(),
    "additive, both turned": TelescopeSettings(additive=True, ra_sign=-1, dec_sign=-1),
    "J2000, gains, soft": TelescopeSettings(
        system="j2000", ra_sign=-1, ra_gain=1.03, dec_gain=0.96, servo_hz=2.0, acceleration_deg_s2=4.0
    ),
    "additive, without tracking": TelescopeSettings(additive=True, dec_sign=-1, tracking=False),
}
LEFT_OUT = {"as the standard", "additive, both turned"}
"""What the others have in them, too."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.soak if name in LEFT_OUT else ()) for name in VARIANTS]
)
def test_what_a_telescope_does_with_moveaxis_is_found_out_and_a_pass_followed_within_the_bound(
    name: str,
) -> None:
    settings = VARIANTS[name]
    profile, found = calibrate(settings, plan=SHORT)
    assert (profile.ra_rate_sign, profile.dec_rate_sign) == (settings.ra_sign, settings.dec_sign)
    assert profile.additive is settings.additive
    assert profile.move_axis == "held"
    assert profile.ra_rate_gain == pytest.approx(settings.ra_gain, abs=0.003)
    assert profile.dec_rate_gain == pytest.approx(settings.dec_gain, abs=0.003)
    assert profile.ra.max_rate_deg_s == 6.0
    # Both ways together, of which the middle is taken.
    assert found.delays.round_trip.seconds == pytest.approx(settings.latency_s, abs=0.006)
    assert profile.clock_offset_s == 0.0
    assert profile.dated_within_s == pytest.approx(settings.latency_s / 2.0, abs=0.004)
    result = follow(settings, profile, seconds=LASTS_S)
    assert result.message is None
    assert result.ended_by == "operator"
    assert result.stopped
    assert len(result.errors) > 3000
    assert result.true.rms_arcsec is not None
    assert result.true.rms_arcsec < BOUND_ARCSEC


def test_a_wrong_sign_is_stopped_by_the_obedience_limit() -> None:
    profile, _ = calibrate(TelescopeSettings(), plan=SHORT)
    result = follow(TelescopeSettings(ra_sign=-1, dec_sign=-1), profile)
    assert result.ended_by == "limit:obedience"
    assert result.stopped


@pytest.mark.parametrize(
    ("settings", "hz"),
    [
        pytest.param(TelescopeSettings(), 5.0, marks=pytest.mark.soak),
        (TelescopeSettings(move_interval_s=0.25), 3.5),
        pytest.param(TelescopeSettings(rates_deg_s=((0.001, 1.5),)), 10.0, marks=pytest.mark.soak),
    ],
)
def test_at_the_rate_that_a_telescope_bears_the_bound_is_kept_too(
    settings: TelescopeSettings, hz: float
) -> None:
    profile, _ = calibrate(settings, hz, SHORT)
    result = follow(settings, profile, hz, LASTS_S)
    assert result.refusals == []
    assert result.stopped
    assert result.true.rms_arcsec is not None
    assert result.true.rms_arcsec < BOUND_ARCSEC
