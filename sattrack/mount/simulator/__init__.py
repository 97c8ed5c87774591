"""The mount's side of the Xerxes protocol: servo axes, the mount's logic, and its UDP server."""
