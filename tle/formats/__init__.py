"""Texts that hold element sets, one module a format: text in, elements and refusals out."""
