"""Orbital elements in, topocentric directions and rates out."""
