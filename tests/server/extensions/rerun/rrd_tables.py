"""Tables of an .rrd file, as Rerun's own reader gives them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import RrdReader


def entities(path: Path) -> dict[str, list[pa.RecordBatch]]:
    """Entity → its chunks, as the reader of the SDK gives them."""
    results: dict[str, list[pa.RecordBatch]] = {}
    for chunk in RrdReader(path).stream():
        results.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
    return results


def column(batches: list[pa.RecordBatch], name: str) -> list[Any]:
    """One column of an entity, of the chunks that have it."""
    return [batch.column(name) for batch in batches if name in batch.schema.names]


def numbers(batches: list[pa.RecordBatch], name: str) -> np.ndarray[Any, Any]:
    """A component that has as many numbers in every row: (n, k) float64."""
    parts = []
    for lists in column(batches, name):
        flat = lists.values
        while not pa.types.is_primitive(flat.type):
            flat = flat.values
        parts.append(np.asarray(flat, np.float64).reshape(len(lists), -1))
    return np.concatenate(parts)


def flat(batches: list[pa.RecordBatch]) -> np.ndarray[Any, Any]:
    """A table's column: as many values a row as there were rows at that time."""
    return np.concatenate([np.asarray(lists.values, np.float64) for lists in column(batches, "Scalars:scalars")])[
        :, None
    ]
