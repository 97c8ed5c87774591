"""The antenna's controller following satellites by elements, in the feeder's harness.

`python bench/antenna_feeder.py [--seeds N] [--rows GLOB]`: the mounts, links, passes and bounds of
`bench/feeder.py`; what steers is the station of `sattrack serve antenna`, told SAT over the interface. The
worst of the seeds; a row that misses a bound says so, and makes the exit code 1.
"""

from __future__ import annotations

import argparse
import fnmatch
import sys
from typing import TYPE_CHECKING

import msgspec
from feeder_passes import KANOPUS, SCENARIOS, SETTLED_S, subjects, world

from sattrack.runtime import demo_pass
from sattrack.servers.antenna.controller import AntennaStation
from sattrack.servers.antenna.equipment import Antenna
from sattrack.servers.antenna.led_mount import axis_range
from sattrack.servers.antenna.protocol import encode
from sattrack.servers.antenna.trajectory import SiteSky

if TYPE_CHECKING:
    from feeder_harness import Scenario
    from feeder_passes import Subject

LINES = {"ISS": (demo_pass.LINE_1, demo_pass.LINE_2), "KANOPUS": KANOPUS}
FIRST_SECOND_S = 1.0
"""When the satellite is asked for: the mount is heard by then."""


class ByElements:
    """A station that is told which satellite to follow."""

    period_s = 0.05

    def __init__(self, subject: Subject, scenario: Scenario) -> None:
        link, facts = scenario.link, subject.facts
        profile = msgspec.structs.replace(
            facts.profile,
            command_delay_s=link.command_s,
            status_delay_s=link.status_s,
            clock_offset_s=0.0,
            move_axis=scenario.move_axis,
        )
        antenna = Antenna(
            SiteSky(subject.propagator.site), "hadec", axis_range(profile, "hadec"), refraction="on"
        )
        self._station = AntennaStation(antenna, profile, facts.limits)
        self._number, self._lines = facts.elements.catalog_number, LINES[subject.name]
        self._ask_from_s = facts.started_utc_s + FIRST_SECOND_S
        self._asked = False

    def status(self, data: bytes, arrival_utc_s: float) -> None:
        self._station.receive(data, arrival_utc_s)

    def command(self, now_utc_s: float) -> bytes:
        if not self._asked and now_utc_s >= self._ask_from_s:
            self._ask(now_utc_s)
        return self._station.tick(now_utc_s)

    def shift_s(self, now_utc_s: float) -> float:
        return self._station.send_shift_s(now_utc_s)

    def repeat(self) -> bytes | None:
        return self._station.repeat()

    def _ask(self, now_utc_s: float) -> None:
        self._asked = True
        number = self._number
        said = [f"TLE {n} {number} {line}" for n, line in enumerate(self._lines, 1)] + [f"SAT {number}"]
        for message in said:
            answer, _ = self._station.receive_command(encode(message), now_utc_s)
            assert b" ACK " in answer, answer


def followed(subject: Subject, scenario: Scenario, seed: int) -> tuple[float, float]:
    """Return RMS and peak of a pass, from ten seconds after its rise, arcseconds."""
    run = world(subject, scenario, seed)
    run.run(ByElements(subject, scenario))
    plan = subject.facts.plan
    return run.figures(plan.start_utc_s + SETTLED_S, plan.end_utc_s - 0.1)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--rows", default="*", metavar="GLOB")
    options = parser.parse_args()
    missed = 0
    print(f"seeds 1 to {options.seeds}: the worst of each")
    print(f"{'scenario':40} {'pass':8} {'RMS″':>8} {'peak″':>8}   bounds")
    for scenario in SCENARIOS:
        if not fnmatch.fnmatch(scenario.name, options.rows):
            continue
        for subject in subjects():
            figures = [followed(subject, scenario, seed) for seed in range(1, options.seeds + 1)]
            rms, peak = (max(numbers) for numbers in zip(*figures, strict=True))
            bounds = scenario.bounds_arcsec
            over = rms > bounds[0] or peak > bounds[1]
            missed += over
            words = f"{bounds[0]:g}″ {bounds[1]:g}″" + ("   MISSED" if over else "")
            print(f"{scenario.name:40} {subject.name:8} {rms:8.3f} {peak:8.3f}   {words}", flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
