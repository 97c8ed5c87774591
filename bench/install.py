"""Build the wheel and the sdist, install each with several Pythons, run the demo, and print the sizes.

python bench/install.py [PYTHON ...]

PYTHON are interpreters, by default those of `python3.11`, `python3.12` and `python3.13` that are found on the
path or at pyenv; the others are named. Everything is made in a temporary folder, in fresh environments: the
build, then for each Python the wheel alone and with [all], and at last the sdist with the first of them.
The exit code is 1 if an install or a demo fails. pip downloads what its cache lacks.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VERSIONS = ("3.11", "3.12", "3.13")
DEMO = ("demo", "--headless", "--seconds", "5", "--json")
PACKAGED = (
    "sattrack/data/cities.csv.gz",
    "sattrack/data/land.txt.gz",
    "sattrack/servers/templates/index.html",
    "sattrack/servers/templates/list.html",
    "sattrack/tui/console.tcss",
    "tle/data/hipparcos_bright.dat.gz",
    "share/man/man1/sattrack.1",
)
"""Files that the program needs and that are no Python modules."""


def main() -> int:
    pythons = sys.argv[1:] or [found for version in VERSIONS if (found := interpreter(version))]
    missing = [] if sys.argv[1:] else [version for version in VERSIONS if interpreter(version) is None]
    with tempfile.TemporaryDirectory(prefix="sattrack-install-") as name:
        folder = Path(name)
        wheel, sdist = build(pythons[0], folder)
        for made in (wheel, sdist):
            print(f"{made.name}: {made.stat().st_size / 1e6:.1f} MB")
        absent = [one for one in PACKAGED if not any(there.endswith(one) for there in contents(wheel))]
        print(f"files missing in the wheel: {', '.join(absent) or 'none'}")
        good = not absent
        for python in pythons:
            for package in (f"{wheel}", f"{wheel}[all]"):
                good &= tried(python, package, folder)
        good &= tried(pythons[0], str(sdist), folder)
    if missing:
        print(f"not tried, not on this machine: Python {', '.join(missing)}")
    return 0 if good else 1


def interpreter(version: str) -> str | None:
    """Return the interpreter of a version, on the path or at pyenv; None if there is none."""
    places = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    return str(places[-1]) if places else shutil.which(f"python{version}")


def build(python: str, folder: Path) -> tuple[Path, Path]:
    """Build wheel and sdist from the last commit, in an environment of their own."""
    source = folder / "source"
    source.mkdir()
    archive = subprocess.run(["git", "-C", str(ROOT), "archive", "HEAD"], check=True, capture_output=True)
    subprocess.run(["tar", "-x", "-C", str(source)], input=archive.stdout, check=True)
    made = environment(python, folder / "build")
    run(made, "-m", "pip", "install", "-q", "build")
    run(made, "-m", "build", "--outdir", str(folder), str(source))
    return next(folder.glob("*.whl")), next(folder.glob("*.tar.gz"))


def contents(wheel: Path) -> list[str]:
    with zipfile.ZipFile(wheel) as opened:
        return opened.namelist()


def tried(python: str, package: str, folder: Path) -> bool:
    """Install a package in a fresh environment and run the demo there; tell whether that went well."""
    place = folder / "installed"
    made = environment(python, place)
    empty = megabytes(place)
    begun_s = time.monotonic()
    run(made, "-m", "pip", "install", "-q", "-c", str(ROOT / "constraints.txt"), package)
    took_s = time.monotonic() - begun_s
    done = subprocess.run(
        [made.with_name("sattrack"), *DEMO], cwd=folder, capture_output=True, text=True, check=False
    )
    summary = json.loads(done.stdout.splitlines()[-1])["summary"] if done.returncode == 0 else None
    received = summary["datagrams"]["received"] if summary else 0
    what = Path(package).name
    version = subprocess.run([made, "-V"], capture_output=True, text=True, check=True).stdout.strip()
    size = megabytes(place) - empty
    outcome = f"{received} datagrams" if summary else f"exit {done.returncode}: {done.stderr}"
    largest = ", ".join(f"{name} {size:.0f}" for name, size in largest_packages(place)[:4])
    print(
        f"{version}: {what}: {size:.0f} MB ({largest}), installed in {took_s:.0f} s; demo: {outcome}",
        flush=True,
    )
    shutil.rmtree(place)
    return received > 0


def environment(python: str, place: Path) -> Path:
    """Make a virtual environment; return its Python."""
    subprocess.run([python, "-m", "venv", str(place)], check=True)
    return place / "bin" / "python"


def run(python: Path, *arguments: str) -> None:
    environ = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    subprocess.run([python, *arguments], check=True, env=environ, stdout=subprocess.DEVNULL)


def megabytes(place: Path) -> float:
    return sum(file.lstat().st_size for file in place.rglob("*") if file.is_file()) / 1e6


def largest_packages(place: Path) -> list[tuple[str, float]]:
    (packages,) = place.glob("lib/python*/site-packages")
    sizes: dict[str, float] = {}
    for one in packages.iterdir():
        if one.is_dir() and not one.name.endswith(".dist-info"):
            name = one.name.removesuffix(".libs")
            sizes[name] = sizes.get(name, 0.0) + megabytes(one)
    return sorted(sizes.items(), key=lambda each: -each[1])


if __name__ == "__main__":
    sys.exit(main())
