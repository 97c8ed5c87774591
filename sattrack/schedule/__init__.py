"""Schedules of passes: the file that a person writes, and the plan that is made of it."""
