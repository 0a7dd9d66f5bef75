"""`python -m imuscope.server.library.played_file_worker`: read a file that is played, for played_file.py.

Standard input is a socket. Its first line is JSON {path, protocol}, answered with {format, devices, damage, span,
preambles}; each further line {pass, start, stop} is answered with the blocks of the file: {pass, device, direction,
done, size, count}, the bytes, `count` ends and as many times (int64), then {pass, is_last}. A failure is {message,
hint}.
"""

import json
import os
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.replay import extent
from imuscope.recordings.sources import Source
from imuscope.recordings.system.parent_death import die_with_parent
from imuscope.recordings.system.resource_limits import TooLong, bounded, bounded_by

STANDARD_INPUT, STANDARD_OUTPUT, STANDARD_ERROR = range(3)


def main() -> None:
    """Answer until the socket is closed."""
    die_with_parent()
    bounded()
    os.dup2(STANDARD_ERROR, STANDARD_OUTPUT)  # which has no reader
    with socket.socket(fileno=os.dup(STANDARD_INPUT)) as line, line.makefile("rwb") as opened:
        file = cast(BinaryIO, opened)
        try:
            _serve(file)
        except BrokenPipeError:
            pass
        except RecordingError as error:
            _send(file, {"message": error.message, "hint": error.hint})
        except (MemoryError, TooLong) as error:
            what = "memory" if isinstance(error, MemoryError) else "time"
            hint = "The file may be damaged or malicious."
            _send(file, {"message": f"Reading the file exceeds the {what} limit.", "hint": hint})
        except OSError as error:
            words = (error.strerror or "it failed").lower()
            _send(file, {"message": f"The file cannot be read any more: {words}.", "hint": "Check the disk."})


def _serve(file: BinaryIO) -> None:
    source: Source | None = None
    for text in file:
        request = json.loads(text)
        if source is None:
            path = Path(request["path"])
            bounded_by(path, is_last=False)
            source = open_file(path, request["protocol"])
            _send(file, _about(source))
        else:
            bounded_by(source.path, is_last=False)
            _send_blocks(file, source, request)


def _about(source: Source) -> dict[str, Any]:
    span = extent(source)
    preamble = getattr(source, "preamble", lambda device: b"")
    return {
        "format": source.format,
        "devices": [
            {"id": one.id, "protocol": one.protocol, "identity": dict(one.identity)} for one in source.devices.values()
        ],
        "damage": [one.words for one in source.damage[:1]],
        "span": span,
        "preambles": {device: preamble(device).hex() for device in source.devices},
    }


def _send_blocks(file: BinaryIO, source: Source, request: Mapping[str, Any]) -> None:
    number = request["pass"]
    for part in source.parts(request["start"], request["stop"]):
        head = {"pass": number, "device": part.device, "direction": part.direction, "done": part.done}
        file.write(json.dumps(head | {"size": len(part.data), "count": len(part.ends)}).encode() + b"\n")
        for one in (part.data, np.asarray(part.ends, np.int64).tobytes(), np.asarray(part.times, np.int64).tobytes()):
            file.write(one)
        file.flush()
    _send(file, {"pass": number, "is_last": True})


def _send(file: BinaryIO, words: Mapping[str, Any]) -> None:
    file.write(json.dumps(words).encode() + b"\n")
    file.flush()


if __name__ == "__main__":
    main()
