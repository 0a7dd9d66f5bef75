"""The bytes of one device as received: whole, or those that arrived within a range.

    bytes   everything that arrived, and nothing else
    logs    of the vendors' own formats (LogFormat.exported): the same for a device of that family, or its consecutive
            frames without the bytes between them; first those that describe the device, if the recording has them,
            because the vendor's program needs to know the device before its data

Bytes have an arrival time and no other, so t0 and t1 are arrival times, whatever the base: every chunk that arrived
from t0 to t1; where only frames are written, every frame whose last byte did.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.family.info import LogFormat, ProtocolInfo
from imuscope.protocols.framing.stream_buffer import FRAME, ID, OFFSET, SIZE, STATUS, ScanResult, scan_all
from imuscope.protocols.messages.family import NAME as MESSAGES
from imuscope.recordings.exporters.request import ExportError, ExportRequest, ExportStep

if TYPE_CHECKING:
    from imuscope.recordings.sources import ChunkBlock


def write_bytes(request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """The bytes of one device of any kind."""
    return _bytes(request, None, out, step)


def log_writer(family: ProtocolInfo, log: LogFormat) -> Callable[[ExportRequest, Path, ExportStep], list[Path]]:
    """The `write` of a vendor's own format."""

    def write(request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
        if log.exported == "frames":
            return _write_frames(request, family, out, step)
        return _bytes(request, family, out, step)

    return write


def _bytes(request: ExportRequest, family: ProtocolInfo | None, out: Path, step: ExportStep) -> list[Path]:
    device = _chosen(request, family)
    with out.open("wb") as file:
        for part in parts_of(request, device, step):
            lo, hi = _inside(part, request)
            file.write(part.data[_end(part, lo) : _end(part, hi)])
    return [out]


def _write_frames(request: ExportRequest, family: ProtocolInfo, out: Path, step: ExportStep) -> list[Path]:
    """Write the frames of a device, those that describe it first."""
    device = _chosen(request, family)
    head = _described(request, device, family)
    with out.open("wb") as file:
        file.write(b"".join(head))
        for data, times in _frames(parts_of(request, device, step), family):
            keep = (frame for (_, frame), time in zip(data, times, strict=True) if _is_in(time, request))
            file.write(b"".join(frame for frame in keep if frame not in head))
    return [out]


def _chosen(request: ExportRequest, family: ProtocolInfo | None) -> str:
    """The device, by the id of its bytes in the file."""
    devices = {one["id"]: one for one in request.columns.manifest["devices"]}
    fits = {
        one["id"].partition(".")[0]: one for one in devices.values() if family is None or one["protocol"] == family.name
    }
    device = request.device.partition(".")[0]
    if fits and all(one["protocol"] == MESSAGES for one in fits.values()):
        hint = "Download the recording: its MCAP file has them as they came, for other programs too."
        raise ExportError("This recording holds messages, not the bytes of a device.", hint)
    fits = {name: one for name, one in fits.items() if one["protocol"] != MESSAGES}
    if request.source is None or request.columns.manifest.get("format") in ("csv", "table"):
        raise ExportError("This recording holds numbers, not the bytes of a device.", "Export it as CSV or Parquet.")
    if device:
        fits = {name: one for name, one in fits.items() if name == device}
    if not fits:
        words = (
            next((log.device for log in family.logs.log_formats if log.device), family.title)
            if family
            else "that device"
        )
        raise ExportError(f"There are no bytes of {words} in it.", "Choose another device, or export it as bytes.")
    if len(fits) > 1:
        names = ", ".join(f"{one['name']} ({name})" for name, one in fits.items())
        raise ExportError(f"This format holds one device; there are {len(fits)}.", f"Choose one: {names}.")
    return str(next(iter(fits)))


def parts_of(request: ExportRequest, device: str, step: ExportStep, *, whole: bool = False) -> Iterator[ChunkBlock]:
    """Blocks of received bytes that overlap the range; all of them if `whole`."""
    from imuscope.recordings.importers.open_file import open_file  # a server that lists formats reads none

    assert request.source is not None
    start = None if whole or request.t0 == -np.inf else int(request.t0 * 1e9) - 1000
    stop = None if whole or request.t1 == np.inf else int(request.t1 * 1e9) + 1000
    for part in open_file(request.source).parts(start, stop):
        if part.direction == "rx" and part.device == device:
            yield part
        step(min(part.done, 1.0))


def _inside(part: ChunkBlock, request: ExportRequest) -> tuple[int, int]:
    """Chunks of a part that arrived in the range: the first, and one past the last. Times do not descend."""
    times = part.times / 1e9
    return int(np.searchsorted(times, request.t0, "left")), int(np.searchsorted(times, request.t1, "right"))


def _end(part: ChunkBlock, chunks: int) -> int:
    return int(part.ends[chunks - 1]) if chunks else 0


def _is_in(time_ns: int, request: ExportRequest) -> bool:
    return request.t0 <= time_ns / 1e9 <= request.t1


def _described(request: ExportRequest, device: str, family: ProtocolInfo) -> list[bytes]:
    """For each answer the format begins with: the last one before the range, else the first of the file."""
    numbers = tuple(family.logs.log_header.frames) if family.logs.log_header is not None else ()
    by_number: dict[int, bytes] = {}
    whole = ExportRequest(request.columns, request.source)
    for frames, times in _frames(parts_of(whole, device, lambda share: None), family):
        for (number, frame), time in zip(frames, times, strict=True):
            if number in numbers and (number not in by_number or time / 1e9 <= request.t0):
                by_number[number] = frame
        if len(by_number) == len(numbers) and times and times[-1] / 1e9 > request.t0:
            break
    return [by_number[number] for number in numbers if number in by_number]


def _frames(parts: Iterator[ChunkBlock], family: ProtocolInfo) -> Iterator[tuple[list[tuple[int, bytes]], list[int]]]:
    """Whole frames with their message numbers, and the arrival of each one's last byte, ns."""
    held, late = b"", 0
    for part in parts:
        data = held + part.data
        scan = scan_all(family.frames.scan, np.frombuffer(data, np.uint8), 0, final=False)
        frames, ends = _cut(data, scan)
        chunk = np.minimum(np.searchsorted(part.ends + len(held), ends, "left"), len(part.ends) - 1)
        yield frames, part.times[chunk].tolist()
        held, late = data[scan.at :], int(part.times[-1])
    frames, _ = _cut(held, scan_all(family.frames.scan, np.frombuffer(held, np.uint8), 0, final=True))
    yield frames, [late] * len(frames)


def _cut(data: bytes, scan: ScanResult) -> tuple[list[tuple[int, bytes]], Ints]:
    good = scan.table[:, scan.table[STATUS] == FRAME]
    ends = good[OFFSET] + good[SIZE]
    rows = zip(good[ID].tolist(), good[OFFSET].tolist(), ends.tolist(), strict=True)
    return [(number, data[a:b]) for number, a, b in rows], ends
