"""The table of keywords in docs/elements.md is the one that readers and writers use."""

from __future__ import annotations

import math
from pathlib import Path

from tle.formats.omm import FIELDS, OmmField

DOCS = Path(__file__).parents[2] / "docs" / "elements.md"


def row_of(field: OmmField) -> str:
    least = "" if math.isinf(field.least) else "above 0" if 0.0 < field.least < 1.0 else f"{field.least:g}"
    most = "" if math.isinf(field.most) else "below 1" if 0.9 < field.most < 1.0 else f"{field.most:.10g}"
    absent = (
        "refused" if field.default is None else f"{field.default or 0}" if field.default != "" else "empty"
    )
    if field.kind in ("whole", "catalogue"):
        least = "0"
    if field.kind == "epoch":
        least, most = "1957-10-04", "2056-12-31"
    if field.keyword == "EPHEMERIS_TYPE":
        most = "3"
    if field.kind == "number" and field.default == 0.0:
        absent = "0"
    return f"| `{field.keyword}` | {field.meaning} | {field.unit} | {least} | {most} | {absent} |"


def test_the_table_says_what_the_code_does():
    text = DOCS.read_text(encoding="utf-8")
    for field in FIELDS:
        assert row_of(field) in text
