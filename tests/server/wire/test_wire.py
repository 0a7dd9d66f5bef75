"""The wire format in both directions in Python, and up-to-date types of the page."""

import json
import math
import re
import struct
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server import wire
from imuscope.server.generators import files as generated_files
from imuscope.server.generators import route_types as generate_route_types
from imuscope.server.reference import typescript
from imuscope.server.wire import codec as wire_codec
from tests.support.each_row import each_row

DTYPES = list(wire.Dtype.__args__)  # type: ignore[attr-defined]


@given(st.data(), st.lists(st.sampled_from(DTYPES), max_size=6), st.integers(0, 40))
def test_sample_frames_round_trip(data: st.DataObject, dtypes: list[str], n: int) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    columns = [rng.normal(size=n) for _ in range(2)]
    columns += [np.frombuffer(rng.bytes(n * int(dtype[1:])), dtype) for dtype in dtypes]
    frame = wire_codec.encode_samples(7, 2**40, columns, 1.5, history=True, dropped=3)
    assert len(frame) % 8 == 0
    first, second = wire_codec.decode_samples(frame + wire_codec.with_dropped(frame, 9), {7: dtypes})
    assert (first.channel, first.sequence, first.n, first.dropped, first.history, first.now) == (
        7,
        2**40,
        n,
        3,
        True,
        1.5,
    )
    assert second.dropped == 9
    for expected, got in zip(columns, first.columns, strict=True):
        assert got.tobytes() == expected.tobytes()


def test_columns_are_aligned() -> None:
    """Every column starts at a multiple of 8 in the message, which typed-array views in the page rely on."""
    columns = [np.zeros(3), np.zeros(3), np.ones(3, "u1"), np.full(3, 2.0, "f4")]
    frame = wire_codec.encode_samples(1, 0, columns, 0.0)
    at = wire.HEADER.size + 2 * 24
    assert frame[at : at + 3] == b"\1\1\1"
    assert np.frombuffer(frame, "<f4", 3, at + 8).tolist() == [2.0, 2.0, 2.0]


@given(st.binary(max_size=200))
def test_noise_is_a_wire_error(data: bytes) -> None:
    try:
        wire_codec.decode_samples(data, {0: ["f4"], 1: []})
    except wire_codec.WireError:
        return


def test_json_is_readable_by_javascript() -> None:
    value = {
        "nan": math.nan,
        "inf": np.float32(np.inf),
        "big": 2**63,
        "safe": 2**53 - 1,
        "u64": np.uint64(2**64 - 1),
        "bytes": b"\x01\xff",
        "array": np.array([[1.5, math.nan]]),
        "record": np.array([(1, 2.5)], dtype=[("a", "u1"), ("b", "f8")]),
        3: (True, None, np.bool_(False)),
    }
    text = json.dumps(wire_codec.to_json_safe(value), allow_nan=False)
    assert json.loads(text) == {
        "nan": None,
        "inf": None,
        "big": "9223372036854775808",
        "safe": 2**53 - 1,
        "u64": "18446744073709551615",
        "bytes": "01ff",
        "array": [[1.5, None]],
        "record": [{"a": 1, "b": 2.5}],
        "3": [True, None, False],
    }


def test_text_round_trip() -> None:
    request = wire.Subscribe(history=20.0, channels=[1, 2])
    assert wire_codec.decode_text(wire_codec.encode_text(request)) == request
    assert wire_codec.decode_text('{"op":"ping","t":1}') == wire.Ping(1.0)
    assert wire_codec.decode_text('{"op":"interval","s":0.05}') == wire.Interval(0.05)
    assert wire_codec.decode_text('{"op":"interval","s":-1}') == wire.Interval(0.0)
    assert json.loads(wire_codec.encode_text(wire.HistoryEnd())) == {"op": "history_end"}


@each_row(
    "text",
    [
        "",
        "{",
        "[]",
        "1",
        '{"op":"fly"}',
        '{"op":"ping"}',
        '{"op":"ping","t":"1"}',
        '{"op":"ping","t":true}',
        '{"op":"interval","s":"1"}',
        '{"op":"subscribe","history":NaN}',
        '{"op":"subscribe","history":1,"units":"SI"}',
        '{"op":"subscribe","history":1,"channels":["1"]}',
        '{"op":"subscribe","history":1,"channels":[true]}',
        "[" * 100_000,
        '{"op":"ping","t":1e999}',
    ],
)
def test_a_wrong_request_is_refused_with_a_reason(text: str) -> None:
    with pytest.raises(wire_codec.WireError) as caught:
        wire_codec.decode_text(text)
    assert str(caught.value).endswith(".")


@given(st.text(max_size=100))
def test_any_text_is_accepted_or_refused(text: str) -> None:
    try:
        wire_codec.decode_text(text)
    except wire_codec.WireError:
        return


def test_the_page_reads_frames_by_the_same_numbers() -> None:
    text = (typescript.PAGE / "wire" / "frame.ts").read_text(encoding="utf-8")
    numbers = {name: int(number) for name, number in re.findall(r"(\w+)(?: =|:) (\d+)[;,]$", text, re.MULTILINE)}
    codes = wire.HEADER.format.lstrip("<")
    offsets = {
        name: struct.calcsize("<" + codes[:i]) for i, name in enumerate(wire.HEADER_FIELDS) if name != "reserved"
    }
    sizes = {dtype: np.dtype(dtype).itemsize for dtype in get_args(wire.Dtype)}
    flags = {"OPCODE_SAMPLES": wire.OPCODE_SAMPLES, "FLAG_HISTORY": wire.FLAG_HISTORY}
    assert numbers == {**flags, "HEADER_SIZE": wire.HEADER.size, **offsets, **sizes}
    assert f'SUBPROTOCOL = "{wire.SUBPROTOCOL}"' in text


def test_every_answer_in_json_has_a_schema() -> None:
    """Types of the page's HTTP clients need a response model for each route."""
    for path, ways in generated_files.document()["paths"].items():
        for method, operation in ways.items():
            for status, response in operation["responses"].items():
                for kind, content in response.get("content", {}).items():
                    words = set(content.get("schema", {})) - {"title", "description"}
                    assert words, f"{method.upper()} {path} answers {status} with {kind} of any shape"


def test_the_generator_refuses_what_it_does_not_know() -> None:
    import ast

    with pytest.raises(ValueError, match="no TypeScript"):
        typescript.typescript_type(ast.parse("set[int]", mode="eval").body)
    with pytest.raises(ValueError, match="no TypeScript"):
        generate_route_types.typescript_type({"not": {"type": "string"}})
