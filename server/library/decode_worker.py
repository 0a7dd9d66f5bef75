"""`python -m server.library.decode_worker`: one recording decoded in a process of its own, for column_cache.py.

A wish comes on standard input, one JSON object: path, store, and how it is read (words_of of
server/devices/decode_options.py; a key is never on a command line). What goes out are JSON
lines: {"progress": 0..1} as it goes on, {"shown": a folder} when what is decoded so far can be read there, and
{"message", "hint"} when it cannot.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from pathlib import Path

from recordings.bounds import TooLong, bounded, bounded_by
from recordings.importers import open_file
from recordings.mcap_writer import RecordingError
from recordings.parent_death import die_with_parent
from server.devices.decode_options import DecodeOptions, reading
from server.devices.protocol_set import speech
from server.library.decode import decode

STEP = 0.005


def main() -> int:
    """Decode what standard input asks for; 0, or 1 when it could not be done and was told."""
    die_with_parent()
    bounded()
    with contextlib.suppress(OSError):
        os.nice(5)  # live devices come first
    words = sys.stdin.read()
    if not words:
        return 0  # it was started ahead, and nothing was opened
    wish = json.loads(words)
    told = 0.0

    def progress(share: float) -> None:
        nonlocal told
        if share >= told + STEP:
            told = share
            _say(progress=round(share, 3))

    try:
        bounded_by(Path(wish["path"]))
        source = open_file(Path(wish["path"]))
        usual = reading(**wish.get("reading", {}))
        shown = lambda folder: _say(shown=str(folder))  # noqa: E731
        decode(source, Path(wish["store"]), speech(), DecodeOptions(), progress, shown, usual)
    except RecordingError as error:
        _say(message=error.message, hint=error.hint)
        return 1
    except MemoryError:
        _say(message="Opening it takes more memory than it may have.", hint="Is it damaged, or made to do harm?")
        return 1
    except TooLong:
        _say(message="Opening it takes more time than it may have.", hint="Is it damaged, or made to do harm?")
        return 1
    except OSError as error:
        _say(message=f"It cannot be opened: {(error.strerror or 'the disk failed').lower()}.", hint="")
        return 1
    return 0


def _say(**words: object) -> None:
    print(json.dumps(words), flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
