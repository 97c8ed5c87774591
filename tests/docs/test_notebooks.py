"""Each notebook runs from top to bottom, prints what it is kept to print, and draws its pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tools.notebooks import FOLDER, ROOT, cells, outputs, printed

if TYPE_CHECKING:
    from pathlib import Path

NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
PAGE = ROOT / "docs" / "library.md"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_prints_and_draws_what_it_shows(
    path: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    code = [cell for cell in cells(path) if cell["cell_type"] == "code"]
    for cell, made in zip(code, outputs(path), strict=True):
        texts = ["".join(output["text"]) for output in made if output["output_type"] == "stream"]
        assert "".join(texts) == printed(cell)
        assert [one["output_type"] for one in made] == [one["output_type"] for one in cell["outputs"]]
    assert sum(output["output_type"] == "display_data" for cell in code for output in cell["outputs"])


def test_every_notebook_is_on_the_librarys_page() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert len(NOTEBOOKS) >= 3
    assert [path.name for path in NOTEBOOKS if path.name not in page] == []
