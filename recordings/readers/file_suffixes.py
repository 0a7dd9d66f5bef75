"""Suffixes of the files that can be opened, known without importing what reads them."""

import functools

from imuscope.protocols.family.plugins import plugins_of_others
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.recordings.readers import vendor_logs

READER_PLUGINS = "imuscope.readers"  # entry points of other packages
TABLES = (".csv", ".tsv")
SUFFIXES = (
    *(".mcap", *vendor_logs.log_suffixes(), ".bin", ".log", ".txt", ".csv", ".tsv", ".hex", ".ubx", ".nmea"),
    *(f".{name}" for name in PROTOCOLS),
)
OF_READERS = (
    *(".bag", ".db3", ".ulg", ".ulog", ".bin", ".bbl", ".bfl", ".parquet", ".pq", ".arrow", ".feather", ".arrows"),
    *(".ipc", ".npy", ".npz", ".mat", ".h5", ".hdf5", ".nc", ".zip", ".gz", ".zst", ".zstd", ".json", ".jsonl"),
    *(".ndjson", ".asc"),
)
"""Those of recordings/readers/formats/, in the order in which they are tried."""
ALWAYS_LISTED = (".mcap", *vendor_logs.log_suffixes(), ".bin", *TABLES)  # listed even if nothing known is found in them


@functools.cache
def suffixes() -> tuple[str, ...]:
    """Suffixes of all files that can be opened, the most particular first."""
    others: tuple[str, ...] = ()
    if any(plugins_of_others(READER_PLUGINS)):  # these declare more
        from imuscope.recordings.readers.registry import reader_suffixes

        others = reader_suffixes()
    return tuple(dict.fromkeys((*SUFFIXES, *OF_READERS, *others)))
