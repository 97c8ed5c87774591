"""The package names the addresses of the repository that it was built from, as hatchling reads them."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NEEDED = ("pyproject.toml", "README.md", "LICENSE", "tools/project_urls.py", "sattrack/__init__.py")
HOST = "https://codeberg.org/owner/sattrack"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    made = tmp_path / "project"
    for name in NEEDED:
        (made / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, made / name)
    return made


def urls_of(project: Path) -> dict[str, str]:
    done = subprocess.run(
        [sys.executable, "-m", "hatchling", "metadata"],
        cwd=project,
        capture_output=True,
        text=True,
        check=True,
    )
    found: dict[str, str] = json.loads(done.stdout).get("urls", {})
    return found


@pytest.mark.parametrize(
    "cloned_from",
    [
        f"{HOST}.git",
        f"{HOST}/",
        "git@codeberg.org:owner/sattrack.git",
        "ssh://git@codeberg.org:2222/owner/sattrack.git",
        "https://someone:secret@codeberg.org/owner/sattrack",
    ],
)
def test_a_clone_names_the_address_that_it_was_cloned_from(project: Path, cloned_from: str) -> None:
    for words in (["init", "-q"], ["remote", "add", "origin", cloned_from]):
        subprocess.run(["git", "-C", str(project), *words], check=True)
    assert urls_of(project) == {"Homepage": HOST, "Source": HOST, "Issues": f"{HOST}/issues"}


def test_a_copy_of_a_local_folder_and_an_archive_name_none(project: Path) -> None:
    assert urls_of(project) == {}
    for words in (["init", "-q"], ["remote", "add", "origin", "/srv/mirrors/sattrack"]):
        subprocess.run(["git", "-C", str(project), *words], check=True)
    assert urls_of(project) == {}


def test_a_source_distribution_keeps_those_that_it_was_built_with(project: Path, tmp_path: Path) -> None:
    for words in (["init", "-q"], ["remote", "add", "origin", HOST]):
        subprocess.run(["git", "-C", str(project), *words], check=True)
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "sdist"], cwd=project, check=True)
    (archive,) = (project / "dist").iterdir()
    with tarfile.open(archive) as members:
        members.extractall(tmp_path, filter="data")
    assert urls_of(tmp_path / archive.name.removesuffix(".tar.gz"))["Source"] == HOST
