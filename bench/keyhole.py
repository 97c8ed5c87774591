"""What passes near the celestial pole lose to the keyhole: by clipping, and by the way that loses least.

python bench/keyhole.py [PASSES] [--flown N]

Random low orbits over random sites, kept where they come within 2° of the pole; a mount of 6 °/s and 10 °/s²
whose declination axis goes round. Clipping is ideal: the axis follows to its limit, runs at it, and joins the
target as soon as it can. Flown: the engine and the simulated mount, in virtual time, both ways.
"""

from __future__ import annotations

import argparse
import random
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from rehearsal_draws import orbit

from sattrack.core.errors import SattrackError
from sattrack.mount.profiles import ProfileFile
from sattrack.planning.path import Keyhole, axis_path, find_keyholes
from sattrack.runtime.facts import RunRequest, build_engine, prepare
from sattrack.runtime.flight import fly_virtual
from sattrack.safety import SafetyLimits
from tle.instants import Utc
from tle.site import Site

if TYPE_CHECKING:
    from sattrack.runtime.facts import Prepared

WITHIN_DEG = 2.0
LONGEST_S = 900.0
STEP_S = 0.05
MOUNT = ProfileFile(
    name="free", hour_angle_limit_deg=450.0, dec_axis_limits_deg=(-270.0, 270.0), through_pole=True
)
STAYS = msgspec.structs.replace(MOUNT, through_pole=False)
NO_SUN = SafetyLimits(optical=False)


@dataclass(frozen=True)
class PolarPass:
    """A pass with the keyholes that it has."""

    prepared: Prepared
    keyholes: list[Keyhole]


def polar_pass(seed: int) -> PolarPass:
    """Return a pass that comes within WITHIN_DEG of the pole, faster there than the mount can turn."""
    dice = random.Random(f"polar {seed}")
    while True:
        elements = orbit(dice)
        latitude = dice.choice([-1.0, 1.0]) * dice.uniform(20.0, 65.0)
        site = Site(latitude, dice.uniform(-180.0, 180.0), dice.uniform(0.0, 3000.0))
        at = Utc(float(Utc.parse("2026-10-02T00:00:00Z").unix_s) + dice.uniform(0.0, 86400.0))
        request = RunRequest(
            satellite=elements.name,
            mount_url="sim",
            elements=[elements],
            site=site,
            clock_option=at.isoformat("seconds"),
            min_alt_deg=10.0,
            virtual=True,
            profile=STAYS,
            limits=NO_SUN,
        )
        try:
            prepared = prepare(request)
        except SattrackError:
            continue
        plan = prepared.facts.plan
        duration_s = plan.end_utc_s - plan.start_utc_s
        spec = build_engine(prepared.facts).spec
        coarse = spec.propagator.at(Utc(np.linspace(plan.start_utc_s, plan.end_utc_s, 200)))
        if duration_s > LONGEST_S or np.max(np.abs(coarse.dec_deg)) < 90.0 - 3.0 * WITHIN_DEG:
            continue
        instants = np.arange(plan.start_utc_s, plan.end_utc_s, STEP_S)
        path = axis_path(spec.propagator, spec.bias, instants)
        if np.max(np.abs(path.pointing.dec_axis_deg)) < 90.0 - WITHIN_DEG:
            continue
        keyholes = find_keyholes(path, MOUNT.mount, plan.on_target_arcsec / 3600.0)
        if keyholes:
            return PolarPass(prepare(replace(request, profile=MOUNT)), keyholes)


def flown_lost_s(prepared: Prepared, through: bool) -> float:
    """Return the seconds off target of the pass as flown, with or without its detours."""
    plan = prepared.facts.plan
    if not through:
        plan = msgspec.structs.replace(plan, detours=())
    facts = msgspec.structs.replace(prepared.facts, plan=plan)
    summary = fly_virtual(replace(prepared, facts=facts))
    return plan.end_utc_s - plan.start_utc_s - summary.on_target_s


def spread(values: list[float]) -> str:
    low, first, middle, third, high = np.quantile(values, [0.0, 0.25, 0.5, 0.75, 1.0])
    return f"least {low:.2f}, quarters {first:.2f}, {middle:.2f}, {third:.2f}, most {high:.2f}"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("passes", nargs="?", type=int, default=150)
    parser.add_argument("--flown", type=int, default=10, help="how many of them are flown both ways")
    asked = parser.parse_args()
    count = asked.passes
    passes = [polar_pass(seed) for seed in range(count)]
    holes = [hole for one in passes for hole in one.keyholes]
    best = [min(h.clipped_s, h.round_s, h.through_s or h.clipped_s) for h in holes]
    ratios = [b / h.clipped_s for b, h in zip(best, holes, strict=True)]
    print(f"{count} passes within {WITHIN_DEG:g}° of the pole, {len(holes)} keyholes")
    print(f"distance from the pole, degrees: {spread([h.polar_distance_deg for h in holes])}")
    print(f"peak rate of the hour angle, °/s: {spread([h.peak_rate_deg_s for h in holes])}")
    print(f"lost by clipping, s: {spread([h.clipped_s for h in holes])}")
    print(f"lost by the best way on this side of the pole, s: {spread([h.round_s for h in holes])}")
    print(f"lost by the best way of all, s: {spread(best)}")
    print(f"ratio of the best to clipping: {spread(ratios)}")
    half = sum(r <= 0.5 for r in ratios)
    share = sum(best) / sum(h.clipped_s for h in holes)
    print(f"at most half of clipping: {half} of {len(ratios)}; of the seconds of all: {share:.2f}")
    must = [h.end_utc_s - h.begin_utc_s for h in holes]
    hopeless = [m > 0.5 * h.clipped_s for m, h in zip(must, holes, strict=True)]
    print(f"too fast to be followed, by any way, for more than half of what clipping loses: {sum(hopeless)}")
    others = [r for r, h in zip(ratios, hopeless, strict=True) if not h]
    print(f"of the other {len(others)}: ratio {spread(others)}; {sum(r <= 0.5 for r in others)} at most half")
    for low, high in ((0.0, 0.5), (0.5, 1.0), (1.0, 1.5), (1.5, 2.0)):
        some = [r for r, h in zip(ratios, holes, strict=True) if low <= h.polar_distance_deg < high]
        if some:
            print(f"ratio between {low:g}° and {high:g}° from the pole ({len(some)}): {spread(some)}")
    if asked.flown:
        fly(passes[: asked.flown])


def fly(passes: list[PolarPass]) -> None:
    """Fly passes by clipping and through the pole, and print what each loses beside what was planned."""
    pairs = [(flown_lost_s(one.prepared, False), flown_lost_s(one.prepared, True)) for one in passes]
    for k, (one, (clipped, through)) in enumerate(zip(passes, pairs, strict=True)):
        told = ", ".join(f"{h.clipped_s:.1f} and {h.through_s or h.clipped_s:.1f}" for h in one.keyholes)
        print(f"flown {k}: {clipped:.1f} s lost by clipping, {through:.1f} s as planned (planned: {told})")
    clipped_s, through_s = (sum(pair[way] for pair in pairs) for way in (0, 1))
    print(
        f"flown, all {len(pairs)}: {clipped_s:.1f} s by clipping, {through_s:.1f} s as planned: "
        f"{through_s / clipped_s:.2f}"
    )


if __name__ == "__main__":
    main()
