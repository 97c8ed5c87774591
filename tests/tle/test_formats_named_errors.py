"""What SGP4 cannot propagate is an exception with a name of its own, never numbers."""

from __future__ import annotations

import dataclasses
import pickle

import pytest
from tle_facts import DECAYING, ISS

from tle.elements import Elements, Motion, propagation_error
from tle.errors import (
    AmbiguousSatelliteError,
    ChecksumError,
    DecayedError,
    EphemerisError,
    MeanElementsError,
    MeanMotionError,
    PerturbedElementsError,
    PropagationError,
    SemiLatusRectumError,
    SubOrbitalError,
    TleError,
)

ZARYA = Elements.from_tle(*ISS, name="ISS (ZARYA)")


@pytest.mark.parametrize(
    ("code", "kind"),
    [
        (1, MeanElementsError),
        (2, MeanMotionError),
        (3, PerturbedElementsError),
        (4, SemiLatusRectumError),
        (6, DecayedError),
        (99, PropagationError),
    ],
)
def test_each_of_sgp4s_errors_has_its_name(code, kind):
    error = propagation_error(code, ZARYA, ZARYA.epoch.plus(86400.0))
    assert type(error) is kind
    assert isinstance(error, PropagationError)
    assert (error.code, error.exit_code) == (code, 1)
    assert "ISS (ZARYA) (25544)" in str(error)
    assert "+1.0 days" in str(error)
    assert "\n" not in str(error)


def test_an_object_that_has_decayed_and_one_that_was_never_in_orbit():
    decaying = Elements.from_tle(*DECAYING)
    with pytest.raises(DecayedError) as error:
        Motion(decaying).at(decaying.epoch.unix_s + 430.0 * 60.0, 0.0)
    assert not isinstance(error.value, SubOrbitalError)
    # Vallado et al. 2006, verification set: 28872 is sub-orbital; SGP4 fails it on the way to its perigee.
    sub_orbital = dataclasses.replace(
        ZARYA,
        inclination_deg=96.4736,
        raan_deg=157.9986,
        eccentricity=0.0303955,
        arg_perigee_deg=244.0492,
        mean_anomaly_deg=110.6523,
        mean_motion_rev_day=16.46015938,
        bstar_per_earth_radius=0.24476e-3,
    )
    assert sub_orbital.perigee_km < 0.0 < sub_orbital.apogee_km
    with pytest.raises(
        SubOrbitalError, match=r"it is sub-orbital, its elements have their perigee 49 km inside"
    ):
        Motion(sub_orbital).at(sub_orbital.epoch.unix_s + 60.6 * 60.0, 0.0)


def test_elements_of_no_orbit_are_refused_at_their_epoch():
    impossible = dataclasses.replace(ZARYA, eccentricity=0.9906, mean_motion_rev_day=0.01)
    with pytest.raises(PropagationError):
        Motion(impossible).at(impossible.epoch.unix_s, 0.0)


def test_heights_of_known_orbits():
    # A circular orbit of one sidereal day, 86164.0905 s: 42164 km from the Earth's centre.
    geo = dataclasses.replace(ZARYA, mean_motion_rev_day=86400.0 / 86164.0905, eccentricity=0.0)
    assert geo.semi_major_axis_km == pytest.approx(42164.2, abs=0.5)
    assert geo.apogee_km == geo.perigee_km == pytest.approx(35786.0, abs=0.5)


@pytest.mark.parametrize(
    "error",
    [
        SubOrbitalError("it is below the ground", 6),
        ChecksumError("the checksum is wrong", source="a.tle", line=2, text="2 25544", columns=(1, 2)),
        AmbiguousSatelliteError("several", ("ISS", "ISS DEB")),
        EphemerisError("no rows", source="a.cpf", line=7),
    ],
)
def test_an_error_of_another_process_is_the_same_here(error: TleError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert (str(again), vars(again)) == (str(error), vars(error))
    assert again.exit_code == error.exit_code
