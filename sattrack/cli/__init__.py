"""The command line: parse, call, print. One module a command, imported when the command is used."""
