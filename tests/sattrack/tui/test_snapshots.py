"""Every screen at both sizes in both themes, held against what was kept of it."""

from __future__ import annotations

import pytest
from snapshots import FOLDER, NAMES, SIZES, THEMES, all_snapshots


@pytest.fixture(scope="module")
def made() -> dict[str, str]:
    return all_snapshots()


@pytest.mark.parametrize(("columns", "rows"), SIZES)
@pytest.mark.parametrize("name", NAMES)
def test_each_screen_is_as_it_was_kept(made: dict[str, str], name: str, columns: int, rows: int) -> None:
    file = FOLDER / f"{name}-{columns}x{rows}.txt"

    assert made[file.name] == file.read_text(encoding="utf-8"), (
        "if that is meant: python tests/sattrack/tui/snapshots.py, and look at what git says has changed"
    )


def test_nothing_is_kept_that_is_not_drawn_and_the_red_theme_is_red(made: dict[str, str]) -> None:
    assert {file.name for file in FOLDER.iterdir()} == set(made)
    for text in made.values():
        parts = text.split("\n== ")
        assert [part.partition("\n")[0] for part in parts[1:]] == list(THEMES)
        reds = parts[-1].partition("\n")[2]
        for word in reds.split():
            if word.startswith("#"):
                assert word[3:7] == "0000", word
