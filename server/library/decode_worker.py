"""`python -m imuscope.server.library.decode_worker`: decode one recording in a subprocess, for
server/library/column_cache.py.

The request comes on standard input, one JSON object: path, store, the choices on how it is read, which the sidecar of
the recording must still have, and decode options (DecodeOptions.values; a key is never on a command line). The output
are JSON lines: {"progress": 0..1}, {"shown": a folder} when the part decoded so far can be read there, and {"message",
"hint"} for an error.
"""

from pathlib import Path

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.index import summary_in
from imuscope.recordings.sidecar import stored_reading
from imuscope.recordings.system.parent_death import report_to_parent
from imuscope.recordings.system.resource_limits import bounded_by
from imuscope.recordings.tables.options import FileReading
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.library.cache_provenance import CHANGED, write_source
from imuscope.server.library.computed_signals import compute_signals
from imuscope.server.library.decode import decode
from imuscope.server.system.worker_process import begin, progress_reports, reporting


def main() -> None:
    """Decode the recording that standard input requests; without a request it was started in advance, and not used."""
    if not (request := begin(5)):
        return
    with reporting("Opening the recording", "The file may be damaged or malicious.", _unreadable):
        path, store = Path(request["path"]), Path(request["store"])
        stamp, stored = path.stat(), stored_reading(path)
        chosen = (stored or FileReading()).as_json()
        if request.get("chosen", chosen) != chosen:
            raise RecordingError(*CHANGED)
        bounded_by(path)
        source = open_file(path)
        usual = DecodeOptions("", request.get("reading", {}))
        shown = lambda folder: report_to_parent(shown=str(folder))  # noqa: E731
        columns = decode(
            source,
            store,
            all_protocols(),
            DecodeOptions(),
            progress_reports(),
            shown,
            usual,
            compute_signals,
        )
        summary_in(columns.folder)
        write_source(store, path, stamp, stored)


def _unreadable(error: OSError) -> tuple[str, str]:
    return f"The recording cannot be opened: {(error.strerror or 'the disk failed').lower()}.", ""


if __name__ == "__main__":
    main()
