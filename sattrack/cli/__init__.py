"""One module a command, each with a `command` object; imported only by the command that needs it."""
