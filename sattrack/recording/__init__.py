"""Recordings: every input and output of a run with its instant, and the run made again from them."""
