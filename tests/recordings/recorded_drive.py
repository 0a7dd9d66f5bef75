"""Recording of a simulated drive."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings.mcap.writer import McapWriter

START = 1_760_000_000_000_000_000


def drive(
    path: Path,
    seconds: float = 4.0,
    *,
    named: bool = True,
    signals: Mapping[str, str] | None = None,
    started_ns: int = START,
) -> bytes:
    """Records an MTi that streams, in chunks of 10 ms, with a hole of 50 ms; the bytes that were kept.

    Args:
        signals: expressions of computed signals by name.
        started_ns: time of its beginning, unix ns.
    """
    device = XbusSimulator(start_ns=0)
    writer = McapWriter(path, {"title": "A drive"})
    writer.device(
        "1", {"source": "/dev/ttyUSB0", "link": "serial", "baud": 921600, "protocol": "xbus" if named else ""}
    )
    if signals:
        rows = [{"name": name, "expression": expression} for name, expression in signals.items()]
        writer.computed_signals("1", {"signals": rows, "address": ""}, started_ns)
    stored = b""
    for n in range(1, round(seconds * 100)):
        data = device.advance(n * 10_000_000)
        if not 200 <= n < 205 and data:
            writer.chunk("1", "rx", data, started_ns + n * 10_000_000)
            stored += data
    writer.chunk("1", "tx", b"\xfa\xff\x30\x00\xd1", started_ns + 1)
    writer.write_note("marker", "bump", started_ns + 2_000_000_000)
    writer.event({"kind": "link", "level": "info", "text": "Opened.", "device": "1"}, started_ns)
    writer.event({"kind": "gap", "level": "error", "text": "told live", "device": "1"}, started_ns)
    writer.close()
    return stored
