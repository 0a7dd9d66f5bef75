"""Processes that read files from outside: each call runs in its own, within limits.

    python -m imuscope.server.library.file_worker

It is a fork server (server/system/fork_server.py) for foreign_files.py: it imports what reads files once. The answer of
a call has the facts {}, or {"error", "message", "hint"} and for an error of the system {"error", "message", "number"}.
"""

import io
import os
import traceback
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, BinaryIO, cast

from pydantic_core import to_json

from imuscope.recordings.errors import ExplainedError
from imuscope.recordings.readers.registry import READERS
from imuscope.recordings.system.priority import lower_priority
from imuscope.recordings.system.resource_limits import TooLong, bounded, memory_in_use, memory_of_one
from imuscope.server.errors import DomainError
from imuscope.server.library.foreign_files import MALICIOUS, FileCall
from imuscope.server.system.fork_server import JobAnswer, serve

POOL = "ARROW_DEFAULT_MEMORY_POOL"  # another one reserves 1 GiB at once, all that a small machine has for a call
USED = (
    "encodings.utf_8_sig",
    "pyarrow.compute",
    "imuscope.recordings.library.table_preview",
    "imuscope.recordings.library.download",
    "imuscope.server.library.packets",
)
KILLED_S = 1  # from the end of its processor time to the end of the process
PIECE_BYTES = 1 << 18
MOST_WORDS = 1000  # characters of a sentence, which may quote the file


def main() -> None:
    """Serve calls until standard input, a socket, is closed."""
    os.environ[POOL] = "system"
    READERS.all()
    for name in USED:
        import_module(name)
    import_module("pyarrow").array([0])  # this imports pandas, if it is installed
    memory = memory_of_one()

    def limit() -> None:
        lower_priority(5)  # live devices come first
        bounded(memory_in_use() + memory)

    serve(limit, _answer)


def _answer(receive: Callable[[], Any]) -> JobAnswer:
    call: FileCall = receive()
    bounded(memory_in_use() + memory_of_one(), call.cpu_s, KILLED_S)
    module, _, name = call.function.partition(":")
    function = getattr(import_module(module), name)
    if call.writes:
        return JobAnswer({}, lambda send: _written(function, call, send))
    result: list[bytes] = []
    facts = _attempt(call, lambda: result.append(to_json(function(*call.arguments))))
    return JobAnswer(facts, result[0] if result else b"")


def _written(function: Callable[..., None], call: FileCall, send: Callable[[bytes], None]) -> Mapping[str, Any]:
    out = io.BufferedWriter(_Pieces(send), PIECE_BYTES)

    def write() -> None:
        function(*call.arguments, cast(BinaryIO, out))
        out.flush()

    return _attempt(call, write)


class _Pieces(io.RawIOBase):
    """A file whose bytes are sent."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        piece = bytes(data)
        self._send(piece)
        return len(piece)


def _attempt(call: FileCall, work: Callable[[], object]) -> dict[str, Any]:
    """Facts of an attempt at the work."""
    try:
        work()
        return {}
    except (BrokenPipeError, ConnectionResetError):
        raise
    except DomainError as error:
        return {"error": error.kind, "message": error.message[:MOST_WORDS], "hint": error.hint[:MOST_WORDS]}
    except ExplainedError as error:
        return {"error": "recording", "message": error.message[:MOST_WORDS], "hint": error.hint[:MOST_WORDS]}
    except OSError as error:
        return {"error": "system", "message": error.strerror or str(error), "number": error.errno or 0}
    except (MemoryError, TooLong) as error:
        what = "memory" if isinstance(error, MemoryError) else "time"
        return {"error": "recording", "message": f"Reading {call.name} exceeds the {what} limit.", "hint": MALICIOUS}
    except Exception:
        traceback.print_exc()
        hint = "The log of the server has details."
        return {"error": "recording", "message": f"Reading {call.name} failed.", "hint": hint}


if __name__ == "__main__":
    main()
