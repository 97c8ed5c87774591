"""Biases kept from one pass to the next: what is kept, how old it may be, and files that cannot be used."""

from __future__ import annotations

import json
import math
import os
import random
import sqlite3
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bias as bench
import msgspec
import pytest

from sattrack.cli.main import run
from sattrack.core.errors import SattrackError
from sattrack.recording.replay import replay
from sattrack.recording.trace import trace
from sattrack.runtime import demo_pass
from sattrack.runtime.bias_memory import BiasMemory, KeptBias, memory_file, uses_memory, worth_keeping
from sattrack.runtime.facts import Prepared, RunRequest, build_engine, engine_of, open_recording, prepare
from sattrack.runtime.flight import fly_virtual
from sattrack.views.messages import ClearBias, DropRemembered, Message, Nudge
from tle.bias import Bias
from tle.instants import Utc
from tle.propagator import Propagator

if TYPE_CHECKING:
    from collections.abc import Callable

    from sattrack.recording.trace import Trace
    from sattrack.views.run import Summary, TrackView

ELEMENTS = demo_pass.elements()
SEEN_UTC_S = float(Utc.parse("2026-10-02T11:29:24Z").unix_s)
PASS_UTC_S = float(Utc.parse("2026-10-02T13:05:24Z").unix_s)
FIT = KeptBias(
    source="observations",
    utc_s=SEEN_UTC_S,
    along_s=0.8,
    along_sigma_s=0.01,
    cross_km=-0.5,
    cross_sigma_km=0.02,
    observations=14,
    mount="mount.example:5000",
)
NUDGE = KeptBias(source="nudge", utc_s=SEEN_UTC_S, along_s=0.3, cross_deg=0.02)
WRITER = """
import sys
from pathlib import Path
from sattrack.runtime import demo_pass
from sattrack.runtime.bias_memory import BiasMemory, KeptBias
memory = BiasMemory(Path(sys.argv[1]))
for number in range(20):
    one = KeptBias("observations", 1e9 + number, 0.1, 0.01, 0.0, 0.1, observations=5)
    memory.keep(one, demo_pass.elements(), f"{sys.argv[2]} {number}")
"""


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BiasMemory:
    """The memory of a user who has none."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return BiasMemory(memory_file())


def ready(mode: str = "on", **changes: object) -> Prepared:
    """Return the last seconds of the built-in pass."""
    return prepare(
        RunRequest(
            satellite="25544",
            mount_url="sim",
            elements=[ELEMENTS],
            site=demo_pass.SITE.place(),
            clock_option="2026-10-02T13:05:15Z",
            min_alt_deg=78.0,
            virtual=True,
            memory=mode,  # type: ignore[arg-type]
            **changes,  # type: ignore[arg-type]
        )
    )


def fly(prepared: Prepared, *messages: tuple[float, Message]) -> tuple[Summary, list[TrackView]]:
    views: list[TrackView] = []
    return fly_virtual(prepared, views.append, messages), views


def test_the_file_is_where_the_user_keeps_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert memory_file() == tmp_path / "sattrack" / "biases.sqlite3"
    home = Path.home() / ".local" / "share" / "sattrack" / "biases.sqlite3"
    monkeypatch.setenv("XDG_DATA_HOME", "relative")
    assert memory_file() == home
    monkeypatch.delenv("XDG_DATA_HOME")
    assert memory_file() == home


def test_a_fit_comes_back_less_certain_the_older_it_is(memory: BiasMemory) -> None:
    assert memory.recall(ELEMENTS, PASS_UTC_S, "observations") is None
    assert not memory.path.exists()
    memory.keep(FIT, ELEMENTS, "one")
    found = memory.recall(ELEMENTS, SEEN_UTC_S + 43200.0, "observations")
    assert found is not None
    assert (found.along_s, found.cross_km, found.observations) == (0.8, -0.5, 14)
    assert found.along_sigma_s == pytest.approx(math.sqrt(0.01**2 + 0.2**2))
    assert found.cross_sigma_km == pytest.approx(math.sqrt(0.02**2 + 0.05**2))
    assert memory.recall(ELEMENTS, SEEN_UTC_S + 8 * 86400.0, "observations") is None
    assert memory.recall(ELEMENTS, PASS_UTC_S, "nudge") is None


def test_other_elements_of_the_same_object_have_none(memory: BiasMemory) -> None:
    memory.keep(FIT, ELEMENTS, "one")
    later = replace(ELEMENTS, epoch=ELEMENTS.epoch.plus(3600.0))
    corrected = replace(ELEMENTS, mean_anomaly_deg=ELEMENTS.mean_anomaly_deg + 0.0001)
    renamed = replace(ELEMENTS, name="ZARYA", element_set_number=7)
    assert memory.recall(later, PASS_UTC_S, "observations") is None
    assert memory.recall(corrected, PASS_UTC_S, "observations") is None
    assert memory.recall(renamed, PASS_UTC_S, "observations") is not None


def test_the_newest_that_was_not_dropped_is_offered(memory: BiasMemory) -> None:
    memory.keep(FIT, ELEMENTS, "one")
    memory.keep(msgspec.structs.replace(FIT, utc_s=SEEN_UTC_S + 60.0, along_s=0.9), ELEMENTS, "two")
    newest = memory.recall(ELEMENTS, PASS_UTC_S, "observations")
    assert newest is not None
    assert newest.along_s == 0.9
    assert memory.drop(newest.entry)
    assert not memory.drop(99)
    older = memory.recall(ELEMENTS, PASS_UTC_S, "observations")
    assert older is not None
    assert older.along_s == 0.8


def test_a_bias_of_a_time_when_the_clock_was_wrong_hides_none(memory: BiasMemory) -> None:
    memory.keep(FIT, ELEMENTS, "first")
    memory.keep(msgspec.structs.replace(FIT, utc_s=SEEN_UTC_S + 400.0 * 86400.0), ELEMENTS, "a year ahead")

    found = memory.recall(ELEMENTS, PASS_UTC_S, "observations")
    assert found is not None
    assert found.utc_s == SEEN_UTC_S


def test_a_file_that_was_begun_and_has_no_table_holds_nothing_yet(memory: BiasMemory) -> None:
    memory.path.parent.mkdir(parents=True)
    memory.path.touch()
    assert memory.entries() == []
    assert memory.recall(ELEMENTS, PASS_UTC_S, "observations") is None
    memory.keep(FIT, ELEMENTS, "first")
    assert len(memory.entries()) == 1


def test_a_report_takes_the_place_of_its_own_pass_and_what_was_dropped_stays_so(memory: BiasMemory) -> None:
    memory.keep(FIT, ELEMENTS, "one")
    memory.drop(1)
    memory.keep(msgspec.structs.replace(FIT, along_s=0.81, made_by="report"), ELEMENTS, "one")
    (only,) = memory.entries()
    assert (only.along_s, only.made_by, only.dropped) == (0.81, "report", True)


def test_too_few_observations_or_too_uncertain_a_fit_is_not_kept() -> None:
    assert worth_keeping(FIT)
    assert worth_keeping(NUDGE)
    for change in ({"observations": 2}, {"along_sigma_s": 3.0}, {"along_s": math.nan}, {"cross_km": None}):
        assert not worth_keeping(msgspec.structs.replace(FIT, **change))


def test_a_pass_begins_with_what_was_remembered_and_says_so(memory: BiasMemory, tmp_path: Path) -> None:
    memory.keep(FIT, ELEMENTS, "one")
    path = tmp_path / "second.mcap"
    prepared = ready(record=path)
    (words,) = prepared.notes
    assert "+0.800 ± 0.028 s along, -0.50 ± 0.02 km across, from 14 observations 1 h 36 min before" in words
    summary, views = fly(prepared)
    middle = views[len(views) // 2]
    assert middle.remembered is not None
    assert (middle.remembered.state, middle.remembered.entry) == ("in force", 1)
    assert summary.reported_rms_arcsec is not None
    assert summary.reported_rms_arcsec < 0.1
    biased = Propagator(ELEMENTS, demo_pass.SITE.place())
    seen = biased.at(Utc(middle.utc_s), Bias(0.8))
    assert middle.bias_along_s == 0.8
    assert middle.bias_cross_deg == pytest.approx(
        math.degrees(math.atan(-0.5 / float(seen.range_km))), rel=1e-3
    )
    assert summary.bias_memory is None, "what was only recalled is no news to keep"
    recording, facts = open_recording(path)
    assert facts.remembered is not None
    assert facts.remembered.along_s == 0.8
    memory.drop(1)
    again = replay(recording, engine_of)
    assert again.agrees
    assert again.differing == 0, "a replay reads the recording and no memory"


def test_the_operator_drops_it_with_one_word_and_it_is_offered_no_more(memory: BiasMemory) -> None:
    memory.keep(FIT, ELEMENTS, "one")
    summary, views = fly(ready(), (PASS_UTC_S, DropRemembered()))
    assert (views[-1].bias_along_s, views[-1].bias_cross_deg) == (0.0, 0.0)
    assert summary.remembered is not None
    assert summary.remembered.state == "dropped"
    assert summary.bias_memory == "the bias that was dropped is not offered again"
    assert summary.reported_peak_arcsec is not None
    assert summary.reported_peak_arcsec < 20.0, "it is left as gently as a nudge"
    assert ready().facts.remembered is None
    _, views = fly(ready(), (PASS_UTC_S, DropRemembered()))
    assert any("no remembered bias is in force" in words for view in views for words in view.warnings)


def test_clearing_takes_it_away_for_this_pass_alone(memory: BiasMemory) -> None:
    memory.keep(FIT, ELEMENTS, "one")
    summary, views = fly(ready(), (PASS_UTC_S, ClearBias()))
    assert views[-1].bias_along_s == 0.0
    assert summary.remembered is not None
    assert summary.remembered.state == "cleared"
    assert ready().facts.remembered is not None


def test_a_nudge_is_kept_as_one_and_used_only_where_that_is_asked_for(memory: BiasMemory) -> None:
    summary, _ = fly(ready(), (PASS_UTC_S, Nudge(along_s=0.3, cross_deg=0.02)))
    assert summary.bias_memory is not None
    assert "+0.300 s along, +0.0200° across, nudged" in summary.bias_memory
    (kept,) = memory.entries()
    assert (kept.source, kept.along_sigma_s, kept.cross_deg) == ("nudge", None, 0.02)
    told = ready()
    assert told.facts.remembered is None
    assert "remembered, but not used: +0.300 s along" in told.notes[0]
    begun = ready("nudge")
    assert (begun.facts.bias_along_s, begun.facts.bias_cross_deg) == (0.3, 0.02)
    summary, views = fly(begun, (PASS_UTC_S, DropRemembered()))
    assert (views[0].bias_along_s, views[-1].bias_along_s) == (0.3, 0.0)
    assert summary.bias_memory == "the bias that was dropped is not offered again", "nothing is no nudge"
    assert memory.entries()[0].dropped
    fly(ready(), (PASS_UTC_S, Nudge(along_s=0.4)))
    assert [(one.along_s, one.dropped) for one in memory.entries()] == [(0.4, False)]


def test_a_bias_that_is_given_goes_before_the_remembered_one(memory: BiasMemory) -> None:
    memory.keep(FIT, ELEMENTS, "one")
    prepared = ready(bias_along_s=0.1)
    assert prepared.facts.remembered is None
    assert "left aside for the one given" in prepared.notes[0]


def test_simulated_mounts_touch_the_memory_only_where_they_are_told(memory: BiasMemory) -> None:
    assert uses_memory("auto", simulated=False)
    assert not uses_memory("auto", simulated=True)
    assert uses_memory("on", simulated=True)
    assert not uses_memory("off", simulated=False)
    fly(ready("auto"), (PASS_UTC_S, Nudge(along_s=0.3)))
    assert not memory.path.exists()


def test_observations_of_a_pass_are_kept_and_a_report_of_it_has_the_last_word(
    memory: BiasMemory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made: list[Trace] = []

    def once(*of: Any) -> Trace:
        made.extend([] if made else [trace(*of)])
        return made[0]

    monkeypatch.setattr("sattrack.cli.recording.trace", once)
    path, rng = tmp_path / "seen.mcap", random.Random(8)
    true = bench.true_satellite(ELEMENTS, demo_pass.SITE.place(), 0.8)
    seen_s = [PASS_UTC_S + at_s for at_s in range(-4, 8)]
    fly(ready("off", record=path), *((at + 0.2, bench.solution(true, at, rng, 5.0)) for at in seen_s))
    assert run(["report", str(path), "--json"]) == 0
    assert not memory.path.exists(), "a simulated mount's, and nobody asked"
    assert run(["report", str(path), "--json", "--bias-memory", "on"]) == 0
    captured = capsys.readouterr()
    figures = json.loads(captured.out.splitlines()[-1])["bias"]
    (kept,) = memory.entries()
    assert (kept.made_by, kept.along_s) == ("report", figures["along_s"])
    assert "bias memory: kept for these elements" in captured.err
    assert kept.along_s == pytest.approx(0.8, abs=4.0 * figures["along_sigma_s"])
    recalled = memory.recall(ELEMENTS, kept.utc_s, "observations")
    assert recalled is not None
    assert recalled.along_sigma_s == figures["along_sigma_s"]
    assert run(["biases", "--drop", "1"]) == 0
    assert "DROPPED" in capsys.readouterr().out
    assert run(["biases", "--drop", "2"]) == 2


def damaged(memory: BiasMemory) -> str:
    memory.path.write_bytes(b"no database at all, and long enough to be looked at" * 40)
    return "move it away, and a new one is begun"


def cut_in_half(memory: BiasMemory) -> str:
    memory.path.write_bytes(memory.path.read_bytes()[:5000])
    return "cannot be used"


def of_the_future(memory: BiasMemory) -> str:
    with sqlite3.connect(memory.path) as connection:
        connection.execute("PRAGMA user_version = 9")
    connection.close()
    return "of a newer sattrack: layout 9, 1 is known here"


def a_folder(memory: BiasMemory) -> str:
    memory.path.unlink()
    memory.path.mkdir()
    return "cannot be used"


def nonsense_in_it(memory: BiasMemory) -> str:
    with sqlite3.connect(memory.path) as connection:
        connection.execute("UPDATE biases SET along_s = 'much'")
    connection.close()
    return "holds what is no bias"


@pytest.mark.parametrize("harm", [damaged, cut_in_half, of_the_future, a_folder, nonsense_in_it])
def test_a_file_that_cannot_be_used_is_one_line_and_the_pass_goes_on(
    memory: BiasMemory, harm: Callable[[BiasMemory], str]
) -> None:
    memory.keep(FIT, ELEMENTS, "one")
    expected = harm(memory)
    prepared = ready()
    (words,) = prepared.notes
    assert expected in words
    assert words.endswith("nothing is recalled")
    assert "\n" not in words
    summary, _ = fly(prepared, (PASS_UTC_S, Nudge(along_s=0.3)))
    assert summary.ended_by == "set"
    if harm is not nonsense_in_it:
        assert summary.bias_memory is not None
        assert summary.bias_memory.endswith("the bias of this pass is not kept")


def test_a_folder_that_cannot_be_made_keeps_nothing_and_stops_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", "/proc/nowhere")
    summary, _ = fly(ready(), (PASS_UTC_S, Nudge(along_s=0.3)))
    assert summary.ended_by == "set"
    assert summary.bias_memory is not None
    assert "cannot be used" in summary.bias_memory


def test_a_file_that_another_holds_is_told_as_locked(
    memory: BiasMemory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sattrack.runtime.bias_memory.PATIENCE_S", 0.01)
    memory.keep(FIT, ELEMENTS, "one")
    holder = sqlite3.connect(memory.path, isolation_level=None)
    holder.execute("BEGIN EXCLUSIVE")
    with pytest.raises(SattrackError, match="locked: another program holds it"):
        memory.keep(FIT, ELEMENTS, "two")
    with pytest.raises(SattrackError, match="locked"):
        memory.recall(ELEMENTS, PASS_UTC_S, "observations")
    holder.close()
    assert memory.recall(ELEMENTS, PASS_UTC_S, "observations") is not None


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_file_that_may_only_be_read_is_read(memory: BiasMemory) -> None:
    memory.keep(FIT, ELEMENTS, "one")
    memory.path.chmod(0o444)
    memory.path.parent.chmod(0o555)
    assert memory.recall(ELEMENTS, PASS_UTC_S, "observations") is not None
    with pytest.raises(SattrackError, match="readonly"):
        memory.keep(FIT, ELEMENTS, "two")


def test_two_sessions_keep_at_the_same_time_and_nothing_is_lost(memory: BiasMemory) -> None:
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, str(memory.path), name]) for name in ("one", "two")
    ]
    assert [writer.wait() for writer in writers] == [0, 0]
    assert len(memory.entries()) == 40


def test_a_recording_without_a_remembered_bias_is_built_as_before() -> None:
    path = Path(__file__).resolve().parents[3] / "examples" / "passes" / "clean.mcap"
    _, facts = open_recording(path)
    assert facts.remembered is None
    assert build_engine(facts).tracker.steering.remembered is None
