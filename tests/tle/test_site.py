from __future__ import annotations

import pickle

import erfa
import numpy as np
import pytest
from tle_facts import LEIDEN, PARANAL

from tle.errors import SiteError
from tle.site import Site


@pytest.mark.parametrize(
    "place", [LEIDEN, PARANAL, (0.0, 0.0, 0.0), (90.0, 0.0, 2800.0), (-90.0, 0.0, 2800.0)]
)
def test_sites_are_where_erfa_puts_them(place):
    latitude, longitude, height = place
    theirs = erfa.gd2gc(1, np.radians(longitude), np.radians(latitude), height) / 1000.0
    assert Site(*place).itrs_km == pytest.approx(theirs, abs=1e-9)


def test_the_horizon_has_three_axes():
    site = Site(*LEIDEN)
    axes = np.array([site.east, site.north, site.up])
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert site.east[2] == 0.0
    assert site.north[2] > 0.0
    assert np.array(site.up) @ np.array(site.itrs_km) > 6300.0


@pytest.mark.parametrize(
    ("numbers", "words", "field"),
    [
        ((90.1, 0.0), "latitude of 90.1 is outside -90 to 90 degrees north", "latitude_deg"),
        ((float("nan"), 0.0), "latitude of nan", "latitude_deg"),
        ((0.0, 361.0), "longitude of 361.0 is outside -180 to 360 degrees east", "longitude_deg"),
        ((0.0, float("inf")), "longitude of inf", "longitude_deg"),
        ((0.0, 0.0, 2e5), "height of 200000.0 is outside", "height_m"),
        ((0.0, 0.0, float("nan")), "height of nan", "height_m"),
        (("52", 4.5), "latitude is '52': give a number, degrees north", "latitude_deg"),
    ],
)
def test_places_that_are_none_are_refused(numbers, words, field):
    with pytest.raises(SiteError, match=words) as caught:
        Site(*numbers)
    assert caught.value.field == pickle.loads(pickle.dumps(caught.value)).field == field


def test_reads_a_site_from_text():
    assert Site.parse("52.15, 4.49,10") == Site(52.15, 4.49, 10.0)
    assert Site.parse("52.15,4.49") == Site(52.15, 4.49)
    for text in ("", "52.15", "52,4,0,1", "north,4,0", "52.15N,4.49E"):
        with pytest.raises(SiteError, match="is no site"):
            Site.parse(text)
    with pytest.raises(SiteError, match="latitude"):
        Site.parse("95,0,0")
