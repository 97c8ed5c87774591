"""The page for people: what is served, and how it stands. Plain HTML, nothing from elsewhere."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from sattrack.servers.alpaca.actions import ACTIONS
from tle.instants import Utc

if TYPE_CHECKING:
    from sattrack.servers.alpaca.telescope import Telescope

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta http-equiv="refresh" content="5"><title>{title}</title>
<style>body{{font:16px sans-serif;margin:2em;max-width:44em}}th{{text-align:left;padding-right:2em}}</style>
</head><body><h1>{title}</h1>
<table>{rows}</table>
<p>Nothing is set here. The mount, its profile, the site, the safety limits and the elements of satellites are
told to <code>sattrack serve alpaca</code> by its options and by <code>sattrack.toml</code>;
<code>sattrack serve alpaca --help</code> has them all.</p>
<p>The protocol has no authentication: whoever reaches this port moves the mount.</p>
</body></html>
"""


def setup_page(telescope: Telescope, place: str, now_utc_s: float) -> str:
    """Return the page as of an instant."""
    device, state = telescope.device, telescope.state
    rows = [
        ("Program", device.info),
        ("Mount", f"{device.profile.name}, {device.mount}"),
        ("Site", place),
        ("Telescope number", "0"),
        ("Clients connected", str(telescope.clients)),
        ("Actions", ", ".join(ACTIONS)),
        ("Now", Utc(now_utc_s).isoformat("seconds")),
    ]
    if state is None or not state.heard:
        rows.append(("State", "the mount is not heard"))
    else:
        rows += [
            ("State", "parked" if state.at_park else state.doing),
            ("Right ascension", f"{state.ra_h:.5f} h of date"),
            ("Declination", f"{state.dec_deg:+.4f}°"),
            ("Side of the pier", "beyond the pole" if state.beyond_pole else "normal"),
        ]
        if state.tripped is not None:
            rows.append(("Stopped by safety", f"{state.tripped}; AbortSlew makes it ready again"))
    lines = (f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return PAGE.format(title=escape(device.name), rows="\n".join(lines))
