"""`python -m imuscope.server.decode_worker`: decode one recording in a subprocess, for server/library/column_cache.py.

The request comes on standard input, one JSON object: path, store, the choices on how it is read, which the sidecar of
the recording must still have, and decode options (DecodeOptions.values; a key is never on a command line). The output
are JSON lines: {"progress": 0..1}, {"shown": a folder} when the part decoded so far can be read there, and {"message",
"hint"} for an error.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from pathlib import Path

from imuscope.recordings.file_reading import FileReading
from imuscope.recordings.importers import open_file
from imuscope.recordings.mcap_writer import RecordingError
from imuscope.recordings.parent_death import die_with_parent, report_to_parent
from imuscope.recordings.resource_limits import TooLong, bounded, bounded_by
from imuscope.recordings.sidecar import stored_reading
from imuscope.server.devices.decode_options import DecodeOptions
from imuscope.server.devices.protocol_set import all_protocols
from imuscope.server.library.cache_provenance import CHANGED, write_source
from imuscope.server.library.computed_signals import compute_signals
from imuscope.server.library.decode import decode

STEP = 0.005


def main() -> int:
    """Decode the recording that standard input requests. Returns 0, or 1 after a reported error."""
    die_with_parent()
    bounded()
    with contextlib.suppress(OSError):
        os.nice(5)  # live devices come first
    words = sys.stdin.read()
    if not words:
        return 0  # started in advance, and not used
    request = json.loads(words)
    reported = 0.0

    def progress(share: float) -> None:
        nonlocal reported
        if share >= reported + STEP:
            reported = share
            report_to_parent(progress=round(share, 3))

    try:
        path, store = Path(request["path"]), Path(request["store"])
        stamp, stored = path.stat(), stored_reading(path)
        chosen = (stored or FileReading()).as_json()
        if request.get("chosen", chosen) != chosen:
            raise RecordingError(*CHANGED)
        bounded_by(path)
        source = open_file(path)
        usual = DecodeOptions("", request.get("reading", {}))
        shown = lambda folder: report_to_parent(shown=str(folder))  # noqa: E731
        decode(
            source,
            store,
            all_protocols(),
            DecodeOptions(),
            progress,
            shown,
            usual,
            compute_signals,
        )
        write_source(store, path, stamp, stored)
    except RecordingError as error:
        report_to_parent(message=error.message, hint=error.hint)
        return 1
    except MemoryError:
        report_to_parent(
            message="Opening the recording exceeds the memory limit.", hint="The file may be damaged or malicious."
        )
        return 1
    except TooLong:
        report_to_parent(
            message="Opening the recording exceeds the time limit.", hint="The file may be damaged or malicious."
        )
        return 1
    except OSError as error:
        report_to_parent(
            message=f"The recording cannot be opened: {(error.strerror or 'the disk failed').lower()}.", hint=""
        )
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
