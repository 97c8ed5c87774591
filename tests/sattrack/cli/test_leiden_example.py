"""The example of the pass over Leiden runs as written, and says what the built-in pass says."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import TYPE_CHECKING

from sattrack.runtime import demo_pass
from sattrack.settings import load_settings

if TYPE_CHECKING:
    import pytest

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


def test_it_follows_the_pass(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(EXAMPLES / "follow_leiden_pass.py"), run_name="__main__")
    # By skyfield the satellite is above 60° for 64.2 s; a second goes until the mount moves with it.
    assert capsys.readouterr().out.startswith("ISS (ZARYA): on target for 63 s, then ended by set\n")


def test_its_facts_are_those_of_the_built_in_pass() -> None:
    assert (EXAMPLES / "iss_leiden.tle").read_text().splitlines()[-3:] == [
        demo_pass.NAME,
        demo_pass.LINE_1,
        demo_pass.LINE_2,
    ]
    settings = load_settings(EXAMPLES / "sattrack.toml")
    assert settings.site == demo_pass.SITE
    assert settings.elements == (str(EXAMPLES / "iss_leiden.tle"),)
