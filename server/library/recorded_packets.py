"""The frame that made a sample of a recording, and its neighbours: packets.py with the bytes of a file.

It runs in a process of files (foreign_files.py).
"""

from pathlib import Path

from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.sources import Source
from imuscope.server.devices.decode.decode_options import DecodeOptions, recorded
from imuscope.server.devices.link.byte_memory import ByteRun
from imuscope.server.errors import DomainError
from imuscope.server.library.packets import (
    Kind,
    PacketView,
    Read,
    SampleArrival,
    available,
    packets_around,
    required_family,
)


def packets_in_file(
    path: Path,
    device: str,
    moment: SampleArrival,
    usual: DecodeOptions,
    names: tuple[str, ...],
    kind: Kind | None,
    beside: int,
) -> PacketView:
    """As packets_around, of a device in a file.

    Args:
        device: "" for the first.
        usual: decode options, if the recording has none.

    Raises:
        RecordingError, OSError: the file cannot be read.
        DomainError: it has no such device, or none that can be divided into frames, or no times.
    """
    source = open_file(path)
    if not source.timed:
        words = "The bytes of this file have no arrival times, so a sample does not lead to its frame."
        raise DomainError("not-found", words, "imuscope inspect FILE lists its frames.")
    device = device.partition(".")[0] or next(iter(source.devices), "")
    known = source.devices.get(device)
    if known is None:
        raise DomainError(
            "not-found", f"The recording has no bytes of device {device:.40}.", "Choose one of its devices."
        )
    family = required_family(known.protocol)
    settings = recorded(DecodeOptions(), known.identity, usual).settings(family.name)
    read = recorded_bytes(source, device)
    return available(packets_around(device, family, settings, read, moment, names=names, kind=kind, beside=beside))


def recorded_bytes(source: Source, device: str) -> Read:
    def read(since_ns: int, until_ns: int) -> tuple[bytes, list[ByteRun]]:
        runs = []
        for part in source.parts(since_ns, until_ns):
            if part.device == device:
                run = ByteRun(part.direction, part.data, part.ends, part.times).between(since_ns, until_ns)
                runs += [run] if run is not None else []
        preamble = getattr(source, "preamble", None)
        return (preamble(device) if preamble is not None else b""), runs

    return read
