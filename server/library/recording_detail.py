"""Details of an opened recording, apart from its samples."""

import math
from collections.abc import Callable, Mapping
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.sidecar import MarkerInfo
from imuscope.server.devices.decode.protocol_set import sensors_of
from imuscope.server.library.api_models import RecordingDetail, RecordingInfo
from imuscope.server.wire import BitsInfo, ChannelInfo, ColumnInfo, DeviceInfo, EventInfo


def channel_info(manifest: Mapping[str, Any]) -> ChannelInfo:
    columns = [
        ColumnInfo(**{**column, "bits": [BitsInfo(**bit) for bit in column["bits"]]}) for column in manifest["columns"]
    ]
    return ChannelInfo(**{**manifest, "columns": columns})


_KNOWN: WeakKeyDictionary[ColumnStore, dict[int, ChannelInfo]] = WeakKeyDictionary()


def segments_of(store: ColumnStore) -> dict[str, tuple[float, ...]]:
    """Times at which the clock of a device steps, unix s, by device: each begins a segment."""
    segments = store.manifest.get("segments") or {}
    return {device: tuple(times) for device, times in segments.items() if times}


def channels_of(store: ColumnStore) -> dict[int, ChannelInfo]:
    """The channels of a store as described by the wire; cached, because every window needs them."""
    known = _KNOWN.get(store)
    if known is None:
        known = _KNOWN[store] = {info["id"]: channel_info(info) for info in store.manifest["channels"]}
    return known


def products_of(store: ColumnStore) -> Callable[[str], tuple[str, SensorProperties]]:
    """Name of a device's product, and the properties of its sensors, by its id."""
    known = {device["id"]: device for device in store.manifest["devices"]}

    def product(device: str) -> tuple[str, SensorProperties]:
        entry = known.get(device, {"product": "", "protocol": ""})
        return entry["product"], sensors_of(entry["protocol"], entry["product"])

    return product


def detail(info: RecordingInfo, store: ColumnStore, markers: list[MarkerInfo] | None = None) -> RecordingDetail:
    """Details of an opened recording, without its samples.

    Args:
        info: its information in the list.
        markers: markers added later; they follow those of the file.
    """
    manifest = store.manifest
    span = store.span() or (manifest["started"] or 0.0, manifest["ended"] or 0.0)
    progress = manifest.get("progress", 1.0)
    last = span[1] if progress == 1.0 else max(span[1], manifest["ended"] or 0.0)
    own = [MarkerInfo(**marker) for marker in manifest["markers"]]
    return RecordingDetail(
        info=info,
        t0=span[0],
        t1=last,
        devices=[DeviceInfo(**device) for device in manifest["devices"]],
        channels=list(channels_of(store).values()),
        events=[EventInfo(**event) for event in manifest["events"]],
        markers=sorted([*own, *(markers or [])], key=lambda marker: marker.time),
        snapshots=manifest["snapshots"],
        longest_s={str(number): _usual_interval(store, number) for number in store.shapes},
        progress=progress,
        begins=begins(store),
    )


def begins(store: ColumnStore) -> dict[str, float]:
    """Time of the first sample of each device that has one, unix s."""
    times: dict[str, float] = {}
    for number, info in channels_of(store).items():
        if info.kind != "table" and (span := store.span(number)) is not None:
            times[info.device] = min(times.get(info.device, math.inf), span[0])
    return times


def _usual_interval(columns: ColumnStore, channel: int) -> float:
    """Median time between two samples of a channel, s; 0 if it has fewer than two."""
    rows = columns.exact(channel, 0, 4096, columns=[])
    steps = np.diff(np.where(np.isnan(rows.time), rows.arrival, rows.time))
    return float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
