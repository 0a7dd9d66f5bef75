"""The grammar of sources: accepted forms, and errors for others."""

from pathlib import Path

import pytest

from imuscope.server.links.base import LinkError
from imuscope.server.links.capture_file import FileLink
from imuscope.server.links.serial import SerialLink, SerialSettings
from imuscope.server.links.simulator import SimulatorLink
from imuscope.server.links.source_url import SourceUrl, open_link
from imuscope.server.links.tcp import TcpLink, TcpListenLink
from imuscope.server.links.udp import UdpLink
from tests.support.each_row import each_row


@each_row(
    ("text", "kind", "place"),
    [
        ("/dev/ttyUSB0", "serial", "/dev/ttyUSB0"),
        ("/dev/null", "serial", "/dev/null"),
        ("COM3", "serial", "COM3"),
        ("serial:///dev/ttyUSB0?baud=9600", "serial", "/dev/ttyUSB0"),
        ("serial://COM3", "serial", "COM3"),
        ("serial:///dev/serial/by-id/usb-a%20b", "serial", "/dev/serial/by-id/usb-a b"),
        ("tcp://robot.local:4001", "tcp", "robot.local:4001"),
        ("tcp-listen://:4001", "tcp-listen", ":4001"),
        ("UDP://:4001", "udp", ":4001"),
        ("capture.bin", "file", "capture.bin"),
        ("capture.bin?speed=2", "file", "capture.bin"),
        ("/run/robot/imu?baud=9600", "serial", "/run/robot/imu"),  # that is not there yet
        ("file:///data/capture.bin", "file", "/data/capture.bin"),
        ("sim:xbus?rate=400", "simulator", "xbus"),
    ],
)
def test_kinds(text: str, kind: str, place: str) -> None:
    source = SourceUrl.parse(text)
    assert (source.kind, source.place) == (kind, place)


def test_an_existing_file_is_opened_whatever_its_name(tmp_path: Path) -> None:
    odd = tmp_path / "tcp:what?speed=4"
    odd.write_bytes(b"x")
    assert SourceUrl.parse(str(odd)) == SourceUrl(str(odd), "file", str(odd), {})


def test_line_settings() -> None:
    link = open_link("serial:///dev/ttyUSB0?baud=921600&bits=7&parity=even&stop=2&flow=rtscts")
    assert isinstance(link, SerialLink)
    assert link.line == SerialSettings(921_600, 7, "even", 2.0, "rtscts")
    assert link.line.capacity(921_600) == pytest.approx(921_600 / 11)
    assert SerialSettings().capacity(115_200) == 11_520
    assert SerialSettings(stop=1.5, bits=5).capacity(750) == 100


def test_each_kind_of_link(tmp_path: Path) -> None:
    assert isinstance(open_link("/dev/ttyUSB0?baud=9600"), SerialLink)
    tcp = open_link("tcp://[fe80::1]:4001")
    assert isinstance(tcp, TcpLink)
    assert (tcp.host, tcp.port, tcp.place) == ("fe80::1", 4001, "[fe80::1]:4001")
    listener = open_link("tcp-listen://:0")
    assert isinstance(listener, TcpListenLink)
    assert (listener.host, listener.port) == ("", 0)
    assert isinstance(open_link("udp://127.0.0.1:4001"), UdpLink)
    file = open_link(f"{tmp_path}/x.bin?speed=4&loop")
    assert isinstance(file, FileLink)
    assert (file.speed, file.loop) == (4, True)
    simulator = open_link("sim:xbus?rate=400&drop=0.01&burst_ms=16&baud=921600")
    assert isinstance(simulator, SimulatorLink)
    assert simulator.options.rate == 400
    assert (simulator.options.faults.drop, simulator.options.faults.burst_ms, simulator.options.faults.baud) == (
        0.01,
        16,
        921_600,
    )
    assert simulator.options.product == "MTi-630"


@each_row(
    ("text", "words"),
    [
        ("", ["empty"]),
        ("http://robot:80", ["http", "serial, tcp, tcp-listen, udp", "foxglove, file, sim"]),
        ("seriel:///dev/ttyUSB0", ["seriel", "Did you mean serial?"]),
        ("tcp://", ["nothing follows"]),
        ("tcp://robot", ["port is missing", "tcp://host:port"]),
        ("tcp://robot:0", ["port is '0'", "from 1 to 65535"]),
        ("tcp://robot:99999", ["99999", "from 1 to 65535"]),
        ("tcp://robot:80x", ["80x"]),
        ("tcp://:80", ["host is missing"]),
        ("tcp://fe80::1:80", ["[fe80::1]:80"]),
        ("tcp://robot:80?speed=1", ["'speed'", "Any source has"]),
        ("udp://:-1", ["-1", "from 0 to 65535"]),
        ("serial:///dev/ttyUSB0?bauds=9600", ["'bauds'", "Did you mean baud?", "flow"]),
        ("serial:///dev/ttyUSB0?baud=fast", ["'fast'", "from 50 to 12 000 000 Bd"]),
        ("serial:///dev/ttyUSB0?baud=nan", ["'nan'"]),
        ("serial:///dev/ttyUSB0?baud=9600.5", ["whole number"]),
        ("serial:///dev/ttyUSB0?baud=9600&baud=4800", ["baud", "twice"]),
        ("serial:///dev/ttyUSB0?parity=maybe", ["'maybe'", "none, even, odd, mark, space"]),
        ("serial:///dev/ttyUSB0?stop=3", ["'3'", "1, 1.5, 2"]),
        ("serial:///dev/ttyUSB0?flow=both", ["'both'", "rtscts"]),
        ("capture.bin?speed=0", ["speed is '0'", "from 0.01 to 1 000"]),
        ("capture.bin?loop=maybe", ["loop is 'maybe'"]),
        ("sim:abc", ["'abc'", "xbus"]),
        ("sim:xbus?drop=2", ["drop is '2'", "from 0 to 1"]),
        ("sim:xbus?dorp=0.1", ["dorp", "Did you mean drop?"]),
    ],
)
def test_errors_name_the_allowed_values(text: str, words: list[str]) -> None:
    with pytest.raises(LinkError) as caught:
        open_link(text)
    error = caught.value
    assert error.kind == "bad-source"
    assert error.message.endswith(".")
    assert error.hint
    for word in words:
        assert word in str(error)
