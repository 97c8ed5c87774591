"""The addresses that the package's metadata name: those of the repository from which it is built."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

WEB = re.compile(r"(?:https://|ssh://|git@)(?:[^@/]*@)?([\w.-]+)(?::\d+)?[:/]([\w./~-]+?)(?:\.git)?/?")
"""A host and a path, as `git clone` takes them; a user's name and password are no part of them."""


class ProjectUrls(MetadataHookInterface):
    """Gives the package the web addresses of the repository that was cloned; none where it is not known."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add `urls` to the metadata of the project; a source distribution has those it was built with."""
        web = web_address(_origin(Path(self.root)))
        urls = {} if web is None else {"Homepage": web, "Source": web, "Issues": f"{web}/issues"}
        metadata.setdefault("urls", urls)


def web_address(cloned_from: str) -> str | None:
    """Return the page of a repository by the address that it was cloned from; None where it has none."""
    found = WEB.fullmatch(cloned_from)
    return None if found is None else f"https://{found[1]}/{found[2]}"


def _origin(root: Path) -> str:
    """Return the address from which this repository was cloned, empty where it is not known."""
    try:
        done = subprocess.run(
            ["git", "-C", str(root), "config", "--local", "remote.origin.url"],
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip() if (root / ".git").exists() else ""
