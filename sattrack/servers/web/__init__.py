"""The screen of a run in a browser."""
