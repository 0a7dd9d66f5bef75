"""Payloads without a definition, too short or too long for their type: exports have all their bytes."""

from __future__ import annotations

import base64
import csv
import json
import math
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from imuscope.protocols.idtp.frames import SAFETY, build
from imuscope.protocols.isb.frames import DATA
from imuscope.protocols.isb.frames import build as isb_packet
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.exporters import ExportRequest, export
from imuscope.recordings.importers.open_file import open_file
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.extensions.rerun.rrd.chunks import name_of
from imuscope.server.library.decode import decode
from tests.server.extensions.rerun.rrd_tables import column, entities

COUNT = 30
OWN = [bytes([k, 0xAA]) * (1 + k % 3) for k in range(COUNT)]  # of three lengths
SHORT = [bytes([k, 1, 2, 3]) for k in range(COUNT)]
REST = [bytes([k, 0xEE]) for k in range(COUNT)]


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> ColumnStore:
    """A device that sends a vendor type, an Imu3Acc that is too short and an Imu3Gyr that is too long."""
    folder = tmp_path_factory.mktemp("payloads")
    frames = []
    for k in range(COUNT):
        for which, (kind, payload) in enumerate(((0x80, OWN[k]), (0, SHORT[k]), (1, bytes(12) + REST[k]))):
            number = 3 * k + which
            frames.append(build(kind, payload, timestamp=number * 1000, sequence=number, device=7, mode=SAFETY))
    (folder / "a.bin").write_bytes(b"".join(frames))
    return decode(open_file(folder / "a.bin", "idtp"), folder / "store", all_protocols(), DecodeOptions("idtp"))


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


def test_csv_has_the_bytes_of_undescribed_payloads(opened: ColumnStore, tmp_path: Path) -> None:
    made = export("csv", ExportRequest(opened), tmp_path / "x.csv")
    assert sorted(path.name for path in made) == ["x_0x80.csv", "x_Imu3AccBytes.csv", "x_Imu3Gyr.csv"]
    rows = {path.name: rows_of(path) for path in made}
    assert [row["data"] for row in rows["x_0x80.csv"]] == [one.hex() for one in OWN]
    assert {row["0x80Status"] for row in rows["x_0x80.csv"]} == {"1"}
    assert [row["data"] for row in rows["x_Imu3AccBytes.csv"]] == [one.hex() for one in SHORT]
    assert [row["Imu3GyrRest"] for row in rows["x_Imu3Gyr.csv"]] == [one.hex() for one in REST]
    assert [int(row["sequence"]) for row in rows["x_0x80.csv"]] == list(range(0, 3 * COUNT, 3))


def test_parquet_has_the_bytes(opened: ColumnStore, tmp_path: Path) -> None:
    made = {path.name: pq.read_table(path) for path in export("parquet", ExportRequest(opened), tmp_path / "x.parquet")}
    assert made["x_0x80.parquet"]["data"].to_pylist() == OWN
    assert made["x_Imu3AccBytes.parquet"]["data"].to_pylist() == SHORT
    assert made["x_Imu3Gyr.parquet"]["Imu3GyrRest"].to_pylist() == REST


def test_mcap_has_the_bytes_as_its_schema_states(opened: ColumnStore, tmp_path: Path) -> None:
    (made,) = export("mcap", ExportRequest(opened), tmp_path / "x.mcap")
    results: dict[str, list[bytes]] = {}
    with made.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.topic.endswith("/bytes"):
                assert schema is not None
                assert json.loads(schema.data)["properties"]["data"]["contentEncoding"] == "base64"
                topic = channel.topic.partition("/")[2].partition("/")[2]
                results.setdefault(topic, []).append(base64.b64decode(json.loads(message.data)["data"]))
    assert results == {"0x80/bytes": OWN, "Imu3AccBytes/bytes": SHORT, "Imu3Gyr/Imu3GyrRest/bytes": REST}


def test_one_table_has_the_bytes(opened: ColumnStore, tmp_path: Path) -> None:
    """A line for each sample of the fastest; of the others the last value before it."""
    (made,) = export("csv-aligned", ExportRequest(opened), tmp_path / "x.csv")
    rows = list(csv.DictReader(made.read_text().splitlines()[1:]))
    for name in ("0x80.data", "Imu3AccBytes.data", "Imu3GyrRest"):
        (heading,) = (head for head in rows[0] if head.endswith(name))
        expected = {"0x80.data": OWN, "Imu3AccBytes.data": SHORT, "Imu3GyrRest": REST}[name]
        results = list(dict.fromkeys(row[heading] for row in rows if row[heading]))
        assert results == [one.hex() for one in expected[-len(results) :]] or results == [
            one.hex() for one in expected[:-1]
        ]
        assert len(results) >= COUNT - 1


def test_rerun_has_the_bytes(opened: ColumnStore, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (made,) = export("rrd", ExportRequest(opened, title="r.mcap"), tmp_path / "x.rrd")
    assert capfd.readouterr().err == "", "Rerun warned of the dot in the name of the file"
    (result,) = [batches for path, batches in entities(made).items() if path.endswith(name_of(("0x80 bytes",)))]
    texts = [text for lists in column(result, "TextLog:text") for (text,) in lists.to_pylist()]
    assert texts == [one.hex(" ") for one in OWN]


def test_a_part_and_chosen_channels_have_their_bytes_alone(opened: ColumnStore, tmp_path: Path) -> None:
    expected = tuple(info["id"] for info in opened.manifest["channels"] if info["message"] == "0x80")
    (made,) = export("csv", ExportRequest(opened, channels=expected), tmp_path / "x.csv")
    assert [row["data"] for row in rows_of(made)] == [one.hex() for one in OWN]
    lo, hi = opened.span() or (math.nan, math.nan)
    wish = ExportRequest(opened, t0=lo + (hi - lo) / 2, channels=expected)
    (made,) = export("csv", wish, tmp_path / "y.csv")
    messages = [row["data"] for row in rows_of(made)]
    assert 13 <= len(messages) <= 17
    assert messages == [one.hex() for one in OWN[-len(messages) :]]


def test_data_sets_without_a_public_layout_are_exported(tmp_path: Path) -> None:
    """Such replies contain only bytes, so there is no other channel."""
    payloads = [bytes([k]) * 24 for k in range(20)]
    packets = [isb_packet(DATA, 250, one) for one in payloads]
    (tmp_path / "a.bin").write_bytes(b"".join(packets))
    store = decode(open_file(tmp_path / "a.bin", "isb"), tmp_path / "store", all_protocols(), DecodeOptions("isb"))
    (made,) = export("csv", ExportRequest(store), tmp_path / "x.csv")
    assert [row["data"] for row in rows_of(made)] == [one.hex() for one in payloads]
