"""`imuscope send`: answers, read-back, refusals, and confirmation."""

from __future__ import annotations

import json
import signal
import socket
from typing import Any

from imuscope.protocols.xbus.frames import build
from imuscope.protocols.xbus.requests import GO_TO_CONFIG, GO_TO_MEASUREMENT
from tests.support.each_row import each_row
from tests.support.server_process import begun, imuscope
from tests.support.timeouts import PATIENCE_S


def sent(*arguments: str) -> list[dict[str, Any]]:
    """The lines that `imuscope send` printed."""
    done = imuscope("send", *arguments)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def refused(*arguments: str) -> str:
    """The one line with which it failed."""
    done = imuscope("send", *arguments)
    lines = [line for line in done.stderr.splitlines() if "compiling" not in line]
    assert (done.returncode, done.stdout, len(lines)) == (1, "", 1), done
    return lines[0]


def test_an_mti_is_read_and_set_and_measures_again() -> None:
    [answer] = sent("sim:xbus?baud=921600", "ReqDID")
    assert answer["message"] == "DeviceID"
    acknowledged, stored = sent("sim:xbus?baud=921600", "SetLocationID", "location_id=77")
    assert acknowledged["message"] == "SetLocationIDAck"
    assert stored == {"setting": "LocationID", "fields": {"location_id": 77}}


@each_row("number", [signal.SIGTERM, signal.SIGINT])
def test_a_device_measures_again_after_a_signal(number: signal.Signals) -> None:
    """`timeout 5 imuscope send …`, or the end of an ssh connection, left it silent."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(PATIENCE_S)
        source = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        process = begun("send", source, "ReqDID", "--protocol", "xbus", apart=True)
        device, _ = listener.accept()
        with device:
            device.settimeout(PATIENCE_S)
            received = b""
            while build(GO_TO_CONFIG) not in received:
                received += device.recv(4096)
            process.send_signal(number)
            received = b""
            while data := device.recv(4096):
                received += data
        process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 128 + number
        assert received.endswith(build(GO_TO_MEASUREMENT))


def test_a_field_of_an_imx_is_written_and_read_back() -> None:
    acknowledged, stored = sent("sim:isb", "SET_DID_FLASH_CONFIG", "magDeclination=0.25")
    assert acknowledged == {"message": "ACK", "fields": {}}
    assert stored["fields"]["magDeclination"] == 0.25


def test_one_element_of_a_vector_can_be_set() -> None:
    """The device has the others, which stay; without a device they are not known."""
    before = sent("sim:isb", "DID_FLASH_CONFIG")[0]["fields"]["refLla"]
    [stored] = sent("sim:isb", "DID_FLASH_CONFIG", "refLla.2=50.5", "--yes")
    assert stored["fields"]["refLla"] == [*before[:2], 50.5]
    _, stored = sent("sim:isb", "SET_DID_FLASH_CONFIG", "refLla.1=7.25", "--yes")
    assert stored["fields"]["refLla"] == [before[0], 7.25, before[2]]
    assert "the last is 2" in refused("sim:isb", "DID_FLASH_CONFIG", "refLla.3=1")
    done = imuscope("compose", "SET_DID_FLASH_CONFIG", "gps1AntOffset.1=0.3")
    assert done.returncode == 1
    assert "give gps1AntOffset=[…,…,…]" in done.stderr


def test_a_setting_is_read_and_written_by_its_name() -> None:
    [stored] = sent("sim:isb", "streams", 'streams=[{"did": "DID_INS_1", "period": 4}]')
    assert [(row["did"], row["period"]) for row in stored["fields"]["streams"]] == [(4, 4)]
    [info] = sent("sim:isb", "DID_DEV_INFO")
    assert info["fields"]["manufacturer"] == "Inertial Sense Inc"


def test_the_devices_resulting_value_is_reported() -> None:
    done = imuscope("send", "sim:isb", "DID_FLASH_CONFIG", "startupNavDtMs=4", "startupImuDtMs=9", "--yes")
    assert done.returncode == 0
    assert "startupImuDtMs was changed by the device: 4 instead of 9" in done.stderr


def test_harmful_commands_need_confirmation() -> None:
    line = refused("sim:isb", "DID_SYS_CMD.SOFTWARE_RESET")
    assert "The device restarts" in line
    assert "Add --yes" in line
    assert sent("sim:isb", "DID_SYS_CMD.SOFTWARE_RESET", "--yes") == [{"message": "ACK", "fields": {}}]


@each_row(
    ("arguments", "message"),
    [
        (("sim:isb", "DID_SYS_CMD.MANF_CHIP_ERASE", "--yes"), "refused"),
        (("sim:isb", "DID_GPX_FLASH_CFG"), "refused"),
        (("sim:isb", "NoSuchThing"), "unknown message"),
        (("sim:isb", "SET_DID_FLASH_CONFIG", "startupNavDtMs=x"), "must be a number"),
        (("/dev/no-such-port", "ReqDID"), "/dev/no-such-port"),
        (("sim:nothing", "ReqDID"), "Unknown simulator"),
    ],
)
def test_errors_are_one_line(arguments: tuple[str, ...], message: str) -> None:
    assert message in refused(*arguments)


def test_a_frame_of_idtp_is_sent_and_nothing_answers() -> None:
    assert sent("sim:idtp", "Imu3Acc", "acc_x=1") == [{"message": "Imu3Acc", "fields": {}}]


def test_a_message_of_devices_is_not_sent_to_one() -> None:
    assert "MTData2 is sent by devices only" in refused("sim:xbus", "MTData2", "PacketCounter=7")


def test_a_field_of_the_command_that_writes_a_setting_is_found() -> None:
    """The flags of OptionFlags are written by two fields of SetOptionFlags, which it does not have."""
    words = refused("sim:xbus", "OptionFlags", "set_flags=DisableAutoStore")
    assert "unknown field 'set_flags'" in words
    assert words.endswith("the command SetOptionFlags has it.")


def test_a_device_of_a_command_that_was_killed_measures_again_with_the_next() -> None:
    """It left the device silent, and the next command took it for one at rest."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(PATIENCE_S)
        source = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        for is_killed in (True, False):
            process = begun("send", source, "LocationID", "--protocol", "xbus", apart=True)
            device, _ = listener.accept()
            with device:
                device.settimeout(PATIENCE_S)
                received = b""
                while (build(GO_TO_CONFIG) if is_killed else build(GO_TO_MEASUREMENT)) not in received:
                    received += device.recv(100)
                process.kill()
                process.communicate(timeout=PATIENCE_S)
        assert received.startswith(build(GO_TO_MEASUREMENT))
