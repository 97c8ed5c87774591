"""The exceptions a user can meet, each with the exit code that scripts rely on."""

from __future__ import annotations


class SattrackError(Exception):
    """Something could not be done; the message is one line that says what, where and what to do."""

    exit_code = 1


class BadInputError(SattrackError):
    """What the user gave is wrong: a file, an option, a value."""

    exit_code = 2


class SafetyLimitError(SattrackError):
    """A safety limit ended the run; the mount was stopped."""

    exit_code = 3


class LinkLostError(SattrackError):
    """The mount stopped answering, or never answered."""

    exit_code = 4


class InterruptedRunError(SattrackError):
    """The operator interrupted the run; the mount was stopped first."""

    exit_code = 130


class TerminatedRunError(SattrackError):
    """The system ended the run; the mount was stopped first, and a restart goes on where it was."""

    exit_code = 143
