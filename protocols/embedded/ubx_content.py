"""Content of UBX messages: numbers by name, from the table in ubx_messages.txt.

A message of another length than the table's is not read beyond what both have: later generations append fields.

ESF-MEAS carries some numbers of 24 bits with their types. ESF-RAW has several samples of them, each number with a tag:

    4 bytes │ type, number of 24 bits │ sTtag │ type, number │ sTtag │ …       sTtag 1000 1000 … 1256 1256 …
                                                                            sample  └── 01 ──┘ └── 02 ──┘

Its fields are numbered by the samples: gyroX_01, gyroX_02. The tag counts ticks of the sensor, whose length is not
documented: it is a column, and all samples of a message have the time of the message.
"""

import functools
import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources

from imuscope.protocols.schema.fields import Field

_CODES = {"U1": "B", "U2": "H", "U4": "I", "I1": "b", "I2": "h", "I4": "i", "R4": "f", "R8": "d"}
TAG, _RAW_AT, _RAW_SIZE, _MAX_SAMPLES = "sTtag", 4, 8, 99  # of ESF-RAW; samples of a message
_MEASURED, _FLAGS_AT, _DATA_AT, _TYPE_AT = "MEASUREMENT", 4, 8, 24  # of ESF-MEAS: bytes, and bit of a number's type


@dataclass(frozen=True, slots=True)
class _Number:
    """A number of a payload: where it is, and its field; `adds`: it is added to that."""

    at: int
    layout: struct.Struct
    field: Field
    divisor: int
    adds: bool


@functools.cache
def table() -> Mapping[str, list[str]]:
    """First word of each line → all words of such lines."""
    words: dict[str, list[str]] = {}
    text = resources.files("imuscope.protocols.embedded").joinpath("ubx_messages.txt").read_text("utf-8")
    for line in text.splitlines():
        if line and not line.startswith("#"):
            first, *rest = line.split()
            words.setdefault(first, []).extend(rest)
    return words


@functools.cache
def _numbers_of(name: str) -> list[_Number]:
    numbers: list[_Number] = []
    at = 0
    for word in table().get(name.replace("NAV2-", "NAV-"), []):
        field, kind, unit, divisor = f"{word}:::".split(":")[:4]
        if field != "-":
            layout = struct.Struct("<" + _CODES[kind])
            described = Field(field.removeprefix("+"), "f8", unit=unit)
            numbers.append(_Number(at, layout, described, int(divisor or 1), field.startswith("+")))
        at += int(kind) if field == "-" else layout.size
    return numbers


@functools.cache
def _measurements() -> Mapping[int, tuple[Field, int]]:
    """Type of a measurement → its field, and its divisor."""
    words = table()[_MEASURED]
    measurements = {}
    for number, word in zip(words[::2], words[1::2], strict=True):
        name, unit, divisor = word.split(":")
        measurements[int(number)] = Field(name, "f8", unit=unit), int(divisor)
    return measurements


@functools.cache
def fields_of(name: str) -> Mapping[str, Field]:
    """Fields of a message, by name."""
    if name == "ESF-MEAS":
        return {field.name: field for field, _ in _measurements().values()}
    if name == "ESF-RAW":
        return {TAG: Field(TAG, "f8", doc="Ticks of the sensor."), **fields_of("ESF-MEAS")}
    return {one.field.name: one.field for one in _numbers_of(name) if not one.adds}


def values_of(name: str, payload: bytes) -> dict[str, float | int]:
    """Numbers of a payload in their units; empty if the table lacks the message."""
    if name == "ESF-MEAS":
        return _measured(payload)
    if name == "ESF-RAW":
        samples = enumerate(_samples(payload), 1)
        return {f"{field}_{number:02d}": value for number, sample in samples for field, value in sample.items()}
    values: dict[str, float | int] = {}
    for one in _numbers_of(name):
        if one.at + one.layout.size > len(payload):
            break
        (raw,) = one.layout.unpack_from(payload, one.at)
        value = raw / one.divisor if one.divisor != 1 else raw
        values[one.field.name] = values[one.field.name] + value if one.adds else value
    return values


def _measured(payload: bytes) -> dict[str, float | int]:
    values: dict[str, float | int] = {}
    if len(payload) < _DATA_AT:
        return values
    count = payload[_FLAGS_AT + 1] >> 3
    for at in range(_DATA_AT, min(_DATA_AT + 4 * count, len(payload) - 3), 4):
        word = int.from_bytes(payload[at : at + 4], "little")
        if (known := _measurement(word)) is not None:
            values[known[0]] = known[1]
    return values


def _measurement(word: int) -> tuple[str, float] | None:
    """Name and value of a number with its type; None for an unknown type."""
    known = _measurements().get(word >> _TYPE_AT & 63)
    if known is None:
        return None
    field, divisor = known
    number = word & 0xFFFFFF
    return field.name, (number - (number >> 23 << 24)) / divisor


def _samples(payload: bytes) -> list[dict[str, float | int]]:
    """Samples of ESF-RAW: a number of a type that the sample has, or with another tag, begins the next."""
    samples: list[dict[str, float | int]] = []
    for at in range(_RAW_AT, len(payload) - _RAW_SIZE + 1, _RAW_SIZE):
        word, tag = struct.unpack_from("<II", payload, at)
        if (known := _measurement(word)) is None:
            continue
        name, value = known
        if not samples or samples[-1][TAG] != tag or name in samples[-1]:
            if len(samples) == _MAX_SAMPLES:
                break
            samples.append({TAG: tag})
        samples[-1][name] = value
    return samples


def samples_of(name: str, fields: Mapping[str, float | int]) -> list[dict[str, float]]:
    """Samples of the sensors in ESF-MEAS or ESF-RAW by its fields, one for each sensor: which sensors are in a message
    differs from message to message. NaN for an axis that is missing; nothing for other messages.
    """
    if name not in ("ESF-MEAS", "ESF-RAW"):
        return []
    numbered: dict[str, dict[str, float]] = {}
    for full, value in fields.items():
        field, _, number = full.partition("_")
        numbered.setdefault(number, {})[field] = float(value)
    about = (TAG,) if name == "ESF-RAW" else ()
    return [
        {field: sample.get(field, math.nan) for field in (*about, *sensor)}
        for sample in numbered.values()
        for sensor in _sensors()
        if not sample.keys().isdisjoint(sensor)
    ]


@functools.cache
def _sensors() -> Sequence[Sequence[str]]:
    """Measurements of one sensor each: its axes, or its only number."""
    sensors: dict[str, list[str]] = {}
    for field, _ in _measurements().values():
        sensors.setdefault(field.name.rstrip("XYZ"), []).append(field.name)
    return [sorted(names) for names in sensors.values()]
