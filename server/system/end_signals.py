"""Signals that ask a program to end."""

import contextlib
import signal
from collections.abc import Iterator


def end_signals() -> tuple[signal.Signals, ...]:
    """SIGINT (Ctrl-C), SIGTERM, and SIGHUP: the window was closed, or the ssh connection is gone.

    Without SIGHUP where it is ignored, as under `nohup`: then the program is to outlive its terminal.
    """
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        return signal.SIGINT, signal.SIGTERM
    return signal.SIGINT, signal.SIGTERM, signal.SIGHUP


@contextlib.contextmanager
def ending_by_exception() -> Iterator[None]:
    """End by an exception at a signal, so that temporary files and folders are removed."""
    import threading  # the holder of a shared port needs no threads

    def end(number: int, frame: object) -> None:
        raise SystemExit(128 + number)

    if threading.current_thread() is not threading.main_thread():  # only that one may set handlers
        yield
        return
    before = {number: signal.signal(number, end) for number in end_signals() if number != signal.SIGINT}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
