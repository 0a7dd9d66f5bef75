"""Messages made column by column, read by the deserializer of rosbags."""

from __future__ import annotations

from typing import Any

import numpy as np

from imuscope.server.extensions.ros2 import type_support
from imuscope.server.extensions.ros2.cdr_rows import RowEncoder, stamp_columns
from imuscope.server.extensions.ros2.messages import FIELD, FIX, IMU, PRESSURE, TEMPERATURE, TIME, TRANSFORM, TWIST
from tests.server.extensions.ros2.samples import deserialize
from tests.support.each_row import each_row

N = 3
TRANSFORM_TEXTS = {"transforms.0.header.frame_id": "map", "transforms.0.child_frame_id": "imu0"}
TYPES = [
    *((type_name, {"header.frame_id": "imu0"}, {}) for type_name in (IMU, FIELD, FIX, TWIST, PRESSURE, TEMPERATURE)),
    (TIME, {"header.frame_id": "odd", "source": "gnss"}, {}),
    (TRANSFORM, TRANSFORM_TEXTS, {"transforms": 1}),
]


def numbers(type_name: str, path: str = "", lengths: dict[str, int] | None = None) -> dict[str, tuple[str, int | None]]:
    """Every number of a message by its path, from the definition: its type, and its length if it is an array."""
    results: dict[str, tuple[str, int | None]] = {}
    for name, inner, count in type_support.fields_of(type_name):
        place = f"{path}.{name}" if path else name
        if inner == "string":
            continue
        if "/" not in inner:
            results[place] = (inner, count)
        elif count == -1:
            for number in range((lengths or {}).get(place, 0)):
                results |= numbers(inner, f"{place}.{number}", lengths)
        else:
            results |= numbers(inner, place, lengths)
    return results


def value_at(message: Any, path: str) -> Any:
    for part in path.split("."):
        message = message[int(part)] if part.isdecimal() else getattr(message, part)
    return message


@each_row(("type_name", "texts", "lengths"), TYPES, ids=[type_name for type_name, _, _ in TYPES])
def test_every_number_and_text_is_where_rosbags_reads_it(
    type_name: str, texts: dict[str, str], lengths: dict[str, int]
) -> None:
    fields = numbers(type_name, lengths=lengths)
    assert len(fields) >= 3
    source = np.random.default_rng(14)
    values = {
        path: source.integers(0, 100, (N,) if count is None else (N, count)) / (2 if "float" in kind else 1)
        for path, (kind, count) in fields.items()
    }
    messages = RowEncoder(type_name, texts, lengths).encode(N, values)
    assert len(messages) == N
    for row, data in enumerate(messages):
        message = deserialize(data, type_name)
        for path, column in values.items():
            assert np.array_equal(value_at(message, path), column[row]), path
        for path, text in texts.items():
            assert value_at(message, path) == text
        assert type_support.serialize(message, type_name) == data


@each_row("name", ["", "a", "ab", "abc", "abcd", "abcdefg", "größe"])
def test_texts_of_every_length_keep_numbers_aligned(name: str) -> None:
    (data,) = RowEncoder(TEMPERATURE, {"header.frame_id": name}).encode(1, {"temperature": 21.5, "variance": 2.0})
    message = deserialize(data, TEMPERATURE)
    assert (message.header.frame_id, message.temperature, message.variance) == (name, 21.5, 2.0)


def test_times_are_split_into_seconds_and_nanoseconds() -> None:
    columns = dict(stamp_columns(np.array([1_795_000_000_123_456_789, 5])))
    assert columns["header.stamp.sec"].tolist() == [1_795_000_000, 0]
    assert columns["header.stamp.nanosec"].tolist() == [123_456_789, 5]
