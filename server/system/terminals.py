"""Paths of terminals: which may be serial ports, which lead to the same one again, and what stands there now."""

from __future__ import annotations

import contextlib
import os
import stat

PTS = "/dev/pts/"  # folder of pseudo-terminals


def pseudo_terminal(place: str) -> tuple[object, int] | None:
    """The way to a pseudo-terminal, and when that was made, ns (0: it is not there); None for other ports."""
    real = os.path.realpath(place)
    if not real.startswith(PTS):
        return None
    way: object = real
    made = 0
    with contextlib.suppress(FileNotFoundError):
        about = os.stat(place, follow_symlinks=False)
        way = (real, about.st_ino, about.st_ctime_ns) if stat.S_ISLNK(about.st_mode) else real
        made = os.stat(real).st_ctime_ns  # reading, writing and settings of the line do not change it
    return way, made


def is_another(place: str, before: tuple[object, int] | None) -> bool:
    """Whether the path of a pseudo-terminal leads to another one now.

    The kernel gives the number of one that was closed to the next: that may be a user's shell. A link that was made
    again leads to the port of its program.
    """
    now = pseudo_terminal(place)
    return before is not None and now is not None and now[0] == before[0] and now[1] not in (0, before[1])


def standing_at(place: str) -> tuple[int, ...] | None:
    """Identity of the file at a path, changed when a port is plugged in or its permissions are set; None: no file.

    It is read every 0.1 s or more often while a port is gone: that costs a few µs, and also sees what a watch of a
    folder (inotify) does not: links of udev, folders that are not there yet, and permissions that come after the port.
    """
    try:
        about = os.stat(place)
    except (OSError, ValueError):
        return None
    return about.st_dev, about.st_ino, about.st_rdev, about.st_mode, about.st_uid, about.st_gid


def may_be_terminal(place: str, root: str | os.PathLike[str] = "/") -> bool:
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
        kind = os.readlink(f"{os.fspath(root)}/sys/dev/char/{major}:{minor}/subsystem")
    except OSError:
        return True  # a pseudo-terminal has none
    return kind.rpartition("/")[2] == "tty"
