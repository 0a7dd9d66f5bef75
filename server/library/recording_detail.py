"""What the page is told of an opened recording besides its samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from weakref import WeakKeyDictionary

from recordings.column_store import ColumnStore
from server import wire_codec
from server.library.api_models import Marker, RecordedDevice, RecordingDetail, RecordingInfo
from server.library.decode import usual_interval
from server.wire import BitsInfo, ChannelInfo, ColumnInfo, DeviceInfo, EventInfo


def channel_info(told: Mapping[str, Any]) -> ChannelInfo:
    """A ChannelInfo out of a manifest."""
    columns = [
        ColumnInfo(**{**column, "bits": [BitsInfo(**bit) for bit in column["bits"]]}) for column in told["columns"]
    ]
    return ChannelInfo(**{**told, "columns": columns})


_KNOWN: WeakKeyDictionary[ColumnStore, dict[int, ChannelInfo]] = WeakKeyDictionary()


def channels_of(store: ColumnStore) -> dict[int, ChannelInfo]:
    """The channels of a store as the wire describes them; every window asks for them."""
    known = _KNOWN.get(store)
    if known is None:
        known = _KNOWN[store] = {info["id"]: channel_info(info) for info in store.manifest["channels"]}
    return known


def devices_of(store: ColumnStore) -> list[RecordedDevice]:
    """Its devices, with what was counted when it was decoded."""
    figures = store.manifest["figures"]
    out = []
    for told in store.manifest["devices"]:
        counted = figures.get(told["id"], {})
        out.append(
            RecordedDevice(
                id=told["id"],
                name=told["name"],
                protocol=told["protocol"],
                product=told["product"],
                serial_number=told["serial_number"],
                messages=sum(counted.get("messages", {}).values()),
                lost=counted.get("lost", 0),
                rejects=counted.get("rejects", 0),
            )
        )
    return out


def detail(info: RecordingInfo, store: ColumnStore, markers: list[Marker] | None = None) -> RecordingDetail:
    """Everything about an opened recording but its samples.

    Args:
        info: as the list has it.
        markers: those that were put in later; they come after those of the file.
    """
    told = store.manifest
    span = store.span() or (told["started"] or 0.0, told["ended"] or 0.0)
    progress = told.get("progress", 1.0)
    last = span[1] if progress == 1.0 else max(span[1], told["ended"] or 0.0)
    own = [Marker(**marker) for marker in told["markers"]]
    return RecordingDetail(
        info=info,
        t0=span[0],
        t1=last,
        devices=[DeviceInfo(**device) for device in told["devices"]],
        channels=list(channels_of(store).values()),
        events=[EventInfo(**event) for event in told["events"]],
        markers=sorted([*own, *(markers or [])], key=lambda marker: marker.time),
        snapshots=told["snapshots"],
        longest_s={str(number): usual_interval(store, number) for number in store.shapes},
        progress=progress,
    )


def as_json(found: RecordingDetail) -> Any:
    """What JSON can hold of it."""
    return wire_codec.to_json_safe(found)
