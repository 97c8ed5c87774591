"""List the passes over Leiden on 2 October 2026: the whole source at once, then the facts of each pass."""

from __future__ import annotations

from pathlib import Path

from tle import Site, Utc, find_catalogue_passes, pass_facts, read_elements


def main() -> None:
    """Print each pass above 10°: satellite, rise, highest altitude, peak rate in hour angle, sunlight."""
    elements = read_elements(Path(__file__).with_name("iss_leiden.tle"))
    passes = find_catalogue_passes(elements, Site(52.1541, 4.4908), Utc.parse("2026-10-02"), 24.0, 10.0)
    for one, facts in zip(passes, pass_facts(passes), strict=True):
        rise = one.seen.rise_utc
        begins = "already up" if rise is None else rise.isoformat("seconds")
        line = f"{one.elements.label}  {begins}  {one.seen.max_alt_deg:.1f}°"
        if facts is not None:
            line += f"  {facts.peak_ha_rate_deg_s:.3f} °/s  {'sunlit' if facts.sunlit else 'dark'}"
        print(line)


if __name__ == "__main__":
    main()
