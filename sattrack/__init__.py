"""Make a telescope mount follow satellites by streaming axis rates.

A program, `sattrack`; what scripts import is the package `tle`.
"""

__all__ = ["__version__"]

__version__ = "0.1.0"
