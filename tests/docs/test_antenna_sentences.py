"""docs/antenna-conformance.md against the suite that it points to: every sentence, every row, every test."""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TESTS = ROOT / "tests" / "sattrack" / "servers" / "antenna"
SENTENCES = {
    "3.0": 15,
    "4.0": 23,
    "4.1": 3,
    "4.1.1": 58,
    "4.1.2": 19,
    "5.0": 43,
    "6.0": 20,
    "7.0": 31,
    "8.0": 4,
}
"""How many sentences the paper has in each section."""


def entries() -> list[tuple[str, range, str, str]]:
    """Return section, sentences, what they ask for and what shows it, of every line of the page's tables."""
    found, section = [], ""
    for line in (ROOT / "docs" / "antenna-conformance.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            section = line.split()[1]
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| ") and cells[0][0].isdigit():
            first, _, last = cells[0].partition("-")
            found.append((section, range(int(first), int(last or first) + 1), cells[1], cells[2]))
    return found


def suite() -> tuple[set[tuple[str, str]], set[str]]:
    """Return the rows' sections and claims, and the names of all tests that concern the interface."""
    sys.path.insert(0, str(TESTS))
    try:
        from conformance_rows import ROWS
    finally:
        sys.path.remove(str(TESTS))
    texts = [
        path.read_text(encoding="utf-8")
        for path in [*TESTS.glob("*.py"), *Path(__file__).parent.glob("*.py")]
    ]
    names = {name for text in texts for name in re.findall(r"^def (test_\w+)", text, re.MULTILINE)}
    return {(row.section, row.claim) for row in ROWS}, names


def test_every_sentence_of_the_paper_is_gone_through_once() -> None:
    for section, count in SENTENCES.items():
        told = [number for where, numbers, _, _ in entries() if where == section for number in numbers]
        assert told == list(range(1, count + 1)), section


def test_every_sentence_is_shown_by_something_or_says_why_not() -> None:
    for section, numbers, asks, shown in entries():
        assert '"' in shown or "`" in shown or "- " in asks + shown, (section, numbers)


def test_what_is_pointed_to_is_there_and_every_row_is_pointed_to() -> None:
    rows, tests = suite()
    claims = {claim for _, claim in rows}
    pointed = set()
    for _, _, _, shown in entries():
        pointed |= set(re.findall(r'"([^"]+)"', shown))
        commands = re.findall(r"`([^`]+)`", shown)
        assert {c for c in commands if not c.startswith("python bench/")} <= tests | {"POINTING"}
        assert all((ROOT / c.split()[1]).is_file() for c in commands if c.startswith("python bench/"))
    assert pointed == claims
