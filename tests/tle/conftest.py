"""Fixtures of the tests of `tle`: the reference cases, where they are at hand."""

from __future__ import annotations

from pathlib import Path

import pytest

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases"


@pytest.fixture(scope="session")
def cases() -> Path:
    if not CASES.is_dir():
        pytest.skip("the reference cases (../shared/cases) are not here")
    return CASES
