"""MCAP with decoded values, which Foxglove, Lichtblick and PlotJuggler show without configuration.

    topic          /<device>/[<message>/]<quantity>, /<device>/attitude, /<device>/position, /events: the same topics,
                   fields and schemas as the live Foxglove server's, so a layout made of one fits the other
    and            /<device>/<message>/clock and /utc: the device's own clock for each message, and its UTC;
                   /<device>/<message>/arrival: its arrival, and the segment of the clock if there are several;
                   /<device>/<message>/bytes: undescribed payloads, base64 according to their schema
    log time       device time mapped to the host's clock; its arrival if it has none (or if the base is arrival)
    message        JSON {"x_m_s2": …, "y_m_s2": …} (topics.py), or protobuf with units of its own (standard_schemas.py)

Missing values, and those that JSON cannot represent (NaN, infinity), are left out; so are standard messages and events
where Foxglove's package is not installed.

Messages of different topics are interleaved by time, in compressed and indexed chunks. An hour of 1 kHz has some twenty
million messages, so their records are built column by column: Arrow joins texts, one sort orders the topics.
"""

import base64
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from mcap.opcode import Opcode

from imuscope.protocols.arrays import Array, Ints
from imuscope.protocols.messages.records import MessageChannel
from imuscope.recordings.columns.rows import ExactRows
from imuscope.recordings.exporters.entities import DeviceEntity, devices_of
from imuscope.recordings.exporters.message_table import SEGMENT, windows
from imuscope.recordings.exporters.request import ExportRequest, ExportStep
from imuscope.recordings.exporters.topics import EVENTS, bodies, named, schema_of, stamps, tables, topic_of
from imuscope.recordings.file_names import device_names
from imuscope.recordings.mcap.chunked import HEAD, ChunkedFile, chunk_bytes, cut
from imuscope.recordings.optional_packages import lacks

Info = Mapping[str, Any]

WINDOW_ROWS = 1 << 14  # rows of the busiest channel held at once
PER_ROW = 100  # bytes of a message, roughly
STANDARD = not lacks("foxglove")
"""Whether attitudes, positions and events are written as standard messages, too: Foxglove's package encodes them."""
if STANDARD or TYPE_CHECKING:
    from imuscope.recordings.exporters import standard_schemas

_HEAD = np.dtype(
    [("op", "u1"), ("size", "<u8"), ("channel", "<u2"), ("seq", "<u4"), ("log", "<u8"), ("published", "<u8")]
)


@dataclass(frozen=True, slots=True)
class Messages:
    """Messages of some topics: (n,) each.

    Args:
        topic: their number in the file.
        log: ns since 1970.
        body: large binary.
    """

    topic: Array
    log: Array
    body: pa.Array


@dataclass(frozen=True, slots=True)
class DecodedTopic:
    """A topic, and the conversion of a channel's rows to its messages."""

    topic: MessageChannel
    channel: int
    made: Callable[[ExactRows], Messages]
    is_standard: bool  # of rows in the page's units, whatever the others are in


def write(request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """One file."""
    shown = replace(request, columns=request.columns.in_units("shown"))
    streams = _streams(request, shown)
    ranges = {stream.channel: request.rows(stream.channel) for stream in streams}
    payloads = {info["id"]: info for info in request.payloads}
    total = sum(hi - lo for lo, hi in ranges.values()) or 1
    largest = chunk_bytes(total * PER_ROW)
    done = 0
    with out.open("wb") as file:
        target = ChunkedFile(file, profile="")
        target.write_channels({stream.topic.id: stream.topic for stream in streams})
        _events(request, len(streams) + 1, target)
        for window in windows(request.columns, ranges, WINDOW_ROWS):
            rows = {
                number: request.exact(payloads[number], *part)
                if number in payloads
                else request.columns.exact(number, *part)
                for number, part in window.items()
                if part[1] > part[0]
            }
            present = [stream for stream in streams if stream.channel in rows]
            standard = {one.channel: rows[one.channel] for one in present if one.is_standard}
            if request.columns.units != "shown":
                standard = {number: shown.columns.exact(number, *window[number]) for number in standard}
            made = [one.made((standard if one.is_standard else rows)[one.channel]) for one in present]
            _put(target, made, largest)
            done += sum(map(len, rows.values()))
            step(done / total)
        segments = {device: begins for device, begins in request.columns.manifest.get("segments", {}).items() if begins}
        about = {"recording": request.title, "base": request.base}
        simulated = {info["device"] for info in request.infos if request.is_simulated(info["device"])}
        about |= {"simulated": ", ".join(map(request.device_name, sorted(simulated)))} if simulated else {}
        target.end({"export": about | ({"segments": json.dumps(segments)} if segments else {})})
    step(1.0)
    return [out]


def _put(target: ChunkedFile, parts: Iterable[Messages], largest: int) -> None:
    """Write the messages of all topics, the earliest first."""
    columns = list(parts)
    log = np.concatenate([part.log for part in columns])
    order = np.argsort(log, kind="stable")
    body = pa.concat_arrays([part.body for part in columns])
    sizes = pc.binary_length(body).to_numpy()
    head = np.zeros(len(log), _HEAD)
    head["op"], head["size"] = Opcode.MESSAGE, sizes + HEAD - 9
    head["channel"] = np.concatenate([part.topic for part in columns])
    head["log"] = head["published"] = log
    heads = pa.FixedSizeBinaryArray.from_buffers(pa.binary(HEAD), len(head), [None, pa.py_buffer(head)])
    empty = pa.scalar(b"", pa.large_binary())
    records = pc.binary_join_element_wise(heads.cast(pa.large_binary()), body, empty).take(pa.array(order))
    sizes = sizes[order]
    at = np.cumsum(sizes + HEAD) - sizes
    rows = np.stack((head["channel"][order], log[order], at, sizes)).astype(np.int64)
    data = memoryview(records.buffers()[2])
    for first, past in cut(sizes + HEAD, largest):
        target.chunk(data, rows[:, first:past])


def _streams(request: ExportRequest, shown: ExportRequest) -> list[DecodedTopic]:
    """Topics of the request, and of the same in the page's units for standard messages. They are named among all of the
    recording, so the choice changes no name.
    """
    manifest = request.columns.manifest
    names = device_names(manifest["devices"])
    chosen = {info["id"] for info in request.infos}
    in_use: set[str] = set()
    topics: list[DecodedTopic] = []

    def stream(topic: str, info: Info, about: Mapping[str, Any], body: Callable[..., Messages]) -> None:
        in_use.add(topic)
        if info["id"] in chosen:
            described = MessageChannel(len(topics) + 1, topic, **about)
            is_standard = about["encoding"] == "protobuf"
            topics.append(DecodedTopic(described, info["id"], partial(body, described.id), is_standard))

    entities = devices_of(manifest["devices"], shown.columns.manifest["channels"])
    devices = {device.id: device for device in entities}
    for info in manifest["channels"]:
        name, device = names.get(info["device"], info["device"]), devices[info["device"]]
        stream(topic_of(name, info, in_use), info, _json(schema_of(info)), partial(_plain, request, info))
        if STANDARD and device.attitude and device.attitude.channel == info["id"]:
            topic = named(name, standard_schemas.ATTITUDE, in_use=in_use)
            stream(topic, info, _protobuf(standard_schemas.FrameTransform), partial(_transforms, shown, device))
        if STANDARD and device.position and device.position.kind == "place" and device.position.channel == info["id"]:
            topic = named(name, standard_schemas.POSITION, in_use=in_use)
            stream(topic, info, _protobuf(standard_schemas.LocationFix), partial(_fixes, shown, device))
    chosen |= {info["id"] for info in request.clocks if request.columns.rows(info["id"])}
    for info in request.clocks:
        what = "utc" if [column["name"] for column in info["columns"]] == ["utc"] else "clock"
        topic = named(names.get(info["device"], info["device"]), info["message"], what, in_use=in_use)
        stream(topic, info, _json(schema_of(info)), partial(_plain, request, info))
    chosen |= {info["id"] for info in request.payloads}
    for info in manifest.get("payloads", []):
        owner = names.get(info["device"], info["device"])
        topic = named(owner, *dict.fromkeys((info["message"], info["name"])), "bytes", in_use=in_use)
        stream(topic, info, _json(_schema_of_bytes(info)), partial(_bytes, request))
    infos = {(info["device"], info["message"], info["verified"]): info for info in reversed(request.infos)}
    for info in infos.values():
        topic = named(names.get(info["device"], info["device"]), info["message"], "arrival", in_use=in_use)
        segments = request.segments(info["device"])
        about = {**_ARRIVAL, "columns": [*_ARRIVAL["columns"], _SEGMENT] if segments else _ARRIVAL["columns"]}
        stream(topic, info, _json(schema_of(about)), partial(_arrivals, request, about, segments))
    return topics


def _schema_of_bytes(info: Info) -> Mapping[str, Any]:
    data = {"type": "string", "contentEncoding": "base64", "description": info["doc"]}
    return {"type": "object", "title": f"{info['name']} bytes", "properties": {"data": data}}


_SECONDS = {"name": "arrival", "dtype": "f8", "unit": "s", "label": "", "doc": "", "axis": "", "bits": []}
_SEGMENT = {**_SECONDS, "name": SEGMENT, "dtype": "i4", "unit": "", "doc": "Number of the segment of the clock."}
_ARRIVAL: Info = {
    **{"name": "Arrival", "title": "Arrival", "group": "", "kind": "scalar", "frame": ""},
    "doc": "When its bytes arrived at the host, unix seconds.",
    "columns": [_SECONDS],
}


def _json(schema: Mapping[str, Any]) -> Mapping[str, Any]:
    data = json.dumps(schema).encode()
    return {"encoding": "json", "schema": schema["title"], "schema_encoding": "jsonschema", "schema_data": data}


def _protobuf(message: Any) -> Mapping[str, Any]:
    schema = message.get_schema()
    return {
        "encoding": "protobuf",
        "schema": schema.name,
        "schema_encoding": schema.encoding,
        "schema_data": schema.data,
    }


def _times(request: ExportRequest, rows: ExactRows) -> Ints:
    return stamps(rows.arrival_ns, rows.arrival_ns if request.base == "arrival" else rows.time_ns)


def _plain(request: ExportRequest, info: Info, topic: int, rows: ExactRows) -> Messages:
    """Every quantity as JSON."""
    body = bodies(info, rows.columns)
    log = _times(request, rows)
    if info["kind"] == "table":
        first = np.flatnonzero(np.diff(log, prepend=log[:1] - 1))
        body, log = tables(body, first), log[first]
    return Messages(np.full(len(log), topic, np.uint16), log, body.cast(pa.large_binary()))


def _arrivals(request: ExportRequest, about: Info, segments: Sequence[float], topic: int, rows: ExactRows) -> Messages:
    first = np.flatnonzero(np.diff(rows.arrival, prepend=rows.arrival[:1] - 1))  # one per moment of a table
    log = _times(request, rows)[first]
    key = np.where(np.isnan(rows.time), rows.arrival, rows.time)[first]
    body = bodies(about, [rows.arrival[first], np.searchsorted(segments, key, "right")][: len(about["columns"])])
    return Messages(np.full(len(log), topic, np.uint16), log, body.cast(pa.large_binary()))


def _bytes(request: ExportRequest, topic: int, rows: ExactRows) -> Messages:
    (payloads,) = rows.columns
    body = pa.array([b'{"data":"%s"}' % base64.b64encode(one) for one in payloads], pa.large_binary())
    return Messages(np.full(len(rows), topic, np.uint16), _times(request, rows), body)


def _transforms(request: ExportRequest, device: DeviceEntity, topic: int, rows: ExactRows) -> Messages:
    assert device.attitude is not None
    times = _times(request, rows)
    made = standard_schemas.transforms(device.name, device.attitude, rows.columns, times)
    return _of(topic, times, made)


def _fixes(request: ExportRequest, device: DeviceEntity, topic: int, rows: ExactRows) -> Messages:
    place = device.position
    assert place is not None
    times = _times(request, rows)
    height = np.zeros(len(rows))
    if place.height:
        key = np.where(np.isfinite(rows.time), rows.time, rows.arrival)
        lo = max(request.columns.row_at(place.height, float(key[0])), 0)
        hi = max(request.columns.row_at(place.height, float(key[-1])) + 1, lo + 1)
        height_rows = request.columns.exact(place.height, lo, hi)
        height = standard_schemas.heights(_times(request, height_rows), height_rows.columns[0], times)
    return _of(topic, times, standard_schemas.fixes(device.name, place, rows.columns, height, times))


def _of(topic: int, times: Ints, made: Iterable[tuple[int, bytes]]) -> Messages:
    columns = list(made)
    at = np.array([row for row, _ in columns], np.int64)
    body = pa.array([data for _, data in columns], pa.large_binary())
    return Messages(np.full(len(columns), topic, np.uint16), times[at], body)


def _events(request: ExportRequest, topic: int, target: ChunkedFile) -> None:
    """Write the events of the exported devices at the start of the file: they are few."""
    if not STANDARD:
        return
    manifest = request.columns.manifest
    names = device_names(manifest["devices"])
    inside = [
        event
        for event in manifest.get("events", [])
        if "text" in event and request.t0 <= event["time"] <= request.t1 and request.device in ("", event["device"])
    ]
    target.write_channels({topic: MessageChannel(topic, EVENTS, **_protobuf(standard_schemas.Log))})
    if inside:
        made = [standard_schemas.logged(event, names.get(event["device"], "")) for event in inside]
        log = np.array([time for time, _ in made], np.int64)
        body = pa.array([data for _, data in made], pa.large_binary())
        _put(target, [Messages(np.full(len(made), topic, np.uint16), log, body)], 1 << 20)
