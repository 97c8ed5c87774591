"""What a run's screen starts beside itself, called with the same settings as the run."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from sattrack.tui.beside import Beside

if TYPE_CHECKING:
    from pathlib import Path

    from sattrack.cli.common import CommandContext

NO_ELEMENTS = "no passes: give --elements FILE and --site, or set them in sattrack.toml"


def beside(
    context: CommandContext,
    profile: Path | None,
    min_alt_deg: float | None,
    practising: bool,
    mount_url: str | None = None,
) -> Beside:
    """Return how a screen calls `passes` and `mount watch`; `practising`: with the built-in satellite."""
    there = None if mount_url == "sim" else mount_url
    shared = _option("--config", given("--config")) + _option("--profile", profile)
    site = context.site_option
    if site is None and not context.has_site():
        from sattrack.runtime import practice

        where = practice.SITE
        site = f"{where.latitude_deg},{where.longitude_deg},{where.height_m}"
    watch = shared + _option("--site", site)
    least = _option("--min-alt", min_alt_deg)
    sources = context.sources()
    if practising:
        from sattrack.runtime import practice

        lines = f"{practice.NAME}\n{practice.LINE_1}\n{practice.LINE_2}\n"
        return Beside((*watch, *least, "--elements", "-"), watch, lines.encode(), mount_url=there)
    if not sources or "-" in sources or not context.has_site():
        return Beside(None, watch, why=NO_ELEMENTS, mount_url=there)
    named = tuple(word for source in context.element_sources for word in ("--elements", source))
    return Beside((*watch, *least, *named), watch, mount_url=there)


def _option(name: str, value: object | None) -> tuple[str, ...]:
    return () if value is None else (name, str(value))


def given(name: str) -> str | None:
    """Return what this command line says of an option that the context does not keep."""
    for word, following in zip(sys.argv, [*sys.argv[1:], ""], strict=True):
        if word == name:
            return following
        if word.startswith(f"{name}="):
            return word.partition("=")[2]
    return None
