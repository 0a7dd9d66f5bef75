"""Texts shared by links: formats of numbers and addresses, progress lines, errors of listening."""

import contextlib
import errno
import glob
import os
import time
from pathlib import Path

from imuscope.server.links.base import Attempt, LinkError, Progress


def grouped(number: float) -> str:
    """Format a number with digits grouped as in SI: 921600 → "921 600"; 0.01 → "0.01"."""
    return f"{number:,.10g}".replace(",", " ")


def place_of(host: str, port: int) -> str:
    """Format an address: "192.168.1.5:4001", "[fe80::1]:4001"."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def heading(host: str, port: int) -> str:
    """Listening address for display; an empty host stands for all addresses of this machine."""
    return f"port {port}" if host in ("", "0.0.0.0", "::") else place_of(host, port)


def progress_line(progress: Progress | None, what: str, outcome: str) -> None:
    """Report one attempt if `progress` is given."""
    if progress is not None:
        progress(Attempt(what=what, outcome=outcome, time=time.time()))


def is_ours(port: int) -> bool:
    """Whether this process itself listens on that port, by TCP or UDP."""
    own = set()
    for one in glob.iglob("/proc/self/fd/*"):
        with contextlib.suppress(OSError):  # the descriptor of the listing itself is closed already
            own.add(os.readlink(one))
    for name in ("tcp", "tcp6", "udp", "udp6"):
        with contextlib.suppress(OSError):
            for line in Path(f"/proc/self/net/{name}").read_text().splitlines()[1:]:
                parts = line.split()
                if int(parts[1].rpartition(":")[2], 16) == port and f"socket:[{parts[9]}]" in own:
                    return True
    return False


def listen_error(kind: str, host: str, port: int, error: OSError) -> LinkError:
    """Error for a port that cannot be listened on."""
    where = heading(host, port)
    if error.errno == errno.EADDRINUSE:
        if is_ours(port):
            hint = "A port can have only one source: remove the other, or choose another port."
            return LinkError("busy", f"{where.capitalize()} is in use by this server itself.", hint)
        hint = "Choose another port, or stop the program that has this one (`ss -lnptu` shows it)."
        return LinkError("busy", f"{where.capitalize()} is in use by another program.", hint)
    if error.errno == errno.EACCES:
        return LinkError(
            "denied", f"No permission to listen on {where}.", "Ports below 1024 belong to root: choose a higher one."
        )
    if error.errno == errno.EADDRNOTAVAIL or error.errno is None or error.errno < 0:
        hint = f"Leave the host out to listen on every address: {kind}://:{port}."
        return LinkError("not-found", f"This machine has no address {host}.", hint)
    return LinkError("refused", f"Cannot listen on {where}: {error.strerror}.", "Try another port.")
