"""No test reads or writes the user's own data."""

from __future__ import annotations

import os
import socket
from typing import TYPE_CHECKING

import pytest

from sattrack.core.local_time import use_zone

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture(scope="session", autouse=True)
def user_data(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Let the user's settings and data be in folders of the session's, and the list of schedules that run."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("CACHE", "CONFIG", "STATE", "DATA"):
            patch.setenv(f"XDG_{name}_HOME", str(tmp_path_factory.mktemp(name.lower())))
        # Nothing listens there: a test that names no server of its own asks nobody.
        patch.setenv("SATTRACK_CELESTRAK_URL", "http://127.0.0.1:9")
        yield


@pytest.fixture(autouse=True)
def time_zone() -> None:
    """Let local time be UTC, whatever the machine's zone is and whatever a test's command has set."""
    if os.environ.get("TZ") != "UTC":
        use_zone("UTC")


@pytest.fixture
def radio_dish(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run where the settings are those of a radio dish.

    For what moves a mount in real time: at whatever hour it runs, the Sun is in nobody's way.
    """
    (tmp_path / "sattrack.toml").write_text("[safety]\noptical = false\n")
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have guardians write what they did, and schedules be listed, in a folder of the test's own."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


@pytest.fixture
def mount_socket() -> Iterator[socket.socket]:
    """Give what receives a mount's commands."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(60.0)
        yield listener
