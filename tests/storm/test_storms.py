"""The whole program in storms of faults: no invariant breaks, and a seed gives the same storm each time."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import get_args

import msgspec
import pytest
from safety_draws import angle_deg, vector
from storm.draws import KINDS_OF_FAULTS, Fault, Person, draw
from storm.invariants import Watcher, judged
from storm.others import OTHERS_FROM_SEED, What
from storm.world import Judging, Sent, World
from storms import fought

from sattrack.cli.main import run
from sattrack.mount.simulator.sky import direction
from sattrack.pointing.terms import PointingModel

SEEDS = [
    *range(30),
    *range(1000, 1030),
    *range(5000, 5056),
    *range(300_003, 300_143, 7),
    *range(600_000, 600_064),
]
SOAKED = [
    *range(30, 500),
    *range(1030, 1500),
    *range(5056, 5600),
    *range(300_143, 302_000, 7),
    *range(600_064, 600_500),
]
"""From 1000 on the satellite crosses the floor; from 5000 on Alpaca and the antenna are among the servers; of
300,000 and more every seventh is a night; from 600,000 on mounts flip, have a geometry, and more."""
REGRESSIONS = [
    int(line.split()[0])
    for line in (Path(__file__).parent / "regressions.txt").read_text().splitlines()
    if line and not line.startswith("#")
]


@pytest.mark.parametrize("seed", [*SEEDS, *REGRESSIONS])
def test_no_invariant_breaks(seed: int) -> None:
    verdict, _ = judged(draw(seed))
    assert [str(one) for one in verdict.violations] == []


@pytest.mark.parametrize(("seed", "hours"), [(6001, 0.007), pytest.param(6000, 1.0, marks=pytest.mark.soak)])
def test_two_clients_that_fight_for_a_mount_break_nothing(seed: int, hours: float) -> None:
    verdict, _ = fought(draw(seed).fight(hours))
    assert [str(one) for one in verdict.violations] == []
    assert re.match(r"[1-9]\d* orders by one client, [1-9]\d* positions", verdict.why), verdict.why


@pytest.mark.soak
@pytest.mark.parametrize("seed", SOAKED)
def test_no_invariant_breaks_in_more(seed: int) -> None:
    verdict, _ = judged(draw(seed))
    assert [str(one) for one in verdict.violations] == []


class Wire(Judging):
    """Keeps a digest of all that was sent, and of where the axes were."""

    def __init__(self) -> None:
        self.digest = hashlib.sha256()

    def sent(self, world: World, sent: Sent) -> None:
        self.digest.update(f"{world.at_s!r} {sent.who}".encode() + sent.data)

    def turn(self, world: World, axes: object) -> None:
        self.digest.update(repr(axes).encode())


def test_a_seed_gives_the_same_storm_to_the_last_byte() -> None:
    digests = []
    for _ in range(2):
        wire = Wire()
        World(draw(3), wire).run()
        digests.append(wire.digest.hexdigest())
    assert digests[0] == digests[1]


def test_every_kind_of_fault_is_drawn() -> None:
    missing = set(KINDS_OF_FAULTS)
    for seed in (*range(400), *range(OTHERS_FROM_SEED, OTHERS_FROM_SEED + 40)):
        drawn = {fault.kind for fault in draw(seed).faults}
        assert drawn <= set(KINDS_OF_FAULTS)
        missing -= drawn
        if not missing:
            break
    assert not missing


def test_every_kind_of_mount_is_drawn_and_its_profile_tells_where_a_strangers_tube_looks() -> None:
    drawn = set()
    for seed in range(OTHERS_FROM_SEED, OTHERS_FROM_SEED + 40):
        storm = draw(seed)
        assert storm.other is not None
        drawn.add(storm.other.what)
        profile, (first, second) = storm.facts.profile, storm.stands
        if profile.frame is not None:
            ha, dec = profile.frame.direction(first, second)
        elif profile.pointing is not None:
            ha, dec = PointingModel.of(profile.pointing).looks(first, second)
        else:
            ha, dec = direction(first, second)
        assert angle_deg(vector(ha, dec), storm.judge().looks(first, second)) < 0.001
    assert drawn == set(get_args(What))


@pytest.mark.parametrize("kind", ["kill", "sleep"])
def test_after_the_end_of_the_process_the_guardian_or_the_program_stops_the_mount(kind: str) -> None:
    storm = replace(draw(4).fair(), faults=(Fault(12.0, kind, 30.0 if kind == "sleep" else 0.0),))
    watcher = Watcher(storm)
    ended = World(storm, watcher).run()
    assert not watcher.verdict.violations
    assert ended.killed == (kind == "kill")
    assert watcher.path[-1].speed_deg_s < 0.001


@pytest.mark.parametrize("seed", [13, 33])
@pytest.mark.parametrize("fault", [None, Fault(12.8, "kill"), Fault(12.1, "silent", 3.0)], ids=str)
def test_a_mount_that_counts_anew_from_each_abort_obeys_the_first(seed: int, fault: Fault | None) -> None:
    """It obeys 1.8 s late; the program dies meanwhile, or nothing is heard of the mount."""
    late_s, begun_s, brakes_s = 1.8, 12.0, 0.5
    fair = draw(seed).fair()
    profile = msgspec.structs.replace(fair.facts.profile, abort_delay_s=late_s)
    storm = replace(
        fair,
        facts=msgspec.structs.replace(fair.facts, profile=profile),
        parameters=fair.parameters | {"abort_delay_s": late_s},
        program="track",
        people=(Person(begun_s, "", "stop"),),
        faults=() if fault is None else (fault,),
    )
    assert storm.hardware.kind == "position_servo"
    watcher = Watcher(storm)
    World(storm, watcher).run()
    moving = [axes.utc_s - storm.begin_s for axes in watcher.path if axes.speed_deg_s > 0.01]
    assert begun_s + late_s < moving[-1] < begun_s + late_s + brakes_s


def test_a_storm_can_be_looked_at(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["storm", "--seed", "0", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["storm"]["seed"] == 0
    assert {"fault", "command", "program"} <= {one["what"] for one in document["trace"]}


def test_without_the_source_tree_storms_say_what_they_need(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("sattrack.cli.storm.BENCH", tmp_path)
    assert run(["storm", "--seed", "0"]) == 1
    assert "storms need the source tree" in capsys.readouterr().err


def test_a_late_motion_does_not_outlast_a_stop_where_the_link_is_seen_to_reorder() -> None:
    """Of a fifth of the datagrams each way, up to 8 s late, some come after the mount was seen at rest."""
    verdict, _ = judged(draw(212).overtaken(8.0, both=True))
    assert verdict.left_at_rest
