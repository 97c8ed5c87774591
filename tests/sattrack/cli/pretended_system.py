"""A program that runs command lines without what Windows or macOS lack, and prints what came of each.

`python pretended_system.py win32|darwin` reads a JSON list of command lines from standard input and prints a
JSON list of exit code, standard output and standard error of each.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import select
import signal
import socket
import sys
import sysconfig
import time

MISSING = {
    "win32": {
        os: "fork getuid geteuid getgid setsid killpg getpgid sched_setscheduler sched_setaffinity "
        "sched_param nice uname chown fchown fchmod mkfifo openpty set_blocking waitid getloadavg eventfd "
        "memfd_create pidfd_open O_NOFOLLOW O_CLOEXEC O_NONBLOCK O_DIRECTORY WNOHANG",
        signal: "SIGHUP SIGQUIT SIGUSR1 SIGUSR2 SIGKILL SIGALRM SIGWINCH SIGTSTP SIGTTIN SIGTTOU SIGCONT "
        "SIGSTOP SIGCHLD SIGPIPE pthread_sigmask pthread_kill setitimer alarm pidfd_send_signal",
        socket: "AF_UNIX SO_PEERCRED SCM_RIGHTS SO_REUSEPORT MSG_DONTWAIT MSG_NOSIGNAL",
        time: "CLOCK_BOOTTIME CLOCK_MONOTONIC CLOCK_REALTIME clock_gettime tzset",
        select: "poll epoll",
    },
    "darwin": {
        os: "sched_setscheduler sched_setaffinity sched_param SCHED_FIFO SCHED_OTHER SCHED_RESET_ON_FORK "
        "memfd_create pidfd_open eventfd",
        signal: "pidfd_send_signal sigtimedwait",
        socket: "SO_PEERCRED MSG_NOSIGNAL",
        time: "CLOCK_BOOTTIME",
        select: "epoll",
    },
}
UNIX_MODULES = frozenset(
    {"fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty", "curses", "readline"}
)


class Refusal:
    """Finds no module that only Unix has."""

    @staticmethod
    def find_spec(name: str, *_: object) -> None:
        """Raise ModuleNotFoundError for such a module."""
        if name.partition(".")[0] in UNIX_MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def pretend(system: str) -> None:
    """Take away what this system lacks, after what chooses by the real system is imported."""
    import asyncio  # noqa: F401
    import multiprocessing.connection  # noqa: F401
    import ssl  # noqa: F401
    import subprocess  # noqa: F401
    import tempfile  # noqa: F401
    import urllib.request  # noqa: F401

    import aiohttp  # noqa: F401
    import click  # noqa: F401
    import numpy as np  # noqa: F401

    sysconfig.get_config_vars()

    for module, names in MISSING[system].items():
        for name in names.split():
            if hasattr(module, name):
                delattr(module, name)
    if system == "win32":
        for name in UNIX_MODULES:
            sys.modules.pop(name, None)
        sys.meta_path.insert(0, Refusal)  # type: ignore[arg-type]
    sys.platform = system


def main() -> None:
    """Run the command lines."""
    pretend(sys.argv[1])
    from sattrack.cli.main import run

    answers = []
    for line in json.load(sys.stdin):
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = run(line)
        answers.append([code, out.getvalue(), err.getvalue()])
    json.dump(answers, sys.stdout)


if __name__ == "__main__":
    main()
