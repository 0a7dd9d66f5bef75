"""A file, and a recording of its bytes as they arrive: the same clock, date, units, rates and number of rows; and no
column that depends on which fields happen to be there.
"""

import json
import lzma
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

import imuscope
from imuscope.protocols.embedded.nmea import sentence
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.mcap.writer import McapWriter
from tests.recordings.tables.field_files import field_file
from tests.support.each_row import each_row
from tests.support.server_process import ROOT

GOLDEN = ROOT / "tests" / "golden"
N, START = 60, 1_772_445_600


def file_of(name: str, folder: Path) -> Path:
    if not name.startswith("golden/"):
        return field_file(name)
    path = GOLDEN / name.removeprefix("golden/")
    if path.suffix != ".xz":
        return path
    unpacked = folder / path.stem
    unpacked.write_bytes(lzma.decompress(path.read_bytes()))
    return unpacked


def recorded(path: Path, folder: Path) -> Path:
    """A recording of the bytes of a file, as they arrive."""
    source, out = open_file(path), folder / "recorded.mcap"
    writer = McapWriter(out, {"title": path.name})
    protocol = source.devices["1"].protocol
    writer.device("1", {"source": "/dev/ttyACM0", "link": "serial", "baud": 921600, "protocol": protocol})
    for block in source.parts():
        begin = 0
        for end, time in zip(block.ends.tolist(), block.times.tolist(), strict=True):
            writer.chunk("1", "rx", block.data[begin:end], time)
            begin = end
    writer.close()
    return out


@each_row(
    "name",
    [
        *("golden/isb/logs/log.raw.xz", "c16_gnss.nmea", "c31_ros_covariance.raw", "c32_idtp_wrap.bin"),
        *("nmea_rmc_cog_empty.nmea", "nmea_crcrlf.nmea"),
    ],
)
def test_a_recording_of_a_file_is_what_the_file_is(name: str, tmp_path: Path) -> None:
    path = file_of(name, tmp_path)
    with imuscope.open(path) as source, imuscope.open(recorded(path, tmp_path)) as again:
        signals = {(one.message, one.name): one for one in again.signals}
        assert {(one.message, one.name) for one in source.signals} == signals.keys()
        for one in source.signals:
            back = signals[one.message, one.name]
            assert (back.columns, back.units, len(back)) == (one.columns, one.units, len(one)), one.name
            times, theirs = (np.where(np.isnan(each.time), each.arrival, each.time) for each in (one, back))
            assert abs(theirs[0] - times[0]) < 0.1, one.name  # the date, up to the delay of its first bytes
            if len(times) > 1:
                assert np.ptp(theirs) == pytest.approx(np.ptp(times), rel=0.01, abs=0.1), one.name


def written_nmea(path: Path) -> Path:
    """Sentences of which some have empty fields, or lack their last one."""
    lines = [
        sentence(text)
        for n in range(N)
        for text in (
            f"GPRMC,1000{n:02}.00,A,4800.0,N,01100.0,E,0.02,{'' if n % 3 else 90.0},020326,,,A",
            f"PABC,{n},{'' if n % 3 else n * 2},{n}.5",
            f"GPXYZ,{'' if n < 10 else n},,{n}" + (",7" if n % 4 == 0 else ""),
        )
    ]
    path.write_bytes(b"".join(lines))
    return path


def written_lines(path: Path) -> Path:
    """Lines of JSON with other members each."""
    rows = [
        {"time": START + n / 50, **({"ax": n} if n % 2 else {"gx": 1}), **({"temperature": 20} if n > 30 else {})}
        for n in range(N)
    ]
    path.write_text("".join(f"{json.dumps(one)}\n" for one in rows))
    return path


def written_messages(path: Path) -> Path:
    """Messages in JSON, some members of which are absent, with lists of any length."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("Thing", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/thing", "json", schema)
        for n in range(N):
            body = {"a": n, "b": {"x": 1.0, **({"y": n} if n % 2 else {})}, "list": [1, 2, 3][: n % 4]}
            time = (START * 50 + n) * 20_000_000
            writer.add_message(channel, time, json.dumps(body).encode(), time)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("written", "name"), [(written_nmea, "a.nmea"), (written_lines, "a.jsonl"), (written_messages, "a.mcap")]
)
def test_an_absent_field_is_a_value_in_its_column(written: object, name: str, tmp_path: Path) -> None:
    assert callable(written)
    with imuscope.open(written(tmp_path / name)) as opened:
        names = [(one.message, one.name) for one in opened.signals]
        assert len({*names}) == len(names)
        assert {len(one) for one in opened.signals} == {N}
