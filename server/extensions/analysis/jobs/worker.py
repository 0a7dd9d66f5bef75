"""Processes of analyses: each runs in its own, within limits.

    python -m imuscope.server.extensions.analysis.jobs.worker MEMORY_MB TIME_S

It is a fork server (server/system/fork_server.py): it imports what analyses need once, and has no threads. The answer
of a job has the facts {"media"}, or {"kind", "message", "hint"} of an error.
"""

import os
import sys
import traceback
from collections.abc import Callable
from importlib import import_module
from typing import Any

from imuscope.recordings.system.priority import lower_priority
from imuscope.recordings.system.resource_limits import TooLong, bounded, memory_in_use, memory_of_one
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.jobs.jobs import AnalysisJob
from imuscope.server.extensions.analysis.jobs.limits import AnalysisLimits
from imuscope.server.extensions.analysis.noise.registry import load_analyses
from imuscope.server.services.extension import extensions
from imuscope.server.system.fork_server import JobAnswer, serve

USED = (
    "scipy.fft",
    "scipy.ndimage",
    "scipy.signal",
)  # imported late by others, or unpickled
OWN_MB = 128  # of memory besides the limit, for stacks of threads, and for the text of the answer


def main() -> int:
    """Serve jobs until standard input, a socket, is closed."""
    limits = AnalysisLimits.of(sys.argv[1:])
    limits = AnalysisLimits(min(limits.memory_mb, memory_of_one() >> 20), limits.time_s)
    load_analyses()
    for name in (*USED, *(job for extension in extensions() for job in extension.jobs)):
        import_module(name)
    cpu_s = round(limits.time_s * (os.cpu_count() or 1)) + 60  # in several threads
    memory = memory_in_use() + (limits.memory_mb + OWN_MB << 20)

    def limit() -> None:
        lower_priority(5)  # live devices come first; the start, for which a client waits, is over
        bounded(memory, cpu_s)

    serve(limit, lambda receive: _answer(receive, limits))
    return 0


def _answer(receive: Callable[[], Any], limits: AnalysisLimits) -> JobAnswer:
    try:
        job: AnalysisJob = receive()
        media, body = job.content()
        return JobAnswer({"media": media}, body)
    except DomainError as error:
        return _failed(error)
    except MemoryError:
        return _failed(limits.too_much_memory())
    except TooLong:
        return _failed(limits.too_long())
    except Exception:
        traceback.print_exc()
        return _failed(DomainError("fault", "The analysis failed.", "The log of the server has details."))


def _failed(error: DomainError) -> JobAnswer:
    return JobAnswer({"kind": error.kind, "message": error.message, "hint": error.hint}, b"")


if __name__ == "__main__":
    raise SystemExit(main())
