"""A mount's pointing model: its terms, their fit to stars, files, and the choice of stars."""
