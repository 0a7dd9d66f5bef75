"""Messages of subprocesses to their parent, and their termination when it dies.

Their output is no longer needed, and the next server may be producing the same.

Source: prctl(2), PR_SET_PDEATHSIG.
"""

import contextlib
import ctypes
import json
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def die_with_parent() -> None:
    """Terminate this process (SIGTERM) when its parent dies, if the system supports that. Call it first."""
    if sys.platform != "linux":
        return
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGTERM))


def report_to_parent(**words: object) -> None:
    """Write a message to the parent: a line of JSON on standard output.

    Raises:
        SystemExit: the parent is dead. Its end of the pipe is closed a moment before the signal comes.
    """
    try:
        print(json.dumps(words), flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what the interpreter writes at exit
        raise SystemExit(1) from None
