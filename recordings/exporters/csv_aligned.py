"""CSV in one file, for a spreadsheet: a line for each sample of the fastest channel; the others hold their last value.

    # A line for each sample of Acceleration. Any other column holds its last value while that is not older than …
    time (s),arrival (s),timestamp,utc (s),Acceleration.x (m/s²),…,GnssPvtData.lat (°),…

The rule, which the first line of the file states: the fastest channel is the one with the most samples in the range.
Another channel's cell is its last value at that time, if it is not older than twice its usual interval (or twice the
fastest's, if that is longer); else it is empty. So a value repeats until the next one, a pause is visible, and nothing
is interpolated. Tables (satellites) do not fit and are left out. The two times are followed by the device's own clock
for the line's sample, and its UTC if known; the clocks of the other channels are not held.

A line that begins with # is skipped by pandas with `comment="#"`.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from imuscope.recordings.exporters.csv_tables import heading, lines
from imuscope.recordings.exporters.message_table import (
    WINDOW,
    cells,
    clocks_of,
    frame_label,
    known,
    moments,
    of_their_packet,
)
from imuscope.recordings.exporters.message_table import heading as named
from imuscope.recordings.exporters.request import ExportError, ExportRequest, ExportStep, usual_interval, with_unit

MAX_AGE_INTERVALS = 2  # usual intervals for which a value is held


@dataclass(slots=True)
class _Follower:
    """A channel whose last value is held."""

    info: Mapping[str, Any]
    names: list[str]
    oldest_s: float


def write(request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """One file."""
    infos = [info for info in (*request.infos, *request.payloads) if info["kind"] != "table"]
    sizes = {info["id"]: request.rows(info["id"]) for info in infos}
    infos = [info for info in infos if sizes[info["id"]][1] > sizes[info["id"]][0]]
    if not infos:
        raise ExportError("This range contains no channel with one value at a time.", "Choose other channels.")
    leader = max(infos, key=lambda info: sizes[info["id"]][1] - sizes[info["id"]][0])
    least = usual_interval(request.columns, leader["id"])
    clocks = clocks_of(request, leader)
    headings = _Headings(request, clocks)
    others = [
        _Follower(info, headings.of(info), MAX_AGE_INTERVALS * max(usual_interval(request.columns, info["id"]), least))
        for info in infos
        if info is not leader
    ]
    first, last = sizes[leader["id"]]
    with out.open("wb") as file:
        file.write(f"# {_rule(request, leader, others)}\n".encode())
        chosen = [*clocks, leader, *(held.info for held in others)]
        units = [(column["unit"], frame_label(info["frame"])) for info in chosen for column in info["columns"]]
        names = [name for info in (*clocks, leader) for name in headings.of(info)]
        names += [name for held in others for name in held.names]
        heads = [with_unit(name, *one) for name, one in zip(names, units, strict=True)]
        heading(file, ["time (s)", "arrival (s)", *heads])
        for lo in range(first, last, WINDOW):
            hi = min(lo + WINDOW, last)
            lines(file, _batch(request, leader, clocks, others, lo, hi))
            step((hi - first) / (last - first))
    return [out]


def _batch(
    request: ExportRequest,
    leader: Mapping[str, Any],
    clocks: list[Mapping[str, Any]],
    others: list[_Follower],
    lo: int,
    hi: int,
) -> pa.RecordBatch:
    columns = request.columns
    rows = request.exact(leader, lo, hi)
    times, place = columns.clock(leader["id"], lo, hi), columns.clock(leader["id"], lo, hi, "place")
    arrays = [moments(rows.time_ns), moments(rows.arrival_ns)]
    arrays += [known(values) for info in clocks for values in of_their_packet(columns, info, rows.arrival_ns, place)]
    arrays += map(cells, rows.columns)
    for held in others:
        number = held.info["id"]
        first = max(columns.between(number, float(times[0]), np.inf)[0] - 1, 0)
        past = columns.between(number, float(times[0]), float(times[-1]))[1]
        clock = columns.clock(number, first, past)
        at = np.searchsorted(clock, times, "right") - 1
        age = times - clock[np.maximum(at, 0)] if len(clock) else np.full(len(times), np.inf)
        missing = (at < 0) | (age > held.oldest_s)
        exact = request.exact(held.info, first, past)
        for column in exact.columns:
            values = column[np.maximum(at, 0)] if len(column) else np.zeros(len(at), column.dtype)
            arrays.append(cells(values, missing))
    return pa.RecordBatch.from_arrays(arrays, names=[str(n) for n in range(len(arrays))])


class _Headings:
    """Unique headings: with the device if there are several, with the message if needed, and with a number if a
    quantity's layout changed.
    """

    def __init__(self, request: ExportRequest, clocks: Sequence[Mapping[str, Any]]) -> None:
        every = (*request.infos, *request.payloads, *clocks)
        self._request = request
        self._short = Counter((one["device"], name) for one in every for name in _short(one))
        self._long = Counter((one["device"], name) for one in every for name in _long(one))
        self._framed = Counter((one["device"], name, one["frame"]) for one in every for name in _long(one))

    def of(self, info: Mapping[str, Any]) -> list[str]:
        """Those of a channel's columns."""
        own = [named(info, column) for column in info["columns"]]
        device, message, short, long = info["device"], info["message"], _short(info), _long(info)
        if any(self._short[device, name] > (name in short) for name in own):  # another channel has it
            own = [name if name.startswith(f"{message}.") else f"{message}.{name}" for name in own]
            if any(self._long[device, name] > (name in long) for name in own):
                own = [f"{name}[{info['frame']}]" for name in own]
                if any(self._framed[device, name, info["frame"]] > 1 for name in _long(info)):
                    own = [f"{name} #{info['id']}" for name in own]
        several = self._request.has_several_devices
        return [f"{self._request.device_name(device)}.{name}" for name in own] if several else own


def _short(info: Mapping[str, Any]) -> set[str]:
    return {named(info, column) for column in info["columns"]}


def _long(info: Mapping[str, Any]) -> set[str]:
    return {f"{info['message']}.{name}" for name in _short(info)}


def _rule(request: ExportRequest, leader: Mapping[str, Any], others: list[_Follower]) -> str:
    of = f" of {request.device_name(leader['device'])}" if request.has_several_devices else ""
    words = f"A line for each sample of {leader['title'] or leader['name']}{of}."
    if begins := request.segments(leader["device"]):
        words += f" A segment of its clock begins at {', '.join(f'{begin:.6f}' for begin in begins)} s."
    tables = ", ".join(info["name"] for info in request.infos if info["kind"] == "table")
    if tables:
        words += f" Left out, because they have several rows at a time: {tables}."
    if not others:
        return words
    ages = ", ".join(f"{held.info['name']} {held.oldest_s:.4g} s" for held in others)
    return f"{words} Any other column holds its last value while that is not older than: {ages}; else it is empty."
