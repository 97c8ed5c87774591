"""docs/antenna-interface.md against the code that writes it; its examples against the paper's sum."""

from __future__ import annotations

import re
from pathlib import Path

from sattrack.servers.antenna.protocol import BY_WORD
from tools.antenna_interface import DIALOGUE, PAGE, page

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / PAGE).read_text(encoding="utf-8")


def test_the_page_is_as_the_code_writes_it() -> None:
    assert page(ROOT) == TEXT, "run python -m tools.antenna_interface"


def test_every_command_has_an_example() -> None:
    assert {message.split()[0] for _, message in DIALOGUE} == set(BY_WORD)


def test_every_example_carries_the_low_byte_of_its_sum() -> None:
    lines = re.findall(r"^[<>] (.*)\\n$", TEXT, re.MULTILINE)
    assert len(lines) == 2 * len(DIALOGUE)
    for line in lines:
        assert int(line[-2:], 16) == sum(line[:-2].encode("ascii")) % 256
        assert line[-3] == " "
