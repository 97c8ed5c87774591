"""Places of keys and values in TOML text: counted by hand, and held against what another writer wrote."""

from __future__ import annotations

import tomllib
from typing import Any

import msgspec
import pytest
import tomlkit
from hypothesis import given, settings
from hypothesis import strategies as st

from sattrack.core.toml_text import KeyPath, UnknownKeyError, read_typed, toml_positions

TEXT = '''# a comment with [brackets] and "quotes"
name = "a" # after
'odd key' . "inner" = 3

[one.two]
list = [1, "two", # in between
  { x = 1, y.z = [ 2 ] }]
text = """
first
"quoted" ]"""
[[many]]
a = 1
[[many]]
a = 2
  [[many.more]]
  b = true
  [many.table]
  c = 1979-05-27 07:32:00
'''


def test_places_are_where_one_counts_them() -> None:
    found = toml_positions(TEXT)
    counted: dict[KeyPath, tuple[int, int, int, int]] = {
        ("name",): (2, 1, 2, 9),
        ("odd key",): (3, 1, 3, 1),
        ("odd key", "inner"): (3, 1, 3, 23),
        ("one",): (5, 1, 5, 1),
        ("one", "two"): (5, 1, 5, 1),
        ("one", "two", "list"): (6, 1, 6, 8),
        ("one", "two", "list", 0): (6, 9, 6, 9),
        ("one", "two", "list", 1): (6, 12, 6, 13),
        ("one", "two", "list", 2): (7, 3, 7, 3),
        ("one", "two", "list", 2, "x"): (7, 5, 7, 9),
        ("one", "two", "list", 2, "y", "z", 0): (7, 20, 7, 20),
        ("one", "two", "text"): (8, 1, 9, 1),
        ("many", 0, "a"): (12, 1, 12, 5),
        ("many", 1, "a"): (14, 1, 14, 5),
        ("many", 1, "more", 0, "b"): (16, 3, 16, 7),
        ("many", 1, "table", "c"): (18, 3, 18, 7),
    }
    assert {path: tuple(found[path][:4]) for path in counted} == counted


PLAIN = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"], exclude_characters='"\\'), max_size=8
)
VALUES = st.recursive(
    PLAIN | st.integers(-99, 99) | st.booleans() | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(PLAIN, inner, max_size=3),
    max_leaves=12,
)


def leaves(value: Any, path: KeyPath = ()) -> list[tuple[KeyPath, Any]]:
    if isinstance(value, dict):
        return [leaf for key, one in value.items() for leaf in leaves(one, (*path, key))]
    if isinstance(value, list):
        return [leaf for number, one in enumerate(value) for leaf in leaves(one, (*path, number))]
    return [(path, value)]


@settings(max_examples=25, deadline=None)
@given(st.dictionaries(PLAIN, VALUES, max_size=4))
def test_each_value_stands_where_it_is_said_to(document: dict[str, Any]) -> None:
    text = tomlkit.dumps(document)
    assert tomllib.loads(text) == document
    lines = text.split("\n")
    found = toml_positions(text)
    for path, value in leaves(document):
        spot = found[path]
        written = value if isinstance(value, str) else tomlkit.dumps({"x": value})[4:].strip()
        assert lines[spot.value_line - 1][spot.value_column - 1 :].startswith(written)


class Many(msgspec.Struct, forbid_unknown_fields=True):
    many: list[dict[str, int]] = []
    one: Many | None = None


def test_an_unknown_key_is_told_with_the_way_to_it() -> None:
    with pytest.raises(UnknownKeyError) as caught:
        read_typed("[one]\n[one.one]\nmanny = 1\n", "x.toml", Many, columns=False)
    assert caught.value.path == ("one", "one", "manny")
    assert caught.value.said == "x.toml:3: unknown key 'manny' in [one.one]"
    assert str(caught.value) == f"{caught.value.said}; did you mean 'many'?"
