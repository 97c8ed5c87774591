"""`--mount URL` of the commands that lead a mount themselves: what it may be is the same for all."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from sattrack.runtime.mounts import FORMS

if TYPE_CHECKING:
    from collections.abc import Callable


def mount_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add `--mount URL`, handed on as `mount_url`, which `runtime.mounts.mount_address` reads."""
    return click.option("--mount", "mount_url", metavar="URL", help=f"sim, {FORMS}; else as set.")(function)
