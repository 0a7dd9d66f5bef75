"""The bytes of one device as they came: whole, or those that arrived in a stretch.

    bytes   everything that arrived, and nothing else
    raw     the same of an Inertial Sense device: what its vendor's logger writes as .raw
    mtb     Xbus frames one after the other, what is between them left out; first the device's Configuration (and eMTS)
            where the recording holds one, because the vendor's program wants to know the device before its data

Bytes have a time of arrival and no other, so t0 and t1 are that, whatever the base: every chunk that arrived from t0 to
t1; of an .mtb every frame whose last byte did.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from protocols.framing import FRAME, OFFSET, SIZE, STATUS, Ints, ScanResult, scan_all
from protocols.xbus.frames import scan
from recordings.exporters.request import ExportError, ExportRequest, ExportStep
from recordings.importers import open_file
from recordings.sources import ChunkBlock

CONFIGURATION, EMTS = 0x0D, 0x91  # ids of the answers that describe the device


def write_bytes(wish: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """The bytes of one device of any kind."""
    return _bytes(wish, "", out, step)


def write_raw(wish: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """The bytes of an Inertial Sense device."""
    return _bytes(wish, "isb", out, step)


def _bytes(wish: ExportRequest, protocol: str, out: Path, step: ExportStep) -> list[Path]:
    device = _chosen(wish, protocol)
    with out.open("wb") as file:
        for part in _parts(wish, device, step):
            lo, hi = _inside(part, wish)
            file.write(part.data[_end(part, lo) : _end(part, hi)])
    return [out]


def write_mtb(wish: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """The frames of an Xsens device, its Configuration first."""
    device = _chosen(wish, "xbus")
    head = _described(wish, device)
    with out.open("wb") as file:
        file.write(b"".join(head))
        for data, times in _frames(_parts(wish, device, step)):
            keep = (frame for frame, time in zip(data, times, strict=True) if _is_in(time, wish))
            file.write(b"".join(frame for frame in keep if frame not in head))
    return [out]


def _chosen(wish: ExportRequest, protocol: str) -> str:
    """The device, by the id that its bytes have in the file."""
    told = {one["id"]: one for one in wish.columns.manifest["devices"]}
    fits = {one["id"].partition(".")[0]: one for one in told.values() if protocol in ("", one["protocol"])}
    wanted = wish.device.partition(".")[0]
    if wish.source is None or wish.columns.manifest.get("format") in ("csv", "table"):
        raise ExportError("This recording holds numbers, not the bytes of a device.", "Export it as CSV or Parquet.")
    if wanted:
        fits = {name: one for name, one in fits.items() if name == wanted}
    if not fits:
        words = {"xbus": "an Xsens device", "isb": "an Inertial Sense device"}.get(protocol, "that device")
        raise ExportError(f"There are no bytes of {words} in it.", "Choose another device, or export it as bytes.")
    if len(fits) > 1:
        names = ", ".join(f"{one['name']} ({name})" for name, one in fits.items())
        raise ExportError(f"This format holds one device; there are {len(fits)}.", f"Choose one: {names}.")
    return str(next(iter(fits)))


def _parts(wish: ExportRequest, device: str, step: ExportStep) -> Iterator[ChunkBlock]:
    """What came from the device in blocks that reach into the stretch."""
    assert wish.source is not None
    start = None if wish.t0 == -np.inf else int(wish.t0 * 1e9) - 1000
    stop = None if wish.t1 == np.inf else int(wish.t1 * 1e9) + 1000
    for part in open_file(wish.source).parts(start, stop):
        if part.way == "rx" and part.device == device:
            yield part
        step(min(part.done, 1.0))


def _inside(part: ChunkBlock, wish: ExportRequest) -> tuple[int, int]:
    """Chunks of a part that arrived in the stretch: the first, and the one past the last. Times do not descend."""
    times = part.times / 1e9
    return int(np.searchsorted(times, wish.t0, "left")), int(np.searchsorted(times, wish.t1, "right"))


def _end(part: ChunkBlock, chunks: int) -> int:
    return int(part.ends[chunks - 1]) if chunks else 0


def _is_in(time_ns: int, wish: ExportRequest) -> bool:
    return wish.t0 <= time_ns / 1e9 <= wish.t1


def _described(wish: ExportRequest, device: str) -> list[bytes]:
    """The last Configuration and eMTS that came before the stretch; else the first of the file."""
    found: dict[int, bytes] = {}
    whole = ExportRequest(wish.columns, wish.source)
    for frames, times in _frames(_parts(whole, device, lambda share: None)):
        for frame, time in zip(frames, times, strict=True):
            if frame[2] in (CONFIGURATION, EMTS) and (frame[2] not in found or time / 1e9 <= wish.t0):
                found[frame[2]] = frame
        if len(found) == 2 and times and times[-1] / 1e9 > wish.t0:
            break
    return [found[number] for number in (CONFIGURATION, EMTS) if number in found]


def _frames(parts: Iterator[ChunkBlock]) -> Iterator[tuple[list[bytes], list[int]]]:
    """Whole Xbus frames, and when the last byte of each arrived, ns."""
    held, late = b"", 0
    for part in parts:
        data = held + part.data
        found = scan_all(scan, np.frombuffer(data, np.uint8), 0, final=False)
        frames, ends = _cut(data, found)
        chunk = np.minimum(np.searchsorted(part.ends + len(held), ends, "left"), len(part.ends) - 1)
        yield frames, part.times[chunk].tolist()
        held, late = data[found.at :], int(part.times[-1])
    frames, _ = _cut(held, scan_all(scan, np.frombuffer(held, np.uint8), 0, final=True))
    yield frames, [late] * len(frames)


def _cut(data: bytes, found: ScanResult) -> tuple[list[bytes], Ints]:
    good = found.table[:, found.table[STATUS] == FRAME]
    ends = good[OFFSET] + good[SIZE]
    return [data[a:b] for a, b in zip(good[OFFSET].tolist(), ends.tolist(), strict=True)], ends
