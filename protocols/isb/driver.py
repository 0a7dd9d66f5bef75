"""Driver of Inertial Sense devices: requests, writes, refusals and silence.

    ask    GET_DATA, period 0    ──>   DATA: the value     NACK: refused      silence: retry, then NoReplyError
           (not for data sets that stream, as it would end the stream: protocols/isb/stream_restore.py)
    write  SET_DATA              ──>   ACK                 NACK: refused      silence: retry, then NoReplyError
           GET_DATA              ──>   DATA: the present value, compared with the requested one
    do     system command: ACK; a reset may happen before the ACK is sent, so its silence is not a failure
    text   $…                    ──>   a sentence if one is documented, else nothing

There is no Config state: a device measures while it is configured, so `within` only restores the streams afterwards.
A restart ends streams that are not stored: `resume` starts them again, and stores nothing (stream_restore.py).
Streams are read from DID_RMC, which names them, and by listening, which gives their rates. Those to be changed are
written one by one, and no others; they are then observed, and any that did not arrive is requested once more. If a row
gives the interval of its packets (period × source_ms), and the device uses another source than assumed, the multiple is
corrected by the measurement.

All of this is from the document; the times are the usual ones of a serial line at 9600 Bd and above.

Source: ISB document, "Communication"; inertial-sense-sdk 2.7.1, ISComm.h and com_manager.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, TypeVar

from imuscope.protocols.commands.transactions import (
    DeviceContext,
    DeviceDriver,
    DeviceRejectedError,
    LinkLoad,
    NoReplyError,
    PutBack,
    Risk,
    Send,
    Sleep,
    Transaction,
    WaitFor,
    WriteResult,
)
from imuscope.protocols.events import Event, Reply, Text
from imuscope.protocols.isb import annotate as annotated
from imuscope.protocols.isb import bandwidth as budget
from imuscope.protocols.isb import frames, stream_discovery, stream_restore
from imuscope.protocols.isb.commands import (
    COMMAND_ROWS,
    DEV_INFO,
    NMEA_PERIODS,
    SAVE_PERSISTENT,
    SYS_CMD,
)
from imuscope.protocols.isb.config_effects import SAVED, alters, differences, line_change, own_ports, risks_of_change
from imuscope.protocols.isb.dataset_loader import CURRENT, SETS, VERSIONS
from imuscope.protocols.isb.device_info import identity
from imuscope.protocols.isb.encoder import (
    NMEA_NAMES,
    chosen,
    did_of,
    frame,
    persists,
    set_frames,
    streams_frames,
    system_command,
    touched,
)
from imuscope.protocols.isb.frames import ACK, GET_DATA, NACK, SET_DATA, TYPE_MASK
from imuscope.protocols.isb.messages import COMMANDS, SET_PREFIX
from imuscope.protocols.isb.stored_settings import GPX_STREAM_FIELDS, PERSISTENT, STREAMS_SETTING, settings_of
from imuscope.protocols.isb.stream_discovery import ListeningTimes, to_wire
from imuscope.protocols.isb.stream_restore import undisturbed
from imuscope.protocols.isb.streams import STREAMS
from imuscope.protocols.schema.fields import Command, Setting
from imuscope.protocols.schema.json_values import jsonable

T = TypeVar("T")
Values = Mapping[str, Any]

ANSWER_S, MAX_ATTEMPTS = 0.5, 3
ALIVE_S, ALIVE_TRIES = 0.25, 4
RESET_S = 0.3  # until its last bytes are sent
NO = "rejected by the device (NACK): not supported, read-only, or the packet was invalid"


def version_of(known: DeviceContext) -> str:
    """The newest firmware of dataset_loader.VERSIONS not newer than the device's."""
    words = known.firmware.split(".")[:3]
    if not all(word.isdigit() for word in words) or len(words) < 3:
        return CURRENT
    version = tuple(int(word) for word in words)
    older = [one for one in VERSIONS[:-1] if tuple(int(word) for word in one.split(".")) <= version]
    return older[-1] if older else VERSIONS[0]


# -- the two exchanges -------------------------------------------------------------------------------------------------


def answer_of(did: int) -> Callable[[Event], Any]:
    """Matcher for the answer to a GET of `did`: its values; a NACK gives a DeviceRejectedError as a value."""

    def match(event: Event) -> Any | None:
        if isinstance(event, Reply) and event.message is COMMANDS[NACK]:
            return NACK if event.values.get("pktInfo.flags", 0) & TYPE_MASK == GET_DATA else None
        return to_wire(event, did)

    return match


def ack_of(kind: int, did: int, offset: int) -> Callable[[Event], Any]:
    """Matcher for the ACK or NACK of a packet."""

    def match(event: Event) -> Any | None:
        if not isinstance(event, Reply) or event.message not in (COMMANDS[ACK], COMMANDS[NACK]):
            return None
        values = event.values
        if values.get("pktInfo.flags", 0) & TYPE_MASK != kind:
            return None
        if kind == SET_DATA and (values.get("body.dataHdr.id"), values.get("body.dataHdr.offset")) != (did, offset):
            return None
        return ACK if event.message is COMMANDS[ACK] else NACK

    return match


def read_dataset(did: int, *, size: int = 0, offset: int = 0) -> Transaction[Values]:
    """Read a data set, or a part of it. Not for one that streams: see `IsbDriver.within`."""
    row = SETS[did]
    for _ in range(MAX_ATTEMPTS):
        yield Send(frames.get_data(did, size=size, offset=offset, period=0))
        answer = yield WaitFor(answer_of(did), ANSWER_S, row.name, is_answer=True)
        if answer == NACK:
            raise DeviceRejectedError(f"GET {row.name}", NO, NACK)
        if answer is not None:
            return as_text(answer)
    raise NoReplyError(f"GET {row.name}", MAX_ATTEMPTS, ANSWER_S)


def as_text(values: Values) -> Values:
    """Values that JSON can hold: bytes as hex."""
    return {name: jsonable(value) for name, value in values.items()}


def write_dataset(packet: bytes, what: str, *, required: bool = True) -> Transaction[bool]:
    """Send a packet that is acknowledged; returns whether it was.

    Args:
        required: whether silence is a failure (a reset may happen before the ACK is sent).
    """
    kind, did = packet[2] & TYPE_MASK, packet[3]
    offset = int.from_bytes(packet[6:8], "little") if packet[2] & frames.WITH_OFFSET else 0
    for _ in range(MAX_ATTEMPTS):
        yield Send(packet, what)
        answer = yield WaitFor(ack_of(kind, did, offset), ANSWER_S, "ACK", is_answer=True)
        if answer == NACK:
            raise DeviceRejectedError(what, NO, NACK)
        if answer == ACK:
            return True
        if not required:
            return False
    raise NoReplyError(what, MAX_ATTEMPTS, ANSWER_S)


class IsbDriver(DeviceDriver):
    """See imuscope.protocols.commands.transactions.DeviceDriver.

    Args:
        listening: how long the streams of a device are listened to.
    """

    name = "isb"
    restart_words = stream_restore.WORDS
    usual_rates = (
        *(921_600, 115_200, 460_800, 230_400, 3_000_000, 2_000_000, 1_000_000),
        *(57_600, 38_400, 19_200, 9_600),
    )  # tried when the document has no procedure for a lost rate

    def __init__(self, listening: ListeningTimes | None = None) -> None:
        self._listening = listening or ListeningTimes()

    # -- tables --------------------------------------------------------------------------------------------------------

    def commands(self, known: DeviceContext) -> Sequence[Command]:
        if not _is_gpx(known):
            return list(COMMAND_ROWS.values())
        return [row for name, row in COMMAND_ROWS.items() if not name.startswith("DID_RMC.")]

    def settings(self, known: DeviceContext) -> Sequence[Setting]:
        rows = settings_of(version_of(known)).values()
        if not _is_gpx(known):
            return list(rows)
        there = [row for row in rows if row.name != "DID_FLASH_CONFIG" and "EVB" not in row.name]
        return [_streams_of_gpx(row) if row.name == STREAMS_SETTING else row for row in there]

    # -- frames --------------------------------------------------------------------------------------------------------

    def frame(self, command: str, values: Values, known: DeviceContext) -> bytes:
        return frame(command, values, version_of(known))

    def setting_frames(
        self, setting: str, values: Values, known: DeviceContext, *, held: bool = False, old: Values | None = None
    ) -> list[bytes]:
        if setting == STREAMS_SETTING:
            return streams_frames(values, old)
        return set_frames(did_of(setting), values, version_of(known), held=held)

    annotate = staticmethod(annotated.annotate)
    name_of = staticmethod(annotated.name_of)
    # -- transactions --------------------------------------------------------------------------------------------------

    def within(self, body: Transaction[T], known: DeviceContext) -> Transaction[T]:
        """`body`, which may read anything; streams running before are restored afterwards."""
        return (yield from undisturbed(body, lambda did: read_dataset(did)))

    def run(self, command: str, values: Values, known: DeviceContext) -> Transaction[Values]:
        packet = self.frame(command, values, known)
        name = command.removeprefix("$")
        if name in NMEA_NAMES:
            return (yield from self._speak(name, packet))
        kind = packet[2] & TYPE_MASK
        if kind == GET_DATA:
            did, size, offset, period = (int.from_bytes(packet[at : at + 2], "little") for at in (6, 8, 10, 12))
            if did not in SETS:
                raise DeviceRejectedError(command, "there is no such data set")
            if not period:
                return (yield from read_dataset(did, size=size, offset=offset))
            return (yield from self._begin(packet, did))
        if kind == frames.STOP_DID:
            yield Send(packet, command)
            return {}
        resets = command == "DID_SYS_CMD.SOFTWARE_RESET" or ("RESET" in command and packet[3] == SYS_CMD)
        yield from write_dataset(packet, command, required=not resets)
        return {}

    @staticmethod
    def _begin(packet: bytes, did: int) -> Transaction[Values]:
        """Request a stream: its first packet is the answer."""
        yield Send(packet)
        answer = yield WaitFor(answer_of(did), 2.0, SETS[did].name, is_answer=True)
        if answer == NACK:
            raise DeviceRejectedError(f"GET {SETS[did].name}", NO, NACK)
        return as_text(answer or {})

    @staticmethod
    def _speak(name: str, line: bytes) -> Transaction[Values]:
        reply = COMMAND_ROWS[name].reply
        if not reply or (name == "ASCE" and line.count(b",")):
            yield Send(line, name)
            return {}

        def match(event: Event) -> Values | None:
            # firmware 2.7.1 answers ASCE with ASCE, as in its source; the manual says ASCB
            if isinstance(event, Text) and event.protocol == "nmea" and event.name in (reply, name):
                return {"line": event.line, **event.fields}
            return None

        for _ in range(MAX_ATTEMPTS):
            yield Send(line, name)
            answer = yield WaitFor(match, ANSWER_S, f"${reply}", is_answer=True)
            if answer is not None:
                return as_text(answer)
        raise NoReplyError(f"${name}", MAX_ATTEMPTS, ANSWER_S)

    def unfinished(self, command: str, values: Values) -> str | None:
        return None

    def alters(self, command: str, values: Values, known: DeviceContext) -> Collection[str]:
        return alters(command, values, (row.name for row in self.settings(known)))

    def read(self, setting: str, known: DeviceContext) -> Transaction[Values]:
        if setting == STREAMS_SETTING:
            return (yield from self._streams(gpx=_is_gpx(known)))
        values = yield from read_dataset(did_of(setting))
        return _trimmed(setting, values)

    def write(
        self, setting: str, values: Values, known: DeviceContext, *, held: bool = False
    ) -> Transaction[WriteResult]:
        if setting == STREAMS_SETTING:
            return (yield from self._write_streams(values, gpx=_is_gpx(known)))
        try:
            if did_of(setting) == NMEA_PERIODS:
                values = yield from self._with_ended(values)
            for packet in self.setting_frames(setting, values, known, held=held):
                yield from write_dataset(packet, f"{SET_PREFIX}{setting}")
            got = yield from self.read(setting, known)
        except DeviceRejectedError as error:
            return WriteResult(setting, values, None, error.why)
        return WriteResult(setting, values, got)

    def _with_ended(self, values: Values) -> Transaction[Values]:
        """The requested sentences, and those sent now with a period of 0: a device keeps sentences that are not
        named.
        """
        now = yield from read_dataset(NMEA_PERIODS)
        messages = [one for one in values.get("nmeaBroadcastMsgs", []) if one.get("msgID")]
        named = {one["msgID"] for one in messages}
        on = [one for one in now.get("nmeaBroadcastMsgs", []) if one["msgID"] and one["msgPeriod"]]
        ended = [{"msgID": one["msgID"], "msgPeriod": 0} for one in on if one["msgID"] not in named]
        return {"options": 0, **values, "nmeaBroadcastMsgs": [*messages, *ended]}

    def _streams(self, *, gpx: bool, **options: Any) -> Transaction[Values]:
        return (yield from stream_discovery.streams(lambda did: read_dataset(did), self._listening, gpx=gpx, **options))

    def _write_streams(self, values: Values, *, gpx: bool) -> Transaction[WriteResult]:
        """Stop unwanted streams, start and change the others, check the result, and retry what differs."""
        chosen(values)
        got = yield from self._streams(gpx=gpx)
        periods: dict[int, int] = {}
        refused = ""
        for _ in range(MAX_ATTEMPTS if "streams" in values else 0):
            now = {one["did"]: one for one in got["streams"]}
            ended = [did for did in now if did not in {one["did"] for one in values["streams"]}]
            rows = touched([_paced(one, now, periods) for one in values["streams"]], now)
            if refused or not (ended or rows):
                break
            for did in ended:
                yield Send(frames.build(frames.STOP_DID, did))
            for row in rows:
                periods[row["did"]] = row.get("period", 1)
                if not (yield from self._stream(row["did"], periods[row["did"]])):
                    refused = f"{SETS[row['did']].name}: {NO}"
            got = yield from self._streams(also=periods, periods=periods, gpx=gpx)
        if persists(values) and not refused:
            try:
                yield from write_dataset(system_command(SAVE_PERSISTENT), "DID_SYS_CMD.SAVE_PERSISTENT_MESSAGES")
            except DeviceRejectedError:
                refused = "the streams are on, but the device rejected the request to save them"
        return WriteResult(STREAMS_SETTING, values, got, refused)

    @staticmethod
    def _stream(did: int, period: int) -> Transaction[bool]:
        """Request a stream; a refusal (False) comes at once, so the wait is short."""

        def refused(event: Event) -> bool | None:
            return True if answer_of(did)(event) == NACK else None

        yield Send(frames.get_data(did, period=period))
        return not (yield WaitFor(refused, 0.03, "NACK"))

    def identify(self, known: DeviceContext) -> Transaction[DeviceContext]:
        details: dict[str, Any] = {}

        def match(event: Event) -> Any | None:
            if isinstance(event, Reply) and identity(event):
                details.update(identity(event))
                return True
            return None

        for _ in range(MAX_ATTEMPTS):
            yield Send(frames.get_data(DEV_INFO, period=0))
            if (yield WaitFor(match, ANSWER_S, "DID_DEV_INFO", is_answer=True)):
                return replace(known, at_rest=False, **details)
        raise NoReplyError("GET DID_DEV_INFO", MAX_ATTEMPTS, ANSWER_S)

    line_change = staticmethod(line_change)
    own_ports = staticmethod(own_ports)

    def instead(
        self, command: str, values: Values, present: Mapping[str, Values], known: DeviceContext
    ) -> tuple[str, Values] | None:
        """Treat SET_DID_x of a setting as a change of that setting, without the fields that the device maintains."""
        name = command.removeprefix(SET_PREFIX)
        row = next((one for one in self.settings(known) if one.name == name), None)
        if not command.startswith(SET_PREFIX) or row is None or not row.write:
            return None
        read_only = {field.name for field in row.fields if field.read_only}
        return row.name, {name: value for name, value in values.items() if name not in read_only} or values

    def risks(self, setting: str, old: Values | None, new: Values, known: DeviceContext) -> list[Risk]:
        return risks_of_change(setting, old, new, known.product)

    def restart_frames(self, values: Mapping[str, Values], known: DeviceContext) -> list[bytes]:
        return [system_command(one) for one in stream_restore.RESTART] + stream_restore.frames_of(
            values, version_of(known)
        )

    def store_and_restart(self, known: DeviceContext) -> Transaction[Sequence[bytes]]:
        """Save the flash configuration, restart. What runs now is found first: most of it is not stored."""
        running: dict[str, Values] = {}
        for setting in (STREAMS_SETTING, stream_restore.SENTENCES):
            try:
                running[setting] = yield from self.within(self.read(setting, known), known)
            except DeviceRejectedError:  # a product without sentences
                continue
        again = tuple(stream_restore.frames_of(running, version_of(known)))
        yield PutBack(again)
        save, reset = (system_command(one) for one in stream_restore.RESTART)
        with suppress(DeviceRejectedError):  # not every product has it; written values are in flash already
            yield from write_dataset(save, "DID_SYS_CMD.SAVE_FLASH")
        yield from write_dataset(reset, "DID_SYS_CMD.SOFTWARE_RESET", required=False)
        yield Sleep(RESET_S)
        return again

    def resume(self, frames: Sequence[bytes], known: DeviceContext) -> Transaction[None]:
        return stream_restore.resume(frames, lambda did: read_dataset(did), gpx=_is_gpx(known))

    def confirms(self, frame: bytes, event: Event) -> bool:
        return stream_restore.confirms(frame, event)

    def is_alive(self, known: DeviceContext) -> Transaction[bool]:
        for _ in range(ALIVE_TRIES):
            yield Send(frames.get_data(DEV_INFO, period=0))
            if (yield WaitFor(answer_of(DEV_INFO), ALIVE_S, "DID_DEV_INFO")) is not None:
                return True
        return False

    # -- load ----------------------------------------------------------------------------------------------------------

    def load(self, settings: Mapping[str, Values], known: DeviceContext) -> LinkLoad:
        return budget.load(settings)

    def message_rate(self, settings: Mapping[str, Values], known: DeviceContext) -> float | None:
        return budget.message_rate(settings)

    def fit_rates(self, settings: Mapping[str, Values], capacity: float, known: DeviceContext) -> Mapping[str, Values]:
        return budget.fit(settings, capacity)

    same = staticmethod(differences)


def _is_gpx(known: DeviceContext) -> bool:
    return known.product.startswith("GPX")


def _streams_of_gpx(row: Setting) -> Setting:
    return replace(row, fields=GPX_STREAM_FIELDS, read="GET_DID_GPX_RMC")


def _paced(one: Values, now: Mapping[int, Values], periods: Mapping[int, int]) -> Values:
    """A row with the multiple that gives its intended rate, if the device uses another source than the row assumes.
    Only for data sets whose source is not known beforehand; a multiple alone is kept.
    """
    there, meant = now.get(one["did"]), float(one.get("source_ms") or 0) * one.get("period", 1)
    if one["did"] not in periods or there is None or not meant or len(STREAMS[one["did"]].paces) < 2:
        return one
    return {**one, "period": max(1, round(meant / there["source_ms"])), "source_ms": there["source_ms"]}


def _trimmed(setting: str, values: Values) -> Values:
    """A list of sentences without its empty entries; the request to save is not part of the state."""
    if "options" in values and setting in SAVED:
        values = {**values, "options": values["options"] & ~PERSISTENT}
    if setting != "DID_NMEA_BCAST_PERIOD" or "nmeaBroadcastMsgs" not in values:
        return values
    on = [one for one in values["nmeaBroadcastMsgs"] if one["msgID"] and one["msgPeriod"]]
    return {**values, "nmeaBroadcastMsgs": on}
