"""Messages of GNSS receivers: a log of them and a recording of the same bytes have one clock, date and rate."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from imuscope.protocols.embedded.nmea import sentence
from imuscope.protocols.framing.checksums import fletcher16
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode
from tests.recordings.tables.field_files import field_file
from tests.support.each_row import each_row

UTC = 1_772_445_600  # 2026-03-02 10:00:00
LEAPS, GPS_EPOCH, WEEK_S = 18, 315_964_800, 604_800
ARRIVAL = 1_795_878_236_000_000_000


def stored(path: Path, folder: Path) -> ColumnStore:
    return decode(open_file(path), folder / f"{path.name} columns", protocol_set.all_protocols())


def recorded(path: Path, pieces: list[bytes], protocol: str) -> Path:
    """A recording of a stream whose pieces come every 0.1 s, up to 4 ms late."""
    writer = McapWriter(path, {"title": "A receiver"})
    writer.device("1", {"source": "/dev/ttyACM0", "link": "serial", "protocol": protocol})
    for number, piece in enumerate(pieces):
        writer.chunk("1", "rx", piece, ARRIVAL + number * 100_000_000 + number * 7919 % 4_000_000)
    writer.close()
    return path


def ubx(group: int, number: int, payload: bytes) -> bytes:
    body = bytes((group, number)) + len(payload).to_bytes(2, "little") + payload
    return b"\xb5\x62" + body + fletcher16(np.frombuffer(body, np.uint8), 0, len(body)).to_bytes(2, "little")


def gps(at: float) -> tuple[int, int]:
    """Week and time of week, ms."""
    week, tow = divmod(UTC + at + LEAPS - GPS_EPOCH, WEEK_S)
    return int(week), round(tow * 1000)


def rmc(at: float) -> bytes:
    course = "" if round(at * 10) % 4 == 0 else "91.0"
    return sentence(f"GPRMC,1000{at:05.2f},A,4800.0,N,01100.0,E,0.02,{course},020326,,,A")


def zda_and_gga(at: float) -> bytes:
    gga = sentence(f"GNGGA,1000{at:05.2f},4800.0,N,01100.0,E,1,08,1.0,5.0,M,47.0,M,,")
    return gga + (sentence(f"GNZDA,1000{at:05.2f},02,03,2026,00,00") if at == round(at) else b"")


def vectornav(at: float) -> bytes:
    week, tow = gps(at)
    return sentence(f"VNINS,{tow / 1000:.4f},{week},0004,1,2,3,48.0,11.0,5.0,0,0,0,0,0,0")


def posecef(at: float) -> bytes:
    return ubx(0x01, 0x01, struct.pack("<IiiiI", gps(at)[1], 1, 2, 3, 4))


def time_gps(at: float) -> bytes:
    week, tow = gps(at)
    return posecef(at) + ubx(0x01, 0x20, struct.pack("<IihbBI", tow, 0, week, LEAPS, 7, 20))


def time_utc(at: float) -> bytes:
    second, nano = divmod(round(at * 1000), 1000)
    body = struct.pack("<IIiHBBBBBB", gps(at)[1], 20, nano * 1_000_000, 2026, 3, 2, 10, 0, second, 7)
    return posecef(at) + ubx(0x01, 0x21, body)


def not_valid_yet(at: float) -> bytes:
    """The date of a receiver before it knows it is not taken."""
    early = struct.pack("<IIiHBBBBBB", gps(at)[1], 20, 0, 2015, 10, 18, 0, 0, 0, 0)
    return posecef(at) + (ubx(0x01, 0x21, early) if at < 0.3 else time_utc(at))


def pulse(at: float) -> bytes:
    week, tow = gps(at + 1)
    return posecef(at) + ubx(0x0D, 0x01, struct.pack("<IIiHBB", tow, 0, 0, week, 0, 0))


@each_row("message", [rmc, zda_and_gga, vectornav, time_gps, time_utc, not_valid_yet, pulse])
def test_a_receiver_has_one_axis_as_a_file_and_as_a_recording(
    message: Callable[[float], bytes], tmp_path: Path
) -> None:
    """Regression: GPS weeks and valid UTC were no date, and a recording had the arrival as axis and no UTC."""
    pieces = [message(number / 10) for number in range(100)]
    capture = tmp_path / f"{message.__name__}.bin"
    capture.write_bytes(b"".join(pieces))
    file = stored(capture, tmp_path)
    protocol = open_file(capture).devices["1"].protocol
    own = stored(recorded(tmp_path / f"{message.__name__}.mcap", pieces, protocol), tmp_path)
    assert [one["message"] for one in own.manifest["channels"]] == [one["message"] for one in file.manifest["channels"]]
    for info, other in zip(file.manifest["channels"], own.manifest["channels"], strict=True):
        rows, again = file.exact(info["id"], 0, 1000), own.exact(other["id"], 0, 1000)
        assert len(rows) == len(again) > 5
        assert rows.time[0] == pytest.approx(UTC, abs=0.15)
        steps = np.diff(rows.time)
        np.testing.assert_allclose(np.diff(again.time), steps, atol=1e-3)
        assert np.isclose(steps, steps[0], atol=1e-6).all() or len(rows) > 100
    clocks = [one for one in own.manifest["clocks"] if any(column["name"] == "utc" for column in one["columns"])]
    utc = own.exact(clocks[0]["id"], 0, 1000).columns[-1]
    assert utc[-1] == pytest.approx(UTC + 9.9, abs=1e-6) or message is zda_and_gga


def test_a_recorded_receiver_has_its_utc(tmp_path: Path) -> None:
    store = stored(field_file("recorded_nmea_has_utc.mcap"), tmp_path)
    [info] = store.manifest["channels"]
    rows = store.exact(info["id"], 0, 1000)
    np.testing.assert_allclose(np.diff(rows.time), 0.1, atol=1e-4)
    [clock] = store.manifest["clocks"]
    np.testing.assert_allclose(store.exact(clock["id"], 0, 1000).columns[-1], UTC + np.arange(100) / 10, atol=1e-6)


@each_row("name", ["nmea_rmc_cog_empty.nmea", "nmea_crcrlf.nmea"])
def test_every_sentence_of_a_log_is_a_row_of_one_message(name: str, tmp_path: Path) -> None:
    store = stored(field_file(name), tmp_path)
    assert [one["message"] for one in store.manifest["channels"]] == ["GPGGA", "GPRMC"]
    for info in store.manifest["channels"]:
        rows = store.exact(info["id"], 0, 100)
        np.testing.assert_allclose(rows.time, UTC + np.arange(60), atol=1e-6)


@each_row("suffix", ["nmea", "txt", "log", "csv"])
@each_row("head", [b"# a receiver\n" * 100, b"\xef\xbb\xbf# one\r\n\r\n", b"\n\n# two\n"])
def test_a_short_log_under_comments_is_of_sentences(suffix: str, head: bytes, tmp_path: Path) -> None:
    """Regression: some lines of comments hid eight sentences."""
    path = tmp_path / f"log.{suffix}"
    path.write_bytes(head + b"".join(rmc(float(k)) for k in range(8)))
    [info] = stored(path, tmp_path).manifest["channels"]
    assert info["message"] == "GPRMC"
