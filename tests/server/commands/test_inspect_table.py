"""The table of `imuscope inspect`: units and names, and no terminal control characters."""

import io
import json
import struct
from pathlib import Path

from imuscope.protocols.idtp.custom_payloads import parse
from imuscope.protocols.idtp.frames import LITE, SAFETY, build
from imuscope.protocols.isb.frames import DATA
from imuscope.protocols.isb.frames import build as isb_packet
from imuscope.protocols.xbus.frames import build as xbus_frame
from imuscope.server.commands.inspect import inspect_file
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.text.printable import json_text, printable
from tests.support.decode_options import decode_options
from tests.support.each_row import each_row

SCHEMA = """
[[message]]
type = 0x80
name = "Wheels"
[[message.field]]
name = "Speed"
type = "i16"
count = 2
unit = "m/s"
scale = 0.001
"""
STEERING = "\x1b]0;owned\x07\x85\x9b2J\u2028\u202e"


def rows(data: bytes, path: Path, reading: DecodeOptions, text_format: str = "table") -> list[str]:
    path.write_bytes(data)
    inspect_file(path, out := io.StringIO(), reading, text_format=text_format)  # type: ignore[arg-type]
    lines = out.getvalue().split("\n")
    return lines[1:-1] if text_format == "table" else lines[:-1]


def test_version_33_mode_1_and_bare_numbers(tmp_path: Path) -> None:
    frame = build(0, struct.pack("<3f", 0.5, -1.25, 9.81), sequence=3, timestamp=2000, device=7, mode=SAFETY)
    (row,) = rows(frame, tmp_path / "a.bin", DecodeOptions("idtp"))
    assert "version 2.1 (33)  mode Safety (1)  acc_x 0.5 m/s²  acc_y -1.25 m/s²  acc_z 9.81 m/s²" in row


def test_irregularities_are_described_in_words(tmp_path: Path) -> None:
    quaternion = build(6, struct.pack("<4f", 2, 0, 0, 0), mode=LITE)
    short = build(0, bytes(4), sequence=1, mode=LITE)
    nan = build(0, struct.pack("<3f", float("nan"), float("inf"), 0), sequence=2, mode=LITE)
    first, second, third = rows(quaternion + short + nan, tmp_path / "a.bin", DecodeOptions("idtp"))
    assert "(the norm of the quaternion is not 1)" in first
    assert "(shorter than its type: not decoded)" in second
    assert "acc_x nan m/s²  acc_y inf m/s²  acc_z 0 m/s²  (a value is not a number)" in third


def test_described_types_are_in_their_unit(tmp_path: Path) -> None:
    frame = build(0x80, struct.pack("<2h", 1500, -20), mode=SAFETY)
    (row,) = rows(frame, tmp_path / "a.bin", decode_options("idtp", schema=parse(SCHEMA)))
    assert "Speed [1.5, -0.02] m/s" in row
    (line,) = rows(frame, tmp_path / "a.bin", decode_options("idtp", schema=parse(SCHEMA)), "jsonl")
    assert json.loads(line)["fields"]["Speed"] == [1500, -20], "wire values for programs"


def test_items_of_an_mti_have_units_and_choices(tmp_path: Path) -> None:
    items = bytes.fromhex("0810 04 41A80000") + bytes.fromhex("1060 04 00003039") + bytes.fromhex("3010 04 00018B0A")
    baud = xbus_frame(0x19, bytes.fromhex("02"))
    first, second = rows(xbus_frame(0x36, items) + baud, tmp_path / "a.bin", DecodeOptions("xbus"))
    assert "Temperature 21 °C" in first
    assert "SampleTimeFine 12345 × 0.1 ms" in first
    assert "BaroPressure 101130 Pa" in first
    assert "115" in second, "a code of a rate is its rate"


def test_records_of_inertial_sense_have_units(tmp_path: Path) -> None:
    (row,) = rows(
        isb_packet(DATA, 58, struct.pack("<dI6f", 12.5, 0, *(0.25,) * 6)), tmp_path / "a.bin", DecodeOptions("isb")
    )
    assert "time 12.5 s" in row
    assert "I.pqr [14.3239, 14.3239, 14.3239] °/s  I.acc [0.25, 0.25, 0.25] m/s²" in row


def test_device_text_cannot_control_the_terminal(tmp_path: Path) -> None:
    """A device's own name may hold any byte, also the beginning of an escape sequence in one byte (0x9B)."""
    data = xbus_frame(0x1D, b"MTi-630" + STEERING[:12].encode("latin-1").ljust(13)) * 3
    for text_format in ("table", "jsonl"):
        lines = rows(data, tmp_path / "a.bin", DecodeOptions("xbus"), text_format)
        assert all(line.isprintable() for line in lines)
        if text_format == "jsonl":
            (text,) = json.loads(lines[0])["fields"].values()
            assert "\x1b" in text, "and is the same for a program"


@each_row("text", [STEERING, "plain", "µT °/s — “quoted”", "\ud83d", "a\nb", "😀\U000e0001"])
def test_nothing_invisible_is_printed(text: str) -> None:
    assert printable(text).isprintable()
    assert json.loads(json_text({"text": text})) == {"text": text}
    assert json_text({"text": text}).isprintable()
    assert "°" in printable("21 °C")
    assert json_text([1], indent=1).count("\n") == 2


def test_elements_of_a_part_of_an_array_are_named(tmp_path: Path) -> None:
    """A part printed "theta [11.4592, 17.1887]" without which two."""
    part = isb_packet(DATA, 4, struct.pack("<2f", 0.2, 0.3), offset=24)
    [line] = rows(part, tmp_path / "part.bin", decode_options("isb"))
    assert "theta [pitch 11.4592, yaw 17.1887] °" in line


def test_a_text_that_grew_ends_at_its_length(tmp_path: Path) -> None:
    """Four bytes of newer firmware made "hello" a text with 251 zero bytes in it."""
    payload = struct.pack("<II256s", 0, 0, b"hello") + bytes.fromhex("11223344")
    packet = isb_packet(DATA, 72, payload)
    [line] = rows(packet, tmp_path / "text.bin", decode_options("isb"))
    assert line.endswith("message hello")
    [record] = rows(packet, tmp_path / "text.bin", decode_options("isb"), "jsonl")
    assert json.loads(record)["wire"]["unknown"] == {"264": "11223344"}
