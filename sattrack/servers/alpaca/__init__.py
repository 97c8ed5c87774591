"""An ASCOM telescope over HTTP, by the Alpaca protocol: requests, orders to the mount, answers."""
