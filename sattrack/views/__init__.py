"""Views of a run, a mount and a schedule, the messages to them, and their text: immutable types, no I/O."""
