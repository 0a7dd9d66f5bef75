"""The frame that made a sample, byte by byte, and its neighbours, of a live device or of a recording.

    time of a sample ──> arrival and rank among the samples that arrived together (their column)
                         ──> the bytes around that arrival, at most NEAR_BYTES each way ──> the family's listing
                         ──> frames, rejects and the bytes between them ──> the frame of that rank

The bytes of a live device are in memory (server/devices/link/byte_memory.py), those of a recording in its file; only
the neighbourhood is decoded, whatever their length. What each byte means comes from the family: frames from its
listing, their parts from its driver. A family without a driver has a frame as a whole.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.commands.transactions import ByteRange, DeviceDriver
from imuscope.protocols.family.info import ProtocolInfo
from imuscope.protocols.registry.families import family_of
from imuscope.protocols.schema.fields import Message
from imuscope.recordings.columns.store import Base, ColumnStore
from imuscope.server.devices.link.byte_memory import ByteRun, LinkMemory
from imuscope.server.errors import DomainError
from imuscope.server.library.range_query import stored_values
from imuscope.server.library.reject_reasons import explained_rejects
from imuscope.server.streaming.channel_store import StoredChannel
from imuscope.server.wire.codec import to_json_safe

NEAR_BYTES = 1 << 14  # decoded before and after the frame
ENOUGH_BYTES = 1 << 20  # in a window, so that a longer one has no more neighbours, except at an end of the data
WINDOWS_NS = (500_000_000, 10_000_000_000, 600_000_000_000)  # around the arrival, until there are enough frames
TOGETHER_NS = 2_000  # arrivals are unix seconds in 64 bits, exact to 0.24 µs
MAX_TOGETHER = 4096  # samples that arrived together
HEX_BYTES = 4096  # of foreign bytes, shown

Kind = Literal["frame", "reject", "foreign", "sent"]
Read = Callable[[int, int], tuple[bytes, list[ByteRun]]]
"""Bytes that a decoder needs first, and the chunks between two times, ns."""


@dataclass(frozen=True, slots=True)
class SampleArrival:
    """A sample: when its bytes arrived, ns, and how many samples that arrived together came before it."""

    arrival_ns: int
    rank: int = 0
    time: float | None = None  # of the sample on the host's clock, unix s


@dataclass(slots=True)
class PacketInfo:
    """A frame, a rejected one, bytes between frames, or bytes sent to the device."""

    kind: Kind
    arrival: float  # unix s, of its last byte
    gap_ms: float | None  # since the one before; null for the first
    rank: int  # among those that arrived together
    size: int  # bytes
    hex: str
    name: str = ""
    title: str = ""
    protocol: str = ""
    verdict: str = ""  # why it was accepted or rejected, in words
    reason: str = ""  # of a reject
    doc: str = ""
    source: str = ""  # section of the document
    spans: list[ByteRange] = field(default_factory=list)  # its bytes, in order
    fields: dict[str, Any] = field(default_factory=dict)  # values on the wire, as in `imuscope inspect`
    flags: dict[str, Any] = field(default_factory=dict)  # names of set bits


@dataclass(slots=True)
class PacketView:
    """A frame and its neighbours."""

    device: str
    protocol: str
    at: int  # place of the frame in `packets`
    time: float | None  # of the sample, on the host's clock; null if a frame was requested
    packets: list[PacketInfo]


# ── the sample ───────────────────────────────────────────────────────────────────────────────────────────────────────


def live_moment(channel: StoredChannel, time: float, base: Base) -> SampleArrival | None:
    """The sample of a live channel that is nearest to a time; None if there is none."""
    arrival, sampled = stored_values(channel, time - 1.0, base)[:2]
    return _nearest(arrival, np.where(np.isnan(sampled), arrival, sampled), time, base)


def recorded_moment(store: ColumnStore, channel: int, time: float, base: Base) -> SampleArrival | None:
    """The sample of a recorded channel that is nearest to a time; None if there is none."""
    at = store.row_at(channel, time, base)
    lo, hi = max(at - MAX_TOGETHER, 0), min(at + 2, store.rows(channel))
    return _nearest(store.clock(channel, lo, hi, "arrival"), store.clock(channel, lo, hi), time, base)


def _nearest(arrival: Any, sampled: Any, time: float, base: Base) -> SampleArrival | None:
    if not len(arrival):
        return None
    at = int(np.argmin(np.abs((arrival if base == "arrival" else sampled) - time)))
    first = int(np.searchsorted(arrival, arrival[at], "left"))
    return SampleArrival(round(float(arrival[at]) * 1e9), at - first, float(sampled[at]))


# ── the bytes ────────────────────────────────────────────────────────────────────────────────────────────────────────


def live_bytes(link: LinkMemory, preamble: bytes) -> Read:
    return lambda since_ns, until_ns: (preamble, link.runs(since_ns, until_ns))


@dataclass(frozen=True, slots=True)
class _Near:
    """Bytes around an arrival, with the end and the arrival of each chunk."""

    data: bytes
    ends: Ints
    arrival_ns: Ints

    def arrival_of(self, end: int) -> int:
        """Arrival of the chunk with the last byte of a frame that ends there."""
        return int(self.arrival_ns[min(int(np.searchsorted(self.ends, end, "left")), len(self.ends) - 1)])


def _near(runs: Sequence[ByteRun], arrival_ns: int) -> _Near | None:
    """The received chunks of some runs, NEAR_BYTES before and after an arrival."""
    runs = [run for run in runs if run.direction == "rx"]
    if not runs:
        return None
    arrivals = np.concatenate([run.arrival_ns for run in runs])
    offsets = np.cumsum([0, *(len(run.data) for run in runs[:-1])])
    ends = np.concatenate([run.ends.astype(np.int64) + offset for run, offset in zip(runs, offsets, strict=True)])
    first = int(np.searchsorted(arrivals, arrival_ns - TOGETHER_NS, "left"))
    last = int(np.searchsorted(arrivals, arrival_ns + TOGETHER_NS, "right"))
    begin = int(ends[first - 1]) if first else 0
    stop = int(ends[min(max(last - 1, first), len(ends) - 1)])
    low = int(np.searchsorted(ends, begin - NEAR_BYTES, "left"))
    high = min(int(np.searchsorted(ends, stop + NEAR_BYTES, "left")) + 1, len(ends))
    start = int(ends[low - 1]) if low else 0
    data = b"".join(run.data for run in runs)[start : int(ends[high - 1])]
    return _Near(data, ends[low:high] - start, arrivals[low:high])


# ── frames ───────────────────────────────────────────────────────────────────────────────────────────────────────────


def packets_around(
    device: str,
    family: ProtocolInfo,
    settings: Mapping[str, Any],
    read: Read,
    moment: SampleArrival,
    *,
    names: Iterable[str] = (),
    kind: Kind | None = None,
    beside: int = 8,
    newest_ns: int | None = None,
) -> PacketView | None:
    """The frame of a moment and its neighbours.

    Args:
        settings: of the family's listing.
        names: of the message or the quantity of the sample; () for any frame.
        kind: only such a one is looked for.
        beside: number of neighbours on each side.
        newest_ns: arrival of the newest byte; None if that is not known. A frame near it has no more neighbours.

    Returns:
        None if there are no bytes at that time.
    """
    packets: list[PacketInfo] = []
    at = 0
    message_names = set(names) - {""}
    for window_ns in WINDOWS_NS:
        preamble, runs = read(moment.arrival_ns - window_ns, moment.arrival_ns + window_ns)
        near = _near(runs, moment.arrival_ns)
        packets = _packets(near, family, settings, preamble) if near is not None else []
        packets += [packet for run in runs if run.direction == "tx" for packet in _sent(run, family)]
        packets.sort(key=lambda packet: packet.arrival)
        at = _index(packets, moment, message_names, kind)
        is_last = newest_ns is not None and moment.arrival_ns + window_ns > newest_ns
        has_all = at >= beside and (is_last or len(packets) - at > beside)
        if has_all or sum(len(run.data) for run in runs) > ENOUGH_BYTES:
            break
    if not packets:
        return None
    _rank(packets)
    low = max(at - beside, 0)
    shown = packets[low : at + beside + 1]
    driver = (
        family.frames.composer(settings).driver if family.frames.composer is not None else family.configuration.driver
    )
    for packet in shown:
        if packet.kind in ("frame", "sent"):
            _explain(packet, family, driver)
    return PacketView(device, family.name, at - low, moment.time, shown)


def required_family(protocol: str) -> ProtocolInfo:
    """The family of a protocol. DomainError: it is not known."""
    family = family_of(protocol)
    if family is None:
        raise DomainError(
            "not-found", "The protocol of this device is not known.", "Its bytes cannot be divided into frames."
        )
    return family


def available(view: PacketView | None) -> PacketView:
    """The view. DomainError: there is none."""
    if view is None:
        raise DomainError("not-found", "No bytes were received around that time.", "Choose a time within a plot.")
    return view


def _packets(near: _Near, family: ProtocolInfo, settings: Mapping[str, Any], preamble: bytes) -> list[PacketInfo]:
    listing = family.frames.listing(**settings)
    listing.feed(preamble + near.data)
    lines = sorted(listing.drain(stalled=True), key=lambda line: (int(line["offset"]), "reject" in line))
    explained = explained_rejects(family)
    packets: list[PacketInfo] = []
    covered = 0
    for line in lines:
        begin = int(line["offset"]) - len(preamble)
        end = begin + int(line["size"])
        if begin < covered:
            continue  # of the preamble, or part of a frame that is listed
        packets += _foreign(near, covered, begin)
        if "reject" in line and (begin == 0 or end == len(near.data)):
            covered = end
            continue  # only the cut made it
        packets.append(_packet(near, line, begin, end, explained))
        covered = end
    return packets


def _foreign(near: _Near, begin: int, end: int) -> list[PacketInfo]:
    if end <= begin or begin == 0:
        return []
    data = near.data[begin:end]
    return [
        PacketInfo("foreign", near.arrival_of(end) / 1e9, None, 0, len(data), data[:HEX_BYTES].hex(), verdict=FOREIGN)
    ]


FOREIGN = "These bytes between frames belong to no frame of the protocol."


def _packet(near: _Near, line: Mapping[str, Any], begin: int, end: int, explained: Mapping[str, str]) -> PacketInfo:
    arrival, data = near.arrival_of(end) / 1e9, near.data[begin:end]
    if "reject" in line:
        reason = str(line["reject"])
        words = explained.get(reason, reason.replace("_", " "))
        verdict = f"Rejected: {words}."
        return PacketInfo("reject", arrival, None, 0, len(data), data[:HEX_BYTES].hex(), verdict=verdict, reason=reason)
    accepted = "Accepted: it has passed the checks of its protocol."
    verdict = "Accepted without a key: its authenticity is not verified." if line.get("verified") is False else accepted
    return PacketInfo(
        "frame",
        arrival,
        None,
        0,
        len(data),
        data.hex(),
        name=str(line["message"]),
        protocol=str(line["protocol"]),
        verdict=verdict,
        fields=to_json_safe(line.get("fields", {})),
        flags=to_json_safe(line.get("flags", {})),
    )


def _sent(run: ByteRun, family: ProtocolInfo) -> list[PacketInfo]:
    name_of = family.configuration.driver.name_of if family.configuration.driver is not None else lambda data: ""
    chunks = [chunk for piece in run.pieces() for chunk in piece]
    words = "Sent to the device."
    return [
        PacketInfo(
            "sent", at / 1e9, None, 0, len(data), data.hex(), name=name_of(data), protocol=family.name, verdict=words
        )
        for data, at in chunks
    ]


def _index(packets: Sequence[PacketInfo], moment: SampleArrival, names: set[str], kind: Kind | None) -> int:
    """Place of the frame of a moment among the packets, by time."""
    if not packets:
        return 0
    near_s = TOGETHER_NS / 1e9
    together = [i for i, one in enumerate(packets) if abs(one.arrival - moment.arrival_ns / 1e9) <= near_s]
    if names:
        frames = [i for i in together if packets[i].kind == "frame"]
        fitting = [i for i in frames if packets[i].name in names or names & packets[i].fields.keys()] or frames
    else:
        fitting = [i for i in together if kind is None or packets[i].kind == kind]
    if fitting:
        return fitting[min(moment.rank, len(fitting) - 1)]
    of_kind = [i for i, one in enumerate(packets) if kind is None or one.kind == kind] or range(len(packets))
    return min(of_kind, key=lambda i: abs(packets[i].arrival - moment.arrival_ns / 1e9))


def _rank(packets: Sequence[PacketInfo]) -> None:
    """Number packets that arrived together, and measure the gaps."""
    before: PacketInfo | None = None
    for packet in packets:
        if before is not None:
            packet.gap_ms = (packet.arrival - before.arrival) * 1e3
            packet.rank = before.rank + 1 if packet.gap_ms * 1e6 <= TOGETHER_NS else 0
        before = packet


def _explain(packet: PacketInfo, family: ProtocolInfo, driver: DeviceDriver | None) -> None:
    """Name the bytes of a frame, by the tables that its driver has."""
    data = bytes.fromhex(packet.hex)
    if driver is not None and packet.protocol in ("", family.name):
        packet.spans = driver.annotate(data)
    else:
        packet.spans = [ByteRange(0, len(data), f"{packet.name or 'message'}, as a whole", "")]
    row = _row_of(family, packet.name)
    if row is not None:
        packet.title, packet.doc, packet.source = row.title, row.doc, row.source


def _row_of(family: ProtocolInfo, name: str) -> Message | None:
    """The row of a message in the tables of a family; None if it does not offer them."""
    return next((row for row in family.frames.rows() if row.name == name), None)
