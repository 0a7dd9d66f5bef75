"""Results of analyses as JSON and as an Arrow table."""

import io
import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np

from imuscope.server.extensions.analysis.noise.registry import Analysis
from imuscope.server.extensions.analysis.signals.signals import Signal, require_samples

Figures = dict[str, Any]
T = TypeVar("T")
R = TypeVar("R")


def figures_of(analysis: Analysis, signal: Signal, settings: Mapping[str, float]) -> tuple[Figures, dict[str, str]]:
    """Figures of a signal for JSON, where a figure that is not finite is None, and the units of those that have one.

    Raises:
        DomainError: "not-found": the signal has no samples in the range.
    """
    require_samples(signal)
    with np.errstate(over="ignore", invalid="ignore"):
        result = analysis.run(signal, settings)
    figures = {name: _plain(value) for name, value in result.items()}
    if signal.notes:
        figures["notes"] = [*signal.notes, *figures.get("notes", [])]
    units = analysis.units_for(signal, settings).items()
    return figures, {name: unit for name, unit in units if name.partition(".")[0] in result}


def in_parallel(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """Results of work for each item, in order; numpy's and scipy's loops run on several cores."""
    if len(items) < 2:
        return [work(item) for item in items]
    with ThreadPoolExecutor(min(len(items), os.cpu_count() or 1)) as pool:
        return list(pool.map(work, items))


def _plain(value: Any) -> Any:
    """A figure as JSON has it: numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, list):
        if value and isinstance(value[0], float) and np.isfinite(value).all():
            return value
        return [_plain(one) for one in value]
    if isinstance(value, str) or value is None:
        return value
    return value if math.isfinite(value) else None


def arrow_of(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """An Arrow IPC stream: one row per signal; units are in the metadata of the fields, by signal if they differ."""
    import pyarrow as pa

    flat = [{"signal": row["signal"], "device": row["device"], **row["figures"]} for row in rows]
    table = pa.Table.from_pylist(flat)
    fields = []
    for field in table.schema:
        units = {row["signal"]: row["units"][field.name] for row in rows if field.name in row["units"]}
        alike = set(units.values())
        words = {"unit": alike.pop()} if len(alike) == 1 else {f"unit of {name}": unit for name, unit in units.items()}
        fields.append(field.with_metadata(words) if words else field)
    sink = io.BytesIO()
    with pa.ipc.new_stream(sink, pa.schema(fields)) as writer:
        writer.write_table(table.cast(pa.schema(fields)))
    return sink.getvalue()
