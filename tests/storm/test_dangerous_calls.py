"""No code runs what it was given: no shell, no eval, no pickle of foreign bytes. And no secret is logged."""

from __future__ import annotations

import ast
import contextlib
import logging
import re
from pathlib import Path

import pytest

from sattrack.elements.downloads import PASSWORD_VARIABLE, USER_VARIABLE

ROOT = Path(__file__).parents[2]
FORBIDDEN = {"eval", "exec", "compile", "__import__", "os.system", "os.popen", "marshal.loads", "yaml.load"}
UNPICKLING = {"pickle.load", "pickle.loads", "pickle.Unpickler", "shelve.open", "numpy.load", "np.load"}
OWN_PICKLES = {"sattrack/network/engine.py"}
"""Read by worker processes from a folder of their parent's that nobody else can write to."""
SOURCES = [path for folder in ("sattrack", "tle") for path in sorted((ROOT / folder).rglob("*.py"))]


def name_of(node: ast.expr) -> str:
    """Return a dotted name as it is written; empty for anything else."""
    if isinstance(node, ast.Name):
        return node.id
    return f"{name_of(node.value)}.{node.attr}" if isinstance(node, ast.Attribute) else ""


def calls(source: str, names: set[str]) -> list[ast.Call]:
    """Return a file's calls, or none where no name is in it as it would be called."""
    anywhere = "|".join(r"\s*\.\s*".join(name.split(".")) for name in names)
    if not re.search(rf"(?<![\w.])(?:{anywhere})(?!\w)", source):
        return []
    return [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]


def dangers(source: str, file: str) -> list[str]:
    """Return the dangerous calls of a file, each with its line."""
    found = []
    for node in calls(source, FORBIDDEN | UNPICKLING | {"shell"}):
        name = name_of(node.func)
        shell = any(
            word.arg == "shell" and not (isinstance(word.value, ast.Constant) and word.value.value is False)
            for word in node.keywords
        )
        if name in FORBIDDEN or shell or (name in UNPICKLING and file not in OWN_PICKLES):
            found.append(f"{file}:{node.lineno}: {name}")
    return found


def test_nothing_runs_what_it_was_given() -> None:
    assert len(SOURCES) > 200
    found = [
        one
        for path in SOURCES
        for one in dangers(path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix())
    ]
    assert found == []


@pytest.mark.parametrize(
    "source",
    [
        "subprocess.run(x, shell=True)",
        "subprocess.run(x, shell=y)",
        "eval(x)",
        "pickle.loads(x)",
        "os.system(x)",
    ],
)
def test_the_search_finds_what_it_looks_for(source: str) -> None:
    assert dangers(source, "any.py")


def test_every_program_that_is_started_is_a_list_of_words() -> None:
    """A text in place of a list is split by nobody and would hide an argument in a name."""
    starters = {"subprocess.run", "subprocess.Popen", "subprocess.check_output", "subprocess.call"}
    for path in SOURCES:
        for node in calls(path.read_text(encoding="utf-8"), starters):
            if name_of(node.func) in starters:
                assert not isinstance(node.args[0], ast.Constant | ast.JoinedStr), f"{path}:{node.lineno}"


def test_the_password_of_space_track_is_in_no_output_and_no_file(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    from sattrack.cli.main import run

    secret = "correct-horse-battery"
    for name in ("XDG_STATE_HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(USER_VARIABLE, "someone@example.org")
    monkeypatch.setenv(PASSWORD_VARIABLE, secret)
    # Nobody answers there: the login itself fails, and its error is shown with --debug.
    monkeypatch.setenv("SATTRACK_SPACETRACK_URL", "http://127.0.0.1:1")
    with caplog.at_level(logging.DEBUG):
        for arguments in (
            ["elements", "get", "spacetrack:25544", "--debug"],
            ["doctor", "--json", "--debug"],
            ["passes", "25544", "--elements", "spacetrack:25544", "--site", "52,4,0", "--debug"],
        ):
            with contextlib.suppress(Exception):
                assert run(arguments) != 0
    out, err = capfd.readouterr()
    written = b"".join(path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
    assert "127.0.0.1" in err
    assert secret not in out + err + caplog.text
    assert secret.encode() not in written
