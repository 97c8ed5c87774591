"""Every screen at both sizes in both themes, held against what was kept of it."""

from __future__ import annotations

import pytest
from snapshots import FOLDER, NAMES, SIZES, THEMES, file_name, snapshots


@pytest.mark.parametrize("size", SIZES)
def test_each_screen_is_as_it_was_kept_and_the_red_theme_is_red(size: tuple[int, int]) -> None:
    made = snapshots(size)
    kept = {name: (FOLDER / name).read_text(encoding="utf-8") for name in made}
    for name, text in made.items():
        assert text == kept[name], (
            f"{name}: if that is meant: python tests/sattrack/tui/snapshots.py, and look at what git says"
        )
        parts = text.split("\n== ")
        assert [part.partition("\n")[0] for part in parts[1:]] == list(THEMES)
        reds = parts[-1].partition("\n")[2]
        for word in reds.split():
            if word.startswith("#"):
                assert word[3:7] == "0000", word


def test_nothing_is_kept_that_is_not_drawn() -> None:
    assert {file.name for file in FOLDER.iterdir()} == {
        file_name(name, size) for name in NAMES for size in SIZES
    }
