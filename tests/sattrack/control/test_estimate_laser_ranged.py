"""The estimate against a satellite that is known to centimetres: LAGEOS-1 by laser ranging (ILRS, CPF).

SGP4's elements are fitted to the first part of the predictions, as a catalogue does, and on their own then.
"""

from __future__ import annotations

import math
import random
from dataclasses import replace
from pathlib import Path

import bias as bench
import numpy as np
import pytest
from integrated import julian

from sattrack.runtime import demo_pass
from tle.earth import EarthOrientation
from tle.elements import MU_KM3_S2, Elements
from tle.instants import DAY_S, Utc
from tle.orbit_fit import STATES, CorrectableOrbit
from tle.propagator import Propagator

CPF = Path(__file__).resolve().parents[4] / "shared/cases/ephemerides/ilrs/lageos1_cpf_180613_16401.hts"
NODES = 12
FITTED_DAYS = 0.7


class Predicted:
    """Places of a CPF file, Earth-fixed and every 300 s, interpolated in TEME by polynomials."""

    def __init__(self, path: Path) -> None:
        rows = [line.split() for line in path.read_text().splitlines() if line.startswith("10 ")]
        self.instants = np.array([(int(row[2]) - 40587) * DAY_S + float(row[3]) for row in rows])
        earth, places = EarthOrientation.installed(), []
        for instant, row in zip(self.instants, rows, strict=True):
            theta, _, _, _, xp, yp = earth.rotation(float(instant))
            x, y, z = (float(value) / 1000.0 for value in row[5:8])
            x, y, z = x - xp * z, y + yp * z, z + xp * x - yp * y
            c, s = math.cos(theta), math.sin(theta)
            places.append((x * c - y * s, x * s + y * c, z))
        self._places = np.array(places)
        self.elements: Elements

    def at(self, unix_s: float, later_s: float) -> tuple[float, ...]:
        """Return position, velocity and acceleration, km, and 0, as `tle.motion` does."""
        at_s = unix_s + later_s
        first = int(np.searchsorted(self.instants, at_s)) - NODES // 2
        first = min(max(0, first), len(self.instants) - NODES)
        scale_s = self.instants[1] - self.instants[0]
        nodes = (self.instants[first : first + NODES] - at_s) / scale_s
        terms = np.linalg.solve(np.vander(nodes, increasing=True), self._places[first : first + NODES])
        r, v, a = terms[0], terms[1] / scale_s, 2.0 * terms[2] / scale_s**2
        return (*map(float, r), *map(float, v), *map(float, a), 0)


def osculating(motion: Predicted, at_s: float) -> Elements:
    """Return Kepler's elements of the state at an instant: where the fit begins."""
    state = np.array(motion.at(at_s, 0.0)[:6])
    r, v = state[:3], state[3:]
    h = np.cross(r, v)
    e = np.cross(v, h) / MU_KM3_S2 - r / np.linalg.norm(r)
    a = 1.0 / (2.0 / np.linalg.norm(r) - v @ v / MU_KM3_S2)
    node = np.array([-h[1], h[0], 0.0])
    normal = h / np.linalg.norm(h)
    size = float(np.linalg.norm(e))
    true = math.atan2(np.cross(e, r) @ normal, e @ r)
    eccentric = 2.0 * math.atan(math.sqrt((1.0 - size) / (1.0 + size)) * math.tan(0.5 * true))
    return replace(
        demo_pass.elements(),
        name="LAGEOS 1",
        catalog_number=8820,
        epoch=Utc(at_s),
        inclination_deg=math.degrees(math.acos(normal[2])),
        raan_deg=math.degrees(math.atan2(node[1], node[0])) % 360.0,
        eccentricity=size,
        arg_perigee_deg=math.degrees(math.atan2(np.cross(node, e) @ normal, node @ e)) % 360.0,
        mean_anomaly_deg=math.degrees(eccentric - size * math.sin(eccentric)) % 360.0,
        mean_motion_rev_day=DAY_S / (2.0 * math.pi) * math.sqrt(MU_KM3_S2 / a**3),
        mean_motion_dot_rev_day2=0.0,
        mean_motion_ddot_rev_day3=0.0,
        bstar_per_earth_radius=0.0,
    )


def fitted(motion: Predicted, first_s: float, last_s: float) -> Elements:
    instants = np.arange(first_s, last_s, 600.0)
    wanted = np.array([motion.at(float(t), 0.0)[:3] for t in instants]).ravel()
    found = osculating(motion, 0.5 * (first_s + last_s))
    for _ in range(12):
        orbit = CorrectableOrbit(found, Utc(last_s))
        records = [orbit.corrected(step).satrec() for step in (np.zeros(STATES), *(0.5 * np.eye(STATES)))]
        here, *moved = (
            np.array([one.sgp4(*julian(float(t)))[1] for t in instants]).ravel() for one in records
        )
        by_state = np.stack([(there - here) / 0.5 for there in moved], axis=1)
        change = np.linalg.lstsq(by_state, wanted - here, rcond=None)[0]
        found = orbit.corrected(change * min(1.0, 300.0 / float(np.abs(change).max())))
    return found


@pytest.mark.skipif(not CPF.is_file(), reason="the reference cases (../shared/cases) are not here")
def test_solutions_of_a_laser_ranged_satellite_are_taken_and_sigmas_cover_its_errors() -> None:
    motion = Predicted(CPF)
    first_s = float(motion.instants[NODES])
    epoch_s = first_s + FITTED_DAYS * DAY_S
    elements = motion.elements = fitted(motion, first_s, epoch_s)
    site, tally = demo_pass.SITE.place(), bench.Tally()
    scene = bench.Scene(elements, motion, site)  # type: ignore[arg-type] # a motion by another way
    last_s = float(motion.instants[-NODES])
    for rise_s, set_s in scene.passes(0.01, (last_s - epoch_s) / DAY_S):
        instants = [float(second) for second in range(int(rise_s), int(set_s), 30)]
        rng = random.Random(int(rise_s))
        bench.follow_pass(tally, Propagator(elements, site), motion, instants, rng, set_s)  # type: ignore[arg-type]
    assert tally.passes >= 5
    assert tally.taken >= 0.97 * tally.solutions
    assert np.mean(tally.nis) == pytest.approx(1.8, abs=0.25)
    normalised = np.abs([*tally.along, *tally.across])
    assert np.mean(normalised <= 2.0) > 0.88
    assert max(tally.end_arcsec) < 3.0
