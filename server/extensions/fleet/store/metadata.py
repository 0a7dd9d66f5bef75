"""Rows of an opened recording for the small tables: recordings, devices, events, losses, settings."""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from typing import Any

import pyarrow as pa

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.library.recording_probe import RecordingProbe
from imuscope.server.configuration.value_format import spaced
from imuscope.server.devices.decode.protocol_set import sensors_of
from imuscope.server.extensions.fleet.store.tables import DEVICES, EVENTS, LOSSES, RECORDINGS, SETTINGS, StoreTable
from imuscope.server.version import VERSION

Row = dict[str, Any]
_BY_ID = re.compile(r"/dev/serial/by-id/([^?]+)")
_EARLIEST_UNIX_S, _LATEST_UNIX_S = 0.0, 9e9  # unix s; times outside cannot be those of a recording


@dataclass(frozen=True, slots=True)
class StoredFile:
    """The recording in the store, and the file it came from.

    Args:
        key: of the object.
        bytes, checksum: of the object; SHA-256, hexadecimal.
        name, format: of the file as given.
    """

    key: str
    bytes: int
    checksum: str
    name: str
    format: str


@dataclass(frozen=True, slots=True)
class RecordingKey:
    """The columns that every row has."""

    date: date
    robot: str
    recording: str

    @property
    def values(self) -> Row:
        """As part of a row."""
        return {"date": self.date, "robot": self.robot, "recording": self.recording}


def moment(seconds: Any) -> datetime | None:
    """A time in unix s; None if it is not a time."""
    if not isinstance(seconds, int | float) or not _EARLIEST_UNIX_S <= seconds <= _LATEST_UNIX_S:
        return None
    return datetime.fromtimestamp(round(seconds * 1e6) / 1e6, UTC)


def start_of(store: ColumnStore) -> datetime:
    """Start of a recording; 1970 if it has no time."""
    started = store.manifest["started"]
    return moment(started) or datetime.fromtimestamp(0, UTC)


def small_tables(store: ColumnStore, probe: RecordingProbe, key: RecordingKey, file: StoredFile) -> dict[str, pa.Table]:
    """Rows of the small tables, by table; `recordings` last."""
    manifest = store.manifest
    devices = list(_devices(manifest))
    row_lists = {
        DEVICES: devices,
        SETTINGS: list(_settings(manifest)),
        EVENTS: list(_events(manifest, probe)),
        LOSSES: list(_losses(manifest)),
    }
    row_lists[RECORDINGS] = [_recording(manifest, probe, devices, len(_markers(manifest, probe)), file)]
    return {table.name: arrow_rows(table, key, rows) for table, rows in row_lists.items()}


def arrow_rows(table: StoreTable, key: RecordingKey, rows: Sequence[Row]) -> pa.Table:
    """Rows as an Arrow table with the keys of the recording."""
    return pa.Table.from_pylist([{**key.values, **row} for row in rows], table.schema)


def _recording(
    manifest: Mapping[str, Any], probe: RecordingProbe, devices: Sequence[Row], markers: int, file: StoredFile
) -> Row:
    damage = [one["words"] for one in manifest.get("damage", ()) if not one.get("is_remark")]
    return {
        "title": probe.edits.title or probe.title or file.name,
        "started": moment(manifest["started"]),
        "ended": moment(manifest["ended"]),
        "duration_s": _duration(manifest),
        "devices": len(devices),
        **{name: sum(one[name] for one in devices) for name in ("messages", "lost", "rejects")},
        "markers": markers,
        "tags": ", ".join(probe.edits.tags or ()),
        "notes": probe.edits.notes or "",
        "damaged": probe.damaged or (damage[0] if damage else ""),
        "name": file.name,
        "format": file.format,
        "object": file.key,
        "bytes": file.bytes,
        "checksum": file.checksum,
        "host": str(manifest.get("about", {}).get("host", "")),
        "version": VERSION,
        "uploaded": datetime.now(UTC),
    }


def _duration(manifest: Mapping[str, Any]) -> float | None:
    started, ended = manifest["started"], manifest["ended"]
    return None if started is None or ended is None else float(ended - started)


def _devices(manifest: Mapping[str, Any]) -> Iterator[Row]:
    for device in manifest["devices"]:
        counted = manifest["figures"].get(device["id"], {})
        data_sheet = sensors_of(device["protocol"], device["product"])
        yield {
            "device": device["id"],
            **{name: device[name] for name in ("name", "product", "serial_number", "firmware", "protocol", "link")},
            "adapter": adapter_of(device["source"], device["link"]),
            "source": device["source"],
            "baud": device["baud"],
            "duration_s": _duration(manifest),
            "messages": sum(counted.get("messages", {}).values()),
            **{name: int(counted.get(name, 0)) for name in ("bytes", "lost", "gaps", "rejects")},
            "gyro_noise": data_sheet.turn or None,
            "accelerometer_noise": data_sheet.acceleration or None,
        }


def adapter_of(source: str, link: str) -> str:
    """Adapter of a device by its identity, else its port, else the kind of its link.

    >>> adapter_of("/dev/serial/by-id/usb-FTDI_FT232R_A10K-if00-port0?baud=115200", "serial")
    'usb-FTDI_FT232R_A10K-if00-port0'
    """
    if match := _BY_ID.search(source):
        return match[1]
    if link == "serial":
        return source.removeprefix("serial://").partition("?")[0]
    return link


def _markers(manifest: Mapping[str, Any], probe: RecordingProbe) -> list[Row]:
    """Markers of the recording and those that were added later."""
    added = [
        {"time": one.time, "kind": one.kind, "text": one.text, "device": one.device} for one in probe.edits.markers
    ]
    return [*manifest["markers"], *added]


def _events(manifest: Mapping[str, Any], probe: RecordingProbe) -> Iterator[Row]:
    for event in manifest["events"]:
        yield {
            **{name: event[name] for name in ("device", "kind", "level", "text")},
            "time": moment(event["time"]),
            "began": moment(event["t0"]),
            "ended": moment(event["t1"]),
            "samples": int(event["samples"] or 0),
            "data": json.dumps(event["data"], ensure_ascii=False) if event["data"] else None,
        }
    for marker in _markers(manifest, probe):
        names = ("device", "kind", "text")
        yield {**{name: marker[name] for name in names}, "level": "info", "time": moment(marker["time"]), "samples": 0}


def _losses(manifest: Mapping[str, Any]) -> Iterator[Row]:
    for event in manifest["events"]:
        began, ended = moment(event["t0"]), moment(event["t1"])
        if event["kind"] != "gap" or began is None or ended is None:
            continue
        yield {
            "device": event["device"],
            "began": began,
            "ended": ended,
            "duration_s": float(event["t1"] - event["t0"]),
            "samples": int(event["samples"] or 0),
            "cause": str((event["data"] or {}).get("by", "")),
        }


def _settings(manifest: Mapping[str, Any]) -> Iterator[Row]:
    for device, snapshot in manifest["snapshots"].items():
        values = snapshot.get("values")
        for setting, body in values.items() if isinstance(values, Mapping) else ():
            for field, value in flattened(body):
                yield {
                    "device": device,
                    "setting": setting,
                    "title": spaced(setting),
                    "field": field,
                    "value": value if isinstance(value, str) else json.dumps(value, ensure_ascii=False),
                    "number": number_of(value),
                }


def flattened(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every single value with its path; a list of numbers is one value.

    >>> list(flattened({"outputs": [{"rate": 100}], "gain": [1, 2]}))
    [('outputs[0].rate', 100), ('gain', [1, 2])]
    """
    if isinstance(value, Mapping) and value:
        for name, one in value.items():
            yield from flattened(one, f"{path}.{name}" if path else str(name))
    elif isinstance(value, list) and any(isinstance(one, Mapping | list) for one in value):
        for place, one in enumerate(value):
            yield from flattened(one, f"{path}[{place}]")
    else:
        yield path, value


def number_of(value: Any) -> float | None:
    """A finite number; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
