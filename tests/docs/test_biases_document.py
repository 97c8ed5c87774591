"""The messages in docs/biases.md are messages, and a run obeys every one of them as written."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from sattrack.cli.main import run
from sattrack.runtime.facts import RunRequest, prepare
from sattrack.runtime.flight import fly_virtual
from sattrack.views.messages import StopNow, decode_message
from tle.instants import Utc

if TYPE_CHECKING:
    import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = (ROOT / "docs" / "biases.md").read_text(encoding="utf-8")
FIRST_S = float(Utc.parse("2026-10-02T13:04:30Z").unix_s)
BETWEEN_S = 5.0


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", DOCUMENT, re.DOTALL)


def test_a_run_obeys_every_message_as_written() -> None:
    lines = [line.encode() for line in "".join(blocks("json")).splitlines()]
    assert len(lines) > 10
    messages = [decode_message(line) for line in lines]
    assert isinstance(messages[-1], StopNow)
    timed = tuple((FIRST_S + BETWEEN_S * i, message) for i, message in enumerate(messages))
    request = RunRequest("25544", "sim", None, None, "2026-10-02T13:03:10Z", 10.0, virtual=True)
    warnings: set[str] = set()
    searches: set[str] = set()
    offsets: set[str] = set()

    def look(view: object) -> None:
        warnings.update(w for w in view.warnings if "refused" in w or "not taken" in w or "neither" in w)
        searches.update([view.search.how] if view.search else [])
        offsets.update(one.what for one in view.offsets)

    summary = fly_virtual(prepare(request), look, timed)
    assert warnings == set()
    assert searches == {"spiral", "sweep"}
    assert offsets == {"along_s", "cross_deg", "camera_x_deg", "dec_axis_deg", "ra_cos_dec_deg"}
    assert summary.ended_by == "operator"
    assert summary.estimate is not None
    assert summary.estimate.accepted == 2, "the observation, and the offset of a camera"
    assert (summary.bias_along_s, summary.offsets) == (0.0, ()), "clear_bias came last but one"


def test_the_command_with_observations_finds_the_bias_of_the_example(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = next(c for block in blocks("sh") for c in block.splitlines() if "--observations stdin" in c)
    program, _, source = command.partition(" < ")
    assert program.startswith("sattrack ")
    with (ROOT / source).open(encoding="utf-8") as lines:
        monkeypatch.setattr(sys, "stdin", lines)
        assert run([*program.split()[1:], "--json", "--min-alt", "70"]) == 0
    summary = json.loads(capsys.readouterr().out)["summary"]
    estimate = summary["estimate"]
    assert abs(summary["bias_along_s"] - 3.0) < 4.0 * estimate["along_sigma_s"]
    assert estimate["rejected"] == 0


def test_what_sattrack_bias_prints_is_what_the_page_shows(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = next(c for block in blocks("sh") for c in block.splitlines() if c.startswith("sattrack bias"))
    monkeypatch.chdir(ROOT)
    assert run(command.split()[1:]) == 0
    shown = DOCUMENT.partition(command)[2].split("```")[2].strip()
    assert capsys.readouterr().out.strip().splitlines() == shown.splitlines()
