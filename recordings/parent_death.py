"""What becomes of a process that works aside when the one that asked for it is killed? It ends, too.

Nobody waits for what it makes any more, and the next server may be making the same.

Source: prctl(2), PR_SET_PDEATHSIG.
"""

from __future__ import annotations

import contextlib
import ctypes
import signal
import sys

_PR_SET_PDEATHSIG = 1


def die_with_parent() -> None:
    """Have this process told to end (SIGTERM) when its parent is gone; where that can be had. To be called first."""
    if sys.platform != "linux":
        return
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGTERM))
