"""`python -m imuscope.server.extensions.shares.holder SETTINGS`, where SETTINGS is the JSON of `HolderSettings`.

A holder that fails says why: on standard error, which is the journal for a unit of systemd and a log beside its socket
for one that a server has started (places.log_of), and in the system's log.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
from collections.abc import Callable

from imuscope.recordings.system.priority import PERMIT, raise_priority
from imuscope.server.extensions.shares.holder.process import Holder
from imuscope.server.extensions.shares.holder.settings import HolderSettings
from imuscope.server.extensions.shares.holder.shares import ShareError
from imuscope.server.extensions.shares.holder.socket_paths import failure_of, log_of
from imuscope.server.system.end_signals import end_signals

READY = b"ready"
MOST_LOG = 1 << 16  # bytes, beyond which a new log is begun


def main() -> int:
    """Run the holder of the settings on the command line: in the foreground with `stay`, else detached."""
    settings = HolderSettings.from_text(sys.argv[1])
    if settings.stay:
        return run(settings, lambda: None)
    reader, writer = os.pipe()
    if holder := os.fork():  # the server must not be the parent of what outlives it
        os.close(writer)
        with os.fdopen(reader, "rb") as end:
            if end.read() == READY:
                return 0
        os.waitpid(holder, 0)  # until it has let go of the port, which may be opened again at once
        return 1
    os.close(reader)

    def ready() -> None:
        os.write(writer, READY)
        os.close(writer)
        log = _opened_log(log_of(settings.socket))
        for fd in (1, 2):  # readers of this process's output see its end
            os.dup2(log, fd)

    return run(settings, ready)


def run(settings: HolderSettings, ready: Callable[[], None]) -> int:
    """Run a holder; `ready` is called when it answers and all shares are offered."""
    faulthandler.enable()
    if not raise_priority() and settings.stay:
        print(f"imuscope hold: this process has no priority over others. {PERMIT}", file=sys.stderr, flush=True)
    holder = Holder(settings)
    for number in end_signals():
        signal.signal(number, holder.end)
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    failures: list[Exception] = []

    def failed(error: Exception) -> None:
        import syslog
        import traceback

        failures.append(error)
        traceback.print_exception(error)
        words = failure_of(os.getpid()) + f"{type(error).__name__}: {error}"
        print(words, file=sys.stderr, flush=True)
        syslog.syslog(syslog.LOG_ERR, words)

    try:
        holder.run(ready, failed)
    except (OSError, ShareError) as error:
        print(f"imuscope hold: {error}", file=sys.stderr)
        return 1
    return 1 if failures else 0


def _opened_log(path: str) -> int:
    """A descriptor of the log; of nothing if it cannot be written."""
    try:
        log = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        if os.fstat(log).st_size > MOST_LOG:
            os.ftruncate(log, 0)
    except OSError:
        return os.open(os.devnull, os.O_WRONLY)
    return log


if __name__ == "__main__":
    raise SystemExit(main())
