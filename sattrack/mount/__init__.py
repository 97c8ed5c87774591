"""Mounts: what every one is to the rest of the program, and the clients of each kind."""
