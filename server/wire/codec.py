"""Codec of the messages that server/wire/ specifies.

Samples are columns after a header; text is JSON that JavaScript can read. A ring buffer encodes its samples from its
own memory (server/streaming/ring_buffer.py) with the same header.
"""

import json
import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.recordings.errors import ExplainedError
from imuscope.server.wire import (
    FLAG_HISTORY,
    HEADER,
    OPCODE_SAMPLES,
    BrowserText,
    Interval,
    Ping,
    ServerText,
    Subscribe,
)

_DROPPED_AT = 12
_MAX_SAFE_INTEGER = 2**53 - 1  # JavaScript's Number.MAX_SAFE_INTEGER


def padded(size: int) -> int:
    """`size` rounded up to a multiple of 8."""
    return (size + 7) & ~7


def sample_header(
    channel: int, sequence: int, n: int, columns: int, size: int, now: float, *, history: bool = False, dropped: int = 0
) -> bytes:
    """The 40 bytes before the columns; `columns` counts the two time columns, `size` the whole frame."""
    flags = FLAG_HISTORY if history else 0
    return HEADER.pack(OPCODE_SAMPLES, flags, columns, channel, n, dropped, sequence, size, 0, now)


def encode_samples(
    channel: int,
    sequence: int,
    columns: Sequence[NDArray[Any]],
    now: float,
    *,
    history: bool = False,
    dropped: int = 0,
) -> bytes:
    """One sample frame from separate columns (server/streaming/ring_buffer.py encodes faster, from its own memory).

    Args:
        columns: `arrival`, `time`, then the channel's own; 1-d, equal length, the advertised dtypes.
    """
    n = len(columns[0])
    size = HEADER.size + sum(padded(n * column.itemsize) for column in columns)
    parts = [sample_header(channel, sequence, n, len(columns), size, now, history=history, dropped=dropped)]
    for column in columns:
        parts.append(column.astype(column.dtype.newbyteorder("<"), copy=False).tobytes())
        parts.append(bytes(padded(n * column.itemsize) - n * column.itemsize))
    return b"".join(parts)


def with_dropped(frame: bytes, dropped: int) -> bytes:
    """The same frame, with the number of samples dropped before it for this browser."""
    out = bytearray(frame)
    struct.pack_into("<I", out, _DROPPED_AT, min(dropped, 0xFFFF_FFFF))
    return bytes(out)


@dataclass(frozen=True, slots=True)
class SampleFrame:
    """A decoded sample frame; `columns` as views into the message, `arrival` and `time` first."""

    channel: int
    sequence: int
    n: int
    dropped: int
    history: bool
    now: float
    columns: list[NDArray[Any]]


def decode_samples(data: bytes, dtypes: Mapping[int, Sequence[str]]) -> list[SampleFrame]:
    """The frames of one binary message, as the page's worker decodes them; for tests, benchmarks and Python clients.

    Args:
        dtypes: of each channel's own columns, by channel id.

    Raises:
        WireError: invalid frames, or a channel that is not in `dtypes`.
    """
    out: list[SampleFrame] = []
    at = 0
    while at < len(data):
        if len(data) - at < HEADER.size:
            raise WireError(f"{len(data) - at} bytes at {at} are not a frame.", "A frame's header has 40 bytes.")
        opcode, flags, count, channel, n, dropped, sequence, size, _, now = HEADER.unpack_from(data, at)
        if opcode != OPCODE_SAMPLES or channel not in dtypes or size > len(data) - at or size < HEADER.size:
            raise WireError(
                f"No frame of a known channel begins at {at}.", f"Its opcode is {opcode}, its channel {channel}."
            )
        names = ("f8", "f8", *dtypes[channel])
        if count != len(names):
            raise WireError(f"Channel {channel} has {len(names)} columns, the frame {count}.", "Read `channels` first.")
        columns, start = [], at + HEADER.size
        for name in names:
            columns.append(np.frombuffer(data, "<" + name, n, start))
            start += padded(columns[-1].nbytes)
        out.append(SampleFrame(channel, sequence, n, dropped, bool(flags & FLAG_HISTORY), now, columns))
        at += size
    return out


class WireError(ExplainedError, ValueError):
    """Invalid data on the wire; `hint` describes the expected form."""


@cache
def _field_names(kind: type) -> tuple[str, ...] | None:
    """Names of the fields of a dataclass; None for another class."""
    return tuple(one.name for one in fields(kind)) if is_dataclass(kind) else None


def to_json_safe(value: Any) -> Any:
    """`value` converted for JSON and JavaScript, by the rules in section Delivery of server/wire/."""
    kind: Any = type(value)
    if value is None or kind is str or kind is bool:
        return value
    if kind is dict:
        return {str(key): to_json_safe(item) for key, item in value.items()}
    if (names := _field_names(kind)) is not None:
        return {name: to_json_safe(getattr(value, name)) for name in names}
    if isinstance(value, str):
        return value
    if isinstance(value, int | np.integer):
        number = int(value)
        return number if -_MAX_SAFE_INTEGER <= number <= _MAX_SAFE_INTEGER else str(number)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, bytes | bytearray | memoryview):
        return bytes(value).hex()
    if isinstance(value, np.void):
        names = value.dtype.names
        return {name: to_json_safe(value[name]) for name in names} if names else value.tobytes().hex()
    if isinstance(value, np.ndarray):
        return [to_json_safe(item) for item in value] if value.ndim else to_json_safe(value[()])
    if isinstance(value, Mapping):
        return {str(key): to_json_safe(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [to_json_safe(item) for item in value]
    return str(value)


def encode_text(message: ServerText | BrowserText) -> str:
    return json.dumps(to_json_safe(message), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def decode_text(text: str) -> BrowserText:
    """Decode a message of the client.

    Raises:
        WireError: invalid request; the message says why.
    """
    try:
        message = json.loads(text)
    except (ValueError, RecursionError) as error:
        where = (
            f"It fails at character {error.pos + 1}."
            if isinstance(error, json.JSONDecodeError)
            else "A number is too long, or the nesting too deep."
        )
        raise WireError("A text frame must be JSON.", where) from None
    if not isinstance(message, dict):
        raise WireError("A text frame must be a JSON object.", 'For example {"op": "ping", "t": 1}.')
    match message.get("op"):
        case "ping":
            return Ping(_number(message, "t"))
        case "interval":
            return Interval(max(0.0, _number(message, "s")))
        case "subscribe":
            channels = message.get("channels")
            if channels is not None and not (
                isinstance(channels, list) and all(type(item) is int for item in channels)
            ):
                raise WireError("`channels` must be null or a list of channel ids.", f"It was {channels!r:.80}.")
            units = message.get("units", "shown")
            if units not in ("shown", "device"):
                raise WireError('`units` must be "shown" or "device".', f"It was {units!r:.40}.")
            return Subscribe(max(0.0, _number(message, "history")), channels, units)
    raise WireError(f"Unknown op {message.get('op')!r:.40}.", "A browser sends `subscribe`, `interval` or `ping`.")


def _number(message: Mapping[str, Any], name: str) -> float:
    value = message.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e300:
        raise WireError(f"`{name}` must be a finite number.", f"It was {value!r:.40}.")
    return float(value)
