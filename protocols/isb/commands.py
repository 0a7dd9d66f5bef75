"""What can an Inertial Sense device be told and asked, and what does it keep? Commands and settings as rows.

    GET_DID_x          asks once for a data set (or a part of it, or as a stream)             answer: DID_x, or NACK
    SET_DID_x          writes a data set, or neighbouring fields of it by offset              answer: ACK or NACK
    DID_SYS_CMD.x      a system command, sent with its bitwise inverse in one set             answer: ACK or NACK
    DID_RMC.x          a preset of streams, by the bits of DID_RMC                            answer: ACK
    DID_MAG_CAL.x      starts or aborts a calibration of the magnetometers                    answer: ACK
    GET_DATA STOP_…    the packets themselves
    ASCE INFO PERS SRST STPB STPC                  the same in text, NMEA 0183, for every version of the protocol

    settings           the data sets that a device keeps (SETTINGS), and `streams`: which it sends, and how often

What a row says of harm (`caution`, `consequence`) is what a person is told before it is sent.

Rules for editing: a system command is a row of datasets.txt (eSystemCommand) and, where it does harm, one of `_HARM`. A
data set that is kept is a row of `_KEPT`.

Source: ISB document; NMEA document of the same maker, "NMEA input messages"; inertial-sense-sdk 2.7.1, data_sets.h.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

from protocols.isb.frames import GET_DATA, STOP_ALL_PORTS, STOP_CURRENT_PORT
from protocols.isb.manual import noted
from protocols.isb.messages import BY_NAME, COMMANDS, ROWS, SET_PREFIX, places
from protocols.isb.streams import GPX_PRESETS, OF_GPX, PRESETS, STREAMS
from protocols.isb.tables import CURRENT, SETS, SOURCE, TABLES, as_written
from protocols.labels import spoken
from protocols.schema import Bits, Caution, Command, Field, Setting

SYS_CMD, NMEA_PERIODS, RMC, FLASH, MAG_CAL, DEV_INFO, SYS_PARAMS = 7, 8, 9, 12, 19, 1, 10
GET_PREFIX = "GET_"
NMEA_SOURCE = "Inertial Sense user manual, NMEA 0183 (ASCII) protocol"
ISB_SOURCE = "Inertial Sense binary protocol document"
STREAMS_SETTING = "streams"
WHOLE = (8, 126)  # sentences and streams of a GPX act as they are written, which is as a whole
PERSISTENT = 1 << 9  # of the options of streams and sentences: a request to save them, not a state that can be read
SAVE_PERSISTENT, SAVE_FLASH, SOFTWARE_RESET = 1, 97, 99

G_STREAMS, G_NMEA, G_CONFIG, G_CAL, G_SYSTEM, G_ABOUT, G_READ, G_WRITE = (
    *("Streams", "NMEA", "Configuration", "Calibration", "System", "About", "Read a data set", "Write a data set"),
)
GROUPS = (G_STREAMS, G_CONFIG, G_NMEA, G_CAL, G_SYSTEM, G_ABOUT, G_READ, G_WRITE)

SYSTEM_COMMANDS: Mapping[int, str] = {
    value: name for value, name in TABLES.choices["eSystemCommand"].items() if name != "NONE"
}
NMEA_MESSAGES = TABLES.choices["eNmeaMsgId"]


@dataclass(frozen=True, slots=True)
class _Harm:
    """What a command may cost, in words."""

    caution: Caution
    consequence: str


_RESTARTS = _Harm("restarts", "The device restarts; streams that are not saved do not come back.")
_BRIDGE = _Harm("cuts-line", "A port becomes a bridge and no longer answers; a restart of the device ends that.")
_BOOT = _Harm("cuts-line", "It waits in its bootloader for firmware and does not measure until it is restarted.")
_MAKER = _Harm("loses-settings", "This is the maker's own; what it erases cannot be brought back from here.")
_FAULT = _Harm("restarts", "It makes the device fail on purpose; it restarts.")
_ZERO = _Harm("moves-frame", "The device takes it that it stands still now; if it moves, its navigation is wrong.")
_FLASH = _Harm("wears-flash", "It writes the flash memory, which lasts for a limited number of writes.")

_HARM: Mapping[str, _Harm] = {
    "SAVE_PERSISTENT_MESSAGES": _Harm("wears-flash", "What streams now will stream after every restart."),
    "SAVE_FLASH": _FLASH,
    "SAVE_GPS_ASSIST_TO_FLASH_RESET": _RESTARTS,
    "SOFTWARE_RESET": _RESTARTS,
    "ENABLE_BOOTLOADER_AND_RESET": _BOOT,
    "GPX_ENABLE_BOOTLOADER_MODE": _BOOT,
    "GPX_ENABLE_GNSS1_CHIPSET_BOOTLOADER": _BOOT,
    "GPX_ENABLE_GNSS2_CHIPSET_BOOTLOADER": _BOOT,
    "GPX_ENABLE_GNSS1_PASS_THROUGH": _BRIDGE,
    "GPX_ENABLE_GNSS2_PASS_THROUGH": _BRIDGE,
    "GPX_SOFT_RESET_GPX": _Harm("restarts", "The GPX restarts; positions pause."),
    "GPX_HARD_RESET_GNSS1": _Harm("restarts", "The first receiver restarts; positions pause."),
    "GPX_HARD_RESET_GNSS2": _Harm("restarts", "The second receiver restarts; positions pause."),
    "GNSS_RCVR_SOFT_RESET": _Harm("restarts", "The receiver restarts; positions pause."),
    "GNSS_RCVR_HARD_RESET": _Harm("restarts", "The receiver restarts and forgets its satellites; positions pause."),
    "GNSS_RCVR_QUIET_MODE": _Harm("stops-output", "The receiver stops; there are no positions until it is reset."),
    "RESET_EKF_STATES": _Harm("moves-frame", "The navigation filter starts anew; attitude and place are found again."),
    "ZERO_MOTION": _ZERO,
    "REF_POINT_STATIONARY": _ZERO,
}

_BY_NUMBER = _Harm(
    "loses-settings", "By its number, a system command restarts the device, makes a port a bridge or erases."
)
_REPLACES = _Harm("stops-output", "These streams take the place of those of this port.")
_OVERWRITES = _Harm(
    "loses-settings", "It overwrites data of the device that cannot be read back and restored from here."
)
INPUTS = (71, 88)  # wheel encoder, position measurement: samples that a vehicle sends to the device

_SIMPLE_COMMANDS = ("SAVE_PERSISTENT_MESSAGES", "SOFTWARE_RESET", "ZERO_MOTION", "RESET_EKF_STATES", "SAVE_FLASH")


@dataclass(frozen=True, slots=True)
class _Kept:
    """A data set that a device keeps or tells of itself.

    Args:
        title: what it is called; the document has constants only.
        write: whether it can be written.
        after: when what is written takes effect.
    """

    title: str
    group: str
    doc: str
    write: bool = False
    after: str = ""
    simple: bool = False


_KEPT: Mapping[int, _Kept] = {
    12: _Kept(
        "Flash configuration",
        G_CONFIG,
        "What the device keeps over a restart; single fields are written by their offset.",
        True,
        "reset",
        True,
    ),
    8: _Kept("NMEA sentences", G_NMEA, "Which sentences are sent, and how often.", write=True, simple=True),
    19: _Kept("Calibration of the magnetometers", G_CAL, "Calibration of the magnetometers.", write=True, simple=True),
    94: _Kept("Calibration in the field", G_CAL, "Calibration in the field.", write=True),
    87: _Kept("Wheels", G_CAL, "Calibration of wheel encoders.", write=True),
    64: _Kept("Built-in test", G_CAL, "Built-in test.", write=True),
    73: _Kept("Survey of a base", G_CONFIG, "Survey of a base's place.", write=True),
    90: _Kept("CAN bus", G_CONFIG, "Messages on the CAN bus.", True, "reset"),
    61: _Kept("RTK engine", G_CONFIG, "Options of the RTK engine.", write=True),
    121: _Kept("Configuration of a GPX", G_CONFIG, "Configuration of a GPX, kept over a restart.", True, "reset"),
    126: _Kept("Streams of a GPX", G_STREAMS, "Streams of a GPX.", write=True),
    125: _Kept("Built-in test of a GPX", G_CAL, "Built-in test of a GPX.", write=True),
    81: _Kept("Configuration of an EVB", G_CONFIG, "Configuration of an EVB, kept over a restart.", True, "reset"),
    1: _Kept("Device", G_ABOUT, "Product, serial number, versions.", simple=True),
    10: _Kept("State of the system", G_ABOUT, "Temperatures, periods and status now."),
    17: _Kept("First GNSS receiver", G_ABOUT, "Version of the first receiver."),
    18: _Kept("Second GNSS receiver", G_ABOUT, "Version of the second receiver."),
    2: _Kept("Last fault", G_ABOUT, "The last fault."),
    75: _Kept("Traffic of the ports", G_ABOUT, "Traffic and losses of every port."),
    120: _Kept("Device, GPX", G_ABOUT, "Product, serial number, versions of a GPX."),
    93: _Kept("Device, EVB", G_ABOUT, "Product, serial number, versions of an EVB."),
}


# -- fields ------------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1024)
def fields_of(did: int, version: str = CURRENT) -> tuple[Field, ...]:
    """The fields of a data set in firmware `version`, with what the manual says of each, in the units of the wire."""
    row = SETS.get(did)
    if row is None or row.struct is None:
        return ()
    size = row.sizes.get(version, row.struct.size)
    return tuple(as_written(noted(did, field)) for field, _ in places(did, 0, size, version=version))


def _select(name: str, doc: str, choices: Mapping[int, str], dtype: str = "<u2", default: int | None = None) -> Field:
    return Field(name, dtype, choices=choices, default=default, doc=doc)


DATA_SETS: Mapping[int, str] = {did: row.name for did, row in SETS.items() if did and row.struct}
_PERIOD = Field("period", "<u2", default=1, doc="Multiple of the source's period.", low=1)

STREAM_FIELDS = (
    Field(
        "streams",
        shape=(-1,),
        most=len(STREAMS),
        fields=(
            _select("did", "Data set.", {did: row.name for did, row in STREAMS.items()}),
            _PERIOD,
            Field("size", "<u2", unit="B", read_only=True, doc="Bytes of its data, as seen; 0 where none was seen."),
            Field("source_ms", "<f8", unit="ms", read_only=True, doc="Period of its source; 0: when it happens."),
        ),
        title="Streams",
        doc="What this port is sent.",
        source=ISB_SOURCE,
    ),
    Field(
        "options",
        "<u4",
        bits=(Bits("PERSISTENT", 9, doc="Keep these streams over a restart"),),
        title="Options",
        default=0,
        doc="Saves these streams when they are written; whether streams are saved cannot be read.",
        source=ISB_SOURCE,
    ),
)

GPX_STREAM_FIELDS = (
    replace(
        STREAM_FIELDS[0],
        most=len(OF_GPX),
        fields=(
            _select("did", "Data set.", {did: row.name for did, row in STREAMS.items() if did in OF_GPX}),
            *STREAM_FIELDS[0].fields[1:],
        ),
    ),
    STREAM_FIELDS[1],
)

ASCE_FIELDS = (
    Field(
        "options",
        "<u4",
        bits=TABLES.words["RMC_OPTIONS"],
        default=0,
        doc="Ports that are meant (none: this one), and whether the sentences are kept over a restart.",
    ),
    Field(
        "messages",
        shape=(-1,),
        most=20,
        fields=(
            _select("id", "Sentence.", NMEA_MESSAGES),
            Field("period", "<u2", default=1, doc="Multiple of its source's period; 0 switches it off."),
        ),
        default=(),
        doc="Sentences and their periods; without any, the device tells those it has.",
    ),
)

# -- commands ----------------------------------------------------------------------------------------------------------

_STOPS = _Harm("stops-output", "Everything that this port sends stops, NMEA too, until it is asked for again.")
_STOPS_ALL = _Harm("stops-output", "Every port of the device falls silent, also those that other computers listen to.")


def _packets() -> list[Command]:
    get = COMMANDS[GET_DATA]
    did = _select("id", "Data set.", DATA_SETS)
    first = get.fields[0]
    arguments = (replace(first, choices=DATA_SETS), *(replace(field, default=0) for field in get.fields[1:]))
    stop = "ACK"
    return [
        Command("GET_DATA", arguments, "ask", G_STREAMS, simple=False, title="Ask for a data set", doc=get.doc),
        Command(
            "STOP_DID_BROADCAST",
            (replace(did, dtype="u1"),),
            "do",
            G_STREAMS,
            title="Stop one stream",
            doc="Nothing answers it.",
        ),
        _harmed(
            Command(
                "STOP_BROADCASTS_CURRENT_PORT",
                (),
                "do",
                G_STREAMS,
                stop,
                title="Stop all streams of this port",
                doc=COMMANDS[STOP_CURRENT_PORT].doc,
            ),
            _STOPS,
        ),
        _harmed(
            Command(
                "STOP_BROADCASTS_ALL_PORTS",
                (),
                "do",
                G_STREAMS,
                stop,
                simple=False,
                title="Stop all streams of all ports",
                doc=COMMANDS[STOP_ALL_PORTS].doc,
            ),
            _STOPS_ALL,
        ),
    ]


def _harmed(command: Command, harm: _Harm | None) -> Command:
    if harm is None:
        return command
    return replace(command, caution=harm.caution, consequence=harm.consequence)


def _nmea() -> list[Command]:
    rows = (
        Command("ASCE", ASCE_FIELDS, "set", G_NMEA, "ASCB", title="Choose NMEA sentences"),
        Command("INFO", (), "ask", G_NMEA, "INFO", title="Who are you, in text"),
        _harmed(Command("PERS", (), "do", G_NMEA, title="Keep NMEA sentences"), _HARM["SAVE_PERSISTENT_MESSAGES"]),
        _harmed(Command("SRST", (), "do", G_NMEA, simple=False, title="Restart, by text"), _RESTARTS),
        _harmed(Command("STPB", (), "do", G_NMEA, simple=False, title="Stop all ports, by text"), _STOPS_ALL),
        _harmed(Command("STPC", (), "do", G_NMEA, title="Stop this port, by text"), _STOPS),
    )
    docs = {
        "ASCE": "Chooses sentences and their periods; without any, the device tells those it has.",
        "INFO": "The device tells its serial number and versions as a sentence.",
        "SRST": "Restarts the device.",
        "STPB": "Stops binary and text on every port; understood by every version of the protocol.",
        "STPC": "Stops binary and text on this port; understood by every version of the protocol.",
        "PERS": "Keeps what streams now over a restart.",
    }
    return [replace(row, source=NMEA_SOURCE, doc=docs.get(row.name, "")) for row in rows]


def _harm_of(name: str) -> _Harm | None:
    """What a system command may cost."""
    if name in _HARM:
        return _HARM[name]
    if "BRIDGE" in name and not name.startswith("DISABLE"):
        return _BRIDGE
    return _MAKER if name.startswith("MANF_") else _FAULT if name.startswith("FAULT_") else None


HARMLESS_COMMANDS = tuple(
    number
    for number, name in SYSTEM_COMMANDS.items()
    if (harm := _harm_of(name)) is None or harm.caution == "wears-flash"
)


def _system() -> list[Command]:
    commands = []
    for name in SYSTEM_COMMANDS.values():
        harm = _harm_of(name)
        row = Command(
            f"DID_SYS_CMD.{name}",
            (),
            "do",
            G_SYSTEM,
            "ACK",
            simple=name in _SIMPLE_COMMANDS,
            title=spoken(name),
            doc=_does(name),
            source=SOURCE,
        )
        commands.append(_harmed(row, harm))
    return commands


def _does(name: str) -> str:
    """What a system command does."""
    said = TABLES.help.get(("eSystemCommand", name), ("", ""))[1]
    if not said and "_BRIDGE_" in name:
        ends = spoken(name.partition("_BRIDGE_")[2]).replace(" to ", " and ")
        said = f"Passes bytes between two ports: {ends}."
    return f"{said} Sent with its bitwise inverse.".strip()


def _presets() -> list[Command]:
    def options(did: int) -> Field:
        return replace(next(field for field in fields_of(did) if field.name == "options"), default=0)

    return [
        Command(
            f"{head}.{name}",
            (options(BY_NAME[head].id),),
            "do",
            G_STREAMS,
            "ACK",
            caution="stops-output",
            consequence=_REPLACES.consequence,
            simple=name in ("INS", "IMX_PPD", "GPX_IMX"),
            title=f"Streams: {name.replace('_', ' ')}",
            doc="A preset of the maker.",
            source=SOURCE,
        )
        for head, presets in (("DID_RMC", PRESETS), ("DID_GPX_RMC", GPX_PRESETS))
        for name in presets
    ]


def _calibrations() -> list[Command]:
    words = {"MULTI_AXIS": "about all axes", "SINGLE_AXIS": "about the vertical", "ABORT": "abort"}
    return [
        Command(
            f"DID_MAG_CAL.{name}",
            (),
            "do",
            G_CAL,
            "ACK",
            caution="" if name == "ABORT" else "moves-frame",
            consequence="" if name == "ABORT" else "The calibration of the magnetometers is replaced.",
            title=f"Magnetometers: {how}",
            doc="Ends the calibration; nothing of it is kept."
            if name == "ABORT"
            else "Turn the device slowly until the progress is 100 %.",
            source=SOURCE,
        )
        for name, how in words.items()
    ]


def _title(did: int) -> str:
    return _KEPT[did].title if did in _KEPT else ROWS[did].title


def _asks() -> list[Command]:
    get = COMMANDS[GET_DATA].fields
    arguments = tuple(replace(field, default=0, simple=False) for field in get[1:])
    return [
        Command(
            f"{GET_PREFIX}{name}",
            arguments,
            "ask",
            G_READ,
            name,
            simple=False,
            title=_title(did),
            doc=ROWS[did].doc,
            source=SOURCE,
        )
        for did, name in DATA_SETS.items()
    ]


def _sets() -> list[Command]:
    commands = []
    for did, name in DATA_SETS.items():
        kept = _KEPT.get(did)
        command = Command(
            f"{SET_PREFIX}{name}",
            fields_of(did),
            "set",
            G_WRITE,
            "ACK",
            simple=False,
            title=_title(did),
            doc=kept.doc
            if kept and kept.write
            else f"{ROWS[did].doc} A device refuses what it does not let be written.",
            source=SOURCE,
        )
        if did == SYS_CMD:
            command = replace(_harmed(command, _BY_NUMBER), harmless={"command": HARMLESS_COMMANDS})
        elif did == RMC:
            command = _harmed(command, _REPLACES)
        elif not (kept and kept.write) and did not in INPUTS:
            command = _harmed(command, _OVERWRITES)
        commands.append(command)
    return commands


COMMAND_ROWS: Mapping[str, Command] = {
    row.name: row for row in (*_packets(), *_presets(), *_nmea(), *_calibrations(), *_system(), *_asks(), *_sets())
}

# -- settings ----------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=16)
def settings_of(version: str = CURRENT) -> Mapping[str, Setting]:
    """Everything that is kept, by name, for firmware `version`."""
    rows = [
        Setting(
            STREAMS_SETTING,
            STREAM_FIELDS,
            read=f"{GET_PREFIX}DID_RMC",
            write="GET_DATA",
            partial=True,
            editor="streams",
            group=G_STREAMS,
            title="Streams",
            doc="What the device sends to this port, and how often.",
            source=ISB_SOURCE,
        )
    ]
    for did, kept in _KEPT.items():
        name = SETS[did].name
        rows.append(
            Setting(
                name,
                fields_of(did, version),
                read=f"{GET_PREFIX}{name}",
                write=f"{SET_PREFIX}{name}" if kept.write else "",
                partial=kept.write and did not in WHOLE,
                after=kept.after,  # type: ignore[arg-type]
                group=kept.group,
                simple=kept.simple,
                title=kept.title,
                doc=kept.doc,
                source=SOURCE,
            )
        )
    return {row.name: row for row in rows if row.fields}
