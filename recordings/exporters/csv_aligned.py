"""CSV in one file, for a spreadsheet: a line for each sample of the fastest channel; the others hold their last value.

    # A line for each sample of Acceleration. Any other column holds its last value while that is not older than …
    time (s),arrival (s),timestamp,utc (s),Acceleration.x (m/s²),…,GnssPvtData.lat (°),…

The rule, which the first line of the file states: the fastest channel is the one with the most samples in the stretch.
Another channel's cell is its last value at that time, if it is not older than twice its usual interval (or twice the
fastest's, where that is longer); else it is empty. So a value is repeated until the next one comes, a pause is seen,
and nothing is interpolated. Tables (satellites) have no place in it and are left out. What the device's own clock said
of the line's sample, and its UTC where it knows that, stand behind the two times; those of the others are not held.

A line that begins with # is skipped by pandas with `comment="#"`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from recordings.exporters.csv_tables import heading, lines
from recordings.exporters.message_table import WINDOW, cells, clocks_of, known, of_their_moment, spoken
from recordings.exporters.message_table import heading as named
from recordings.exporters.request import ExportError, ExportRequest, ExportStep, usual_interval, with_unit

AGES = 2  # usual intervals that a value is held for


@dataclass(slots=True)
class _Held:
    """A channel whose last value is shown."""

    info: Mapping[str, Any]
    names: list[str]
    oldest_s: float


def write(wish: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """One file."""
    infos = [info for info in (*wish.infos, *wish.payloads) if info["kind"] != "rows"]
    sizes = {info["id"]: wish.rows(info["id"]) for info in infos}
    infos = [info for info in infos if sizes[info["id"]][1] > sizes[info["id"]][0]]
    if not infos:
        raise ExportError("There is nothing in this stretch that has one value at a time.", "Choose other channels.")
    leader = max(infos, key=lambda info: sizes[info["id"]][1] - sizes[info["id"]][0])
    least = usual_interval(wish.columns, leader["id"])
    clocks = clocks_of(wish, leader)
    others = [
        _Held(info, _names(wish, info, clocks), AGES * max(usual_interval(wish.columns, info["id"]), least))
        for info in infos
        if info is not leader
    ]
    first, last = sizes[leader["id"]]
    with out.open("wb") as file:
        file.write(f"# {_rule(wish, leader, others)}\n".encode())
        chosen = [*clocks, leader, *(held.info for held in others)]
        told = [(column["unit"], spoken(info["frame"])) for info in chosen for column in info["columns"]]
        names = [name for info in (*clocks, leader) for name in _names(wish, info, clocks)]
        names += [name for held in others for name in held.names]
        heads = [with_unit(name, *one) for name, one in zip(names, told, strict=True)]
        heading(file, ["time (s)", "arrival (s)", *heads])
        for lo in range(first, last, WINDOW):
            hi = min(lo + WINDOW, last)
            lines(file, _batch(wish, leader, clocks, others, lo, hi))
            step((hi - first) / (last - first))
    return [out]


def _batch(
    wish: ExportRequest,
    leader: Mapping[str, Any],
    clocks: list[Mapping[str, Any]],
    others: list[_Held],
    lo: int,
    hi: int,
) -> pa.RecordBatch:
    columns = wish.columns
    rows = wish.exact(leader, lo, hi)
    times = columns.clock(leader["id"], lo, hi)
    arrays = [pa.array(rows.time, mask=np.isnan(rows.time)), pa.array(rows.arrival)]
    arrays += [known(values) for info in clocks for values in of_their_moment(columns, info, rows)]
    arrays += map(cells, rows.columns)
    for held in others:
        number = held.info["id"]
        first = max(columns.between(number, float(times[0]), np.inf)[0] - 1, 0)
        past = columns.between(number, float(times[0]), float(times[-1]))[1]
        theirs = columns.clock(number, first, past)
        at = np.searchsorted(theirs, times, "right") - 1
        age = times - theirs[np.maximum(at, 0)] if len(theirs) else np.full(len(times), np.inf)
        missing = (at < 0) | (age > held.oldest_s)
        found = wish.exact(held.info, first, past)
        for column in found.columns:
            values = column[np.maximum(at, 0)] if len(column) else np.zeros(len(at), column.dtype)
            arrays.append(cells(values, missing))
    return pa.RecordBatch.from_arrays(arrays, names=[str(n) for n in range(len(arrays))])


def _names(wish: ExportRequest, info: Mapping[str, Any], clocks: list[Mapping[str, Any]]) -> list[str]:
    """Headings that are unique among all: with the device where there are several, the message where it does not say
    so itself, the number where a quantity's layout changed."""
    own = [named(info, column) for column in info["columns"]]
    rest = [
        one for one in (*wish.infos, *wish.payloads, *clocks) if one is not info and one["device"] == info["device"]
    ]
    taken = {named(one, column) for one in rest for column in one["columns"]}
    if taken & set(own):
        alike = {f"{one['message']}.{named(one, column)}" for one in rest for column in one["columns"]}
        own = [name if name.startswith(f"{info['message']}.") else f"{info['message']}.{name}" for name in own]
        if alike & set(own):
            own = [f"{name} #{info['id']}" for name in own]
    return [f"{wish.device_name(info['device'])}.{name}" for name in own] if wish.has_several_devices else own


def _rule(wish: ExportRequest, leader: Mapping[str, Any], others: list[_Held]) -> str:
    of = f" of {wish.device_name(leader['device'])}" if wish.has_several_devices else ""
    words = f"A line for each sample of {leader['title'] or leader['name']}{of}."
    if not others:
        return words
    ages = ", ".join(f"{held.info['name']} {held.oldest_s:.4g} s" for held in others)
    return f"{words} Any other column holds its last value while that is not older than: {ages}; else it is empty."
