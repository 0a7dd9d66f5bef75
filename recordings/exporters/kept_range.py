"""A range of a recording as a recording: its chunks byte for byte, and what decoding needs at its beginning.

    before it          of each device the chunks from the beginning of the frame that is incomplete there, and one chunk
                       of the last frames that say how later ones are decoded (VendorLogs.describing)
    at its beginning   the last snapshot and the last computed signals of each device
    in it              every chunk received or sent, messages, events, markers
    metadata           as they were; title, tags and markers of the user; a note of its origin before the user's

A range is one of samples: its chunks are those with which they arrived, and those between them. A capture or a log is
wrapped first. Values and arrivals are those of the original; the fit of a device's clock begins again, so its times
agree within their ±.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.family.info import ProtocolInfo
from imuscope.protocols.framing.stream_buffer import FRAME, ID, OFFSET, SIZE, STATUS, scan_all
from imuscope.protocols.registry.families import family_of
from imuscope.recordings import sidecar
from imuscope.recordings.exporters.request import ExportError, ExportRequest, ExportStep
from imuscope.recordings.importers.open_file import CaptureSource, open_file
from imuscope.recordings.importers.wrapped_capture import wrap_capture
from imuscope.recordings.mcap.chunked import HEAD, ChunkedFile
from imuscope.recordings.mcap.own_recordings import is_ours
from imuscope.recordings.mcap.reader import CHANNEL_ID, DATA, LENGTH, TIME, McapReader, MessageBlock
from imuscope.recordings.mcap.records import message
from imuscope.recordings.mcap.writer import DEVICE, EDIT, RAW_ENCODING, RECORDING, SIGNALS, SNAPSHOT

LATEST_NS = (1 << 62) - 1
LEAD_BYTES = 1 << 14  # in which the beginning of a frame is looked for: eight of the longest


@dataclass(slots=True)
class _Lead:
    """Received bytes of a device before the range: its last chunks, and the last frames that describe it."""

    family: ProtocolInfo | None
    chunks: list[tuple[int, bytes]] = field(default_factory=list)
    frames: dict[int, bytes] = field(default_factory=dict)
    rest: bytes = b""

    def add(self, chunks: list[tuple[int, bytes]]) -> None:
        if self.family is not None and self.family.logs.describing:
            self._describe(self.family, b"".join(data for _, data in chunks))
        self.chunks += chunks
        sizes = np.cumsum([len(data) for _, data in reversed(self.chunks)])
        self.chunks = self.chunks[-int(np.searchsorted(sizes, LEAD_BYTES)) - 1 :]

    def _describe(self, family: ProtocolInfo, data: bytes) -> None:
        data = self.rest + data
        scan = scan_all(family.frames.scan, np.frombuffer(data, np.uint8), 0, final=False)
        good = scan.table[:, scan.table[STATUS] == FRAME]
        for number in family.logs.describing:
            for at in np.flatnonzero(good[ID] == number)[-1:].tolist():
                self.frames[number] = data[good[OFFSET, at] : good[OFFSET, at] + good[SIZE, at]]
        self.rest = data[scan.at :]

    def beginning(self) -> list[tuple[int, bytes]]:
        """The chunks that the range begins with."""
        data = b"".join(data for _, data in self.chunks)
        begin = 0
        if self.family is not None and data:
            begin = scan_all(self.family.frames.scan, np.frombuffer(data, np.uint8), 0, final=False).at
        ends = np.cumsum([len(data) for _, data in self.chunks])
        chunks = self.chunks[int(np.searchsorted(ends, begin, "right")) :]
        frames = b"".join(self.frames.values())
        return [*([(chunks[0][0] if chunks else 0, frames)] if frames else []), *chunks]


def write(request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """Write the recording; returns it."""
    source = request.source
    if source is None or not source.is_file():
        raise ExportError("The recording has no file.", "Open it again.")
    first, last = _arrivals(request)
    edits = sidecar.read(source)
    if is_ours(source):
        own = source
    else:
        capture = open_file(source)
        if not isinstance(capture, CaptureSource):
            hint = "Export the range as CSV or Parquet, which open again."
            raise ExportError("This recording holds numbers or messages, not the bytes of a device.", hint)
        own = out.with_name("whole.mcap")
        with own.open("wb") as file:
            wrap_capture(capture, "", sidecar.Edits(), file)
    with McapReader(own) as reader, out.open("wb") as file:
        _cut(reader, request, (first, last), ChunkedFile(file), edits, step)
    if own != source:
        own.unlink()
    return [out]


def _arrivals(request: ExportRequest) -> tuple[int, int]:
    """First and last arrival of the samples in the range, ns; of those of every device, whichever are chosen."""
    ends: list[int] = []
    for info in request.columns.manifest["channels"]:
        lo, hi = request.rows(info["id"]) if request.columns.rows(info["id"]) else (0, 0)
        if lo < hi:
            arrivals = request.columns.clock_ns(info["id"], lo, hi, "arrival")
            ends += [int(arrivals.min()), int(arrivals.max())]
    if not ends:
        raise ExportError("This range contains nothing to keep.", "Choose a longer range.")
    return (0 if request.t0 == -math.inf else min(ends)), (LATEST_NS if request.t1 == math.inf else max(ends))


def _cut(
    reader: McapReader,
    request: ExportRequest,
    span: tuple[int, int],
    target: ChunkedFile,
    edits: sidecar.Edits,
    step: ExportStep,
) -> None:
    first, last = span
    leads: dict[int, _Lead] = {}
    latest: dict[int, bytes] = {}
    has_begun = False
    for block in reader.blocks(None, last + 1):
        target.write_channels(reader.topics)
        before = np.ascontiguousarray(block.table[:, block.table[TIME] < first])
        for number in np.unique(before[CHANNEL_ID]).tolist() if not has_begun else ():
            topic = reader.topics[number]
            rows = np.ascontiguousarray(before[:, before[CHANNEL_ID] == number])
            if topic.topic.startswith((SNAPSHOT, SIGNALS)):
                latest[number] = _messages(block, rows[:, -1:])[0][1]
            elif topic.topic.startswith("rx/") and topic.encoding == RAW_ENCODING:
                lead = leads.setdefault(number, _Lead(_family(request, topic.topic[3:])))
                lead.add(_messages(block, rows))
        inside = np.ascontiguousarray(block.table[:, (block.table[TIME] >= first) & (block.table[TIME] <= last)])
        if inside.shape[1]:
            if not has_begun:
                _begin(target, first, leads, latest)
                has_begun = True
            target.chunk(block.data, inside)
        step(min(block.done / max(reader.size, 1), 1.0))
    metadata = dict(reader.metadata)
    whole = edits.over(sidecar.from_metadata(metadata.get(EDIT, {})))
    title = whole.title or metadata.get(RECORDING, {}).get("title", "")
    note = _origin(request, title or (request.source or Path()).stem)
    t0, t1 = first / 1e9, last / 1e9
    metadata[EDIT] = replace(
        whole,
        title=None,
        notes="\n\n".join(filter(None, (note, whole.notes))),
        pinned=None,
        markers=tuple(one for one in whole.markers if t0 <= one.time <= t1),
    ).as_metadata()
    metadata[RECORDING] = {**metadata.get(RECORDING, {}), "title": request.title}
    # findings of decoding the whole: the protocol of each device, and the unit of its timestamps
    events = [one for one in request.columns.manifest["events"] if "option" in one["data"]]  # those of live lack it
    units = {one["device"]: {one["data"]["option"]: one["data"]["unit"]} for one in events}
    for one in request.columns.manifest["devices"]:
        if "." not in (device := one["id"]) and one["protocol"]:
            known = metadata.get(DEVICE + device, {})
            metadata[DEVICE + device] = {**known, "protocol": one["protocol"], **units.get(device, {})}
    target.end(metadata)


def _begin(target: ChunkedFile, first: int, leads: Mapping[int, _Lead], latest: Mapping[int, bytes]) -> None:
    """Write what decoding needs before the first chunk of the range."""
    rows = [(number, time or first, data) for number, lead in leads.items() for time, data in lead.beginning()]
    rows += [(number, first, data) for number, data in latest.items()]
    if rows:
        sizes = np.array([len(data) for *_, data in rows], np.int64)
        at = np.cumsum(sizes + HEAD) - sizes
        table = np.stack((*np.array([row[:2] for row in rows], np.int64).T, at, sizes))
        target.chunk(memoryview(b"".join(message(*row) for row in rows)), table)


def _messages(block: MessageBlock, rows: Ints) -> list[tuple[int, bytes]]:
    """Time and data of messages."""
    places = zip(rows[TIME].tolist(), rows[DATA].tolist(), rows[LENGTH].tolist(), strict=True)
    return [(time, bytes(block.data[at : at + size])) for time, at, size in places]


def _family(request: ExportRequest, device: str) -> ProtocolInfo | None:
    of = {one["id"].partition(".")[0]: one["protocol"] for one in request.columns.manifest["devices"]}
    return family_of(of[device]) if of.get(device) else None


def _origin(request: ExportRequest, title: str) -> str:
    """A note on the range: of which recording, from when to when."""
    columns, source = request.columns, request.source or Path()
    begin, end = columns.span(base=request.base) or (0.0, 0.0)
    t0, t1 = max(request.t0, begin), min(request.t1, end)
    dates = [f"{datetime.fromtimestamp(math.floor(t * 1e3) / 1e3, UTC):%Y-%m-%d %H:%M:%S.%f}"[:-3] for t in (t0, t1)]
    return f"{_clock(t0 - begin)} to {_clock(t1 - begin)} of {title}.\n{source.name}, {dates[0]} to {dates[1]} UTC."


def _clock(seconds: float) -> str:
    """A position in a recording, as the player writes it: 21:52.314, 1:02:03.000."""
    ms = round(seconds * 1e3)
    hours = f"{ms // 3_600_000}:" if ms >= 3_600_000 else ""
    return f"{hours}{ms // 60_000 % 60:02}:{ms // 1000 % 60:02}.{ms % 1000:03}"
