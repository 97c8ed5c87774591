"""Hamlib's rotctld protocol, version 1: what clients say, what is answered, and where the mount is to be."""
