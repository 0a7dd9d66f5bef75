"""Frames round-trip through the real command line, and texts become the intended frame."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.embedded.nmea import sentence
from imuscope.protocols.idtp.frames import LITE, SAFETY, build
from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.commands.commands import manual
from imuscope.server.commands.compose import ComposeError, composers, find_composer, frame_of, frames_of, parse
from imuscope.server.commands.inspect import inspect_file
from imuscope.server.devices.decode.decode_options import DecodeOptions, checked_options
from tests.support.decode_options import decode_options
from tests.support.each_row import each_row
from tests.support.server_process import imuscope
from tests.support.source_files import ROOT

GOLDEN = ROOT / "tests" / "golden"
KEY = bytes(range(32))
S = 10**9


def composed(message: str, *pairs: str, protocol: str = "", key: bytes | None = None) -> str:
    known = DeviceContext(settings={"key": key} if key else {})
    spoken = composers(decode_options(key=key) if key else DecodeOptions())
    return frame_of(find_composer(spoken, message, protocol, pairs), message, pairs, known)[0].hex()


def both_ways(data: bytes, path: Path, reading: DecodeOptions, **how: Any) -> None:
    """compose(inspect(frame)) is the frame, for every frame of some bytes."""
    path.write_bytes(data)
    inspect_file(path, out := io.StringIO(), reading, text_format="jsonl", **how)
    lines = out.getvalue().splitlines()
    assert lines
    frames = frames_of(lines, composers(reading))
    for line, frame in zip(lines, frames, strict=True):
        record = json.loads(line)
        assert frame == data[record["offset"] : record["offset"] + record["size"]], line


# -- both ways ---------------------------------------------------------------------------------------------------------


def _vectors(name: str) -> list[dict[str, Any]]:
    document = json.loads((GOLDEN / name).read_text())
    return document if isinstance(document, list) else document["vectors"]


@each_row("name", ["commands.json", "data.json"])
def test_every_golden_packet_of_inertial_sense(name: str, tmp_path: Path) -> None:
    packets = [bytes.fromhex(row["packet_hex"]) for row in _vectors(f"isb/{name}") if row.get("packet_hex")]
    assert len(packets) > 20
    for number, packet in enumerate(packets):
        both_ways(packet, tmp_path / f"{number}.bin", DecodeOptions("isb"))


def test_every_golden_message_of_xsens(tmp_path: Path) -> None:
    frames = [bytes.fromhex(row["message_hex"]) for row in _vectors("xbus/commands.json") if row.get("message_hex")]
    assert len(frames) > 100
    for number, frame in enumerate(frames):
        both_ways(frame, tmp_path / f"{number}.bin", DecodeOptions("xbus"), direction="tx")


def test_every_golden_frame_of_idtp(tmp_path: Path) -> None:
    for number, row in enumerate(_vectors("idtp/vectors.json")):
        key = bytes.fromhex(row["key_hex"]) if row["key_hex"] else None
        reading = decode_options("idtp", key=key or "", min_mode="lite", no_replay_check=True)
        both_ways(bytes.fromhex(row["frame_hex"]), tmp_path / f"{number}.bin", reading)


def test_simulators_compose_with_forwarded_data(tmp_path: Path) -> None:
    isb = IsbSimulator().advance(3 * S)
    both_ways(isb + sentence("INFO,1,2") + isb, tmp_path / "isb.bin", DecodeOptions("isb"))
    both_ways(XbusSimulator().advance(2 * S), tmp_path / "xbus.bin", DecodeOptions("xbus"))
    both_ways(IdtpSimulator(mode=2, key=KEY).advance(S), tmp_path / "idtp.bin", decode_options("idtp", key=KEY))


@each_row("name", ["mti_float32.bin", "mti_float32_satinfo_ecef.bin"])
def test_a_capture_through_the_real_command_line(name: str, captures: Path) -> None:
    file = captures / "xbus" / name
    if not file.is_file():
        pytest.skip(f"no capture {name}")
    _through_the_command_line(file)


def test_files_through_the_real_command_line(tmp_path: Path) -> None:
    _through_the_command_line(GOLDEN / "xbus" / "sample.mtb")
    log = tmp_path / "imx.raw"
    log.write_bytes(IsbSimulator(vibration=1.0).advance(8 * S))
    _through_the_command_line(log)


def _through_the_command_line(file: Path) -> None:
    listed = imuscope("inspect", str(file), "--format", "jsonl")
    assert listed.returncode == 0, listed.stderr
    back = imuscope("compose", "--jsonl", "-", stdin=listed.stdout.encode())
    assert back.returncode == 0, back.stderr
    data = file.read_bytes()
    records = [json.loads(line) for line in listed.stdout.splitlines()]
    frames = [bytes.fromhex(line) for line in back.stdout.splitlines()]
    assert frames == [data[one["offset"] : one["offset"] + one["size"]] for one in records]
    assert records


# -- words -------------------------------------------------------------------------------------------------------------


def _arguments(row: dict[str, Any]) -> tuple[str, Sequence[str]] | None:
    """A command vector in command line form; None for messages that a device sends."""
    what, args = row["what"], row["args"]
    name = args.get("did_name", "")
    if what == "get_data":
        return "GET_DATA", [
            f"{part}={args[key]}"
            for part, key in zip(("id", "size", "offset", "period"), ("did", "size", "offset", "period"), strict=True)
        ]
    if what == "set_data_offset" or what == "mag_recal_multi_axis":
        return f"SET_{name}", [f"{args['field']}={json.dumps(args['value'])}"]
    if what.startswith("rmc_preset"):
        return f"DID_RMC.{what.removeprefix('rmc_preset_')}", []
    if what.startswith("rmc_"):
        return "SET_DID_RMC", [f"bits={args['bits']}", f"options={args['options']}"]
    system = {
        "save_persistent": "SAVE_PERSISTENT_MESSAGES",
        "software_reset": "SOFTWARE_RESET",
        "save_flash": "SAVE_FLASH",
    }
    if what in system:
        return f"DID_SYS_CMD.{system[what]}", []
    stops = {"stop_broadcasts_all_ports": "STOP_BROADCASTS_ALL_PORTS"}
    stops["stop_broadcasts_current_port"] = "STOP_BROADCASTS_CURRENT_PORT"
    return (stops[what], []) if what in stops else None


def test_the_commands_of_inertial_sense_in_words() -> None:
    requests = [(row, _arguments(row)) for row in _vectors("isb/commands.json")]
    written = [(row, words) for row, words in requests if words]
    assert len(written) >= 36
    for row, (message, pairs) in ((row, words) for row, words in written if words):
        assert composed(message, *pairs, protocol="isb") == row["packet_hex"], row["what"]


def test_the_frames_of_idtp_in_words() -> None:
    for row in _vectors("idtp/vectors.json"):
        fields, key = row["fields"], row["key_hex"]
        names = ("timestamp", "sequence", "device_id", "version", "mode")
        pairs = [f"{name}={fields[name]}" for name in names]
        pairs += [f"type={fields['payload_type']}", f"data={fields['payload_hex']}"]
        assert composed("Frame", *pairs, key=bytes.fromhex(key) if key else None) == row["frame_hex"], row["what"]


def test_names_stand_for_numbers() -> None:
    assert composed("SET_DID_FLASH_CONFIG", "dynamicModel=AIRBORNE_4G") == "ef49250c0300400008b4d1"
    flags = composed("SET_DID_FLASH_CONFIG", "sysCfgBits=BITS_DISABLE_LEDS|BITS_AUTO_MAG_RECAL")
    assert flags == composed("SET_DID_FLASH_CONFIG", "sysCfgBits=0x14")
    assert bytes.fromhex(composed("$STPB")) == b"$STPB*15\r\n"
    assert bytes.fromhex(composed("STPC")) == b"$STPC*14\r\n"
    pairs: tuple[str, ...] = ("messages.0.id=PPIMU", "messages.0.period=1")
    pairs += ("messages.1.id=PINS2", "messages.1.period=10", "messages.2.id=GNGGA", "messages.2.period=1")
    assert bytes.fromhex(composed("ASCE", *pairs)) == b"$ASCE,0,2,1,5,10,7,1*39\r\n"  # the document's example


def test_a_command_with_two_forms_needs_no_suffix() -> None:
    """Only "SetFilterProfile (modern)" took a label, and only the long name a rate of the sentences."""
    for name in ("SetFilterProfile", "SetFilterProfile (modern)"):
        assert bytes.fromhex(composed(name, "profile=Robust/VRU"))[4:-1] == b"Robust/VRU"
    assert bytes.fromhex(composed("SetFilterProfile", "profile=39"))[4:-1] == bytes([0, 39])
    for name in ("SetStringOutputType", "SetStringOutputType (600-series)"):
        assert bytes.fromhex(composed(name, "string_types=0x400", "frequency=5"))[4:-1].hex() == "000004000005"
    assert bytes.fromhex(composed("SetStringOutputType", "string_types=0x400"))[4:-1].hex() == "0400"


@each_row(
    ("message", "field", "words", "value"),
    [
        ("SET_DID_FLASH_CONFIG", "gnssSatSigConst", "GPS|GAL", 0x0033),  # was 0x0011: the lowest bit of each group
        ("SET_DID_FLASH_CONFIG", "gnssSatSigConst", "GPS|SBS|GLO=OFF", 0x1003),
        ("SET_DID_GPX_FLASH_CFG", "gnssSatSigConst", "GPS=L1|GAL_E5|BDS", 0x00E1),
        (
            "SET_DID_FLASH_CONFIG",
            "ioConfig",
            "GPS1_SOURCE=SER1|GPS2_TYPE=GPX|G15_STROBE_INPUT",
            4 << 16 | 3 << 25 | 1 << 11,
        ),
        ("SET_DID_FLASH_CONFIG", "ioConfig", "G6G7_COM1, IO_CONFIG_G1G2_CAN_BUS", 0x44),
        ("SET_DID_FLASH_CONFIG", "ioConfig", '["IO_CONFIG_GPS1_SOURCE: SER1", "IO_CONFIG_GPS1_NO_INIT"]', 0x41000),
        ("SET_DID_FLASH_CONFIG", "sensorConfig", "SENSOR_ROTATION=180_0_0", 8 << 16),  # was 0x8, a gyro range
        ("SET_DID_FLASH_CONFIG", "sysCfgBits", "SYS_CFG_BITS_BOR_THRESHOLD=LEVEL_2|DISABLE_LEDS", 2 << 22 | 16),
        ("SET_DID_FLASH_CONFIG", "platformConfig", "TYPE=RUG3_G2|PRESET=RUG3_7_S1_RS232_S2_GPS1_S0_GPS2", 0x70A),
        ("SET_DID_GPX_FLASH_CFG", "sysCfgBits", "BOR_THRESHOLD=LEVEL_1", 1 << 22),
        ("SET_DID_RMC", "options", "PORT_SER0|PORT_SER1|PERSISTENT", 0x203),  # bits 0 and 1 were a speed filter
        ("SET_DID_RMC", "options", "NMEA_SPEED_FILTER=DISABLE", 0x800),
        ("SET_DID_GPX_RMC", "bits", "GPS1_POS", 0x20),  # was bit 10 of an IMX, which is GPS1_VERSION here
        ("SET_DID_GPX_RMC", "bits", "GRMC_BITS_GPS1_POS|GRMC_BITS_GPS2_RTK_CMP_REL", 0x200020),
        ("SET_DID_RMC", "bits", "GPS1_POS", 0x400),
    ],
)
def test_names_of_groups_stand_for_their_bits(message: str, field: str, words: str, value: int) -> None:
    assert composed(message, f"{field}={words}") == composed(message, f"{field}={value}")


@each_row(
    ("field", "words", "message"),
    [
        ("ioConfig", "GPS1_SOURCE", "GPS1_SOURCE needs a value, as in GPS1_SOURCE=…: DISABLE, SER0, SER1, SER2"),
        ("ioConfig", "GPS1_SOURCE=SER7", "GPS1_SOURCE is one of DISABLE, SER0, SER1, SER2, given 'SER7'"),
        ("ioConfig", "GPS1_SOURCE=1", "GPS1_SOURCE is one of DISABLE, SER0, SER1, SER2, given '1'"),
        ("ioConfig", "GPS1_SOURCE=SER0|GPS1_SOURCE=SER1", "ioConfig has GPS1_SOURCE twice: give it one value"),
        ("sensorConfig", "SENSOR_ROTATION_1_2_3", "sensorConfig has no flag 'SENSOR_ROTATION_1_2_3'; nearest are:"),
        ("sysCfgBits", "MAG_RECAL_MODE=9", "MAG_RECAL_MODE is one of DO_NOTHING, MULTI_AXIS, SINGLE_AXIS, given '9'"),
    ],
)
def test_names_that_no_group_has_are_refused_with_those_it_has(field: str, words: str, message: str) -> None:
    with pytest.raises(ComposeError) as refused:
        composed("SET_DID_FLASH_CONFIG", f"{field}={words}")
    assert message in str(refused.value)


def test_angles_may_be_typed_in_degrees_where_they_state_it() -> None:
    radians = composed("SET_DID_FLASH_CONFIG", "insRotation=[0,0,1.5707963267948966]")
    assert composed("SET_DID_FLASH_CONFIG", "insRotation=[0,0,90deg]") == radians
    assert composed("SET_DID_FLASH_CONFIG", "insRotation=0, 0, 90°") == radians
    with pytest.raises(ComposeError, match="startupNavDtMs must be a number"):
        composed("SET_DID_FLASH_CONFIG", "startupNavDtMs=90deg")


def test_the_inverse_of_a_system_command_need_not_be_typed() -> None:
    """A form asked for both numbers of which one follows from the other."""
    assert composed("SET_DID_SYS_CMD", "command=97") == composed("DID_SYS_CMD.SAVE_FLASH")


def test_paths_lead_into_lists() -> None:
    pairs = ("outputs.0.data_identifier=0x1020", "outputs.0.output_frequency=65535")
    whole = composed("SetOutputConfiguration", 'outputs=[{"data_identifier": 4128, "output_frequency": 65535}]')
    assert composed("SetOutputConfiguration", *pairs) == whole == "faffc0041020ffff0f"


@each_row(
    ("words", "message"),
    [
        (["SetOutputConfigurationn"], "nearest are: SetOutputConfiguration"),
        (["SET_DID_FLASH_CONFIG", "startupNavDt=1"], "nearest are: startupNavDtMs"),
        (["SET_DID_FLASH_CONFIG", "dynamicModel=AIRBORNE"], "nearest are: AIRBORNE_"),
        (["SET_DID_FLASH_CONFIG", "startupGPSDtMs=100"], "lies between 200 and 4294967295 ms, given 100"),
        (["SET_DID_FLASH_CONFIG", "startupNavDtMs"], "is not valid; write it as FIELD=VALUE"),
        (["GET_DATA", "id=no"], "is not an allowed value"),
        (["SetOutputConfiguration", "outputs.1.data_identifier=1"], "the next is outputs.0"),
    ],
)
def test_unknown_names_are_answered_with_the_nearest(words: list[str], message: str) -> None:
    with pytest.raises(ComposeError, match=message):
        composed(words[0], *words[1:])


def test_invalid_requests_exit_with_status_1_and_one_line() -> None:
    done = imuscope("compose", "NoSuchThing")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.count("\n") == 1
    assert "unknown message: 'NoSuchThing'" in done.stderr
    done = imuscope("compose", "--jsonl", "-", stdin=b'{"protocol":"isb","message":"GET_DATA","fields":{}}\n')
    assert (done.returncode, done.stderr) == (1, "imuscope: line 1: id is missing.\n")


def test_values_without_a_field() -> None:
    assert parse([], ()) == {}
    with pytest.raises(ComposeError, match="this message has no fields"):
        parse(["a=1"], ())


def test_a_bare_type_number_becomes_a_safety_frame() -> None:
    """`compose 0x80` wanted a protocol, and made a Lite frame where named types make Safety frames."""
    frame = bytes.fromhex(composed("0x80", "device_id=7", "data=0102"))
    assert frame == build(0x80, b"\1\2", device=7, mode=SAFETY)
    assert composed("0x80", "data=0102", "mode=Lite", protocol="idtp") == build(0x80, b"\1\2", mode=LITE).hex()
    with pytest.raises(ComposeError, match="0x80 is a number in several protocols; add --protocol xbus or idtp"):
        composed("0x80", "data=0102")
    assert composed("0x80", "data=0102", protocol="xbus").startswith("faff80")


def shown_by_inspect(frame: str, path: Path, reading: DecodeOptions) -> str:
    path.write_bytes(bytes.fromhex(frame))
    inspect_file(path, out := io.StringIO(), reading)
    return out.getvalue().splitlines()[-1]


@each_row(
    ("typed", "shown"),
    [
        ("function=4 line=7 pulse_width=10 delay_offset_or_clock_period=-1.5", "pulse_width 10 ms"),
        ("function=3 line=2 pulse_width=0.1 delay_offset_or_clock_period=6000", "pulse_width 0.1 ms"),
    ],
)
def test_a_number_is_typed_in_the_unit_in_which_it_is_listed_and_shown(tmp_path: Path, typed: str, shown: str) -> None:
    """10 typed for a pulse of 10 ms made one of 1 ms."""
    frame = composed("SetSyncSettings", *(f"settings.0.{pair}" for pair in typed.split()))
    assert shown in shown_by_inspect(frame, tmp_path / "a.bin", DecodeOptions("xbus"))
    text = "\n".join(manual(DecodeOptions("xbus"), "SetSyncSettings"))
    assert "pulse_width  u2, ms, 0 to 6553.5, in steps of 0.1" in text
    assert "with function 4 or 14: Offset, ms, -3000 to 3000, in steps of 0.1" in text
    words = bytes.fromhex(frame)[14:16]
    assert words == {"1": (65_536 - 15).to_bytes(2, "big"), "0": (60_000).to_bytes(2, "big")}[shown.split()[1][0]]


def test_a_number_between_two_steps_or_out_of_range_is_refused_in_its_unit() -> None:
    for typed, words in (("10.05", "multiple of 0.1 ms, given 10.05"), ("7000", "0 and 6553.5 ms, given 7000 ms")):
        with pytest.raises(ComposeError, match=words):
            composed("SetSyncSettings", "settings.0.function=4", "settings.0.line=7", f"settings.0.pulse_width={typed}")


def test_numbers_of_a_vendors_own_message_are_typed_in_their_unit(tmp_path: Path) -> None:
    """w=[1,2] m/s was sent as 0.01 and 0.02, and 1.5 was refused as not whole."""
    schema = (
        '[[message]]\ntype = 0x80\nname = "WheelSpeed"\n[[message.field]]\nname = "w"\ntype = "i16"\ncount = 2\n'
        'unit = "m/s"\nscale = 0.01\n'
    )
    reading = checked_options("idtp", {"schema": schema})
    assert "w  i2 × 2, m/s, -327.68 to 327.67, in steps of 0.01" in "\n".join(manual(reading, "WheelSpeed"))
    every = composers(reading)
    for pairs in (["w=[1.5,-2]"], ["w=1.5, -2"], ["w.0=1.5", "w.1=-2"]):
        frame, values = frame_of(find_composer(every, "WheelSpeed"), "WheelSpeed", pairs)
        assert values["w"] == [150, -200]
        assert "w [1.5, -2] m/s" in shown_by_inspect(frame.hex(), tmp_path / "a.bin", reading)
    with pytest.raises(ComposeError, match=r"w is a multiple of 0.01 m/s, given 1.555"):
        frame_of(find_composer(every, "WheelSpeed"), "WheelSpeed", ["w=[1.555,0]"])


def test_a_data_message_is_composed_by_the_names_of_its_items() -> None:
    """MTData2, which `inspect` prints, was said to have no fields."""
    frame = composed("MTData2", "PacketCounter=7", "Quaternion=1,0,0,0")
    assert frame == "faff36181020020007201010" + "3f800000" + "00" * 12 + frame[-2:]
