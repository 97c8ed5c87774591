"""Gears that no report shows, learnt as a user does from recorded passes under a simulated sky."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import periodic
import pytest

from sattrack.mount.model import MountProfile
from sattrack.mount.profiles import load_profile_file
from sattrack.mount.simulator.hidden import waves

if TYPE_CHECKING:
    from pathlib import Path

SEED, PASSES = 3, 4
NOISE_ARCSEC = periodic.NOISE_ARCSEC * math.sqrt(2.0)


@pytest.mark.soak
def test_a_hidden_gear_is_a_fifth_at_held_out_passes_and_one_that_was_turned_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    facts, mount = periodic.passes_of_demo(PASSES + 1), periodic.drawn(SEED)
    files = [tmp_path / f"pass{k}.mcap" for k in range(PASSES)]
    for k, file in enumerate(files):
        periodic.follow(facts[k], mount, MountProfile(), k, file)
    assert periodic.learnt(files, tmp_path / "learnt.toml") == 0
    known = load_profile_file(tmp_path / "learnt.toml").mount
    assert known.periodic is not None
    assert known.periodic.without_arcsec is not None
    assert known.periodic.with_arcsec is not None
    before, after = (
        math.sqrt(max(0.0, one**2 - NOISE_ARCSEC**2))
        for one in (known.periodic.without_arcsec, known.periodic.with_arcsec)
    )
    assert after < before / 5.0
    size, cycles, phase_deg = waves(mount.hidden.ha_wave)[0]
    found = next(wave for wave in known.periodic.first if wave.cycles == cycles)
    assert found.sin_arcsec == pytest.approx(size * math.cos(math.radians(phase_deg)), abs=1.0)
    assert found.cos_arcsec == pytest.approx(size * math.sin(math.radians(phase_deg)), abs=1.0)

    state, seen = mount.rng.getstate(), []
    for profile in (MountProfile(), known):
        mount.rng.setstate(state)
        seen.append(periodic.follow(facts[PASSES], mount, profile, PASSES).seen_rms())
    assert seen[1] < seen[0]

    turned = tmp_path / "turned.mcap"
    periodic.follow(facts[PASSES], mount, MountProfile(), PASSES, turned, turned_deg=periodic.HALF_WAVE_DEG)
    capsys.readouterr()
    assert periodic.learnt([*files, turned], tmp_path / "none.toml") == 1
    assert "turned.mcap: its wave of" in capsys.readouterr().err
    assert not (tmp_path / "none.toml").exists()
