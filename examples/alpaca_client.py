"""Follow a satellite with any program that speaks Alpaca: here ASCOM's own client for Python, alpyca.

Serve a mount, the simulated one here, and run this beside it:

    sattrack serve alpaca --mount sim --clock 2026-10-02T13:03:00Z &
    python examples/alpaca_client.py 127.0.0.1:11111
"""

import json
import sys
import time

from alpaca.telescope import Telescope


def main(address: str) -> None:
    """Connect, follow the satellite until it is acquired, lead it by half a second, stop."""
    telescope = Telescope(address, 0)
    telescope.Connect()
    while telescope.Connecting:
        time.sleep(0.1)
    print(f"{telescope.Name}: {telescope.DriverInfo[0]}")

    followed = json.loads(telescope.Action("TrackSatellite", json.dumps({"satellite": "ISS"})))
    print(f"following {followed['name']} until {followed['to_utc']}")
    while telescope.Slewing:
        time.sleep(0.1)
    print("acquired")

    time.sleep(2.0)
    telescope.Action("Bias", json.dumps({"along_s": 0.5}))
    told = json.loads(telescope.Action("Bias"))
    print(f"{told['phase']}, {told['error_arcsec']:.2f} arcseconds off, {told['along_s']:+.1f} s along")

    telescope.AbortSlew()
    while telescope.Slewing:
        time.sleep(0.1)
    print("stopped")
    telescope.Disconnect()
    telescope.rqs.close()


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1:11111")
