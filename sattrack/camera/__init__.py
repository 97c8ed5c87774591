"""Frames of a camera on the telescope, and where the satellite is in them."""
