"""Opening a file of a folder that anybody may put things into: only if it is a file.

A named pipe waits for a writer when it is opened, a device may never end, and a socket cannot be opened at all. One of
them in a library must not keep a server from starting, so everything that is found by its name is opened here.
"""

import errno
import json
import os
import stat
from pathlib import Path
from typing import Any, BinaryIO

_NO_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)


def open_regular(path: Path) -> BinaryIO:
    """A file, open for reading.

    Raises:
        OSError: it cannot be opened, or is something else than a file.
    """
    descriptor = os.open(path, os.O_RDONLY | _NO_WAITING)
    kind = os.fstat(descriptor).st_mode
    if stat.S_ISREG(kind):
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    if stat.S_ISDIR(kind):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise OSError(errno.EINVAL, "it is a pipe or a device, not a file", str(path))


def read_regular(path: Path) -> bytes:
    """All bytes of a file. Raises as `open_regular` does."""
    with open_regular(path) as file:
        return file.read()


def read_object(path: Path) -> dict[str, Any]:
    """The JSON object in a file; {} if it cannot be read, or has something else."""
    try:
        content = json.loads(read_regular(path))
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def readable_name(path: Path) -> str:
    """The name of a file as text: a byte that is not UTF-8 becomes U+FFFD."""
    return os.fsencode(path.name).decode(errors="replace")
