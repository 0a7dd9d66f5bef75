"""A simulated MTi: its output and its answers."""

from __future__ import annotations

import copy
import functools
import struct
from typing import Any

from imuscope.protocols.events import Event
from imuscope.protocols.xbus import frames
from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from tests.protocols.decoding import decode_chunks, run

S = 10**9


def decode(data: bytes) -> list[Event]:
    return decode_chunks(XbusDecoder(), [(0, data)])


def replies(data: bytes) -> list[tuple[int, bytes]]:
    """Message number and payload of all frames but MTData2."""
    result, at = [], 0
    while at < len(data):
        head = 6 if data[at + 3] == 0xFF else 4
        size = data[at + 3] if head == 4 else struct.unpack_from(">H", data, at + 4)[0]
        assert sum(data[at + 1 : at + head + size + 1]) & 0xFF == 0
        if data[at + 2] != frames.MTDATA2:
            result.append((data[at + 2], data[at + head : at + head + size]))
        at += head + size + 1
    return result


def reply_to(device: XbusSimulator, mid: int, payload: bytes = b"", now: int = 2 * S) -> tuple[int, bytes]:
    """Send one message; the one answer."""
    answers = replies(device.receive(frames.build(mid, payload), now))
    assert len(answers) == 1, answers
    return answers[0]


def in_config(product: str = "MTi-630", **options: Any) -> XbusSimulator:
    """A device that has measured for a second and then was sent GoToConfig."""
    return copy.deepcopy(_in_config(product, tuple(options.items())))


@functools.cache
def _in_config(product: str, options: tuple[tuple[str, Any], ...]) -> XbusSimulator:
    device = XbusSimulator(product, **dict(options))
    run(device, 1)
    assert reply_to(device, 0x30, now=1 * S) == (0x31, b"")
    return device
