"""ASCOM's Alpaca protocol: what clients ask of a telescope over HTTP, and what is answered. No I/O."""
