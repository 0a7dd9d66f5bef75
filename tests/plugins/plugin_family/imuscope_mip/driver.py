"""Commands and settings of MIP devices, and the transactions that play them.

A command is one field in one packet. The device answers with a packet of the same descriptor set: Ack first, with the
command's descriptor and an error code, then what was asked for. A setting has one descriptor and a function: write,
read, save (over power), load, default. Devices answer while they stream, so no state has to be changed for it.

Numbers and layouts serve as proof of the plug-in interface; they were not compared with the vendor's manual.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from imuscope.plugin import (
    Batch,
    ByteRange,
    Command,
    DeviceContext,
    DeviceDriver,
    DeviceRejectedError,
    EncodeError,
    Event,
    Field,
    NoReplyError,
    Reply,
    Send,
    Setting,
    Transaction,
    Values,
    WaitFor,
    WriteResult,
    size_of,
    unpack,
)
from imuscope_mip.json_codec import frame_from_json, name_of, rows_of
from imuscope_mip.messages import ERRORS, FUNCTIONS, ROTATION, ROTATION_NAME
from imuscope_mip.packets import HEADER, SUM, SYNC

TRIES, TIMEOUT_S, ALIVE_S = 3, 0.5, 1.5
TOLERANCE = 1e-6
DEVICE, VEHICLE = "Device", "Mounting"
COMMANDS: tuple[Command, ...] = (
    Command("Ping", kind="ask", group=DEVICE, reply="Ack", doc="Asks whether the device is there."),
    Command("GetDeviceInformation", kind="ask", group=DEVICE, reply="DeviceInformation", title="Device information"),
    Command(
        "SetToIdle",
        group=DEVICE,
        reply="Ack",
        title="Stop streaming",
        caution="stops-output",
        consequence="The device sends no data until it is resumed.",
    ),
    Command("Resume", group=DEVICE, reply="Ack", title="Resume streaming"),
    Command(
        f"Write{ROTATION_NAME}",
        ROTATION,
        "set",
        VEHICLE,
        "Ack",
        title="Rotation from sensor to vehicle",
        doc="How the sensor is mounted; the attitude is then that of the vehicle.",
    ),
    *(
        Command(f"{words}{ROTATION_NAME}", (), "ask" if words == "Read" else "do", VEHICLE, "Ack")
        for words in FUNCTIONS.values()
        if words != "Write"
    ),
)
SETTINGS = (
    Setting(
        ROTATION_NAME,
        ROTATION,
        f"Read{ROTATION_NAME}",
        f"Write{ROTATION_NAME}",
        group=VEHICLE,
        title="Rotation from sensor to vehicle",
        doc="How the sensor is mounted; the attitude is then that of the vehicle.",
    ),
)


class MipDriver(DeviceDriver):
    """See imuscope.protocols.commands.transactions.DeviceDriver."""

    name = "mip"
    usual_rates = (115_200, 921_600, 460_800, 230_400, 57_600, 38_400, 19_200, 9_600)

    def commands(self, known: DeviceContext) -> Sequence[Command]:
        return COMMANDS

    def settings(self, known: DeviceContext) -> Sequence[Setting]:
        return SETTINGS

    def frame(self, command: str, values: Values, known: DeviceContext) -> bytes:
        row = next((row for row in COMMANDS if row.name == command), None)
        if row is None:
            raise EncodeError(f"there is no command {command!r}")
        _check(row.arguments, values)
        return frame_from_json({"message": command, "fields": values})

    def setting_frames(
        self, setting: str, values: Values, known: DeviceContext, *, held: bool = False, old: Values | None = None
    ) -> list[bytes]:
        if not held:
            _check(_setting(setting).fields, values)
        return [frame_from_json({"message": f"Write{setting}", "fields": values})]

    def annotate(self, frame: bytes) -> list[ByteRange]:
        if frame[:2] != SYNC or len(frame) < HEADER + SUM:
            return [ByteRange(0, len(frame), "unknown")] if frame else []
        spans = [
            ByteRange(0, 2, "sync"),
            ByteRange(2, 1, f"descriptor set 0x{frame[2]:02X}"),
            ByteRange(3, 1, "length"),
        ]
        at = HEADER
        for row in rows_of(frame):
            size = frame[at]
            spans += [ByteRange(at, 1, f"size {size}"), ByteRange(at + 1, 1, row.name)]
            inside = at + 2
            if row.prefix:
                spans.append(ByteRange(inside, len(row.prefix), f"function {FUNCTIONS[row.prefix[0]].lower()}"))
                inside += len(row.prefix)
            for field in row.fields:
                value = unpack((field,), frame, inside)[field.name]
                spans.append(ByteRange(inside, size_of(field), f"{field.name} = {value}", field.name))
                inside += size_of(field)
            at += size
        return [*spans, ByteRange(at, SUM, "checksum")]

    def name_of(self, frame: bytes) -> str:
        return name_of(rows_of(frame)) if frame[:2] == SYNC and len(frame) >= HEADER + SUM else ""

    def run(self, command: str, values: Values, known: DeviceContext) -> Transaction[Values]:
        return (yield from _request(self.frame(command, values, known), command))

    def alters(self, command: str, values: Values, known: DeviceContext) -> Collection[str]:
        return (ROTATION_NAME,) if command in (f"Load{ROTATION_NAME}", f"Default{ROTATION_NAME}") else ()

    def read(self, setting: str, known: DeviceContext) -> Transaction[Values]:
        row = _setting(setting)
        values = yield from _request(frame_from_json({"message": row.read}), row.read)
        return {field.name: values[field.name] for field in row.fields}

    def write(
        self, setting: str, values: Values, known: DeviceContext, *, held: bool = False
    ) -> Transaction[WriteResult]:
        [frame] = self.setting_frames(setting, values, known, held=held)
        try:
            yield from _request(frame, f"Write{setting}")
        except DeviceRejectedError as error:
            return WriteResult(setting, values, refused=error.why)
        got = yield from self.read(setting, known)
        return WriteResult(setting, values, got)

    def identify(self, known: DeviceContext) -> Transaction[DeviceContext]:
        values = yield from _request(frame_from_json({"message": "GetDeviceInformation"}), "GetDeviceInformation")
        report = identity_of(values)
        return DeviceContext(**{**{"baud": known.baud, "device": known.device}, **report})

    def store_and_restart(self, known: DeviceContext) -> Transaction[Sequence[bytes]]:
        """Settings take effect at once and are saved; no restart is needed."""
        yield from _request(frame_from_json({"message": f"Save{ROTATION_NAME}"}), f"Save{ROTATION_NAME}")
        return ()

    def is_alive(self, known: DeviceContext) -> Transaction[bool]:
        def match(event: Event) -> bool | None:
            return True if isinstance(event, Batch | Reply) else None

        yield Send(frame_from_json({"message": "Ping"}), "Ping")
        return bool((yield WaitFor(match, ALIVE_S, "a packet")))

    def factory(self, known: DeviceContext) -> Mapping[str, Values]:
        return {ROTATION_NAME: {field.name: 0.0 for field in ROTATION}}

    def same(self, setting: str, a: Values, b: Values) -> list[str]:
        """A float32 has six digits: 0.1 is read back as 0.10000000149."""
        return [name for name in a if name in b and not math.isclose(a[name], b[name], abs_tol=TOLERANCE)]


def _setting(name: str) -> Setting:
    for row in SETTINGS:
        if row.name == name:
            return row
    raise EncodeError(f"there is no setting {name!r}; there are: {', '.join(row.name for row in SETTINGS)}")


def _check(fields: Sequence[Field], values: Values) -> None:
    """EncodeError: a value is outside its range."""
    for field in fields:
        value = values.get(field.name)
        if not isinstance(value, int | float) or field.low is None or field.high is None:
            continue
        if not field.low <= value <= field.high:
            words = f"{field.name} is {value:g}, not from {field.low:.4g} to {field.high:.4g} {field.unit}"
            raise EncodeError(words, field.name)


def _request(frame: bytes, what: str) -> Transaction[dict[str, Any]]:
    """Send, wait for its Ack; the values of the answer."""
    number, descriptor = frame[2], frame[HEADER + 1]

    def match(event: Event) -> Reply | None:
        is_answer = (
            isinstance(event, Reply) and event.message.id == number and event.values.get("command") == descriptor
        )
        return event if is_answer else None  # type: ignore[return-value]

    for _ in range(TRIES):
        yield Send(frame, what)
        reply = yield WaitFor(match, TIMEOUT_S, f"the answer to {what}")
        if reply is None:
            continue
        code = int(reply.values["error"])
        if code:
            raise DeviceRejectedError(what, ERRORS.get(code, f"error {code}"), code)
        return {name: value for name, value in reply.values.items() if name not in ("command", "error")}
    raise NoReplyError(what, TRIES, TIMEOUT_S)


def identity_of(values: Values) -> dict[str, str]:
    """Product, serial number and firmware of device information."""
    if "model_name" not in values:
        return {}
    number = int(values["firmware"])
    return {
        "product": str(values["model_name"]).strip(),
        "serial_number": str(values["serial_number"]).strip(),
        "firmware": f"{number // 1000}.{number // 100 % 10}.{number % 100:02d}",
    }


def identity(reply: Reply) -> Mapping[str, str]:
    """See DeviceTraits.identity."""
    return identity_of(reply.values)


IDENTIFY_REQUEST = frame_from_json({"message": "GetDeviceInformation"})
