"""Places of holders: one Unix socket for each port, in a folder that only its user may enter.

$XDG_RUNTIME_DIR/imuscope/   of a user who is logged in, or as a service sets it
/run/imuscope/               of root
/tmp/imuscope-UID/           else

    0123456789abcdef.sock    the socket, by the path that the holder was given: it stays when an adapter comes back
                             under another number
    %dev%ttyUSB0.sock        a link to it, by the port that this path leads to now: other paths of the port find it
"""

from __future__ import annotations

import os
import stat

TYPE_CHECKING = False
if TYPE_CHECKING:
    from pathlib import Path

LONGEST = 107 - len("/0123456789abcdef.sock")
"""Of the folder, bytes: the system takes no longer path of a socket."""


def runtime_folder() -> Path:
    """The folder for sockets; it is created if necessary.

    Raises:
        OSError: it cannot be created, belongs to another user, or its path is too long.
    """
    from pathlib import Path  # as tempfile and hashlib below: a holder, which is given its path, needs none of them

    runtime, uid = os.environ.get("XDG_RUNTIME_DIR"), os.getuid()
    if runtime:
        folder = Path(runtime, "imuscope")
    elif uid == 0:
        folder = Path("/run/imuscope")
    else:
        import tempfile

        folder = Path(tempfile.gettempdir(), f"imuscope-{uid}")
    if len(os.fsencode(folder)) > LONGEST:
        raise OSError(f"the path {folder} has more than {LONGEST} bytes; set XDG_RUNTIME_DIR to a shorter one")
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    about = folder.lstat()
    if not stat.S_ISDIR(about.st_mode) or about.st_uid != uid or about.st_mode & 0o022:
        raise PermissionError(f"{folder} can be written by others; remove it, or set XDG_RUNTIME_DIR")
    return folder


def socket_of(place: str, folder: Path | None = None) -> Path:
    """The socket of a holder that was given this place.

    Args:
        place: path of a serial port, or "tcp://host:port".
        folder: in place of `runtime_folder`.
    """
    import hashlib

    name = place if "://" in place else os.path.abspath(place)
    return (folder or runtime_folder()) / f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.sock"


def port_link(place: str, path: str) -> str:
    """The link to the socket `path` by the port that a place leads to now; "" for a port of the network."""
    if not place:
        return ""
    return os.path.join(os.path.dirname(path), f"{os.path.realpath(place).replace('/', '%')}.sock")


def sockets_of(place: str) -> list[Path]:
    """Sockets at which the holder of a port may listen, by any path of the port. OSError as `runtime_folder`."""
    first = socket_of(place)
    if "://" in place:
        return [first]
    return [first, first.with_name(os.path.basename(port_link(place, str(first)))), socket_of(os.path.realpath(place))]


def log_of(path: str) -> str:
    """The log of the holder with a socket."""
    return f"{path.removesuffix('.sock')}.log"


def failure_of(pid: int) -> str:
    """Beginning of the line in the log that says why a holder failed."""
    return f"imuscope hold [{pid}] failed: "


def cause_of_end(path: str, pid: int) -> str:
    """Why the holder with a socket failed; "" if it did not, or is not known."""
    try:
        with open(log_of(path), errors="replace") as log:
            lines = log.read().splitlines()
    except OSError:
        return ""
    head = failure_of(pid)
    return next((line.removeprefix(head) for line in reversed(lines) if line.startswith(head)), "")
