"""Waves of the axes' angles, learnt from passes that a few lines of spherical trigonometry make."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from sattrack.core.errors import SattrackError
from sattrack.mount.model import PeriodicErrors, Wave
from sattrack.pointing.learn import Learnt, PassResiduals, Prior, learn

Array = NDArray[np.float64]

NAMES = ("IH", "ID", "CH", "NP", "MA", "ME")
NOISE_ARCSEC = 1.5
FRAMES = 200


def track(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return seconds, hour angle and declination of a body on a great circle, 2° a second to 0.5°."""
    since = np.linspace(-150.0, 150.0, FRAMES)
    pole = np.array([rng.uniform(-0.7, 0.7), rng.uniform(-0.7, 0.7), rng.uniform(-0.5, 0.5)])
    towards = np.array([0.5, 0.0, 0.8]) + 0.25 * rng.standard_normal(3)
    across = np.cross(pole, towards)
    across, towards = (one / np.linalg.norm(one) for one in (across, towards))
    along = np.arctan(since / 60.0)[:, None]
    unit = np.cos(along) * towards + np.sin(along) * across
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return since, np.degrees(np.arctan2(unit[:, 1], unit[:, 0])), np.degrees(np.arcsin(unit[:, 2]))


def made(
    seed: int,
    waves: tuple[tuple[int, float, float, float], ...] = (),
    known_arcsec: float | None = None,
    terms: dict[str, float] | None = None,
    wild: int = 0,
    apart_arcsec: float = 5.0,
) -> PassResiduals:
    """Return a pass of a seed with hidden waves (axis, cycles, sine, cosine), an orbit and a mount."""
    rng = np.random.default_rng(seed)
    since, first, second = track(rng)
    level = np.cos(np.radians(second))
    h, d = np.radians(first), np.radians(second)
    zero, one = np.zeros_like(h), np.ones_like(h)
    # Wallace's formulas; on the sky, what turns the first axis counts by the cosine.
    added = [
        (level, zero),
        (zero, one),
        (one, zero),
        (np.sin(d), zero),
        (-np.cos(h) * np.sin(d), np.sin(h)),
        (np.sin(h) * np.sin(d), np.cos(h)),
    ]
    columns = -np.array(added).transpose(2, 1, 0)
    rates = np.stack([np.gradient(np.unwrap(first, period=360.0)) * level, np.gradient(second)], axis=1)
    ahead = rates / np.hypot(*rates.T)[:, None]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    far = 1.0 / np.sqrt(1.0 + (since / 60.0) ** 2)
    drift = (since / 150.0)[:, None]
    own = np.stack(
        [1000.0 * rates / rates.max(), 60.0 * left * far[:, None], 10.0 * drift * ahead, 10.0 * drift * left],
        axis=2,
    )
    values = np.array([(terms or {}).get(name, 0.0) for name in NAMES]) + apart_arcsec * rng.standard_normal(
        6
    )
    seen = own @ rng.standard_normal(4) + columns @ values
    for axis, cycles, sine, cosine in waves:
        angle = np.radians(cycles * (first if axis == 0 else second))
        on_sky = level if axis == 0 else one
        seen[:, axis] += (sine * np.sin(angle) + cosine * np.cos(angle)) * on_sky
    seen += NOISE_ARCSEC * rng.standard_normal(seen.shape)
    seen[rng.choice(FRAMES, wild, replace=False)] += 300.0
    sigma = 60.0 if known_arcsec is None else known_arcsec
    prior = Prior(NAMES, np.full(6, sigma), np.full(6, apart_arcsec), known_arcsec is not None)
    return PassResiduals(
        f"2026-10-{seed % 28 + 1:02d}T00:00:00Z",
        seen,
        np.full(FRAMES, NOISE_ARCSEC),
        np.stack([first, second], axis=1),
        np.stack([level, one], axis=1),
        own,
        columns,
        prior,
    )


def named(passes: list[PassResiduals]) -> list[str]:
    return [f"pass{k}.mcap" for k in range(len(passes))]


GEAR = (0, 7, 6.0, -8.0)
"""Ten arcseconds at 7 a turn of the first axis."""


def left_over(found: Learnt, axis: int, hidden: tuple[tuple[int, float, float], ...], angles: Array) -> float:
    """Return the RMS of hidden waves less those found, at angles."""
    assert found.periodic is not None
    waves = (found.periodic.first, found.periodic.second)[axis]
    every = [*hidden, *((one.cycles, -one.sin_arcsec, -one.cos_arcsec) for one in waves)]
    at = np.radians(angles)
    return float(np.sqrt(np.mean(sum(s * np.sin(n * at) + c * np.cos(n * at) for n, s, c in every) ** 2)))


def test_a_gear_is_learnt_from_three_passes_and_a_next_one_has_a_fifth_of_it() -> None:
    passes = [made(seed, (GEAR,)) for seed in (1, 2, 3)]
    found = learn(passes, named(passes))
    assert found.periodic is not None
    assert [wave.cycles for wave in found.periodic.first] == [7]
    assert found.periodic.second == ()
    wave = found.periodic.first[0]
    assert abs(wave.sin_arcsec - 6.0) < 4.0 * wave.sigma_arcsec
    assert abs(wave.cos_arcsec + 8.0) < 4.0 * wave.sigma_arcsec
    angles = made(9).angles_deg[:, 0]
    assert left_over(found, 0, ((7, 6.0, -8.0),), angles) < 10.0 / math.sqrt(2.0) / 5.0
    assert all(one.with_arcsec < one.without_arcsec for one in found.held_out)


def test_waves_of_both_axes_slow_and_fast_are_found_together() -> None:
    hidden = (GEAR, (1, 9, 0.0, 8.0), (0, 180, 2.0, 0.0), (1, 360, 0.0, -1.5))
    passes = [made(seed, hidden, wild=3) for seed in range(11, 16)]
    found = learn(passes, named(passes)).periodic
    assert found is not None
    assert [wave.cycles for wave in found.first] == [7, 180]
    assert [wave.cycles for wave in found.second] == [9, 360]
    assert found.with_arcsec == pytest.approx(NOISE_ARCSEC * math.sqrt(2.0), rel=0.1)


@pytest.mark.parametrize("begin", [100, 200])
def test_a_mount_without_such_errors_gets_no_table(begin: int) -> None:
    passes = [made(begin + k) for k in range(3)]
    found = learn(passes, named(passes))
    assert found.periodic is None
    assert any("no wave" in note for note in found.notes)


def test_what_one_pass_alone_shows_is_not_taken() -> None:
    passes = [made(21, ((0, 40, 5.0, 0.0),)), *(made(seed) for seed in (22, 23, 24))]
    try:
        assert learn(passes, named(passes)).periodic is None
    except SattrackError as error:
        assert "pass" in str(error)  # noqa: PT017


def test_a_pass_that_is_given_twice_proves_nothing_by_itself() -> None:
    passes = [made(21, ((0, 40, 5.0, 0.0),)), made(22), made(21, ((0, 40, 5.0, 0.0),))]
    with pytest.raises(SattrackError, match=r"pass2\.mcap: it is the same pass as pass0\.mcap: give it once"):
        learn(passes, named(passes))


def test_a_mount_that_was_homed_between_passes_is_refused_by_name() -> None:
    turned = (0, 7, -8.0, -6.0)
    passes = [*(made(seed, (GEAR,)) for seed in (31, 32, 33)), made(34, (turned,))]
    with pytest.raises(SattrackError, match=r"pass3\.mcap: its wave of 7 a turn .* turned by [-+]\d+°"):
        learn(passes, named(passes))


def test_one_pass_needs_a_table_to_be_held_against() -> None:
    with pytest.raises(SattrackError, match="give 2"):
        learn([made(41, (GEAR,))], ["only.mcap"])


KNOWN = PeriodicErrors("2026-09-30T00:00:00Z", 3, (Wave(7, 6.2, -7.9, 0.1),), ())


def test_a_table_goes_on_with_one_more_pass() -> None:
    found = learn([made(41, (GEAR,))], ["next.mcap"], KNOWN).periodic
    assert found is not None
    assert found.passes == 4
    assert [wave.cycles for wave in found.first] == [7]
    assert abs(found.first[0].sin_arcsec - 6.0) < 0.3


def test_a_table_of_another_phase_is_not_kept() -> None:
    turned = (0, 7, -8.0, -6.0)
    with pytest.raises(SattrackError, match="does not hold any more"):
        learn([made(51, (turned,))], ["next.mcap"], KNOWN)
    passes = [made(seed, (turned,)) for seed in (51, 52, 53)]
    found = learn(passes, named(passes), KNOWN)
    assert any("does not hold any more" in note for note in found.notes)
    assert found.periodic is not None
    assert found.periodic.passes == 3
    assert abs(found.periodic.first[0].sin_arcsec + 8.0) < 0.5


def test_a_table_is_not_made_surer_by_the_passes_it_came_from() -> None:
    later = PeriodicErrors("2026-12-01T00:00:00Z", 3, KNOWN.first, ())
    passes = [made(seed, (GEAR,)) for seed in (1, 2, 3)]
    found = learn(passes, named(passes), later)
    assert found.periodic is not None
    assert found.periodic.passes == 3
    assert any("made anew" in note for note in found.notes)


def test_a_pointing_model_follows_slowly_what_passes_agree_on() -> None:
    hidden = {"MA": 40.0, "CH": -25.0}
    passes = [made(seed, (), 2.0, hidden, apart_arcsec=1.0) for seed in range(61, 67)]
    found = learn(passes, named(passes))
    assert found.terms is not None
    moved = {name: value for name, (value, _) in found.terms.items()}
    assert 10.0 < moved["MA"] < 45.0
    assert -30.0 < moved["CH"] < -6.0
    assert all(sigma < 4.0 for _, sigma in found.terms.values())
    assert all(one.with_arcsec < one.without_arcsec for one in found.terms_held_out)


def test_a_pointing_model_that_holds_is_left_alone() -> None:
    passes = [made(seed, (), 2.0) for seed in range(71, 77)]
    found = learn(passes, named(passes))
    assert found.terms is None or max(abs(value) for value, _ in found.terms.values()) < 5.0
