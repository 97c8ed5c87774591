"""Follow a satellite with any program that speaks Alpaca: here ASCOM's own client for Python, alpyca.

Serve a mount, the simulated one here, and run this beside it:

    sattrack serve alpaca --mount sim --clock 2026-10-02T13:03:00Z &
    python examples/alpaca_client.py 127.0.0.1:11111
"""

import argparse
import json
import sys
import time

try:
    from alpaca import exceptions
    from alpaca.telescope import Telescope
except ImportError:
    sys.exit("this example needs ASCOM's client: pip install alpyca")

REFUSALS = (
    *(exceptions.AlpacaRequestException, exceptions.DriverException, exceptions.InvalidOperationException),
    *(
        exceptions.InvalidValueException,
        exceptions.NotConnectedException,
        exceptions.ActionNotImplementedException,
    ),
)


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
    parser = argparse.ArgumentParser(
        description="Follow the ISS with a mount served by `sattrack serve alpaca`."
    )
    parser.add_argument(
        "address", nargs="?", default="127.0.0.1:11111", help="HOST:PORT of the Alpaca server"
    )
    address = parser.parse_args().address
    try:
        main(address)
    except OSError:
        sys.exit(f"nothing answers at {address}: is `sattrack serve alpaca --mount sim` running there?")
    except REFUSALS as error:
        sys.exit(f"the mount refused: {error}")
