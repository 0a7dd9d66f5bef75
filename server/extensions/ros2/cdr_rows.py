"""Many messages of one type as CDR at once: the layout is that of a numpy record.

    encoder = RowEncoder("sensor_msgs/msg/Temperature", {"header.frame_id": "imu0"})
    encoder.encode(2, {"header.stamp.sec": [1, 2], "temperature": [20.5, 20.6]})        two messages

A message whose texts and lengths of sequences are constant has one size, and each number its place in it. So a batch of
samples becomes messages column by column, ten times as fast as one message after the other. Numbers that are not given
are 0.

    00 01 00 00 │ fields, each aligned to its size; text: u32 length with NUL, bytes, NUL      little-endian

Source: OMG CDR (formal/2002-06-51, 15.3), XCDR1 as in DDS; the fields of a type come from type_support.py.
"""

import struct
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.server.extensions.ros2.type_support import fields_of

HEADER = b"\x00\x01\x00\x00"


class RowEncoder:
    """Encoder of the messages of a type.

    Args:
        type: "sensor_msgs/msg/Imu".
        texts: every text that is not empty, by its path: {"header.frame_id": "imu0"}.
        lengths: every sequence that is not empty, by its path: {"transforms": 1}.
    """

    def __init__(self, type_name: str, texts: Mapping[str, str], lengths: Mapping[str, int] | None = None) -> None:
        self._texts, self._lengths = texts, lengths or {}
        self._template = bytearray(HEADER)
        self._names: list[str] = []
        self._formats: list[tuple[str, tuple[int, ...]]] = []
        self._offsets: list[int] = []
        self._place(type_name, "")
        self._dtype = np.dtype(
            {
                "names": self._names,
                "formats": self._formats,
                "offsets": self._offsets,
                "itemsize": len(self._template),
            }
        )

    @property
    def size(self) -> int:
        """Bytes of a message."""
        return len(self._template)

    def encode(self, n: int, values: Mapping[str, Any]) -> list[bytes]:
        """Messages of `n` samples.

        Args:
            values: by path, a column of n numbers or one for all: "orientation.x"; an array has its own axis last.
        """
        data, size = self._template * n, self.size
        rows = np.frombuffer(data, self._dtype)
        for path, value in values.items():
            rows[path] = value
        return [bytes(data[at : at + size]) for at in range(0, n * size, size)]

    def _place(self, type_name: str, path: str) -> None:
        for name, inner, count in fields_of(type_name):
            place = f"{path}.{name}" if path else name
            if count is None:
                self._field(inner, place)
            elif count >= 0 and inner in SIZES:
                self._number(inner, place, (count,))
            else:
                length = self._lengths.get(place, 0) if count < 0 else count
                if count < 0:
                    self._constant("I", length, 4)
                for number in range(length):
                    self._field(inner, f"{place}.{number}")

    def _field(self, type_name: str, path: str) -> None:
        if type_name == "string":
            text = self._texts.get(path, "").encode() + b"\x00"
            self._constant("I", len(text), 4)
            self._template += text
        elif type_name in SIZES:
            self._number(type_name, path, ())
        else:
            self._place(type_name, path)

    def _number(self, type_name: str, path: str, shape: tuple[int, ...]) -> None:
        size = SIZES[type_name]
        self._align(size)
        self._names.append(path)
        self._formats.append((FORMATS[type_name], shape))
        self._offsets.append(len(self._template))
        self._template += bytes(size * int(np.prod(shape)))

    def _constant(self, code: str, value: int, size: int) -> None:
        self._align(size)
        self._template += struct.pack(f"<{code}", value)

    def _align(self, size: int) -> None:
        self._template += bytes(-(len(self._template) - len(HEADER)) % size)


FORMATS = {
    "bool": "u1",
    "octet": "u1",
    "byte": "u1",
    "char": "u1",
    **{f"{sign}int{8 * size}": f"<{sign or 'i'}{size}" for sign in ("", "u") for size in (1, 2, 4, 8)},
    "float32": "<f4",
    "float64": "<f8",
}
SIZES = {name: np.dtype(dtype).itemsize for name, dtype in FORMATS.items()}


def stamp_columns(times_ns: NDArray[np.int64], path: str = "header.stamp") -> Iterator[tuple[str, NDArray[np.int64]]]:
    """Values of a time's two fields, of times in ns since 1970."""
    yield f"{path}.sec", times_ns // 1_000_000_000
    yield f"{path}.nanosec", times_ns % 1_000_000_000
