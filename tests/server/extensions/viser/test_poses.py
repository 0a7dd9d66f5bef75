"""Attitude, gravity and track of a device in a 3D scene; accepted meshes."""

import json
import math
import struct
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols import rotations
from imuscope.protocols.clocks.unix_time import nanoseconds
from imuscope.protocols.rotations import euler_columns
from imuscope.recordings.columns.rows import ExactRows
from imuscope.server.extensions.viser import meshes, poses
from imuscope.server.extensions.viser.replay_sync import ReplayFollower
from imuscope.server.wire.codec import SampleFrame
from tests.support.each_row import each_row

Q = rotations.Quaternion


def info(number: int, kind: str, title: str, names: str, unit: str = "", frame: str = "") -> dict[str, Any]:
    """A channel as the wire describes it."""
    columns = [{"name": name, "unit": unit, "dtype": "f4"} for name in names.split()]
    about = {"id": number, "device": "1", "message": "M", "name": title.replace(" ", ""), "title": title, "kind": kind}
    return {**about, "unit": unit, "frame": frame, "columns": columns, "group": ""}


def samples(
    number: int, *rows: Sequence[float], history: bool = False, t0: float = 100.0, dt: float = 1.0
) -> SampleFrame:
    columns = [np.array(column, np.float64) for column in zip(*rows, strict=True)]
    time = t0 + dt * np.arange(len(rows))
    return SampleFrame(number, 0, len(rows), 0, history, 0.0, [time, time, *columns])


def view_of(*infos: dict[str, Any]) -> poses.DeviceView:
    [result] = poses.device_views([{"id": "1", "name": "MTi"}], infos)
    return result


def turned(q: Q, v: Sequence[float]) -> list[float]:
    w, x, y, z = rotations.multiply(rotations.multiply(q, (0.0, v[0], v[1], v[2])), (q[0], -q[1], -q[2], -q[3]))
    assert abs(w) < 1e-9
    return [x, y, z]


def of_euler(*angles: float) -> Q:
    w, x, y, z = rotations.of_euler(np.radians(angles)).tolist()
    return (w, x, y, z)


ANGLE = st.floats(-179, 179)


@given(ANGLE, st.floats(-88, 88), ANGLE)
def test_angles_become_the_quaternion_that_has_these_angles(roll: float, pitch: float, yaw: float) -> None:
    q = of_euler(roll, pitch, yaw)
    results = [float(column[0]) for column in euler_columns([np.array([part]) for part in q])]
    assert results == pytest.approx([roll, pitch, yaw], abs=1e-6)
    assert np.degrees(rotations.euler_of(np.array(q))) == pytest.approx([roll, pitch, yaw], abs=1e-6)


@given(ANGLE, ANGLE, ANGLE)
def test_a_matrix_is_read_row_by_row(roll: float, pitch: float, yaw: float) -> None:
    q = of_euler(roll, pitch, yaw)
    rows = np.column_stack([turned(q, axis) for axis in np.eye(3)])
    result = rotations.quaternion_of(rows)
    assert abs(sum(a * b for a, b in zip(result, q, strict=True))) == pytest.approx(1)


@each_row(
    ("frame", "north_east_up"),
    [("ENU", ([0, 1, 0], [1, 0, 0], [0, 0, 1])), ("NED", ([1, 0, 0], [0, 1, 0], [0, 0, -1]))],
)
def test_every_frame_comes_to_lie_in_one_world(frame: str, north_east_up: tuple[list[int], ...]) -> None:
    in_enu = ([0, 1, 0], [1, 0, 0], [0, 0, 1])
    for own, expected in zip(north_east_up, in_enu, strict=True):
        assert turned(rotations.ENU_FROM[frame], own) == pytest.approx(expected)
    assert turned(rotations.ENU_FROM["NWU"], [0, 1, 0]) == pytest.approx([-1, 0, 0])


@given(st.tuples(*[st.floats(-10, 10)] * 3).filter(lambda v: math.hypot(*v) > 1e-3))
def test_an_arrow_along_x_comes_to_point_there(v: tuple[float, float, float]) -> None:
    assert turned(rotations.from_x(v), [1, 0, 0]) == pytest.approx([part / math.hypot(*v) for part in v], abs=2e-3)


def test_the_newest_row_is_the_pose_and_nonsense_leaves_it() -> None:
    one = view_of(
        info(7, "quaternion", "Quaternion", "w x y z", frame="NED from body"), info(8, "scalar", "T", "value")
    )
    assert one.q_frame_from_body is None
    assert one.frame == "NED"
    one.update(samples(7, [1, 0, 0, 0], [0, 1, 0, 0]))
    assert one.q_frame_from_body == (0, 1, 0, 0)
    one.update(samples(7, [0, 2, 0, 0], [math.nan, 0, 0, 0]))
    assert one.q_frame_from_body == (0, 1, 0, 0)
    one.update(samples(8, [3.0]))


def test_gravity_is_opposite_to_specific_force_at_rest() -> None:
    one = view_of(
        info(1, "euler", "Euler angles", "roll pitch yaw", "°"),
        info(2, "vector", "Acceleration", "x y z", "m/s²"),
        info(3, "vector", "Magnetic field", "x y z", "a.u."),
    )
    assert one.channels == [2, 3, 1]
    one.update(samples(2, [0, 0, 9.80665]))
    one.update(samples(3, [0.4, 0, -0.9]))
    assert one.gravity == pytest.approx((0, 0, -1))
    assert one.field == pytest.approx((0.4, 0, -0.9))


def test_a_device_without_an_attitude_is_in_no_scene() -> None:
    assert poses.device_views([{"id": "1", "name": "MTi"}], [info(1, "vector", "Acceleration", "x y z", "m/s²")]) == []


def test_a_track_has_its_past_before_it_and_ten_points_a_second_at_most() -> None:
    one = view_of(
        info(1, "quaternion", "Quaternion", "w x y z"), info(2, "vector", "Local position", "north east down", "m")
    )
    one.update(samples(2, *[[i, 0, -5] for i in range(100)], t0=100, dt=0.01))
    one.update(samples(2, [-2, 0, -5], [-1, 0, -5], history=True, t0=98, dt=1))
    track = one.track(600)
    assert track[:3].tolist() == [[0, -2, 5], [0, -1, 5], [0, 0, 5]]  # east, north, up
    assert 10 <= len(track) <= 13
    assert one.place == (0, 99, 5)
    assert len(one.track(0.5)) < 8
    one.forget_track()
    assert one.track(600).shape == (0, 3)


def test_positions_become_metres_and_invalid_ones_are_omitted() -> None:
    one = view_of(info(1, "quaternion", "Quaternion", "w x y z"), info(2, "vector", "Position", "lat lon alt", "°"))
    one.update(samples(2, [0, 0, 0], [math.nan, 8, 400], [47.0, 8.0, 400.0], [47.001, 8.0, 410.0]))
    assert one.place is not None
    track = one.track(600)
    assert track[-1].tolist() == pytest.approx([0, 0, 0], abs=0.01)  # the first received is the newest of them
    assert track[0].tolist() == pytest.approx([0, -111.2, -10], abs=0.2)
    assert len(track) == 2


# ── meshes ───────────────────────────────────────────────────────────────────────────────────────────────────────────

TRIANGLE = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0]], "<f4")


def stl(points: np.ndarray[Any, Any] = TRIANGLE) -> bytes:
    triangles = np.zeros(len(points) // 3, meshes._STL)
    triangles["vertices"] = points.reshape(-1, 3, 3)
    return bytes(80) + struct.pack("<I", len(triangles)) + triangles.tobytes()


def glb(**more: Any) -> bytes:
    document = {
        "accessors": [{"min": [0, 0, 0], "max": [4, 1, 1], "count": 3}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        **more,
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIIII4sI", b"glTF", 2, 20 + len(text), len(text), 0, b"", 0)[:16] + b"JSON" + text


def test_an_stl_is_brought_to_one_metre_around_the_origin() -> None:
    for data in (stl(), text_stl()):
        mesh = meshes.read("../part.stl", data)
        assert mesh.name == "..part.stl"
        assert np.ptp(mesh.vertices, axis=0).tolist() == pytest.approx([1, 0.5, 0])
        assert mesh.vertices.min(axis=0).tolist() == pytest.approx([-0.5, -0.25, 0])
        assert mesh.faces.tolist() == [[0, 1, 2]]


def text_stl() -> bytes:
    lines = "".join(f"vertex {x} {y} {z}\n" for x, y, z in TRIANGLE.tolist())
    return f"solid part\nfacet normal 0 0 1\nouter loop\n{lines}endloop\nendfacet\nendsolid part\n".encode()


def test_a_glb_goes_on_as_it_is_with_its_scale() -> None:
    data = glb()
    mesh = meshes.read("drone.glb", data)
    assert mesh.glb == data
    assert mesh.scale == pytest.approx(0.25)


@each_row(
    ("data", "words"),
    [
        (b"", "neither"),
        (b"PK\x03\x04", "neither"),
        (bytes(meshes.MAX_BYTES + 1), "20 MB"),
        (stl(np.zeros((3, 3), "<f4")), "the same"),
        (stl(np.full((3, 3), np.inf, "<f4")), "is not a number"),
        (b"solid nothing\nendsolid", "no complete triangle"),
        (glb() + b"x", "not a complete GLB"),
        (glb()[:-1], "damaged"),
        (glb(extensionsUsed=["KHR_draco_mesh_compression"]), "another host"),
        (glb(buffers=[{"uri": "https://elsewhere.example/a.bin"}]), "another file"),
        (glb(images=[{"uri": "skin.png"}]), "another file"),
        (glb(accessors=[{"count": 10**9}]), "triangles"),
        (glb(accessors=[]), "no bounds"),
        (glb(meshes=[]), "no geometry"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_an_invalid_mesh_is_refused_with_the_reason(data: bytes, words: str) -> None:
    with pytest.raises(meshes.MeshError, match=words):
        meshes.read("x", data)


@given(st.binary(max_size=300), st.sampled_from([b"", b"glTF", b"solid ", b"glTF\2\0\0\0"]))
def test_arbitrary_bytes_are_refused_and_nothing_else(data: bytes, before: bytes) -> None:
    with pytest.raises(meshes.MeshError):
        meshes.read("x", before + data)


# ── recordings ───────────────────────────────────────────────────────────────────────────────────────────────────────


class Store:
    """A recording of one device that turns: row i at i seconds."""

    manifest: ClassVar[dict[str, Any]] = {
        "devices": [{"id": "1", "name": "MTi"}],
        "channels": [
            info(1, "quaternion", "Quaternion", "w x y z"),
            info(2, "vector", "Local position", "north east down", "m"),
        ],
    }

    def span(self) -> tuple[float, float]:
        return 0.0, 9.0

    def row_at(self, channel: int, t: float) -> int:
        return min(int(t), 9)

    def exact(self, channel: int, lo: int, hi: int) -> ExactRows:
        t = np.arange(lo, hi, dtype=np.float64)
        at = nanoseconds(t)
        return ExactRows(at, at, [t] * (4 if channel == 1 else 3))

    def thinned(self, channel: int, t0: float, t1: float, most: int) -> ExactRows:
        return self.exact(channel, max(0, int(t0)), int(t1) + 1)


def test_the_playhead_advances_between_two_messages_of_the_page() -> None:
    clock = [0.0]
    replayed = ReplayFollower(Store(), lambda: clock[0])  # type: ignore[arg-type] # as much of a store as is read
    replayed.move(2.0, 2.0)
    first = replayed.changes()
    assert first is not None
    assert first["rows"]["1"][0] == [2.0]
    assert first["past"]["2"][0] == [0.0, 1.0, 2.0]
    assert replayed.changes() is None
    clock[0] = 0.5
    second = replayed.changes()
    assert second is not None
    assert (second["rows"]["1"][0], "past" in second) == ([3.0], False)
    replayed.move(1.0, 0.0)
    back = replayed.changes()
    assert back is not None
    assert back["past"]["2"][0] == [0.0, 1.0]
    clock[0] = 5.0
    assert replayed.changes() is None
    replayed.move(100.0, 1.0)
    assert replayed.head == 9.0
