"""INDI telescopes as mounts, in the terms of an Alpaca telescope, which the gateway speaks."""
