"""docs/schedules.md against the code: its examples load, its output is printed, and no key is left out."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from sattrack.cli.main import run
from sattrack.schedule import schema
from sattrack.schedule.file import load_schedule

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "schedules.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
EXAMPLES = [block for kind, block in BLOCKS if kind == "toml"]


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_each_example_is_a_schedule(number: int, tmp_path: Path) -> None:
    (tmp_path / "night.csv").write_text("satellite,start,end\nISS,2026-10-03 01:00,2026-10-03 01:05\n")
    path = tmp_path / "night.toml"
    path.write_text(EXAMPLES[number], encoding="utf-8")
    assert load_schedule(path).entries


def test_there_are_examples() -> None:
    assert len(EXAMPLES) == 4


def test_the_plan_of_the_example_is_as_printed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    assert run(["run", "examples/night.toml", "--dry-run", "--config", "examples/sattrack.toml"]) == 0
    assert capsys.readouterr().out in [block for _, block in BLOCKS]


def test_errors_are_as_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = (
        '[[passes]]\nsatellite = "ISS"\n\n\n\n\nprioirty = 2\n',
        '\n\n\n\n\n\n\n[[passes]]\nrule = "all of sky.tle, abve 30°"\n',
        'timezone = "Europe/Amsterdam"\n[[fixed]]\nstart = 2026-10-25 02:30:00\nend = 2026-10-25 04:00:00\n'
        'satellite = "ISS"\n',
    )
    told = next(block for _, block in BLOCKS if block.startswith("night.toml:")).splitlines()
    for text, says in zip(wrong, told, strict=True):
        path = tmp_path / "night.toml"
        path.write_text(text, encoding="utf-8")
        assert run(["run", str(path), "--dry-run"]) == 2
        said = capsys.readouterr().err.replace(f"{tmp_path}/", "").removeprefix("sattrack: ").strip()
        assert said == says


def test_every_key_condition_and_reason_to_choose_is_told() -> None:
    kinds: list[type[msgspec.Struct]] = [
        schema.ScheduleText,
        schema.PassEntry,
        schema.FixedEntry,
        schema.ImportEntry,
        schema.SlewAction,
        schema.SearchAction,
        schema.CommandAction,
        schema.WebhookAction,
        schema.Weather,
    ]
    told = set(re.findall(r"[a-z_]+", " ".join(re.findall(r"`([^`\n]+)`", TEXT))))
    for kind in kinds:
        missing = {field.encode_name for field in msgspec.structs.fields(kind)} - told
        assert not missing, (kind, missing)
    for condition in schema.KNOWN:
        assert f"| `{condition}" in TEXT


def test_defaults_are_those_of_the_code() -> None:
    terms = schema.Terms()
    rows = dict(re.findall(r"^\| `([a-z_]+)`[^|]*\|[^|]*\| ([^|]*) \|$", TEXT, re.MULTILINE))
    for name in ("priority", "min_altitude_deg", "settle_s", "least_s"):
        assert float(rows[name]) == getattr(terms, name)
    assert rows["if_elements_old"] == f"`{terms.if_elements_old}`, {terms.elements_oldest_days:g}"
    assert rows["if_sun_up"] == f"`{terms.if_sun_up}`, {terms.sun_up_deg:g}"
    assert rows["if_weather_unsafe"] == f"`{terms.if_weather_unsafe}`"
    assert schema.FIXED_PRIORITY == 100.0
