"""Paths that may be serial ports."""

from __future__ import annotations

import os
import stat
from pathlib import Path


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
