"""Static entities of a scene: body, axes, frames, names and colours of curves. Sent first.

The body is a flat box with a nose, so that front, top and side are distinguishable from every direction: x forward, y
to the left, z up for a device in ENU or NWU; the same mesh serves NED, whose z points down, because the axes show the
directions.

Colours are those of the page (web/src/ui/tokens.css, light theme): x, y and z are distinct for the colour-blind.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.recordings.exporters.entities import WORLD, Attitude, Curve, DeviceEntity
from imuscope.server.extensions.rerun.rrd.chunks import name_of

AXES = {"x": (208, 60, 40), "y": (20, 132, 92), "z": (40, 98, 214), "w": (120, 92, 168), "": (96, 112, 128)}
OTHERS = ((40, 98, 214), (208, 60, 40), (20, 132, 92), (176, 112, 0), (120, 92, 168), (0, 130, 150))
LENGTH, WIDTH, HEIGHT, NOSE = 0.62, 0.4, 0.14, 0.3
BODY, TOP, FRONT = (214, 218, 224), (150, 162, 178), (238, 140, 40)
TRACK_POINTS = 20_000

TURNS = {  # quaternions x, y, z, w: the world (ENU) from the frame
    "ENU": (0.0, 0.0, 0.0, 1.0),
    "NED": (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0),
    "NWU": (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)),
}


def body() -> rr.Mesh3D:
    """The mesh: a box from −LENGTH to LENGTH with a wedge in front, every face with vertices of its own."""
    x, y, z, n = LENGTH, WIDTH, HEIGHT, LENGTH + NOSE
    quads = [
        ([(-x, -y, z), (x, -y, z), (x, y, z), (-x, y, z)], TOP),
        ([(-x, y, -z), (x, y, -z), (x, -y, -z), (-x, -y, -z)], BODY),
        ([(-x, -y, -z), (x, -y, -z), (x, -y, z), (-x, -y, z)], BODY),
        ([(x, y, -z), (-x, y, -z), (-x, y, z), (x, y, z)], BODY),
        ([(-x, y, -z), (-x, -y, -z), (-x, -y, z), (-x, y, z)], BODY),
        ([(x, -y, z), (n, 0, z), (n, 0, z), (x, y, z)], FRONT),
        ([(x, y, -z), (n, 0, -z), (n, 0, -z), (x, -y, -z)], FRONT),
        ([(x, -y, -z), (n, 0, -z), (n, 0, z), (x, -y, z)], FRONT),
        ([(n, 0, -z), (x, y, -z), (x, y, z), (n, 0, z)], FRONT),
    ]
    corners = np.array([corner for quad, _ in quads for corner in quad], np.float32)
    halves = np.array([(0, 1, 2), (0, 2, 3)])
    triangles = (4 * np.arange(len(quads))[:, None, None] + halves).reshape(-1, 3)
    quad = corners.reshape(-1, 4, 3)
    normals = np.cross(quad[:, 1] - quad[:, 0], quad[:, 3] - quad[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    colors = np.repeat(np.array([color for _, color in quads], np.uint8), 4, axis=0)
    return rr.Mesh3D(
        vertex_positions=corners,
        triangle_indices=triangles,
        vertex_normals=np.repeat(normals, 4, axis=0),
        vertex_colors=colors,
    )


def arrows(length: float, labels: Sequence[str], *, faint: bool = False) -> rr.Arrows3D:
    """Three axes with their names."""
    colors = [(*AXES[axis], 110 if faint else 255) for axis in "xyz"]
    radius = 0.012 if faint else 0.03
    vectors = np.eye(3) * length
    return rr.Arrows3D(vectors=vectors, colors=colors, labels=list(labels), radii=[radius] * 3, show_labels=True)


def send_scene(stream: rr.RecordingStream, devices: Sequence[DeviceEntity]) -> None:
    """Send the world, and the body and track of each device."""
    stream.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for device in devices:
        if device.attitude is not None:
            _send_body(stream, device.attitude)
        if device.position is not None:
            send_here(stream, device)


def _send_body(stream: rr.RecordingStream, attitude: Attitude) -> None:
    frame = attitude.path[:-1]
    turn = rr.Quaternion(xyzw=TURNS[attitude.frame])
    stream.log(name_of(frame), rr.Transform3D(quaternion=turn), static=True)
    letters = {"N": "north", "E": "east", "D": "down", "W": "west", "U": "up"}
    reference = arrows(1.6, [letters[letter] for letter in attitude.frame], faint=True)
    stream.log(name_of((*frame, "reference")), reference, static=True)
    stream.log(name_of((*attitude.path, "shape")), body(), static=True)
    stream.log(name_of((*attitude.path, "axes")), arrows(1.25, "xyz"), static=True)


def send_style(stream: rr.RecordingStream, curve: Curve, columns: Sequence[Mapping[str, Any]], frame: str) -> None:
    """Send name and colour of each component of an entity, and the frame of its values, if any."""
    names = [str(columns[i]["label"] or columns[i]["name"]) for i in curve.columns]
    names = [curve.path[-1] if name == "value" else name for name in names]
    colors = [
        AXES[columns[i]["axis"]] if columns[i]["axis"] else OTHERS[i % len(OTHERS)]
        for i in curve.columns  # by its place in the message: those with units of their own share a plot nevertheless
    ]
    stream.log(name_of(curve.path), rr.SeriesLines(names=names, colors=colors, widths=1.2), static=True)
    frame = frame or ("body" if any(columns[i]["axis"] in ("x", "y", "z") for i in curve.columns) else "")
    if frame:
        stream.log(name_of(curve.path), rr.AnyValues(frame=frame), static=True)


def send_track(stream: rr.RecordingStream, device: DeviceEntity, enu: Floats, latlon: Floats) -> None:
    """Send the track in metres and on the map, thinned to `TRACK_POINTS`, with gaps for missing positions.

    Args:
        enu: (n, 3) m; latlon: (n, 2) °; NaN for missing positions.
    """
    good: NDArray[np.bool_] = np.asarray(np.isfinite(enu).all(axis=1))
    if not good.any():
        return
    ends = np.flatnonzero(np.diff(good.astype(np.int8))) + 1
    step = max(1, int(good.sum()) // TRACK_POINTS)
    pieces = [rows for rows in np.split(np.arange(len(enu)), ends) if good[rows[0]]]
    parts = [np.append(rows[::step], rows[-1]) for rows in pieces]
    color, radii = [_color(device)], rr.Radius.ui_points(1.5)
    lines = rr.LineStrips3D([enu[rows].astype(np.float32) for rows in parts], colors=color, radii=radii)
    stream.log(name_of((WORLD, "track", device.name)), lines, static=True)
    assert device.position is not None
    if device.position.on_map:
        ways = rr.GeoLineStrings(lat_lon=[latlon[rows] for rows in parts], colors=color, radii=radii)
        stream.log(name_of((*device.position.on_map, "track")), ways, static=True)


def send_here(stream: rr.RecordingStream, device: DeviceEntity) -> None:
    """Send a point at the current position."""
    here = rr.Points3D([(0, 0, 0)], colors=[_color(device)], radii=rr.Radius.ui_points(6), labels=[device.title])
    stream.log(name_of((WORLD, device.name, "here")), here, static=True)
    if device.position is not None and device.position.on_map:
        point = rr.GeoPoints.from_fields(colors=[_color(device)], radii=rr.Radius.ui_points(6))
        stream.log(name_of(device.position.on_map), point, static=True)


def _color(device: DeviceEntity) -> tuple[int, int, int]:
    """A colour that is the same in every run."""
    return OTHERS[sum(device.id.encode()) % len(OTHERS)]
