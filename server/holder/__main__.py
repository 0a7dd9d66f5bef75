"""`python -m server.holder SETTINGS`, where SETTINGS is the JSON of `HolderSettings`."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable

from server.holder.process import Holder
from server.holder.settings import HolderSettings
from server.holder.shares import ShareError

READY = b"ready"


def main() -> int:
    """Run the holder of the settings on the command line: in the foreground with `stay`, else detached."""
    settings = HolderSettings.from_text(sys.argv[1])
    if settings.stay:
        return run(settings, lambda: None)
    reader, writer = os.pipe()
    if os.fork():  # the server must not be the parent of what outlives it
        os.close(writer)
        with os.fdopen(reader, "rb") as end:
            return 0 if end.read() == READY else 1
    os.close(reader)

    def ready() -> None:
        os.write(writer, READY)
        os.close(writer)
        for fd in (1, 2):  # whoever waits for the end of what this process prints need not wait any more
            os.dup2(os.open(os.devnull, os.O_WRONLY), fd)

    return run(settings, ready)


def run(settings: HolderSettings, ready: Callable[[], None]) -> int:
    """Run a holder; `ready` is called when it answers and all shares are offered."""
    holder = Holder(settings)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, holder.end)
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    try:
        holder.run(ready)
    except (OSError, ShareError) as error:
        print(f"imuscope hold: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
