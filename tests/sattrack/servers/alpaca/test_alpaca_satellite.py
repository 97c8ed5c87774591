"""Satellites by way of Alpaca's actions: followed, offset, refused to others, given up."""

from __future__ import annotations

import json
from operator import attrgetter

import msgspec
import pytest
from alpaca_stand import BEGIN_UTC_S, PROFILE, VirtualTelescope
from antenna_harness import SITE, separation_arcsec
from msgspec.structs import replace

from sattrack.runtime import demo_pass
from sattrack.runtime.facts import encode_facts
from sattrack.safety import SafetyLimits
from sattrack.servers.alpaca.protocol import Fault, FollowOrder, Number, Passes, TrackSatellite
from sattrack.servers.alpaca.serve import Satellites, run_summary
from sattrack.settings import SiteSettings
from tle.instants import Utc
from tle.propagator import Propagator

LIMITS = SafetyLimits(optical=False)
SATELLITES = Satellites(
    elements=[demo_pass.elements()],
    site=SiteSettings(SITE.latitude_deg, SITE.longitude_deg, SITE.height_m),
    profile=PROFILE,
    limits=LIMITS,
    min_alt_deg=10.0,
    refraction="off",
    mount="the simulated mount",
)


IN_THE_PASS_UTC_S = BEGIN_UTC_S + 130.0
ACQUIRED_AFTER_S = 25.0


def follow(scope: VirtualTelescope, seconds: float) -> None:
    facts = SATELLITES.facts(TrackSatellite("ISS"), scope.now_utc_s)
    number = scope.give(FollowOrder(msgspec.Raw(encode_facts(facts))))
    answer = scope.answered(number)
    assert answer is not None
    assert answer.fault == 0, answer.message
    scope.run_for(seconds)


def off_arcsec(scope: VirtualTelescope, along_s: float = 0.0) -> float:
    """Return how far the axes themselves are from the satellite, seen so many seconds ahead on its track."""
    truth = scope.truths[-1]
    propagator = Propagator(demo_pass.elements(), SITE)
    if along_s:
        from tle.bias import Bias

        propagator = Propagator(demo_pass.elements(), SITE, Bias(along_s, 0.0))
    seen = propagator.at(Utc(truth.utc_s))
    return separation_arcsec(truth.ra_deg, truth.dec_deg, float(seen.ra_deg), float(seen.dec_deg))


def test_a_satellite_is_followed_as_track_follows_it_and_told_of() -> None:
    scope = VirtualTelescope(begin_utc_s=BEGIN_UTC_S + 105.0)
    follow(scope, 5.0)
    assert scope.get("slewing") is True
    scope.run_until(BEGIN_UTC_S + 150.0)
    assert scope.get("slewing") is False
    assert scope.get("tracking") is True
    assert off_arcsec(scope) < 1.0
    told = scope.telescope.state
    assert told is not None
    assert told.following is not None
    assert (told.following.catalog_number, told.following.acquired) == (25544, True)


def test_a_bias_is_set_added_to_and_followed_and_told() -> None:
    scope = VirtualTelescope(begin_utc_s=IN_THE_PASS_UTC_S)
    assert scope.fault_of("action", Action="Bias", Parameters='{"along_s": 1}') is Number.INVALID_OPERATION
    follow(scope, ACQUIRED_AFTER_S)
    scope.put("action", Action="Bias", Parameters='{"along_s": 0.5}')
    scope.run_for(12.0)
    assert off_arcsec(scope, 0.5) < 1.0
    scope.put("action", Action="BIAS", Parameters='{"along_s": -0.2, "add": true}')
    scope.run_for(12.0)
    assert off_arcsec(scope, 0.3) < 1.0
    told = scope.telescope.state
    assert told is not None
    assert told.following is not None
    assert told.following.along_s == pytest.approx(0.3)
    for wrong in ('{"along_s": 5000}', '{"along": 1}', "1", '{"along_s": "x"}', "[" * 5000):
        assert scope.fault_of("action", Action="Bias", Parameters=wrong) is Number.INVALID_VALUE, wrong
    assert off_arcsec(scope, 0.3) < 1.0


def test_while_a_satellite_is_followed_other_commands_are_refused_by_its_name_and_an_abort_ends_it() -> None:
    scope = VirtualTelescope(begin_utc_s=IN_THE_PASS_UTC_S)
    follow(scope, ACQUIRED_AFTER_S)
    ra_h = scope.get("rightascension")
    refused = [
        ("moveaxis", {"Axis": 0, "Rate": 1.0}),
        ("slewtocoordinatesasync", {"RightAscension": ra_h, "Declination": 40.0}),
        ("synctocoordinates", {"RightAscension": ra_h, "Declination": 40.0}),
        ("findhome", {}),
        ("park", {}),
        ("rightascensionrate", {"RightAscensionRate": 0.1}),
        ("pulseguide", {"Direction": 0, "Duration": 100}),
    ]
    for member, parameters in refused:
        with pytest.raises(Fault, match=r"ISS \(ZARYA\)") as raised:
            scope.put(member, **parameters)
        assert raised.value.number is Number.INVALID_OPERATION
    assert off_arcsec(scope) < 1.0
    scope.put("abortslew")
    scope.run_for(5.0)
    stands = scope.truths[-1]
    scope.run_for(2.0)
    assert scope.truths[-1].dec_deg == pytest.approx(stands.dec_deg, abs=1e-4)
    assert scope.get("slewing") is False
    scope.put("moveaxis", Axis=1, Rate=1.0)
    scope.run_for(1.0)
    scope.put("moveaxis", Axis=1, Rate=0)
    assert abs(scope.truths[-1].dec_deg - stands.dec_deg) > 0.3
    assert scope.get("tracking") is False, "the abort has left the mount standing"


def test_at_the_end_of_its_pass_the_mount_is_free_again() -> None:
    scope = VirtualTelescope(begin_utc_s=BEGIN_UTC_S + 480.0)
    follow(scope, 60.0)
    told = scope.telescope.state
    scope.get("slewing")
    told = scope.telescope.state
    assert told is not None
    assert told.following is None
    assert (told.doing, told.failure) == ("idle", None)
    assert scope.station.log_lines[-1] == "follows ISS (ZARYA) no more: set"
    assert scope.fault_of("moveaxis", Axis=1, Rate=1.0) is Number.OK


@pytest.mark.parametrize("part", ["steering.biases.at", "take"])
def test_a_satellite_whose_directions_fail_is_given_up_and_the_mount_stopped_and_free(
    part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scope = VirtualTelescope(begin_utc_s=IN_THE_PASS_UTC_S)
    follow(scope, ACQUIRED_AFTER_S)

    def broken(*_: object) -> None:
        raise ArithmeticError("the orbit has decayed")

    owner, _, name = f"tracker.{part}".rpartition(".")
    monkeypatch.setattr(attrgetter(owner)(scope.station.engine), name, broken)
    scope.run_for(5.0)
    with pytest.raises(Fault, match="decayed"):
        scope.get("slewing")
    stands = scope.truths[-1].dec_deg
    scope.run_for(1.0)
    assert scope.truths[-1].dec_deg == stands
    assert scope.fault_of("moveaxis", Axis=1, Rate=1.0) is Number.OK


def test_a_satellite_is_not_begun_in_mid_move() -> None:
    scope = VirtualTelescope()
    scope.put("moveaxis", Axis=1, Rate=1.0)
    facts = SATELLITES.facts(TrackSatellite("ISS"), scope.now_utc_s)
    answer = scope.answered(scope.give(FollowOrder(msgspec.Raw(encode_facts(facts)))))
    assert answer is not None
    assert answer.fault == Number.INVALID_OPERATION
    answer = scope.answered(scope.give(FollowOrder(msgspec.Raw(b'{"nonsense":1}'))))
    assert answer is not None
    assert answer.fault != 0
    assert scope.get("slewing") is True


def test_passes_are_those_of_the_command_line() -> None:
    (first, *_) = SATELLITES.passes(Passes("25544", hours=12.0), BEGIN_UTC_S)
    assert first["rise_utc"].startswith("2026-10-02T13:01:5")
    assert first["max_alt_deg"] == pytest.approx(81.27, abs=0.01)
    told = run_summary(SATELLITES.facts(TrackSatellite("1998-067A"), BEGIN_UTC_S))
    assert told["from_utc"] == first["rise_utc"]
    assert told["to_utc"] == first["set_utc"]
    json.dumps(told)


@pytest.mark.parametrize(
    ("satellites", "asked", "number", "words"),
    [
        (replace(SATELLITES, elements=[]), TrackSatellite("ISS"), Number.INVALID_OPERATION, "--elements"),
        (SATELLITES, TrackSatellite("HUBBLE"), Number.INVALID_VALUE, "HUBBLE"),
        (SATELLITES, TrackSatellite("ISS", 89.9), Number.INVALID_OPERATION, "does not rise above 89.9"),
        (
            replace(SATELLITES, limits=replace(LIMITS, floor_altitude_deg=20.0)),
            TrackSatellite("ISS", 15.0),
            Number.INVALID_VALUE,
            "kept above 20",
        ),
    ],
)
def test_what_cannot_be_followed_is_refused_with_the_reason(
    satellites: Satellites, asked: TrackSatellite, number: Number, words: str
) -> None:
    with pytest.raises(Fault, match=words) as raised:
        satellites.facts(asked, BEGIN_UTC_S)
    assert raised.value.number is number
