"""Channels: splitting of batches, names of columns, and merging of layouts in stream order."""

from typing import Any

import numpy as np
import pytest

from imuscope.protocols.events import Batch
from imuscope.protocols.isb.decoder import IsbDecoder
from imuscope.protocols.schema.fields import Bits, Field, Message
from imuscope.server.streaming import channels
from imuscope.server.streaming.channels import ChannelRegistry, factors_of
from imuscope.server.wire import ChannelInfo
from tests.protocols.isb.isb_vectors import by_did
from tests.support.each_row import each_row

SATELLITE = (Field("svId", "u1"), Field("cno", "u1", unit="dBHz"))


def batch(message: Message, columns: dict[str, Any], offsets: list[int], *, timed: bool = True) -> Batch:
    n = len(offsets)
    at = np.array(offsets, np.int64)
    return Batch(message, "", at * 1_000_000_000, at, at * 1000 if timed else None, columns if n else {})


class FakePage:
    """Advertised channels."""

    def __init__(self) -> None:
        self.infos: list[ChannelInfo] = []

    def __call__(self, info: ChannelInfo) -> int:
        self.infos.append(info)
        return len(self.infos)

    def __getitem__(self, name: str) -> ChannelInfo:
        return [info for info in self.infos if info.name == name][-1]


def split(page: FakePage, *batches: Batch, channels: ChannelRegistry | None = None) -> dict[str, list[np.ndarray]]:
    channels = channels or ChannelRegistry("1", page)
    pieces = channels.split([(one, one.offset * 1.0, one.offset * 10**9) for one in batches])
    return {page.infos[piece.channel - 1].name: piece.columns for piece in pieces}


def one(field: Field, array: Any, **message: Any) -> tuple[ChannelInfo, list[np.ndarray]]:
    page = FakePage()
    row = Message(1, "MTData2", (field,), channel_per_field=True, **message)
    array = np.asarray(array)
    columns = split(page, batch(row, {field.name: array}, list(range(len(array)))))
    return page[field.name], columns[field.name]


def test_a_vector_has_a_column_and_a_colour_per_axis() -> None:
    field = Field("Acceleration", ">f4", (3,), unit="m/s²", axes=("x", "y", "z"), decimals=3, frame="")
    info, columns = one(field, np.arange(6, dtype="f4").reshape(2, 3))
    assert (info.kind, info.unit, info.message) == ("vector", "m/s²", "MTData2")
    assert [(c.name, c.axis, c.dtype, c.decimals) for c in info.columns] == [
        ("x", "x", "f4", 3),
        ("y", "y", "f4", 3),
        ("z", "z", "f4", 3),
    ]
    assert [column.tolist() for column in columns[2:]] == [[0, 3], [1, 4], [2, 5]]


@each_row(
    ("field", "shape", "dtype", "kind", "names", "axes"),
    [
        (Field("Quaternion", axes=("q0", "q1", "q2", "q3")), (4,), "f8", "quaternion", "q0 q1 q2 q3", "wxyz"),
        (Field("DeltaQ", axes=("q0", "q1", "q2", "q3")), (4,), "f8", "vector", "q0 q1 q2 q3", "wxyz"),
        (Field("EulerAngles", axes=("roll", "pitch", "yaw")), (3,), "f4", "euler", "roll pitch yaw", "xyz"),
        (Field("VelocityXYZ", axes=("N", "E", "D")), (3,), "f4", "vector", "N E D", "xyz"),
        (Field("RotationMatrix"), (3, 3), "f8", "matrix", "m11 m12 m13 m21 m22 m23 m31 m32 m33", None),
        (Field("LatLon", axes=("latitude", "longitude")), (2,), "f8", "vector", "latitude longitude", None),
        (Field("PacketCounter"), (), "u2", "counter", "value", None),
        (Field("SampleTimeFine"), (), "u4", "counter", "value", None),
        (Field("BaroPressure"), (), "u4", "scalar", "value", None),
        (Field("StatusByte", bits=(Bits("FilterValid", 1),)), (), "u1", "status", "value", None),
    ],
)
def test_kinds_and_names(
    field: Field, shape: tuple[int, ...], dtype: str, kind: str, names: str, axes: str | None
) -> None:
    info, columns = one(field, np.zeros((2, *shape), dtype))
    assert info.kind == kind
    assert [column.name for column in info.columns] == names.split()
    if axes is not None:
        assert "".join(column.axis for column in info.columns) == axes
    assert len(columns) == 2 + len(info.columns)
    assert {column.dtype for column in info.columns} == {dtype}


def test_a_matrix_is_row_by_row() -> None:
    _, columns = one(Field("RotationMatrix"), np.arange(9.0).reshape(1, 3, 3))
    assert [column[0] for column in columns[2:]] == list(range(9))


def test_flags_and_choices_travel_as_words() -> None:
    bits = (Bits("ClipAccX", 8, severity="warning", doc="Out of range."), Bits("Mode", 23, 3, choices={1: "hold"}))
    info, _ = one(Field("StatusWord", bits=bits, title="Status"), np.zeros(1, "u4"))
    (column,) = info.columns
    assert column.label == "Status"
    assert [(bit.name, bit.low, bit.width, bit.severity, bit.choices) for bit in column.bits] == [
        ("ClipAccX", 8, 1, "warning", {}),
        ("Mode", 23, 3, "", {"1": "hold"}),
    ]


def test_a_record_is_one_channel() -> None:
    dtype = np.dtype([("itow", "u4"), ("dop", "f4", (2,)), ("accX", "u2")])
    fields = (Field("itow", "u4", unit="ms"), Field("dop", "f4", (2,), axes=("h", "v")), Field("accX", "u2"))
    info, columns = one(Field("GnssPvtData", fields=fields), np.array([(1, (2, 3), 4), (5, (6, 7), 8)], dtype))
    assert info.kind == "record"
    assert [(c.name, c.unit, c.axis, c.dtype) for c in info.columns] == [
        ("itow", "ms", "", "u4"),
        ("dop_h", "", "", "f4"),
        ("dop_v", "", "", "f4"),
        ("accX", "", "x", "u2"),
    ]
    assert [column.tolist() for column in columns[2:]] == [[1, 5], [2, 6], [3, 7], [4, 8]]


def test_satellites_are_rows_of_one_time() -> None:
    dtype = np.dtype([("itow", "u4"), ("satellites", [("svId", "u1"), ("cno", "u1")], (3,))])
    array = np.zeros(2, dtype)
    array["itow"] = [100, 200]
    array["satellites"]["svId"] = [[1, 2, 3], [4, 5, 6]]
    fields = (Field("itow", "u4"), Field("satellites", shape=(-1,), fields=SATELLITE))
    info, columns = one(Field("GnssSatInfo", fields=fields), array)
    assert info.kind == "table"
    assert [(c.name, c.unit) for c in info.columns] == [("itow", ""), ("svId", ""), ("cno", "dBHz")]
    assert columns[0].tolist() == [0, 0, 0, 1, 1, 1]
    assert columns[2].tolist() == [100, 100, 100, 200, 200, 200]
    assert columns[3].tolist() == [1, 2, 3, 4, 5, 6]


def test_bytes_are_no_channel() -> None:
    """They are shown as bytes: tests/server/streaming/test_unknown_payloads.py."""
    page = FakePage()
    row = Message(1, "M", (Field("0x4FF0", "bytes", (3,)),), channel_per_field=True)
    assert split(page, batch(row, {"0x4FF0": np.zeros((2, 3), "u1")}, [0, 10])) == {}
    assert page.infos == []


def test_text_is_not_a_channel() -> None:
    page = FakePage()
    row = Message(1, "M", (Field("words"),), channel_per_field=True)
    array = np.array(["a"], object)
    assert split(page, batch(row, {"words": array}, [0])) == {}
    assert page.infos == []


def test_layouts_of_one_drain_are_merged_in_stream_order() -> None:
    """A device with acceleration at every frame and pressure at some sends two layouts, which come as two batches."""
    page = FakePage()
    acc, pressure = Field("Acceleration", "f4", (3,), axes=("x", "y", "z")), Field("BaroPressure", "u4")
    both = Message(1, "MTData2", (acc, pressure), channel_per_field=True)
    some = Message(1, "MTData2", (acc,), channel_per_field=True)
    offsets = {"both": [0, 30, 60], "some": [10, 20, 40, 50]}
    values = {name: np.array(at, "f4")[:, None].repeat(3, 1) for name, at in offsets.items()}
    results = split(
        page,
        batch(both, {"Acceleration": values["both"], "BaroPressure": np.array([1, 2, 3], "u4")}, offsets["both"]),
        batch(some, {"Acceleration": values["some"]}, offsets["some"]),
    )
    assert len(page.infos) == 2
    for column in results["Acceleration"]:
        assert column.tolist() == [0, 10, 20, 30, 40, 50, 60]
    assert results["BaroPressure"][2].tolist() == [1, 2, 3]


def test_a_channel_keeps_its_id_and_a_changed_one_gets_a_new_one() -> None:
    page = FakePage()
    channels = ChannelRegistry("1", page)
    for _ in range(3):  # new Message objects of the same layout, as after a reconnection
        row = Message(1, "MTData2", (Field("Velocity", "f4", (3,), frame="ENU"),), channel_per_field=True)
        split(page, batch(row, {"Velocity": np.zeros((1, 3), "f4")}, [0]), channels=channels)
    assert len(page.infos) == 1
    row = Message(1, "MTData2", (Field("Velocity", "f8", (3,), frame="NED"),), channel_per_field=True)
    split(page, batch(row, {"Velocity": np.zeros((1, 3), "f8")}, [0]), channels=channels)
    assert [info.frame for info in page.infos] == ["ENU", "NED"]


def test_the_second_of_duplicate_items_counts() -> None:
    row = Message(1, "MTData2", (Field("T", "f4", unit="a"), Field("T", "f4", unit="b")), channel_per_field=True)
    page = FakePage()
    split(page, batch(row, {"T": np.zeros(1, "f4")}, [0]))
    assert [info.unit for info in page.infos] == ["b"]


def test_any_other_message_is_one_channel() -> None:
    page = FakePage()
    row = Message(1, "INS", (Field("theta", "f4", (3,)), Field("week", "u4"), Field("week2", "u4")), title="Inertial")
    columns = {"theta": np.zeros((2, 3), "f4"), "week": np.zeros(2, "u4"), "week2": np.zeros(2, "u4")}
    result = split(page, batch(row, columns, [0, 1], timed=False))
    (info,) = page.infos
    assert (info.name, info.title, info.kind) == ("INS", "Inertial", "record")
    assert [column.name for column in info.columns] == ["theta_0", "theta_1", "theta_2", "week", "week2"]
    assert len(result["INS"]) == 7


def test_displayed_units_are_degrees_and_metres() -> None:
    """Units in SHOWN are converted in unit, dtype and digits; values stay as sent until they are read."""
    turn = Field("RateOfTurn", ">f4", (3,), unit="rad/s", axes=("x", "y", "z"), decimals=4)
    info, columns = one(turn, np.array([[0.0, np.pi, -np.pi / 2]], "f4"))
    assert info.unit == "°/s"
    assert [(c.unit, c.dtype, c.decimals) for c in info.columns] == [("°/s", "f4", 2)] * 3
    assert [column.sent_unit for column in info.columns] == ["rad/s"] * 3
    assert [float(column[0]) * by for column, by in zip(columns[2:], factors_of(info), strict=True)] == pytest.approx(
        [0.0, 180.0, -90.0]
    )

    fix = Field("GnssPvtData", fields=(Field("numSV", "u1"), Field("height", ">i4", unit="mm")))
    info, columns = one(fix, np.array([(7, -1234)], [("numSV", "u1"), ("height", "i4")]))
    assert [(c.name, c.unit, c.dtype, c.decimals) for c in info.columns] == [
        ("numSV", "", "u1", -1),
        ("height", "m", "f8", 3),
    ]
    assert [column.tolist() for column in columns[2:]] == [[7], [-1234]]
    assert factors_of(info) == (1.0, 1e-3)


def test_fields_with_separate_channels() -> None:
    """Vectors and status words of an Inertial Sense set are channels of their own; a clock alone is the time axis."""
    decoder = IsbDecoder()
    decoder.feed(by_did(4) + by_did(58), 0)
    page = FakePage()
    channels = ChannelRegistry("d", page)
    batches = [event for event in decoder.drain() if isinstance(event, Batch)]
    channels.split([(one, np.zeros(len(one)), np.zeros(len(one), np.int64)) for one in batches])
    results = page.infos
    kinds = {info.name: info.kind for info in results}
    assert kinds["DID_INS_1.theta"] == "euler"
    assert kinds["DID_INS_1.insStatus"] == "status"
    assert kinds["DID_IMU.I.pqr"] == "vector"
    assert "DID_IMU" not in kinds
    assert kinds["DID_INS_1"] == "record"
    lla = next(info for info in results if info.name == "DID_INS_1.lla")
    assert [(column.name, column.unit) for column in lla.columns] == [("lat", "°"), ("lon", "°"), ("alt", "m")]
    assert (lla.frame, lla.title, lla.group) == ("WGS84", "Position", "INS 1")


def test_units_of_groups_of_elements_cost_no_column() -> None:
    """Two units for 21 elements described two columns, and the recording of such a message could not be opened."""
    info, columns = one(Field("Covariance", "<f4", (5,), unit="m²,rad²"), np.arange(10, dtype=np.float32).reshape(2, 5))
    assert [column.unit for column in info.columns] == [""] * 5
    assert len(columns) == 2 + 5


def test_a_channel_that_cannot_be_described_costs_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    described = channels._column_infos

    def broken(field: Field, array: Any, prefix: str) -> Any:
        return described(field, array, prefix)[: 1 if field.name == "Bad" else None]

    monkeypatch.setattr(channels, "_column_infos", broken)
    row = Message(1, "M", (Field("Good", "<f4", (2,)), Field("Bad", "<f4", (2,))), channel_per_field=True)
    page = FakePage()
    result = split(page, batch(row, {"Good": np.zeros((3, 2)), "Bad": np.zeros((3, 2))}, [0, 9, 18]))
    assert result.keys() == {"Good"}
    assert [info.name for info in page.infos] == ["Good"]
