"""Directions around a sensor in cells of equal area: which were seen, which are missing.

The half around +z and the half around −z have the same three rings, like a dartboard:

    ring 0    3 cells, 0° to 29° from the axis      ring 1    9 cells, to 60°      ring 2    12 cells, to 90°

Each cell is about 30° wide and has 1/48 of the sphere. In an equal-area projection of a half the rings end at the
square root of 1/8, 1/2 and 1 of its radius.
"""

from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats

CELLS_PER_RING = (3, 9, 12)
HALF = sum(CELLS_PER_RING)
CELLS = 2 * HALF
_ENDS = tuple(accumulate(CELLS_PER_RING))
AXES = ("+x", "−x", "+y", "−y", "+z", "−z")
AXIS_VECTORS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64)
NEAR_DEG = 50.0
SEEN_NEAR = 0.4  # of the cells near an axis


def unit_vectors(values: Floats) -> Floats:
    """Directions of vectors, (n, 3)."""
    vectors: Floats = values / np.maximum(np.linalg.norm(values, axis=-1, keepdims=True), 1e-300)
    return vectors


def cells_of(directions: Floats) -> NDArray[np.int64]:
    """Cell of each direction, (n,)."""
    x, y, z = directions.T
    share = np.clip(1 - np.abs(z), 0, 1 - 1e-12)  # of the area of a half, from its axis
    edges = np.array(_ENDS[:-1]) / HALF
    ring = np.searchsorted(edges, share, "right")
    counts = np.array(CELLS_PER_RING)[ring]
    begins = np.array((0, *_ENDS[:-1]))[ring]
    sector = np.floor(np.remainder(np.arctan2(y, x), 2 * np.pi) / (2 * np.pi) * counts).astype(np.int64)
    cells: NDArray[np.int64] = np.where(z >= 0, 0, HALF) + begins + np.minimum(sector, counts - 1)
    return cells


def cell_centres() -> Floats:
    """Centre of each cell, (CELLS, 3)."""
    centres = []
    begin = 0
    for count in CELLS_PER_RING:
        share = (begin + count / 2) / HALF
        angles = (np.arange(count) + 0.5) * 2 * np.pi / count
        flat = np.sqrt(1 - (1 - share) ** 2)
        centres.append(np.stack([flat * np.cos(angles), flat * np.sin(angles), np.full(count, 1 - share)], axis=1))
        begin += count
    half = np.concatenate(centres)
    return np.concatenate((half, half * [1, 1, -1]))


CENTRES = cell_centres()


def missing_axes(is_covered: NDArray[np.bool_]) -> list[str]:
    """Axes that too few of the cells near them were seen of."""
    near = np.cos(np.radians(NEAR_DEG)) <= AXIS_VECTORS @ CENTRES.T
    shares = (near & is_covered).sum(axis=1) / near.sum(axis=1)
    return [axis for axis, share in zip(AXES, shares.tolist(), strict=True) if share < SEEN_NEAR]
