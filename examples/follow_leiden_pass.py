"""Follow the high part of a pass in virtual time with a nudge on the way, and print how near the mount kept.

Run from the project's root: python examples/follow_leiden_pass.py
"""

from __future__ import annotations

from pathlib import Path

from sattrack.runtime.facts import RunRequest, prepare
from sattrack.runtime.flight import fly_virtual
from sattrack.views.messages import Nudge
from tle import Site, Utc, read_elements

HERE = Path(__file__).parent


def main() -> None:
    """Follow it."""
    request = RunRequest(
        satellite="ISS (ZARYA)",
        mount_url="sim",
        elements=read_elements(HERE / "iss_leiden.tle"),
        site=Site(52.1541, 4.4908, 0.0),
        clock_option="2026-10-02T13:00:00Z",
        min_alt_deg=60.0,
        virtual=True,
    )
    nudge_at = Utc.parse("2026-10-02T13:05:00Z").unix_s
    summary = fly_virtual(prepare(request), messages=((float(nudge_at), Nudge(along_s=0.2)),))
    print(f"{summary.name}: on target for {summary.on_target_s:.0f} s, then ended by {summary.ended_by}")
    print(f"true error {summary.true_rms_arcsec:.3f}″ RMS, {summary.true_peak_arcsec:.2f}″ peak")


if __name__ == "__main__":
    main()
