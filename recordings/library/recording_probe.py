"""Metadata of a recording before it is decoded. recordings/library/probe.py reads it from the file."""

from dataclasses import dataclass, field

from imuscope.recordings import sidecar
from imuscope.recordings.readers.vendor_logs import log_suffixes

TABLE_FORMATS = ("csv", "parquet", "arrow", "arrow-stream", "mat", "mat4", "hdf5", "npy", "npz")
"""Formats of files that may be one table."""
CAPTURE_FORMATS = ("bin", *(suffix.removeprefix(".") for suffix in log_suffixes()))
"""Formats of files of raw bytes, or of what carried them."""


@dataclass(slots=True)
class RecordedDevice:
    """Identity of a recorded device, as far as the probed part contains it."""

    id: str
    name: str = ""
    protocol: str = ""
    product: str = ""
    serial_number: str = ""
    messages: int | None = None  # frames; null until they are counted
    lost: int = 0
    rejects: int = 0
    simulated: bool = False
    counts_losses: bool = False  # whether lost frames are known: none lost means that none are missing


@dataclass(slots=True)
class RecordingProbe:
    """Metadata of a file, read without decoding it.

    Args:
        started: unix s; None if unknown. So is `duration`, s.
        damaged: one sentence, "" if no damage is known.
        remark: sentences on parts that are left out, and on how the file was read; "" before it was opened.
        edits: changes made by the user, as stored in the file itself.
        is_archive: whether other files are in it.
    """

    format: str
    title: str = ""
    started: float | None = None
    duration: float | None = None
    devices: list[RecordedDevice] = field(default_factory=list)
    damaged: str = ""
    remark: str = ""
    edits: sidecar.Edits = field(default_factory=sidecar.Edits)
    markers: int = 0
    is_archive: bool = False

    @property
    def may_be_table(self) -> bool:
        """Whether the file may be a table, or an archive of some."""
        return self.format in TABLE_FORMATS or self.is_archive
