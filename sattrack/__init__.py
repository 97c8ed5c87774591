"""Make a telescope mount follow satellites by streaming axis rates."""

__version__ = "0.1.0"
