"""The recording's layout, an MCAP file with one channel for each kind of input and output, and what made it.

Instants are UTC. MCAP counts them in integer nanoseconds of POSIX time, which is finer than the floats that
the run computes with, so every instant comes back as the same float. The same code with the same libraries on
the same kind of processor gives the same bytes; linear algebra rounds differently from one kind of processor
to the next, and so do versions of libraries.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
from functools import cache
from pathlib import Path

import msgspec

LIBRARIES = ("astropy-iers-data", "filterpy", "msgspec", "numpy", "pyerfa", "scipy", "sgp4")
"""Packages that take part in what is computed of a datagram."""
DATA = ("astropy-iers-data",)
"""Of those, the ones whose content and not only whose rounding changes from version to version."""
NOT_COMPUTING = (
    "calibration",
    "cli",
    "elements",
    "mount/simulator",
    "planning",
    "recording",
    "runtime",
    "schedule",
    "servers",
    "tui",
)
"""Folders of the package that no command datagram comes from."""


class Environment(msgspec.Struct, frozen=True):
    """Processor, interpreter and libraries, each by its own name for itself."""

    machine: str
    processor: str
    python: str
    libraries: dict[str, str]


@cache
def here() -> Environment:
    """Return the environment of this process."""
    versions = {name: _version(name) for name in LIBRARIES}
    return Environment(platform.machine(), _processor(), platform.python_version(), versions)


@cache
def fingerprint() -> str:
    """Return a digest of the code that computes, 16 hexadecimal digits: comments and layout count too."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for root in (package.parent / "tle", package):
        for path in sorted(root.rglob("*.py")):
            name = path.relative_to(package.parent).as_posix()
            if not name.startswith(tuple(f"sattrack/{folder}/" for folder in NOT_COMPUTING)):
                digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    facts = {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    model = facts.get("model name") or platform.processor() or platform.machine()
    # Clouds call many processors by one name; what they can do decides which code linear algebra takes.
    abilities = " ".join(sorted(facts.get("flags", facts.get("Features", "")).split()))
    return f"{model} ({hashlib.sha256(abilities.encode()).hexdigest()[:8]})"


FORMAT_VERSION = 3
"""1: datagrams, messages, views. 2: datagrams sent once more. 3: what made it, failures, the summary."""
PROFILE = "sattrack"

RUN = "run"
STATUS = "status"
COMMAND = "command"
REPEAT = "repeat"
OPERATOR = "operator"
FAILURE = "failure"
VIEW = "view"
SUMMARY = "summary"
CHANNELS = {
    RUN: "json",
    STATUS: "xerxes-status",
    COMMAND: "xerxes-command",
    REPEAT: "xerxes-command",
    OPERATOR: "json",
    VIEW: "json",
    FAILURE: "json",
    SUMMARY: "json",
}


class RunHeader(msgspec.Struct, frozen=True):
    """The first message: everything that makes the run besides its inputs."""

    format_version: int
    program_version: str
    spec: msgspec.Raw
    """The run's own facts, see `sattrack.runtime.facts.RunFacts`."""
    fingerprint: str | None = None
    """Of the code that made the run; None before format 3."""
    environment: Environment | None = None
    anonymous: bool = False
    """Whether site and time are not where and when it was."""


class Failure(msgspec.Struct, frozen=True):
    """What broke outside what the engine computes, and turned the run into a stop."""

    words: str


def to_ns(utc_s: float) -> int:
    """Return an instant as integer nanoseconds, exact to one."""
    whole = int(utc_s // 1.0)
    return whole * 1_000_000_000 + round((utc_s - whole) * 1e9)


def from_ns(ns: int) -> float:
    """Return the float that `to_ns` was given."""
    return ns / 1_000_000_000
