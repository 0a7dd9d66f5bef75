"""Export request: a range of some channels of an opened recording."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.recordings.columns.payloads import BYTES, payloads_of
from imuscope.recordings.columns.rows import ExactRows
from imuscope.recordings.columns.store import Base, ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.file_names import device_names

ExportStep = Callable[[float], None]  # called with 0..1; an exception it raises ends the export


class ExportError(RecordingError):
    """An export that is not possible: one sentence, and what to do."""


@dataclass(frozen=True)
class ExportRequest:
    """Request for an export.

    Args:
        columns: the opened recording.
        source: its file, for formats that hold the bytes of a device.
        title: of the recording, for headers.
        t0, t1: both ends included, unix s.
        channels: ids; None for all.
        device: for formats that hold one device; "" if there is only one.
        base: the time that t0, t1 and the order of rows refer to.
    """

    columns: ColumnStore
    source: Path | None = None
    title: str = ""
    t0: float = -math.inf
    t1: float = math.inf
    channels: tuple[int, ...] | None = None
    device: str = ""
    base: Base = "device"

    @cached_property
    def infos(self) -> Sequence[Mapping[str, Any]]:
        """The chosen channels that have rows, as the manifest describes them (server/wire/, ChannelInfo)."""
        channels = self.columns.manifest["channels"]
        return [info for info in channels if self._is_chosen(info) and self.columns.rows(info["id"])]

    @cached_property
    def clocks(self) -> Sequence[Mapping[str, Any]]:
        """Clock readings of the devices, for the messages of the chosen channels: described like channels, but not
        for plots. Their columns are the clock as sent ("timestamp", "time"), or "utc".
        """
        chosen = {(info["device"], info["message"], info["verified"]) for info in self.infos}
        clocks = self.columns.manifest.get("clocks", [])
        return [info for info in clocks if (info["device"], info["message"], info["verified"]) in chosen]

    @cached_property
    def payloads(self) -> Sequence[Mapping[str, Any]]:
        """Undescribed bytes of the chosen device, or of the messages of the chosen channels: described like channels,
        each with one column of "bytes".
        """
        chosen = {(info["device"], info["message"], info["verified"]) for info in self.infos}
        return [
            info
            for info in self.columns.manifest.get("payloads", [])
            if self.columns.rows(info["id"])
            and (self._is_chosen(info) or (info["device"], info["message"], info["verified"]) in chosen)
        ]

    def exact(self, info: Mapping[str, Any], lo: int, hi: int) -> ExactRows:
        """Rows of a channel as stored; of payloads their bytes."""
        rows = self.columns.exact(info["id"], lo, hi)
        return payloads_of(self.columns.folder, rows) if info["kind"] == BYTES else rows

    def _is_chosen(self, info: Mapping[str, Any]) -> bool:
        return (self.channels is None or info["id"] in self.channels) and self.device in ("", info["device"])

    def segments(self, device: str) -> Sequence[float]:
        """Begin of each segment of a device's clock after the first, unix s."""
        begins: Sequence[float] = self.columns.manifest.get("segments", {}).get(device, ())
        return begins

    def rows(self, channel: int) -> tuple[int, int]:
        """The rows of a channel in the export: the first, and one past the last."""
        return self.columns.between(channel, self.t0, self.t1, self.base)

    def device_name(self, device: str) -> str:
        """Name of a device; if several share it, followed by the id."""
        return device_names(self.columns.manifest["devices"]).get(device, device)

    def is_simulated(self, device: str) -> bool:
        """Whether a simulator made the data of a device, which every format says."""
        return any(one.get("simulated") for one in self.columns.manifest["devices"] if one["id"] == device)

    @property
    def has_several_devices(self) -> bool:
        """Whether the recording has samples of more than one device."""
        return len({info["device"] for info in self.columns.manifest["channels"]}) > 1


def usual_interval(columns: ColumnStore, channel: int) -> float:
    """Usual interval of a channel's samples, s; 0 if it has fewer than two times."""
    steps = np.diff(columns.clock(channel, 0, 4096))
    return float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0


def with_unit(name: str, unit: str, frame: str = "") -> str:
    """A column's heading: "Acceleration.x (m/s²)", "Velocity.x (m/s; NED)", "Quaternion.q0 (ENU from body)"."""
    details = "; ".join(filter(None, (unit, frame)))
    return f"{name} ({details})" if details else name
