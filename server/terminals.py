"""Paths of terminals: which may be serial ports, and which lead to the same one again."""

from __future__ import annotations

import os
import stat
from pathlib import Path


def pseudo_terminal(place: str) -> object:
    """Identity of the pseudo-terminal that a path leads to; None for other ports.

    The kernel gives the number of one that was closed to the next: that may be a user's shell. So a path leads to the
    same port again only if it is a link that was recreated.
    """
    real = os.path.realpath(place)
    if not real.startswith("/dev/pts/"):
        return None
    try:
        about = os.stat(place, follow_symlinks=False)
    except FileNotFoundError:
        return real  # it is gone, and was not a link
    return (real, about.st_ino, about.st_ctime_ns) if stat.S_ISLNK(about.st_mode) else real


def may_be_terminal(place: str, root: Path = Path("/")) -> bool:
    """Whether a path may be a serial port: only then it is opened, because to open another device can have effects.

    The system reports the kind of a device; where it does not (`/sys` is missing), the opened port has to be a
    terminal.
    """
    try:
        about = os.stat(place)
    except OSError:
        return True  # which is reported when it is opened
    if not stat.S_ISCHR(about.st_mode):
        return False
    major, minor = os.major(about.st_rdev), os.minor(about.st_rdev)
    try:
        kind = os.readlink(root / f"sys/dev/char/{major}:{minor}/subsystem")
    except OSError:
        return True  # a pseudo-terminal has none
    return kind.rpartition("/")[2] == "tty"
