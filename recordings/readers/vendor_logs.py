"""Files of vendors' own formats: suffixes, naming, companions.

The formats are rows of the families (VendorLogs.log_formats); this module accesses the disk.
"""

from pathlib import Path

from imuscope.protocols.arrays import Ints
from imuscope.protocols.family.info import LogFormat, LogName, ProtocolInfo
from imuscope.protocols.registry.families import log_formats
from imuscope.recordings.system.regular_file import read_regular


def log_suffixes() -> tuple[str, ...]:
    return tuple(one.suffix for _, one in log_formats())


def marked_format(head: bytes) -> tuple[ProtocolInfo, LogFormat] | None:
    """The format whose marker the first bytes of a file hold, whatever its name."""
    return next(((family, one) for family, one in log_formats() if one.marker and head.startswith(one.marker)), None)


def suffix_format(suffix: str) -> tuple[ProtocolInfo, LogFormat] | None:
    """The format of a suffix; None if only a marker identifies it."""
    return next(((family, one) for family, one in log_formats() if one.suffix == suffix and not one.marker), None)


def log_name(path: Path) -> LogName | None:
    """Information from the name of a log file; None for any other name."""
    return next((name for _, one in log_formats() if (name := one.read_name(path.stem)) is not None), None)


def parts_of(path: Path) -> list[Path]:
    """All files of the log that `path` belongs to, in order; the file alone if its name is not a log's."""
    name = log_name(path)
    if name is None:
        return [path]
    parts = []
    for other in path.parent.glob(f"*{path.suffix}"):
        parsed = log_name(other)
        if parsed is not None and parsed.stem == name.stem:
            parts.append((parsed.part, other))
    return [other for _, other in sorted(parts)] or [path]


def read_index(path: Path, log_format: LogFormat) -> tuple[Ints, Ints] | None:
    """(offsets, ms) of the index beside a log, ascending; None if there is no usable one."""
    if log_format.read_index is None:
        return None
    try:
        return log_format.read_index(read_regular(path.with_suffix(log_format.index_suffix)))
    except OSError:
        return None
