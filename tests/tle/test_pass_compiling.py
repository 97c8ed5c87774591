"""Where machine code is kept, and what becomes of a search where numba does not work."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tle import compiled_cache, compiled_start
from tle.compiled_start import NoCompilerError, is_worth_compiling, numba_is_there, prepare

BROKEN = {
    "not for this numpy": "raise ImportError('Numba needs NumPy 1.22 or less. Got NumPy 2.4.')",
    "far too old": "def njit(function): return function",
    "of another make": "raise SystemError('initialization failed')",
}
needs_numba = pytest.mark.skipif(not numba_is_there(), reason="numba is not installed")


def told_by(code: str, folder: Path) -> tuple[int, str, str]:
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(folder)!r})\n{code}"],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("how", BROKEN)
def test_a_numba_that_does_not_work_is_told_in_one_line_and_done_without(how: str, tmp_path: Path) -> None:
    (tmp_path / "numba").mkdir()
    (tmp_path / "numba" / "__init__.py").write_text(BROKEN[how] + "\n")
    example = Path(__file__).parents[2] / "examples" / "iss_leiden.tle"
    arguments = ["passes", "ISS", "--elements", str(example), "--site", "52.1541,4.4908,0"]
    arguments += ["--from", "2026-10-02", "--csv"]
    code = f"""
from tle import compiled_start
compiled_start._WORTH = 0.0
from sattrack.cli.main import run
sys.exit(run({arguments!r}))
"""
    status, out, err = told_by(code, tmp_path)
    assert status == 0
    assert len(out.splitlines()) == 6
    assert err.startswith("sattrack: numba does not work here (")
    assert err.endswith("; searching without it\n")
    assert err.count("\n") == 1


def test_a_numba_that_does_not_work_is_warned_of_in_a_script(tmp_path: Path) -> None:
    (tmp_path / "numba").mkdir()
    (tmp_path / "numba" / "__init__.py").write_text(BROKEN["far too old"] + "\n")
    code = """
import warnings
from tle import Site, Utc, compiled_start, find_catalogue_passes
compiled_start._WORTH = 0.0
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    print(len(find_catalogue_passes([], Site(0.0, 0.0), Utc.parse("2026-10-02"), 1.0)))
print(*(w.category.__name__ for w in caught))
try:
    find_catalogue_passes([], Site(0.0, 0.0), Utc.parse("2026-10-02"), 1.0, compiled=True)
except compiled_start.NoCompilerError as error:
    print("refused")
"""
    assert told_by(code, tmp_path) == (0, "0\nRuntimeWarning\nrefused\n", "")


def test_a_small_search_is_not_worth_it() -> None:
    assert not is_worth_compiling(1, 240.0)
    assert is_worth_compiling(28488, 24.0) == numba_is_there()


@needs_numba
def test_nothing_is_left_to_compile_after_getting_ready() -> None:
    prepare()
    from tle.compiled import near_arcs, windows
    from tle.compiled_crossings import crossings

    assert [len(f.signatures) for f in (windows, near_arcs, crossings)] == [1, 1, 1]  # type: ignore[attr-defined]
    assert compiled_start.is_compiled() == (compiled_cache.cache_folder() is not None)


@needs_numba
def test_each_version_keeps_its_machine_code_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    look_up = compiled_cache.cache_folder.__wrapped__
    first = look_up()
    assert first is not None
    assert first.parent == tmp_path / "sattrack"
    assert look_up() == first
    monkeypatch.setattr(compiled_cache, "version", lambda _: "0.0")
    assert look_up() not in (first, None)


@needs_numba
def test_nothing_is_kept_where_nothing_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/dev/null/nowhere")
    assert compiled_cache.cache_folder.__wrapped__() is None


def test_what_is_wrong_is_an_error_of_ours() -> None:
    assert NoCompilerError("x").exit_code == 2
