"""Validation of mesh files for the scene: GLB and STL, treated as untrusted input.

    GLB   "glTF" │ u32 version 2 │ u32 length │ chunk: u32 size │ "JSON" │ … │ chunk: u32 size │ "BIN\0" │ …
    STL   80 bytes │ u32 triangles │ triangles × (normal, 3 vertices: 12 f32, u16)          or text, "solid …"

A GLB is sent to the browser unchanged, so it must not refer to anything outside itself: no address of a buffer or an
image, and no compression whose decoder the viewer would fetch from another host. Both formats are scaled to one metre,
whatever their unit.

Source: glTF 2.0 (Khronos), section 4.4; StereoLithography Interface Specification, 3D Systems, October 1989.
"""

import json
import re
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_BYTES = 20 * 1024 * 1024
MAX_TRIANGLES = 300_000
# Their decoders are not part of the viewer, which would fetch them from another host.
FETCHED = {"KHR_draco_mesh_compression", "KHR_texture_basisu", "EXT_meshopt_compression"}
_STL = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"vertex\s+([-+.\deE]+)\s+([-+.\deE]+)\s+([-+.\deE]+)")


class MeshError(ValueError):
    """The reason why a file cannot be used as a body, in one sentence."""


@dataclass(frozen=True, slots=True)
class Mesh:
    """A body.

    Args:
        name: name of the file, for display.
        scale: factor that makes it one metre long.
        glb: the file itself; empty for an STL.
        vertices: (n, 3) float32 around the origin; faces: (m, 3) uint32.
    """

    name: str
    scale: float
    glb: bytes
    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]


def read(name: str, data: bytes) -> Mesh:
    """The mesh in a file.

    Raises:
        MeshError: too large, neither GLB nor STL, damaged, or with external references.
    """
    if len(data) > MAX_BYTES:
        raise MeshError(f"A mesh may have at most {MAX_BYTES >> 20} MB.")
    name = re.sub(r"[^\w .()-]", "", name)[:60] or "mesh"
    if data[:4] == b"glTF":
        return _glb(name, data)
    if len(data) >= 84 and len(data) == 84 + 50 * struct.unpack_from("<I", data, 80)[0]:
        return _stl(name, np.frombuffer(data, _STL, offset=84)["vertices"].reshape(-1, 3))
    if data[:512].lstrip()[:5].lower() == b"solid":
        try:
            points = [[float(part) for part in vertex] for vertex in _VERTEX.findall(data)]
        except ValueError:
            raise MeshError("This STL contains a vertex that is not a number.") from None
        with np.errstate(over="ignore"):  # values too large for a float32 become inf, which is reported
            vertices = np.array(points, np.float32)
        return _stl(name, vertices)
    raise MeshError("This is neither a GLB nor an STL file.")


def _stl(name: str, points: NDArray[np.float32]) -> Mesh:
    if len(points) < 3 or len(points) % 3:
        raise MeshError("This STL contains no complete triangle.")
    if len(points) > 3 * MAX_TRIANGLES:
        raise MeshError(f"A mesh may have at most {MAX_TRIANGLES} triangles.")
    if not np.isfinite(points).all():
        raise MeshError("This STL contains a vertex that is not a number.")
    wide = points.astype(np.float64)  # a sum of large float32 values would overflow
    low, high = wide.min(axis=0), wide.max(axis=0)
    size = float((high - low).max())
    if not size > 0:
        raise MeshError("All points of this STL are the same.")
    vertices = np.asarray((wide - (low + high) / 2) / size, np.float32)
    return Mesh(name, 1.0, b"", vertices, np.arange(len(points), dtype=np.uint32).reshape(-1, 3))


def _glb(name: str, data: bytes) -> Mesh:
    try:
        version, length, size, sort = struct.unpack_from("<III4s", data, 4)
        document = json.loads(data[20 : 20 + size])
    except (struct.error, ValueError, RecursionError):
        raise MeshError("This GLB is damaged.") from None
    if version != 2 or length != len(data) or sort != b"JSON" or not isinstance(document, dict):
        raise MeshError("This is not a complete GLB of version 2.")
    if FETCHED & set(map(str, _list(document, "extensionsUsed"))):
        raise MeshError("This GLB is compressed in a way that needs a decoder from another host. Export it plain.")
    for one in _list(document, "buffers") + _list(document, "images"):
        if isinstance(one, dict) and "uri" in one and not str(one["uri"]).startswith("data:"):
            raise MeshError("This GLB refers to another file. Export it with all data included.")
    accessors = [one for one in _list(document, "accessors") if isinstance(one, dict)]
    if sum(one["count"] for one in accessors if isinstance(one.get("count"), int)) > 12 * MAX_TRIANGLES:
        raise MeshError(f"A mesh may have at most {MAX_TRIANGLES} triangles.")
    empty = np.zeros((0, 3))
    return Mesh(name, 1 / _extent(document), data, empty.astype(np.float32), empty.astype(np.uint32))


def _extent(document: dict[str, Any]) -> float:
    """Largest side of the largest primitive, from the mandatory bounds of the position accessors."""
    sizes = []
    try:
        for mesh in _list(document, "meshes"):
            for primitive in mesh["primitives"]:
                accessor = document["accessors"][primitive["attributes"]["POSITION"]]
                sizes.append(max(float(b) - float(a) for a, b in zip(accessor["min"], accessor["max"], strict=True)))
    except (KeyError, IndexError, TypeError, ValueError):
        raise MeshError("This GLB has no bounds.") from None
    size = max(sizes, default=0.0)
    if not 1e-9 < size < 1e9:
        raise MeshError("This GLB contains no geometry.")
    return size


def _list(document: dict[str, Any], name: str) -> list[Any]:
    entries = document.get(name, [])
    return entries if isinstance(entries, list) else []
