"""`imuscope inspect`: one line per frame, from which the frame can be composed."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.framing.stream_buffer import REASONS
from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.frames import get_data, set_data, stop
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.xbus.frames import build
from imuscope.protocols.xbus.json_codec import frame_from_json
from imuscope.server.commands.inspect import inspect_file
from imuscope.server.commands.inspect_table import explained_rejects
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.errors import UsageError
from tests.protocols.xbus.xbus_vectors import everything
from tests.support.decode_options import decode_options
from tests.support.each_row import each_row

SENTENCE = b"$HCHDM,123.45,M*18\r\n"


def lines_of(path: Path, reading: DecodeOptions = DecodeOptions("auto"), **options: Any) -> list[dict[str, Any]]:  # noqa: B008
    out = io.StringIO()
    inspect_file(path, out, reading, text_format="jsonl", **options)
    return [json.loads(line) for line in out.getvalue().splitlines()]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A counter, a sentence, a damaged frame, a frame with another bus identifier."""
    good = build(0x36, bytes.fromhex("1020020007E02004 00000003"))
    bad = bytearray(build(0x36, bytes.fromhex("1020020008")))
    bad[-1] ^= 1
    path = tmp_path / "capture.bin"
    path.write_bytes(good + SENTENCE + bytes(bad) + build(0x31, bid=1) + good * 20)
    return path


def test_jsonl(file: Path) -> None:
    first, sentence, second, *_ = lines_of(file)
    assert first == {
        "offset": 0,
        "size": 17,
        "protocol": "xbus",
        "id": 54,
        "message": "MTData2",
        "fields": {"PacketCounter": 7, "StatusWord": 3},
        "flags": {"StatusWord": ["Selftest", "FilterValid"]},
    }
    assert (sentence["offset"], sentence["size"], sentence["protocol"], sentence["id"]) == (17, 20, "nmea", None)
    assert sentence["message"] == "HCHDM"
    assert second["message"] == "GoToConfigAck"
    assert second["wire"] == {"bid": 1}


def test_rejects_are_shown_on_request(file: Path) -> None:
    assert not [line for line in lines_of(file) if "reject" in line]
    (reject,) = [line for line in lines_of(file, rejects=True) if "reject" in line]
    assert reject == {"offset": 37, "size": 10, "reject": "bad_checksum"}


def test_table(file: Path) -> None:
    out = io.StringIO()
    inspect_file(file, out, rejects=True)
    head, first, sentence, reject, *_ = out.getvalue().splitlines()
    assert head.split() == ["offset", "size", "message", "fields"]
    assert first.endswith("PacketCounter 7  StatusWord 3 (Selftest, FilterValid)")
    assert "nmea HCHDM" in sentence
    assert reject.endswith("bad_checksum: the checksum does not match")


def test_every_vector_comes_back(tmp_path: Path) -> None:
    """frame_of of each line returns the frame byte for byte, without any other part of the file."""
    frames = list(everything())
    path = tmp_path / "all.bin"
    path.write_bytes(b"".join(frames))
    lines = lines_of(path, DecodeOptions("xbus"))
    assert [frame_from_json(line) for line in lines] == frames


@each_row(
    ("payload", "wire"),
    [
        ("1020020001 1020020002", {"items": [[0x1020, 2], [0x1020, 2]], "repeated": [[0, 1]]}),
        ("0811040551F7CF", {"items": [[0x0811, 4]]}),
        ("E08008 0000000000000005", {"items": [[0xE080, 8]]}),
        ("1020020001 E02004 0000", {"trailing": "e020040000"}),
    ],
)
def test_details_are_shown_beyond_names(tmp_path: Path, payload: str, wire: dict[str, Any]) -> None:
    path = tmp_path / "one.bin"
    path.write_bytes(build(0x36, bytes.fromhex(payload)))
    (line,) = lines_of(path, DecodeOptions("xbus"))
    assert line["wire"] == wire
    assert frame_from_json(line) == path.read_bytes()


def test_extended_header_and_nan(tmp_path: Path) -> None:
    path = tmp_path / "one.bin"
    path.write_bytes(build(0x36, bytes.fromhex("0810047FC00001"), extended=True))
    (line,) = lines_of(path, DecodeOptions("xbus"))
    assert line["wire"] == {"extended": True}
    assert line["fields"] == {"Temperature": {"f32": "7fc00001"}}
    assert frame_from_json(line) == path.read_bytes()


def test_capture(captures: Path) -> None:
    """All frames of a real capture are listed and lead back to their bytes."""
    path = captures / "xbus" / "mti_float32_satinfo_ecef.bin"
    if not path.is_file():
        pytest.skip(f"no capture {path.name}")
    data = path.read_bytes()
    lines = lines_of(path)
    assert len(lines) == 100
    for line in lines:
        assert frame_from_json(line) == data[line["offset"] : line["offset"] + line["size"]]


def test_unknown_bytes(tmp_path: Path) -> None:
    path = tmp_path / "noise.bin"
    path.write_bytes(bytes(1000))
    with pytest.raises(UsageError, match="no known protocol"):
        lines_of(path)
    with pytest.raises(UsageError, match="unknown protocol 'x'"):
        lines_of(path, DecodeOptions("x"))


# -- the other families ------------------------------------------------------------------------------------------------

KEY = bytes(range(16))


def test_isb_both_ways(tmp_path: Path) -> None:
    path = tmp_path / "imx.bin"
    path.write_bytes(IsbSimulator().advance(2_000_000_000))
    first, *others = lines_of(path)
    assert (first["message"], first["fields"]["serialNumber"]) == ("DID_DEV_INFO", 62_000)
    assert {line["protocol"] for line in others} == {"isb"}
    path.write_bytes(get_data(4, period=2) + set_data(12, bytes(4), 16) + stop())
    names = [line["message"] for line in lines_of(path, direction="tx")]
    assert names == ["GET_DATA", "SET_DID_FLASH_CONFIG", "STOP_BROADCASTS_CURRENT_PORT"]


def test_idtp_keys_modes_and_replays(tmp_path: Path) -> None:
    path = tmp_path / "idtp.bin"
    secure = IdtpSimulator(mode=2, key=KEY).advance(200_000_000)
    path.write_bytes(secure + IdtpSimulator(mode=1, device_id=7).advance(100_000_000))
    assert {line["reject"] for line in lines_of(path, rejects=True) if "reject" in line} == {"no_key"}
    lines = lines_of(path, decode_options("auto", key=KEY), rejects=True)
    assert {line["reject"] for line in lines if "reject" in line} == {"below_min_mode"}
    lines = lines_of(path, decode_options("auto", key=KEY, min_mode="safety"), rejects=True)
    assert not [line for line in lines if "reject" in line or "verified" in line]
    assert {line["reject"] for line in lines_of(path, decode_options("idtp", key=b"x"), rejects=True)} >= {"bad_hmac"}
    shown = [line for line in lines_of(path, decode_options("idtp", unverified=True)) if line["fields"]["mode"] == 2]
    assert {line["verified"] for line in shown} == {False}
    path.write_bytes(secure + secure)
    assert "stale" in {line.get("reject") for line in lines_of(path, decode_options("idtp", key=KEY), rejects=True)}
    twice = lines_of(path, decode_options("idtp", key=KEY, no_replay_check=True))
    assert len(twice) == 2 * len(lines_of(path, decode_options("idtp", key=KEY)))


def test_a_mixed_file_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "mixed.bin"
    path.write_bytes(IsbSimulator().advance(2_000_000_000) + IdtpSimulator().advance(300_000_000))
    notes = io.StringIO()
    inspect_file(path, io.StringIO(), notes=notes)
    assert "mixed.bin also has messages of IDTP 2.1; it is listed as Inertial Sense" in notes.getvalue()
    long = IsbSimulator().advance(10_000_000_000)
    path.write_bytes(long + IdtpSimulator().advance(50_000_000) + long)  # neither at its beginning nor at its end
    inspect_file(path, io.StringIO(), notes=(notes := io.StringIO()))
    assert "also has messages of IDTP 2.1" in notes.getvalue()
    path.write_bytes(IsbSimulator().advance(2_000_000_000))
    inspect_file(path, io.StringIO(), notes=(quiet := io.StringIO()))
    assert quiet.getvalue() == ""


def test_every_reason_is_explained() -> None:
    results = {reason for family in PROTOCOLS.values() for reason in explained_rejects(family)}
    assert results == set(REASONS) - {""}


def test_the_table_explains_codes_and_identifiers(tmp_path: Path) -> None:
    """They were bare decimals: "code 4", "data_identifier 4128", the name of a device as one number of 19 digits."""
    label = bytes.fromhex("8080000100000000")  # of Configuration: the low word first
    configuration = (label + bytes(90) + label).ljust(118, b"\0")
    frames = [
        build(0x42, b"\x04"),
        build(0xC1, bytes.fromhex("1020FFFF402A0064")),
        build(0x0D, configuration),
        build(0x01, bytes.fromhex("0000000080800001")),
        build(0x01, bytes.fromhex("0080003A")),
    ]
    (tmp_path / "a.bin").write_bytes(b"".join(frames))
    out = io.StringIO()
    inspect_file(tmp_path / "a.bin", out, DecodeOptions("xbus"))
    _, error, outputs, report, long, short = out.getvalue().splitlines()
    assert "code message invalid (4)" in error
    assert "data_identifier 0x1020 (" in outputs
    assert "data_identifier 0x402A (" in outputs
    assert "master_device_id 0080800001 " in report
    assert " device_id 0080800001 " in report
    assert long.endswith("device_id 0080800001")
    assert short.endswith("device_id 0080003A")
    first, *_ = lines_of(tmp_path / "a.bin", DecodeOptions("xbus"))
    assert first["fields"] == {"code": 4}  # from which the frame is made again


def test_bytes_that_belong_to_nothing_are_counted_with_the_place_to_search(tmp_path: Path) -> None:
    """Records that no decoder recognised vanished: no line, no reject, no word."""
    good = build(0x36, bytes.fromhex("1020020007"))
    path, notes = tmp_path / "a.bin", io.StringIO()
    path.write_bytes(good + SENTENCE + b"\x00\x90\x01" + good + b"\x05")
    inspect_file(path, io.StringIO(), DecodeOptions("xbus"), notes=notes)
    assert f"4 of {2 * len(good) + 24} bytes belong to no accepted frame" in notes.getvalue()
    assert f"offset {len(good) + len(SENTENCE)}." in notes.getvalue()
    path.write_bytes(good + SENTENCE)
    inspect_file(path, io.StringIO(), DecodeOptions("xbus"), notes=(quiet := io.StringIO()))
    assert quiet.getvalue() == ""


def test_the_table_shows_every_form_of_a_quantity(tmp_path: Path) -> None:
    """Only the last of two coordinate systems was listed."""
    payload = bytes.fromhex("201010" + "3F800000" + "00" * 12 + "201410" + "00000000" + "3F800000" + "00" * 8)
    (tmp_path / "a.bin").write_bytes(build(0x36, payload))
    inspect_file(tmp_path / "a.bin", out := io.StringIO(), DecodeOptions("xbus"))
    assert "Quaternion [0, 1, 0, 0]  (also Quaternion 0x2010 [1, 0, 0, 0])" in out.getvalue()
