"""Does a frame lead back to itself through the real command line, and do words become the frame they mean?"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from protocols.dialogues import Known
from protocols.idtp.device import IdtpDevice
from protocols.isb.device import IsbDevice
from protocols.isb.writing import sentence
from protocols.xbus.device import XbusDevice
from server.commands.compose import ComposeError, chosen, frame_of, frames_of, parse, tongues
from server.commands.inspect import inspect_file
from server.live.reading import Reading
from tests.process import imuscope

GOLDEN = Path(__file__).parents[1] / "golden"
KEY = bytes(range(32))
S = 10**9


def composed(message: str, *pairs: str, protocol: str = "", key: bytes | None = None) -> str:
    spoken = tongues(key)
    return frame_of(chosen(spoken, message, protocol), message, pairs, Known(key=key))[0].hex()


def both_ways(data: bytes, path: Path, reading: Reading, **how: Any) -> None:
    """compose(inspect(frame)) is the frame, for every frame of some bytes."""
    path.write_bytes(data)
    inspect_file(path, out := io.StringIO(), reading, format="jsonl", **how)
    lines = out.getvalue().splitlines()
    assert lines
    frames = frames_of(lines, tongues(reading.key))
    for line, frame in zip(lines, frames, strict=True):
        record = json.loads(line)
        assert frame == data[record["offset"] : record["offset"] + record["size"]], line


# -- both ways ---------------------------------------------------------------------------------------------------------


def _vectors(name: str) -> list[dict[str, Any]]:
    found = json.loads((GOLDEN / name).read_text())
    return found if isinstance(found, list) else found["vectors"]


@pytest.mark.parametrize("name", ["commands.json", "data.json"])
def test_every_golden_packet_of_inertial_sense(name: str, tmp_path: Path) -> None:
    packets = [bytes.fromhex(row["packet_hex"]) for row in _vectors(f"isb/{name}") if row.get("packet_hex")]
    assert len(packets) > 20
    for number, packet in enumerate(packets):
        both_ways(packet, tmp_path / f"{number}.bin", Reading("isb"))


def test_every_golden_message_of_xsens(tmp_path: Path) -> None:
    frames = [bytes.fromhex(row["message_hex"]) for row in _vectors("xbus/commands.json") if row.get("message_hex")]
    assert len(frames) > 100
    for number, frame in enumerate(frames):
        both_ways(frame, tmp_path / f"{number}.bin", Reading("xbus"), direction="tx")


def test_every_golden_frame_of_idtp(tmp_path: Path) -> None:
    for number, row in enumerate(_vectors("idtp/vectors.json")):
        key = bytes.fromhex(row["key_hex"]) if row["key_hex"] else None
        reading = Reading("idtp", key, min_mode=0, replay_check=False)
        both_ways(bytes.fromhex(row["frame_hex"]), tmp_path / f"{number}.bin", reading)


def test_what_twins_send_with_what_passes_through_their_ports(tmp_path: Path) -> None:
    isb = IsbDevice().advance(3 * S)
    both_ways(isb + sentence("INFO,1,2") + isb, tmp_path / "isb.bin", Reading("isb"))
    both_ways(XbusDevice().advance(2 * S), tmp_path / "xbus.bin", Reading("xbus"))
    both_ways(IdtpDevice(mode=2, key=KEY).advance(S), tmp_path / "idtp.bin", Reading("idtp", KEY))


@pytest.mark.parametrize("name", ["mti_float32.bin", "mti_float32_satinfo_ecef.bin"])
def test_a_capture_through_the_real_command_line(name: str, captures: Path) -> None:
    file = captures / "xbus" / name
    if not file.is_file():
        pytest.skip(f"no capture {name}")
    _through_the_command_line(file)


def test_files_through_the_real_command_line(tmp_path: Path) -> None:
    _through_the_command_line(GOLDEN / "xbus" / "sample.mtb")
    log = tmp_path / "imx.raw"
    log.write_bytes(IsbDevice(road=1.0).advance(8 * S))
    _through_the_command_line(log)


def _through_the_command_line(file: Path) -> None:
    listed = imuscope("inspect", str(file), "--format", "jsonl")
    assert listed.returncode == 0, listed.stderr
    back = imuscope("compose", "--jsonl", "-", given=listed.stdout.encode())
    assert back.returncode == 0, back.stderr
    data = file.read_bytes()
    records = [json.loads(line) for line in listed.stdout.splitlines()]
    frames = [bytes.fromhex(line) for line in back.stdout.splitlines()]
    assert frames == [data[one["offset"] : one["offset"] + one["size"]] for one in records]
    assert records


# -- words -------------------------------------------------------------------------------------------------------------


def _arguments(row: dict[str, Any]) -> tuple[str, Sequence[str]] | None:
    """A command vector as it is written on the command line; None for those that a device sends."""
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
    asked = [(row, _arguments(row)) for row in _vectors("isb/commands.json")]
    written = [(row, words) for row, words in asked if words]
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


def test_paths_lead_into_lists() -> None:
    pairs = ("outputs.0.data_identifier=0x1020", "outputs.0.output_frequency=65535")
    whole = composed("SetOutputConfiguration", 'outputs=[{"data_identifier": 4128, "output_frequency": 65535}]')
    assert composed("SetOutputConfiguration", *pairs) == whole == "faffc0041020ffff0f"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["SetOutputConfigurationn"], "nearest are: SetOutputConfiguration"),
        (["SET_DID_FLASH_CONFIG", "startupNavDt=1"], "nearest are: startupNavDtMs"),
        (["SET_DID_FLASH_CONFIG", "dynamicModel=AIRBORNE"], "nearest are: AIRBORNE_"),
        (["SET_DID_FLASH_CONFIG", "startupNavDtMs=500"], "lies between 0 and 100 ms, given 500"),
        (["SET_DID_FLASH_CONFIG", "startupNavDtMs"], "is no FIELD=VALUE"),
        (["GET_DATA", "id=no"], "none of its choices"),
        (["SetOutputConfiguration", "outputs.1.data_identifier=1"], "the next is outputs.0"),
    ],
)
def test_what_is_not_known_is_answered_with_the_nearest(words: list[str], said: str) -> None:
    with pytest.raises(ComposeError, match=said):
        composed(words[0], *words[1:])


def test_one_line_and_status_1_for_what_cannot_be() -> None:
    done = imuscope("compose", "NoSuchThing")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.count("\n") == 1
    assert "no message is called 'NoSuchThing'" in done.stderr
    done = imuscope("compose", "--jsonl", "-", given=b'{"protocol":"isb","message":"GET_DATA","fields":{}}\n')
    assert (done.returncode, done.stderr) == (1, "imuscope: line 1: id is missing.\n")


def test_values_without_a_field() -> None:
    assert parse([], ()) == {}
    with pytest.raises(ComposeError, match="this message has none"):
        parse(["a=1"], ())
