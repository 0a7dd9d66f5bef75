"""Per-second link and clock statistics of a recording: the live health panel's values, computed when a recording is
opened.

    health.bin    row after row, as the recording is decoded; several rows may belong to one second
                 second │ device │ message │ count │ bytes │ late │ drift │ uncertainty
                   i8       u2       u2       u4      u4     f4     f4        f4

`message` 0 is the link: bytes received, and the state of the device's clock; any other is a kind of message: its
samples in that second, and the delay of the latest hundredth of them against the device's clock (ms). Counts of one
second add up; of the other values the last or the worst counts. An hour of five messages is 750 kB.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats, Ints

NAME = "health.bin"
ROW = np.dtype(
    [
        *(("second", "<i8"), ("device", "<u2"), ("message", "<u2"), ("count", "<u4"), ("bytes", "<u4")),
        *(("late", "<f4"), ("drift", "<f4"), ("uncertainty", "<f4")),
    ]
)
LATE_SHARE = 0.99  # as the live figure: 99 of 100 samples stay below
LINK = 0
UNKNOWN = 0xFFFF


class HealthHistoryWriter:
    """Writes the file while a recording is decoded.

    Args:
        folder: the store being made.
    """

    def __init__(self, folder: Path) -> None:
        self._file = (folder / NAME).open("wb", buffering=1 << 16)
        self._devices: dict[str, int] = {}
        self._messages: dict[str, int] = {"": LINK}

    @property
    def names(self) -> dict[str, list[str]]:
        """Names of devices and messages by number, for the manifest."""
        return {"devices": list(self._devices), "messages": list(self._messages)}

    def add(self, device: str, ends: Ints, times: Ints) -> None:
        """Add chunks: the end of each, and its arrival (ns)."""
        seconds, which = np.unique(times // 1_000_000_000, return_inverse=True)
        sizes = np.bincount(which, np.diff(ends, prepend=0), len(seconds))
        self._put(device, "", seconds, bytes=sizes)

    def samples(self, device: str, message: str, arrival: Floats, time: Floats) -> None:
        """Add samples of one message: (n,) each, unix s; `time` by the device's clock, NaN if it has none."""
        if not len(arrival):
            return
        order = np.floor(arrival).astype(np.int64)
        starts = np.flatnonzero(np.diff(order, prepend=order[0] - 1))
        late = 1e3 * np.maximum(arrival - time, 0.0)
        worst = [_highest(part) for part in np.split(late, starts[1:])]
        self._put(device, message, order[starts], count=np.diff(starts, append=len(order)), late=np.array(worst))

    def clock(self, device: str, at: float, drift_ppm: float, uncertainty_ms: float) -> None:
        """Store the clock figures of a device at a time, unix s."""
        self._put(device, "", np.array([int(at)]), drift=drift_ppm, uncertainty=uncertainty_ms)

    def flush(self) -> None:
        """Make the data readable."""
        self._file.flush()

    def close(self) -> None:
        """Finish the file."""
        self._file.close()

    def _put(self, device: str, message: str, seconds: NDArray[np.int64], **values: Any) -> None:
        rows = np.zeros(len(seconds), ROW)
        for name in ("late", "drift", "uncertainty"):
            rows[name] = np.nan
        rows["second"] = seconds
        rows["device"] = self._devices.setdefault(device, len(self._devices))
        rows["message"] = self._messages.setdefault(message, len(self._messages))
        for name, value in values.items():
            rows[name] = value
        self._file.write(rows.tobytes())


def _highest(late: Floats) -> float:
    known = late[~np.isnan(late)]
    if not len(known):
        return float("nan")
    at = int(LATE_SHARE * (len(known) - 1))
    return float(np.partition(known, at)[at])


@dataclass(slots=True)
class HealthHistory:
    """A range of seconds of one device: a list holds one value a second from `first` on; None: unknown.

    Args:
        first: the first second, unix s.
        before: bytes received before.
        jitter_ms: delay of the latest hundredth of the samples.
        messages: kind of message → samples in each second.
        counted: kind of message → samples before `first`.
    """

    first: int
    before: int
    bytes: list[int]
    jitter_ms: list[float | None]
    drift_ppm: list[float | None]
    uncertainty_ms: list[float | None]
    messages: dict[str, list[int]] = field(default_factory=dict)
    counted: dict[str, int] = field(default_factory=dict)


def health_history(
    folder: Path, names: Mapping[str, list[str]], device: str, link: str, t0: int, t1: int
) -> HealthHistory:
    """The seconds t0 ≤ second ≤ t1.

    Args:
        folder: of the store.
        names: of its manifest.
        link: the device whose link it shares (itself if it has its own): bytes are counted per link.
    """
    n = t1 - t0 + 1
    rows = _rows(folder)
    selected = rows[rows["device"] == _number(names, "devices", device)]
    links = rows[(rows["device"] == _number(names, "devices", link)) & (rows["message"] == LINK)]
    near = selected[(selected["second"] >= t0) & (selected["second"] <= t1)]
    size = links[(links["second"] >= t0) & (links["second"] <= t1)]
    late = np.full(n, np.nan)
    np.fmax.at(late, near["second"] - t0, near["late"])
    history = HealthHistory(
        first=t0,
        before=int(links["bytes"][links["second"] < t0].sum(dtype=np.int64)),
        bytes=_summed(size["second"] - t0, size["bytes"], n),
        jitter_ms=_plain(late),
        drift_ppm=_plain(_held(selected, "drift", t0, n)),
        uncertainty_ms=_plain(_held(selected, "uncertainty", t0, n)),
    )
    past = selected[selected["second"] < t0]
    for number in np.unique(selected["message"]).tolist():
        if number == LINK:
            continue
        name = names["messages"][number]
        own = near[near["message"] == number]
        history.messages[name] = _summed(own["second"] - t0, own["count"], n)
        history.counted[name] = int(past["count"][past["message"] == number].sum(dtype=np.int64))
    return history


def _rows(folder: Path) -> NDArray[Any]:
    """Complete rows: the last one may be partially written."""
    path = folder / NAME
    whole = path.stat().st_size // ROW.itemsize if path.exists() else 0
    return np.memmap(path, ROW, "r", shape=(whole,)) if whole else np.empty(0, ROW)


def _number(names: Mapping[str, list[str]], kind: str, name: str) -> int:
    known = names.get(kind, [])
    return known.index(name) if name in known else UNKNOWN


def _summed(place: NDArray[np.int64], values: NDArray[Any], n: int) -> list[int]:
    return np.bincount(place, values, n).astype(np.int64).tolist()  # type: ignore[no-any-return]


def _held(rows: NDArray[Any], name: str, t0: int, n: int) -> Floats:
    """The last value of each second or before; an infinite one says that none is known since."""
    known = rows[~np.isnan(rows[name])]
    known = known[np.argsort(known["second"], kind="stable")]
    at = np.searchsorted(known["second"], np.arange(t0, t0 + n), "right") - 1
    if not len(known):
        return np.full(n, np.nan)
    values = known[name][np.maximum(at, 0)]
    return np.where((at >= 0) & np.isfinite(values), values, np.nan)


def _plain(values: Floats) -> list[float | None]:
    return [None if value != value else round(value, 4) for value in values.tolist()]
