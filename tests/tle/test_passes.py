from __future__ import annotations

import json

import numpy as np
import pytest
from tle_facts import DECAYING, ISS, LEIDEN, MOLNIYA, PARANAL, TDRS3

from tle.earth import EarthOrientation
from tle.elements import Elements
from tle.errors import DecayedError, SiteError, TimeRangeError
from tle.instants import Utc
from tle.passes import find_passes
from tle.propagator import Propagator
from tle.site import Site

START = Utc.parse("2026-10-02")
OVER_LEIDEN = Propagator(Elements.from_tle(*ISS), Site(*LEIDEN))


def test_reference_passes(cases):
    compared = 0
    for case in json.loads((cases / "tracks" / "passes.json").read_text()):
        elements = Elements.from_tle(case["line1"], case["line2"])
        propagator = Propagator(elements, Site(case["lat"], case["lon"], case["h_m"]))
        found = find_passes(propagator, Utc.parse(case["start"]), case["hours"], case["horizon_deg"])
        assert len(found) == len(case["passes"])
        for ours, theirs in zip(found, case["passes"], strict=True):
            compared += 1
            for instant, key in (("rise_utc", "aos"), ("culminate_utc", "tca"), ("set_utc", "los")):
                assert abs(getattr(ours, instant) - Utc.parse(theirs[key])) < 0.02
            for angle, key in (
                ("rise_az_deg", "az_aos"),
                ("set_az_deg", "az_los"),
                ("max_alt_deg", "max_el_deg"),
            ):
                assert getattr(ours, angle) == pytest.approx(theirs[key], abs=0.001)
    assert compared == 178


def test_the_pass_over_leiden():
    # Reference pass: rise 12:59:53.652, culmination 13:05:24.226 at 81.27188°, set 13:10:54.042, above 0°.
    (found,) = [p for p in find_passes(OVER_LEIDEN, START, 24.0, 0.0) if p.max_alt_deg > 80.0]
    assert abs(found.rise_utc - Utc.parse("2026-10-02T12:59:53.652Z")) < 0.02
    assert abs(found.culminate_utc - Utc.parse("2026-10-02T13:05:24.226Z")) < 0.02
    assert abs(found.set_utc - Utc.parse("2026-10-02T13:10:54.042Z")) < 0.02
    assert found.max_alt_deg == pytest.approx(81.27188, abs=0.001)
    angles = (found.rise_az_deg, found.culminate_az_deg, found.set_az_deg)
    assert angles == pytest.approx((261.9923, 174.5562, 87.1343), abs=0.001)


@pytest.mark.parametrize(
    ("lines", "place", "start"),
    [(ISS, LEIDEN, "2026-10-02"), (MOLNIYA, PARANAL, "2025-09-02"), (TDRS3, LEIDEN, "2026-06-01")],
    ids=["LEO", "HEO", "GSO"],
)
@pytest.mark.parametrize("min_alt_deg", [-30.0, 0.0, 10.0, 37.9])
def test_none_is_missed(lines, place, start, min_alt_deg):
    propagator = Propagator(Elements.from_tle(*lines), Site(*place), place="geometric")
    first = Utc.parse(start)
    times = Utc(first.unix_s + np.arange(0.0, 86400.0, 1.0))
    above = propagator.at(times).alt_deg > min_alt_deg
    found = find_passes(propagator, first, 24.0, min_alt_deg)
    covered = np.zeros(len(times), dtype=bool)
    for one in found:
        rise_s = -np.inf if one.rise_utc is None else one.rise_utc.unix_s
        set_s = np.inf if one.set_utc is None else one.set_utc.unix_s
        covered |= (times.unix_s > rise_s) & (times.unix_s < set_s)
        assert one.max_alt_deg > min_alt_deg
    assert (covered == above).all()


def test_a_pass_of_seconds_is_found():
    highest = max(find_passes(OVER_LEIDEN, START, 24.0, 0.0), key=lambda p: p.max_alt_deg)
    (found,) = find_passes(OVER_LEIDEN, START, 24.0, highest.max_alt_deg - 1e-2)
    assert 0.1 < found.set_utc - found.rise_utc < 3.0
    assert find_passes(OVER_LEIDEN, START, 24.0, highest.max_alt_deg + 1e-4) == []


def test_passes_cut_by_the_ends_of_the_span():
    begun = find_passes(OVER_LEIDEN, Utc.parse("2026-10-02T13:03:00Z"), 0.02, 10.0)
    assert [(p.rise_utc, p.set_utc) for p in begun] == [(None, None)]
    assert begun[0].culminate_utc == Utc.parse("2026-10-02T13:03:00Z").plus(72.0)
    (rising,) = find_passes(OVER_LEIDEN, Utc.parse("2026-10-02T12:55:00Z"), 0.2, 10.0)
    assert rising.rise_utc is not None
    assert rising.set_utc is None
    assert rising.set_az_deg is None
    (setting,) = find_passes(OVER_LEIDEN, Utc.parse("2026-10-02T13:06:00Z"), 0.2, 10.0)
    assert setting.rise_utc is None
    assert setting.culminate_utc == Utc.parse("2026-10-02T13:06:00Z")
    assert setting.set_utc is not None


def test_a_satellite_that_is_always_up_and_one_that_never_is():
    always = Propagator(Elements.from_tle(*TDRS3), Site(*PARANAL))
    (one,) = find_passes(always, Utc.parse("2026-06-01"), 3.0, 10.0)
    assert (one.rise_utc, one.set_utc) == (None, None)
    assert one.max_alt_deg > 60.0
    assert find_passes(always, Utc.parse("2026-06-01"), 48.0, 89.0) == []


def test_decay_ends_the_span():
    elements = Elements.from_tle(*DECAYING)
    propagator = Propagator(elements, Site(*LEIDEN), earth=EarthOrientation.fixed(0.0))
    last = elements.epoch.plus(424 * 60.0)
    found = find_passes(propagator, elements.epoch, 48.0, -90.0)
    assert [p.culminate_utc <= last for p in found] == [True]
    with pytest.raises(DecayedError):
        find_passes(propagator, elements.epoch.plus(430 * 60.0), 1.0)


@pytest.mark.parametrize("hours", [0.0, -1.0, float("nan"), 1e6])
def test_spans_of_no_sense_are_refused(hours):
    with pytest.raises(TimeRangeError, match="hours is no span"):
        find_passes(OVER_LEIDEN, START, hours)
    with pytest.raises(SiteError, match="least altitude"):
        find_passes(OVER_LEIDEN, START, 1.0, 95.0)
