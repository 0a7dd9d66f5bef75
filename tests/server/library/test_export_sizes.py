"""Estimated export sizes are close to the real ones, for every family and column format."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings.exporters import FORMATS, ExportRequest, export
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library import export_sizes
from imuscope.server.library.decode import decode
from imuscope.server.library.export_worker import one_file
from tests.recordings.recorded_drive import START
from tests.support.each_row import each_row

SECONDS = 14
STEP_NS = 50_000_000


def recorded(folder: Path, device: Any, protocol: str) -> ExportRequest:
    """A device that streams, recorded and decoded."""
    writer = McapWriter(folder / "drive.mcap", {"title": "A drive"})
    writer.device("1", {"source": "/dev/ttyUSB0", "link": "serial", "baud": 921600, "protocol": protocol})
    for now in range(STEP_NS, SECONDS * 1_000_000_000, STEP_NS):
        if data := device.advance(now):
            writer.chunk("1", "rx", data, START + now)
    writer.close()
    source = open_file(folder / "drive.mcap")
    return ExportRequest(decode(source, folder / "store", protocol_set.all_protocols()), folder / "drive.mcap", "drive")


@each_row("protocol", ["xbus", "isb", "idtp"])
def test_the_estimated_size_is_that_of_the_file_within_30_percent(protocol: str, tmp_path: Path) -> None:
    device: Any = {"xbus": XbusSimulator(measuring=True), "isb": IsbSimulator(), "idtp": IdtpSimulator()}[protocol]
    wish = recorded(tmp_path, device, protocol)
    first, _ = wish.columns.span() or (0.0, 0.0)
    for part in (wish, replace(wish, t0=first + 3, t1=first + 9)):
        message = export_sizes.sizes(part, tmp_path)
        assert set(message) == {name for name, one in FORMATS.items() if not one.needs_source}
        for export_format, size in message.items():
            out = tmp_path / export_format
            out.mkdir(exist_ok=True)
            made = export(export_format, part, out / f"drive{FORMATS[export_format].suffix}")
            assert size == pytest.approx(one_file(made, out, "zip").stat().st_size, rel=0.3), export_format
    (received,) = export_sizes.received_bytes(wish).values()
    (bytes_,) = export("bytes", wish, tmp_path / "drive.bin")
    assert received == pytest.approx(bytes_.stat().st_size, rel=0.02)
