"""Schedules: the file that a person writes, the plan made of it, and the night that carries it out."""
