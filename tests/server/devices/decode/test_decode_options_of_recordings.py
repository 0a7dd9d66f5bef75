"""Decode options of a device also apply to its recordings: unit of time, rotation, vendor types, key."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.idtp.custom_payloads import parse, written
from imuscope.protocols.idtp.frames import SAFETY, SECURE, build
from imuscope.recordings.importers.open_file import open_file
from imuscope.server.devices.decode.decode_options import DecodeOptions, recorded
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.library.column_cache import ColumnCache
from imuscope.server.library.decode import decode
from tests.support.decode_options import decode_options
from tests.support.server_process import imuscope

KEY = bytes(range(16))
SCHEMA = """
[[message]]
type = 0x80
name = "Wheels"
doc = "Odometry \\"as sent\\", µm."
[[message.field]]
name = "Speed"
type = "i16"
count = 4
axes = ["fl", "fr", "rl", "rr"]
unit = "m/s"
scale = 0.001
decimals = 2
[[message.field]]
name = "Steering"
type = "f32"
bias = 1.5
"""
OPTIONS = decode_options(schema=parse(SCHEMA), time_unit="ms", rotation="body_from_enu")


def capture(folder: Path, mode: int = SAFETY) -> Path:
    """Half a minute of a device with timestamps in ms."""
    path = folder / "a.bin"
    frames = (build(0x80, bytes(12), timestamp=100 * k, sequence=k, device=7, mode=mode, key=KEY) for k in range(300))
    path.write_bytes(b"".join(frames))
    return path


def test_a_schema_is_written_as_it_is_read() -> None:
    assert parse(written(parse(SCHEMA))) == parse(SCHEMA)


def test_the_first_device_seen() -> None:
    """Priority: options given for this file, then those in the recording, then the server's defaults."""
    about: dict[str, Any] = {"time_unit": "s", "rotation": "nonsense"}

    def settings(options: DecodeOptions, about: dict[str, Any], usual: DecodeOptions) -> dict[str, Any]:
        return recorded(options, about, usual).settings("idtp")

    assert settings(DecodeOptions(), about, OPTIONS)["time_unit"] == "ms", "nothing of a recording that makes no sense"
    assert settings(DecodeOptions(), {"time_unit": "s"}, OPTIONS)["time_unit"] == "s"
    assert settings(decode_options(time_unit="us"), {"time_unit": "s"}, OPTIONS)["time_unit"] == "us"
    assert settings(decode_options(key=b"own"), {}, decode_options(key=b"usual"))["key"] == b"own"
    assert "key" not in settings(DecodeOptions(), {"key": "00"}, OPTIONS), "a recording gives no key"


def test_an_uploaded_capture_is_decoded_with_the_servers_options(tmp_path: Path) -> None:
    source = open_file(capture(tmp_path), "idtp")
    columns = decode(source, tmp_path / "store", all_protocols(), DecodeOptions(), usual=OPTIONS)
    assert {info["name"] for info in columns.manifest["channels"]} == {"Speed", "Steering", "WheelsStatus"}
    columns = decode(source, tmp_path / "other", all_protocols(), DecodeOptions())
    assert {info["name"] for info in columns.manifest["channels"]} == {"0x80Status"}


def test_the_cache_reports_to_its_process(tmp_path: Path) -> None:
    capture(tmp_path, SECURE)
    report = decode_options(key=KEY, schema=parse(SCHEMA))

    async def names(usual: DecodeOptions) -> set[str]:
        shelf = ColumnCache(tmp_path / "data", lambda name: tmp_path / f"{name}.bin", usual)
        try:
            return {info["name"] for info in (await shelf.opened("a")).manifest["channels"]}
        finally:
            await shelf.close()

    assert asyncio.run(names(report)) == {"Speed", "Steering", "WheelsStatus"}
    assert asyncio.run(names(DecodeOptions())) == set(), "read in another way it is another store"


@pytest.fixture
def schema(tmp_path: Path) -> Path:
    path = tmp_path / "wheels.toml"
    path.write_text(SCHEMA)
    return path


def test_a_recording_stores_its_decode_options(tmp_path: Path, schema: Path) -> None:
    made = tmp_path / "r.mcap"
    source = f"{capture(tmp_path)}?speed=1000&rotation=body_from_enu"
    done = imuscope("record", source, "--schema", str(schema), "-o", str(made))
    assert done.returncode == 0, done.stderr
    (device,) = open_file(made).devices.values()
    assert device.identity["rotation"] == "body_from_enu"
    done = imuscope("decode", str(made), "-o", str(tmp_path / "x.csv"))
    assert done.stdout.split() == [str(tmp_path / "x_Wheels.csv")]
