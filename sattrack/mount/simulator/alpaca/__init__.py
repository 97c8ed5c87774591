"""A simulated Alpaca telescope: a mount with MoveAxis behind HTTP, for practice and tests.

It knows the ASCOM Alpaca interface alone and nothing of whoever follows satellites with it.
"""
