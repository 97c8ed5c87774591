"""The recordings in `examples/passes` come out again with today's code: to the byte where it is the same."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from sattrack.recording.format import FORMAT_VERSION, OPERATOR, REPEAT, Recording
from sattrack.recording.replay import Replay, Tolerances, replay
from sattrack.runtime.facts import engine_of, open_recording
from sattrack.views.messages import ObservationMessage, decode_message

if TYPE_CHECKING:
    from collections.abc import Callable

pytest_plugins = ["sattrack.pytest_plugin"]
PASSES = Path(__file__).resolve().parents[3] / "examples" / "passes"
FREE = Tolerances(other_ticks=1.0)
"""Another control law is free to command otherwise; what the recorded mount shows must stay what it was."""


@pytest.mark.parametrize("name", ["faults", "edge"])
def test_an_example_comes_out_again(name: str) -> None:
    recording, facts = open_recording(PASSES / f"{name}.mcap")
    assert recording.header.format_version == FORMAT_VERSION
    assert not recording.problems
    assert facts.elements is not None
    assert "/" not in facts.elements.source, "no folder of the computer that made it"
    result = replay(recording, engine_of, tolerances=FREE)
    assert result.agrees, result.reasons
    assert result.ticks > 2500
    assert facts.profile.move_axis == ("edge" if name == "edge" else "held")


def test_the_pass_with_faults_has_lost_and_repeated_datagrams_and_observations() -> None:
    entries = list(Recording(PASSES / "faults.mcap").entries())
    seen = [decode_message(entry.data) for entry in entries if entry.topic == OPERATOR]
    assert len(seen) > 30
    assert all(isinstance(one, ObservationMessage) for one in seen)
    assert any(entry.topic == REPEAT for entry in entries)


def test_the_clean_one_is_a_test_as_it_stands(sattrack_pass: Callable[..., Replay]) -> None:
    recording, facts = open_recording(PASSES / "clean.mcap")
    assert recording.header.format_version == FORMAT_VERSION
    assert not recording.problems
    result = sattrack_pass(PASSES / "clean.mcap", FREE)
    assert result.agrees
    assert result.ticks > 2500
    assert facts.profile.move_axis == "held"
