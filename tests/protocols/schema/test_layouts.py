"""Rows of a table ⇄ bytes, and errors of callers."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.framing.checksums import check_sum8, sum8
from imuscope.protocols.framing.stream_buffer import StreamBuffer
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.layouts import EncodeError, Layout, form_for_size, pack, size_of, unpack
from imuscope.protocols.schema.validation import find_problems
from tests.support.each_row import each_row

RECORD = Field("r", shape=(-1,), fields=(Field("a", "u1"), Field("b", ">i2", scale=0.5)))
FIELDS = (Field("n", ">u2"), Field("v", ">f4", (3,)), Field("t", "ascii", (4,), pad=0x20), RECORD)


def test_one_frame() -> None:
    payload = bytes.fromhex("0102 3F800000 00000000 BF800000 41422020 01FFFE 020003")
    fields = form_for_size(FIELDS, len(payload))
    assert fields is not None
    values = unpack(fields, payload)
    assert values == {"n": 258, "v": [1.0, 0.0, -1.0], "t": "AB", "r": [{"a": 1, "b": -2}, {"a": 2, "b": 3}]}
    assert pack(FIELDS, values) == payload
    assert form_for_size(FIELDS, len(payload) + 1) is None
    assert form_for_size(FIELDS, 3) is None
    assert size_of(FIELDS[1]) == 12


def test_columns_have_shown_units_and_native_order() -> None:
    fields = form_for_size(FIELDS, 21)
    assert fields is not None
    row = bytes.fromhex("0102 3F800000 00000000 BF800000 41422020 01FFFE")
    columns = Layout.of(fields).columns(np.frombuffer(row * 3, np.uint8).reshape(3, -1))
    assert columns["n"].dtype == np.uint16
    assert columns["v"].dtype == np.float32
    assert columns["v"].shape == (3, 3)
    assert columns["r"]["b"].tolist() == [[-1.0]] * 3
    assert columns["r"].dtype["b"] == np.float64
    assert list(columns) == ["n", "v", "t", "r"]
    assert columns["n"] is columns["n"]


WIRES = (">f4", "<f8", "<i2", "u1", "fp1220", "fp1632", "ascii", "bytes")


@each_row("dtype", WIRES)
@each_row("shape", [(), (2,), (3,), (16,), (17,), (3, 3)])
@each_row("scale", [1.0, 0.5])
def test_rows_decode_together_as_they_do_alone(dtype: str, shape: tuple[int, ...], scale: float) -> None:
    if dtype == "bytes" and len(shape) != 1:
        return
    fields = (Field("before", "u1"), Field("x", dtype, shape, scale=scale if dtype not in ("ascii", "bytes") else 1.0))
    layout = Layout.of(fields)
    rows = np.random.default_rng(1).integers(0, 256, (200, layout.size), np.uint8)
    many = layout.columns(rows)["x"]
    alone = np.concatenate([layout.columns(rows[k : k + 1])["x"] for k in range(200)])
    assert many.dtype == alone.dtype
    assert many.shape == (200, *shape)
    assert many.tobytes() == alone.tobytes()
    assert dtype == "bytes" or many.flags.c_contiguous


def test_matrix_by_columns() -> None:
    field = Field("m", ">f8", (3, 3), column_major=True)
    rows = np.arange(9, dtype=">f8").view(np.uint8).reshape(1, -1)
    assert Layout.of((field,)).columns(rows)["m"][0].tolist() == [[0, 3, 6], [1, 4, 7], [2, 5, 8]]


@given(st.lists(st.floats(-32768, 32767.9), min_size=1, max_size=4))
def test_fixed_point(values: list[float]) -> None:
    field = Field("x", "fp1632", (len(values),))
    raw = pack((field,), {"x": values})
    back = unpack((field,), raw)["x"]
    assert all(abs(a - b) <= 2.0**-33 for a, b in zip(values, back, strict=True))
    columns = Layout.of((field,)).columns(np.frombuffer(raw, np.uint8).reshape(1, -1))
    assert columns["x"][0].tolist() == back


@each_row(
    ("field", "value", "words"),
    [
        (Field("x", "u1"), 256, "x is a whole number from 0 to 255, given 256"),
        (Field("x", ">i2"), 1.5, "whole number from -32768"),
        (Field("x", "fp1220"), 2048.0, r"\[-2048, 2048\)"),
        (Field("x", "fp1632"), math.inf, r"\[-32768, 32768\)"),
        (Field("x", ">f4"), 1e300, "32-bit float"),
        (Field("x", ">f4"), "1", "is a number"),
        (Field("x", ">f4", (3,)), [1, 2], "has 3 values, given 2"),
        (Field("x", ">f4", (3,)), 1, "is a list"),
        (Field("x", "ascii", (2,)), "abc", "at most 2 characters"),
        (Field("x", "ascii", (-1,)), "€", "ASCII"),
        (Field("x", "bytes", (2,)), b"abc", "has 2 bytes"),
        (RECORD, [{"a": 1}], "b is missing"),
        (RECORD, [3], "record of a, b"),
    ],
)
def test_values_that_do_not_fit(field: Field, value: Any, words: str) -> None:
    with pytest.raises(EncodeError, match=words):
        pack((field,), {field.name: value})


def test_unknown_name() -> None:
    with pytest.raises(EncodeError, match="no field is called 'y'; there are: x"):
        pack((Field("x", "u1"),), {"y": 1})


def test_nan_keeps_its_bytes() -> None:
    field = Field("x", ">f4")
    for digits in ("7fc00001", "ff800000", "7f800001"):
        value = unpack((field,), bytes.fromhex(digits), exact=True)
        assert value == {"x": {"f32": digits}}
        assert pack((field,), value) == bytes.fromhex(digits)


def test_check_value_of_the_sum() -> None:
    """GoToConfig, MT0101P section 6."""
    frame = bytes.fromhex("FAFF3000D1")
    assert sum8(np.frombuffer(frame, np.uint8), 1, 5) == 0
    assert check_sum8(frame[1:-1]) == 0xD1


def test_the_buffer_gives_the_arrival_time_of_each_byte() -> None:
    buffer = StreamBuffer()
    for arrival, chunk in ((10, b"abc"), (20, b""), (30, b"defg"), (40, b"h")):
        buffer.append(chunk, arrival)
    assert buffer.data() == b"abcdefgh"
    buffer.release(2)
    assert buffer.data() == b"cdefgh"
    assert buffer.start == 2
    assert buffer.arrivals(np.array([2, 3, 6, 7])).tolist() == [10, 30, 30, 40]
    assert [buffer.arrival(at) for at in (2, 3, 6, 7)] == [10, 30, 30, 40]
    buffer.release(8)
    assert len(buffer) == 0


def test_hundredths_are_shown_as_the_decimal_that_was_sent() -> None:
    """Times 0.01, 9999 hundredths were 99.99000000000001."""
    field = Field("cno", "<i4", scale=0.01, unit="dBHz")
    shown = Layout.of((field,)).columns(
        np.frombuffer(np.array([9999, -9999, 1], "<i4").tobytes(), np.uint8).reshape(3, 4)
    )
    assert [repr(float(value)) for value in shown["cno"]] == ["99.99", "-99.99", "0.01"]


def test_a_text_too_long_in_a_list_of_texts_is_named_by_its_place() -> None:
    names = Field("names", "ascii", (3, 4))
    assert list(find_problems([names], {"names": ["ab", "cd", "ef"]})) == []
    [problem] = find_problems([names], {"names": ["ab", "much too long", "ef"]})
    assert problem.path == "names.1"
    [problem] = find_problems([names], {"names": "much too long"})
    assert problem.path == "names.0"
