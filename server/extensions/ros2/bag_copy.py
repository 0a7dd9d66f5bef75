"""Messages of ROS in a recording, copied to a bag as they came: stamps, frames, covariances, types and all fields.

    rx of "messages"    records (protocols/messages/records.py)  ──cdr──> as they are
                                                                ──ros1─> as CDR; only the header's `seq` is left out

Messages of other encodings (JSON, protobuf) have no type of ROS: their channels are exported as those of a sensor.
"""

from __future__ import annotations

import contextlib
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from imuscope.protocols.arrays import Ints
from imuscope.protocols.messages.family import NAME as MESSAGES
from imuscope.protocols.messages.records import HEAD, MESSAGE, MESSAGE_HEAD, Definitions, MessageChannel, records_of
from imuscope.recordings.exporters.raw_bytes import parts_of

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2 import Writer

    from imuscope.recordings.exporters.request import ExportRequest, ExportStep

Connections = dict[tuple[str, str], "Connection"]
"""By topic and type."""

DAMAGED = (SerdeError, ValueError, IndexError, struct.error)
ENCODINGS = {"cdr": "ros2msg", "ros1": "ros1msg"}


def copy_messages(request: ExportRequest, writer: Writer, step: ExportStep) -> set[tuple[str, str]]:
    """Copy the messages of the range, of the chosen topics; returns those copied, (device, topic)."""
    topics: set[tuple[str, str]] = set()
    connections: Connections = {}
    for device in request.columns.manifest["devices"] if request.source is not None else ():
        if device["protocol"] == MESSAGES and request.device in ("", device["id"]):
            copy = _Copy(request, writer, device["id"], connections)
            copy.run(step)
            topics |= {(device["id"], topic) for topic in copy.inside}
    return topics


class _Copy:
    """Copy of the messages of one device.

    Args:
        connections: topics of the bag so far, which several devices may share.

    Attributes:
        inside: by topic of ROS, the arrivals of its messages in the range; None if none of its fields is described.
    """

    def __init__(self, request: ExportRequest, writer: Writer, device: str, connections: Connections) -> None:
        self._request, self._writer, self._device = request, writer, device
        self._definitions = Definitions()
        self._connections = connections
        self._types: dict[MessageChannel, Any] = {}
        self.inside: dict[str, Ints | None] = {}

    def run(self, step: ExportStep) -> None:
        for part in parts_of(self._request, self._device, step, whole=self._request.base == "device"):
            ends, times = part.ends.tolist(), part.times.tolist()
            for begin, end, arrival_ns in zip([0, *ends[:-1]], ends, times, strict=True):
                for opcode, record in records_of(part.data[begin:end]):
                    if opcode == MESSAGE:
                        self._write(record, arrival_ns)
                    else:
                        with contextlib.suppress(ValueError):  # a damaged definition, as the decoder takes it
                            self._definitions.read(opcode, record[HEAD.size :])

    def _write(self, record: bytes, arrival_ns: int) -> None:
        channel = self._definitions.channels.get(MESSAGE_HEAD.unpack_from(record)[2])
        if channel is None:
            return
        if channel not in self._types:
            self._types[channel] = _types_of(channel)
        types, topic = self._types[channel], channel.topic
        if types is None:
            return
        if topic not in self.inside:
            self.inside[topic] = self._arrivals(topic)
        if not self._is_inside(self.inside[topic], arrival_ns):
            return
        data = record[MESSAGE_HEAD.size :]
        if channel.encoding == "ros1":
            try:
                data = bytes(types.ros1_to_cdr(data, channel.schema))
            except DAMAGED:
                return
        key = topic, channel.schema
        if key not in self._connections:
            self._connections[key] = self._writer.add_connection(*key, typestore=types)
        self._writer.write(self._connections[key], arrival_ns, data)

    def _is_inside(self, arrivals: Ints | None, arrival_ns: int) -> bool:
        if arrivals is None:
            return self._request.channels is None and self._request.t0 <= arrival_ns / 1e9 <= self._request.t1
        at = int(np.searchsorted(arrivals, arrival_ns))
        return at < len(arrivals) and int(arrivals[at]) == arrival_ns

    def _arrivals(self, topic: str) -> Ints | None:
        """Arrivals of the messages of a topic in the range; None if nothing of them is described."""
        columns = self._request.columns
        key = self._device, topic
        if all((info["device"], info["message"]) != key for info in columns.manifest["channels"]):
            return None
        numbers = [info["id"] for info in self._request.infos if (info["device"], info["message"]) == key]
        rows = [columns.clock_ns(number, *self._request.rows(number), "arrival") for number in numbers]
        return np.unique(np.concatenate([np.empty(0, np.int64), *rows]))


def _types_of(channel: MessageChannel) -> Any:
    """Types of ROS 2 by the definition that the recording has; None for a channel of another encoding, or a definition
    that cannot be read.
    """
    if ENCODINGS.get(channel.encoding) != channel.schema_encoding:
        return None
    try:
        types = get_types_from_msg(channel.schema_data.decode(), channel.schema)
        if channel.encoding == "cdr":
            store = get_typestore(Stores.EMPTY)
            store.register(types)
            with contextlib.suppress(TypesysError, KeyError):  # the definition leaves out the common types
                store.generate_msgdef(channel.schema)
                return store
        store = get_typestore(Stores.ROS2_HUMBLE)  # the header of ROS 1 differs
        store.register({name: fields for name, fields in types.items() if name not in store.fielddefs})
        store.generate_msgdef(channel.schema)
    except (TypesysError, UnicodeDecodeError, KeyError):
        return None
    return store
