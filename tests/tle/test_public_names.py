from __future__ import annotations

import subprocess
import sys

import pytest

import tle


@pytest.mark.parametrize("name", tle.__all__)
def test_every_public_name_is_there_and_documented(name):
    assert getattr(tle, name).__doc__


def test_every_public_name_stays_what_it_is():
    # A module of the same name would take its place once imported.
    code = (
        "import tle; print(*[n for n in tle.__all__ for _ in (1, 2) if type(getattr(tle, n)) is type(tle)])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "", "")


def test_the_module_lists_its_public_names():
    assert dir(tle) == sorted(tle.__all__)


def test_importing_the_package_imports_nothing_else():
    code = "import sys, tle; print([n for n in sys.modules if n.startswith('tle.') or n == 'numpy'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "[]", "")


def test_unknown_names_are_named():
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        tle.Nothing  # noqa: B018


def test_directions_need_no_heavy_package():
    code = (
        "import sys; before = set(sys.modules); import tle; from tle import *;"
        "heavy = {'skyfield', 'scipy', 'matplotlib', 'astropy', 'asyncio', 'socket'};"
        "print(*heavy & (set(sys.modules) - before))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "", "")
