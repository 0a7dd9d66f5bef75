"""Handlers of messages with more effect than storing a number.

One function per message: device, payload and device time in; the payload of the acknowledgement out, None for none. A
message that cannot be executed raises `RequestRefusedError` with the code of the Error. `ACTIONS` gives the states in
which each is valid.

Source: MT0101P 2020.A, 5.3.1-5.3.7.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from imuscope.protocols import rotations
from imuscope.protocols.simulator import trajectory
from imuscope.protocols.xbus.enums import CLOCK_BIAS
from imuscope.protocols.xbus.products import ALL, FILTER, RTK, Model
from imuscope.protocols.xbus.simulator.settings import (
    ALIGNMENT,
    ERROR_MESSAGE,
    ERROR_PARAMETER,
    OPTIONS,
    SYNC,
    RequestRefusedError,
)

if TYPE_CHECKING:
    from imuscope.protocols.xbus.simulator.device import XbusSimulator


# Sync functions and the lines on which each is accepted: rows of Table 11, columns of Table 12, with the footnotes of
# both. Transcribed a second time, apart from product_options.py, which validates what a user enters: a slip in one of
# the two shows as a refusal in a test. Source: MT0101P 2020.A, 5.3.4.
_SEND_LATEST, _GNSS_PULSE = 8, 14
_FUNCTIONS: Mapping[str, tuple[tuple[int, ...], tuple[int, ...]]] = {  # Table 11, by column: sync in, sync out
    "MTi-1s": ((8,), ()),
    "MTi-7": ((8, 9), (14,)),
    "MTi-10s/100s": ((3, 8, 9, 11), (4,)),
    "MTi-G-710": ((3, 8, 9, 11), (4, 14)),
    "MTi-610/620/630": ((3, 8, 9, 11), (4,)),
    "MTi-670/680G": ((3, 8, 9, 11), (4, 14)),
}
_INPUTS: Mapping[str, tuple[int, ...]] = {  # Table 12
    "MTi-1s": (2, 0),
    "MTi-7": (2, 1),
    "MTi-10s/100s": (2, 0),
    "MTi-G-710": (2, 0, 1, 5),
    "MTi-610/620/630": (2, 9),
    "MTi-670/680G": (2, 9),
}
_OUTPUT: Mapping[str, int] = {"MTi-10s/100s": 4, "MTi-G-710": 4, "MTi-610/620/630": 7, "MTi-670/680G": 7}
_PULSE: Mapping[int, tuple[int, ...]] = {
    7: (8,),
    710: (4,),
    670: (2, 9, 7),  # footnote 5: on In1 or In2 the time pulse comes with it
    680: (10, 7),  # footnotes 1 and 6: In3 is the internal line of the pulse
}
SOFTWARE = 6


def accepts(model: Model, function: int, line: int) -> bool:
    """Whether a product performs a function on a line."""
    column = _column(model)
    inputs, outputs = _FUNCTIONS[column]
    if function in inputs:
        return line in _INPUTS[column] or (line == SOFTWARE and function == _SEND_LATEST)
    if function not in outputs:
        return False
    return line in _PULSE[model.number] if function == _GNSS_PULSE else line == _OUTPUT[column]


def is_sync_out(function: int) -> bool:
    """Whether a function generates a pulse."""
    return any(function in outputs for _, outputs in _FUNCTIONS.values())


def _column(model: Model) -> str:
    if model.series == 1:
        return "MTi-7" if model.number == 7 else "MTi-1s"
    if model.series == 600:
        return "MTi-670/680G" if model.number >= 670 else "MTi-610/620/630"
    return "MTi-G-710" if model.number == 710 else "MTi-10s/100s"


MAX_ITEMS = 32  # of an output configuration
MAX_DELAY, MAX_OFFSET = 60_000, 30_000  # tables 9 and 10, 100 µs
RTCM = 0xD3
EMTS_BYTES = 256
TURNING = math.radians(1)  # rad/s: faster is not at rest


def _empty(payload: bytes) -> None:
    if payload:
        raise RequestRefusedError(ERROR_MESSAGE)


def _sized(payload: bytes, *sizes: int) -> None:
    if len(payload) not in sizes:
        raise RequestRefusedError(ERROR_MESSAGE)


# -- states ------------------------------------------------------------------------------------------------------------


def wake_up_ack(device: XbusSimulator, payload: bytes, now: int) -> None:
    device.stop()


def go_to_config(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """Enter the config state; ignores a payload, which hosts send when they search for devices on RS-485."""
    device.stop()
    return b""


def init_bus(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """Reserved in the document; the vendor's software sends it first, and continues when it is answered."""
    _empty(payload)
    return device.identifier()


def emts(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """EMTS, undocumented: the calibration for the head of a log. Two bytes select its part; here it is empty."""
    _sized(payload, 0, 2)
    return bytes(EMTS_BYTES)


def go_to_measurement(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    _empty(payload)
    device.measure(now)
    return b""


def reset(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    _empty(payload)
    device.reset(now)
    return b""


def restore_factory(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    _empty(payload)
    device.restore()
    return b""


# -- identity ----------------------------------------------------------------------------------------------------------


def device_id(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    _empty(payload)
    return device.identifier()


def product_code(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    _empty(payload)
    return device.product.code.encode("ascii").ljust(20)


def hardware_version(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    _empty(payload)
    return bytes(device.product.hardware)


def firmware(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    _empty(payload)
    return struct.pack(">BBBII", *device.product.firmware)


def selftest(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """Self-test results: all nine sensor axes pass; the two flags above them are the MTi-7's own."""
    _empty(payload)
    return struct.pack(">H", 0x7FF if device.product.name == "MTi-7" else 0x1FF)


# -- settings ----------------------------------------------------------------------------------------------------------


def option_flags(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    _sized(payload, 0, 8)
    if not payload:
        return device.settings[OPTIONS]
    set_flags, clear_flags = struct.unpack(">II", payload)
    flags = int.from_bytes(device.settings[OPTIONS], "big")
    device.settings[OPTIONS] = struct.pack(">I", flags & ~clear_flags | set_flags)  # setting has precedence
    return b""


def configuration(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    _empty(payload)
    return device.configuration()


def output_configuration(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """Both forms return the list in effect; an entry 0, 0 stands for an empty list."""
    if len(payload) % 4 or len(payload) > 4 * MAX_ITEMS:
        raise RequestRefusedError(ERROR_MESSAGE)
    if payload:
        requested = [pair for pair in struct.iter_unpack(">HH", payload) if pair != (0, 0)]
        device.output = tuple((identifier, device.grant(identifier, rate)) for identifier, rate in requested)
    return b"".join(struct.pack(">HH", *pair) for pair in device.output)


def sync_settings(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """Twelve bytes an entry: function, line, polarity, once, skip first, skip factor, pulse width, delay."""
    if not payload:
        return device.settings[SYNC]
    if len(payload) % 12 or len(payload) > 120:
        raise RequestRefusedError(ERROR_MESSAGE)
    entries = [payload[at : at + 12] for at in range(0, len(payload), 12)]
    entries = [entry for entry in entries if entry[2]]  # polarity 0 clears
    if not all(_is_sync(device, entry) for entry in entries):
        raise RequestRefusedError(ERROR_PARAMETER)
    device.settings[SYNC] = b"".join(entries)
    return b""


def _is_sync(device: XbusSimulator, entry: bytes) -> bool:
    """Whether the product has this function and line, and the delay suits the function."""
    function, line, polarity, once = entry[:4]
    delay = int.from_bytes(entry[10:12], "big")
    if is_sync_out(function):
        fits = delay <= MAX_OFFSET or delay >= 65_536 - MAX_OFFSET
    else:
        fits = delay <= MAX_DELAY or function == CLOCK_BIAS
    return fits and accepts(device.product.model, function, line) and polarity <= 3 and once <= 1


def alignment(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """One byte requests a matrix, 0 sensor or 1 local; a quaternion after it sets it."""
    _sized(payload, 1, 17)
    which = payload[0]
    if which > 1:
        raise RequestRefusedError(ERROR_PARAMETER)
    stored = device.settings[ALIGNMENT]
    if len(payload) == 1:
        return stored[17 * which : 17 * which + 17]
    if not abs(math.hypot(*struct.unpack(">4f", payload[1:])) - 1) < 1e-2:
        raise RequestRefusedError(ERROR_PARAMETER)
    device.settings[ALIGNMENT] = payload + stored[17:] if which == 0 else stored[:17] + payload
    return b""


def filter_profiles(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """Five rows of type, version and a label of 20 characters; unused rows have type 0."""
    _empty(payload)
    rows = [struct.pack("BB", number, 1) + label.encode().ljust(20) for number, label in device.product.profiles[:5]]
    return b"".join(rows + [bytes(2) + b" " * 20] * (5 - len(rows)))


# -- actions -----------------------------------------------------------------------------------------------------------


def reset_orientation(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """Code 0 stores and needs the config state; the others need measurement, 1 (heading) a product without GNSS.

    A reset that is not stored is discarded when the device next begins to measure.
    """
    _sized(payload, 2)
    heading = () if "gnss" in device.product.capabilities else (1,)
    allowed = (0,) if device.phase == "config" else (*heading, 3, 4, 5, 6, 7)
    code = int.from_bytes(payload, "big")
    if code not in allowed:
        raise RequestRefusedError(ERROR_PARAMETER)
    if code:
        device.reset_pending = _aligned(
            device.reset_pending or device.settings[ALIGNMENT], code, device.run.setup.motion_at(np.array([now / 1e9]))
        )
    elif device.reset_pending:
        device.settings[ALIGNMENT], device.reset_pending = device.reset_pending, b""
    return b""


def _aligned(stored: bytes, code: int, motion: trajectory.MotionState) -> bytes:
    """Both alignments after a reset: 1 and 4 turn the heading, 3 and 4 level the object, 5 to 7 undo it."""
    sensor, local = stored[:17], stored[17:]
    roll, pitch, yaw = motion.euler[0]
    if code in (3, 4):
        sensor = b"\0" + _rotation(roll, pitch, 0.0)
    if code in (1, 4):
        local = b"\1" + _rotation(0.0, 0.0, -yaw)
    if code in (6, 7):
        sensor = b"\0" + _rotation(0.0, 0.0, 0.0)
    if code in (5, 7):
        local = b"\1" + _rotation(0.0, 0.0, 0.0)
    return sensor + local


def _rotation(roll: float, pitch: float, yaw: float) -> bytes:
    return struct.pack(">4f", *rotations.of_euler(np.array([[roll, pitch, yaw]]))[0])


def no_rotation(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """Start a no-rotation update, shown in the status word; the motion is searched for its first moment."""
    _sized(payload, 2)
    seconds = int.from_bytes(payload, "big")
    if not seconds:
        raise RequestRefusedError(ERROR_PARAMETER)
    moments = now / 1e9 + np.arange(0, min(seconds, 3600), 0.1)
    turning = np.linalg.norm(device.run.setup.motion_at(moments).rate, axis=1) > TURNING
    end = now + seconds * 10**9
    noticed = int(moments[int(np.argmax(turning))] * 1e9) if turning.any() else end
    device.change(no_rotation=(now, end, noticed))
    return b""


def utc_time(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """Set or return UTC; both forms return it."""
    _sized(payload, 0, 12)
    if payload:
        ns, year, month, day, hour, minute, second, _ = struct.unpack(">IH6B", payload)
        try:
            whole = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
        except ValueError:
            raise RequestRefusedError(ERROR_PARAMETER) from None
        if not 1999 <= year <= 2099 or ns > 10**9:
            raise RequestRefusedError(ERROR_PARAMETER)
        device.change(utc_ns=int(whole.timestamp()) * 10**9 + ns - now, utc_valid=True)
    state = device.run.state
    utc = state.utc_ns + now
    date = np.datetime64(utc // 10**9, "s").item()
    flags = 7 if state.utc_valid or "gnss" in device.product.capabilities else 0
    return struct.pack(
        ">IH6B", utc % 10**9, date.year, date.month, date.day, date.hour, date.minute, date.second, flags
    )


def adjust_utc_time(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """Shift UTC by ticks of 0.1 ms, at most a second either way."""
    _sized(payload, 4)
    ticks = int.from_bytes(payload, "big", signed=True)
    if not 1 <= abs(ticks) <= 10_000:
        raise RequestRefusedError(ERROR_PARAMETER)
    device.change(utc_ns=device.run.state.utc_ns + ticks * 100_000)
    return b""


def icc_command(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """In-run compass calibration: 0 starts, 1 stops and gives results, 2 stores, 3 queries."""
    _sized(payload, 1)
    command = payload[0]
    if command > 3:
        raise RequestRefusedError(ERROR_PARAMETER)
    if (command == 2) != (device.phase == "config"):
        raise RequestRefusedError(ERROR_MESSAGE)
    running = device.run.state.representative_motion
    if command == 3:
        return bytes([3, running])
    if command == 1:
        device.change(representative_motion=False)
        return struct.pack(">BfBB", 1, 0.42 if running else 0.0, 2, 0 if running else 2)  # 2: not enough data
    if command == 0:
        device.change(representative_motion=True)
    return payload


def forward_gnss_data(device: XbusSimulator, payload: bytes, now: int) -> bytes:
    """Whole RTCM 3 messages (D3, 10 bits of length, content, 3 bytes of checksum); a partial one is refused. Other data
    goes to the receiver unchanged: RTCM is the document's example of forwarded data.
    """
    if payload and payload[0] != RTCM:
        return b""
    at = 0
    while at < len(payload):
        if payload[at] != RTCM or len(payload) < at + 6:
            raise RequestRefusedError(ERROR_MESSAGE)
        at += 6 + ((payload[at + 1] & 3) << 8 | payload[at + 2])
    if at != len(payload) or not payload:
        raise RequestRefusedError(ERROR_MESSAGE)
    return b""


def request_data(device: XbusSimulator, payload: bytes, now: int) -> None:
    """Send the latest sample if SendLatest waits for the software line."""
    _empty(payload)
    if SOFTWARE not in device.send_latest:
        raise RequestRefusedError(ERROR_MESSAGE)
    device.send_newest()


Action = Callable[["XbusSimulator", bytes, int], bytes | None]


@dataclass(frozen=True, slots=True)
class Handler:
    """Handler of a message, with the states and products it applies to."""

    phases: tuple[str, ...]
    action: Action
    products: frozenset[int] = ALL


_CONFIG, _MEASUREMENT, _BOTH = ("config",), ("measurement",), ("config", "measurement")

ACTIONS: Mapping[int, Handler] = {
    0x3F: Handler(("wake-up",), wake_up_ack),
    0x30: Handler(_BOTH, go_to_config),
    0x02: Handler(_CONFIG, init_bus),
    0x90: Handler(_CONFIG, emts),
    0x10: Handler(_CONFIG, go_to_measurement),
    0x40: Handler(_BOTH, reset),
    0x0E: Handler(_CONFIG, restore_factory),
    0x00: Handler(_CONFIG, device_id),
    0x1C: Handler(_CONFIG, product_code),
    0x1E: Handler(_CONFIG, hardware_version),
    0x12: Handler(_CONFIG, firmware),
    0x24: Handler(_CONFIG, selftest),
    OPTIONS: Handler(_CONFIG, option_flags),
    0x0C: Handler(_CONFIG, configuration),
    0xC0: Handler(_CONFIG, output_configuration),
    SYNC: Handler(_CONFIG, sync_settings),
    ALIGNMENT: Handler(_CONFIG, alignment),
    0x62: Handler(_CONFIG, filter_profiles, FILTER),
    0x34: Handler(_MEASUREMENT, request_data),
    0xA4: Handler(_BOTH, reset_orientation, FILTER),
    0x22: Handler(_MEASUREMENT, no_rotation, FILTER),
    0x60: Handler(_CONFIG, utc_time),
    0xA8: Handler(_CONFIG, adjust_utc_time),
    0x74: Handler(_BOTH, icc_command, FILTER),
    0xE2: Handler(_MEASUREMENT, forward_gnss_data, RTK),
}
"""Message number → the states in which it is valid, and its handler."""
