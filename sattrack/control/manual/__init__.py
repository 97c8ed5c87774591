"""A mount operated by hand: what is asked for, carried out and shown, without I/O."""
