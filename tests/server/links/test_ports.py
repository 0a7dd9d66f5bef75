"""The list of serial ports, and listening on the free ones."""

import io
import json
import os
from pathlib import Path

import pytest

from imuscope.server.links import ports
from imuscope.server.links.base import ScanWindows
from tests.server.links.link_fixtures import device, pty


class Comport:
    """Port information as pyserial gives it."""

    def __init__(self, device: str, **known: object) -> None:
        self.device = device
        self.__dict__.update({"vid": None, "pid": None, "description": "n/a", **known})


def test_ports_are_described_by_maker_and_product(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Device nodes without a UART (ttyS1) are not ports, neither here nor in `doctor`."""
    monkeypatch.setattr(ports, "SYS_TTY", str(tmp_path))
    for name, uart in (("ttyS0", "4"), ("ttyS1", "0")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(uart + "\n")
    results = [
        Comport("/dev/ttyUSB10", vid=0x0403, pid=0x6001, product="FT232R USB UART", serial_number="A50285BI"),
        Comport("/dev/ttyUSB2", vid=0x2639, pid=0x0301, product="MTi converter", serial_number="DB1ABC"),
        Comport("/dev/ttyACM0", vid=0x1234, pid=0x0001, manufacturer="Robots Ltd", product="Probe"),
        Comport("/dev/ttyACM1", vid=0x1234, pid=0x0002),
        Comport("/dev/ttyS0", description="ttyS0"),
        Comport("/dev/ttyS1", description="ttyS1"),
    ]
    monkeypatch.setattr(ports.system_ports, "comports", lambda: results)
    monkeypatch.setattr(ports, "BOARD_PORTS", ())
    listed = ports.list_ports(in_use=["/dev/ttyACM0"])
    assert [(info.device, info.description) for info in listed] == [
        ("/dev/ttyACM0", "Robots Ltd Probe"),
        ("/dev/ttyACM1", "USB 1234:0002 USB serial port"),
        ("/dev/ttyS0", "ttyS0"),
        ("/dev/ttyUSB2", "Xsens USB converter, serial DB1ABC"),
        ("/dev/ttyUSB10", "FTDI FT232R USB UART, serial A50285BI"),
    ]
    assert listed[0].busy == "a session of this server"
    assert not listed[1].busy


async def test_scan_listens_on_free_ports_and_leaves_the_others_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    with device(921_600) as bench, pty() as silent, pty() as batch, pty() as refused:
        monkeypatch.setattr(ports, "holder", lambda path: "minicom (process 7)" if path == batch.path else "")
        monkeypatch.setattr(ports.os, "access", lambda path, mode: path != refused.path)
        os.chown(refused.path, -1, 20)
        os.chmod(refused.path, 0o660)
        messages: list[str] = []
        infos = await ports.scan(
            [bench.slave, silent.path, batch.path, refused.path, "/dev/ttyNope"],
            progress=lambda device, one: messages.append(device),
            windows=ScanWindows(0.6, 0.05),  # a busy machine lets a device wait for 0.1 s
        )
        speaking, quiet, busy, denied, absent = infos
        assert [one.what for one in speaking.attempts] == ["115 200 Bd", "921 600 Bd"]
        assert "Xbus frame" in speaking.attempts[-1].outcome
        assert quiet.attempts[-1].outcome == "0 B at every rate: is it powered, and set to send?"
        assert busy.busy == "minicom (process 7)"
        assert busy.attempts[0].outcome == "In use by minicom (process 7)."
        assert "usermod -aG" in denied.denied
        assert "There is no port /dev/ttyNope." in absent.attempts[0].outcome
        assert set(messages) == {info.device for info in infos}
        # The session's own link is left alone even when its source is another name of the same port.
        (mine,) = await ports.scan([bench.slave], in_use=[os.path.realpath(bench.slave)])
        assert mine.busy == "a session of this server"


def test_print_ports(monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    monkeypatch.setattr(ports, "list_ports", lambda in_use=(): [])
    ports.print_ports(out)
    assert "No serial port is present." in out.getvalue()

    with device(115_200) as bench:
        info = ports.PortInfo(bench.slave, "FTDI adapter")
        monkeypatch.setattr(ports, "list_ports", lambda in_use=(): [info])
        out = io.StringIO()
        ports.print_ports(out)
    lines = out.getvalue().splitlines()
    assert lines[0] == f"{bench.slave}  FTDI adapter"
    assert "115 200 Bd: " in lines[-1]
    assert "Xbus frame" in lines[-1]


def test_ports_are_a_list_for_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    listed = [ports.PortInfo("/dev/ttyX", "FTDI adapter", busy="minicom")]
    for infos in ([], listed):
        monkeypatch.setattr(ports, "list_ports", lambda in_use=(), infos=infos: infos)
        out = io.StringIO()
        ports.print_ports(out, as_json=True)
        assert [one["device"] for one in json.loads(out.getvalue())] == [one.device for one in infos]
