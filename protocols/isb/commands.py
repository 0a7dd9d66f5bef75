"""Commands of an Inertial Sense device, as rows.

    GET_DID_x          asks once for a data set (or a part of it, or as a stream)             answer: DID_x, or NACK
    SET_DID_x          writes a data set, or neighbouring fields of it by offset              answer: ACK or NACK
    DID_SYS_CMD.x      a system command, sent with its bitwise inverse in one set             answer: ACK or NACK
    DID_RMC.x          a preset of streams, by the bits of DID_RMC                            answer: ACK
    DID_MAG_CAL.x      starts or aborts a calibration of the magnetometers                    answer: ACK
    GET_DATA STOP_…    the packets themselves
    ASCE INFO PERS SRST STPB STPC                  the same in text, NMEA 0183, for every version of the protocol

The risk in a row (`caution`, `consequence`) is shown to the user before it is sent. stored_settings.py lists
the stored settings.

Rules for editing: a system command is a row of datasets.txt (eSystemCommand) and, if it has a risk, one of `_RISKS`. A
stored data set is a row of stored_settings.py.

Source: ISB document; NMEA document of the same maker, "NMEA input messages"; inertial-sense-sdk 2.7.1, data_sets.h.
"""

from collections.abc import Mapping
from dataclasses import replace

from imuscope.protocols.commands.transactions import Risk
from imuscope.protocols.isb.dataset_loader import SOURCE, TABLES
from imuscope.protocols.isb.field_docs import SENTENCES
from imuscope.protocols.isb.frames import GET_DATA, STOP_ALL_PORTS, STOP_CURRENT_PORT
from imuscope.protocols.isb.messages import BY_NAME, COMMANDS, ROWS, SET_PREFIX
from imuscope.protocols.isb.stored_settings import (
    DATA_SETS,
    G_CAL,
    G_NMEA,
    G_READ,
    G_STREAMS,
    G_SYSTEM,
    G_WRITE,
    GET_PREFIX,
    STORED,
    fields_of,
    select,
)
from imuscope.protocols.isb.streams import GPX_PRESETS, PRESETS
from imuscope.protocols.schema.fields import Command, Field
from imuscope.protocols.schema.labels import constant_label

SYS_CMD, NMEA_PERIODS, RMC, FLASH, MAG_CAL, DEV_INFO, SYS_PARAMS = 7, 8, 9, 12, 19, 1, 10
NMEA_SOURCE = "Inertial Sense user manual, NMEA 0183 (ASCII) protocol"
SAVE_PERSISTENT, SAVE_FLASH, SOFTWARE_RESET = 1, 97, 99

SYSTEM_COMMANDS: Mapping[int, str] = {
    value: name for value, name in TABLES.choices["eSystemCommand"].items() if name != "NONE"
}
INVERSE = "invCommand"  # of a system command
NMEA_MESSAGES = TABLES.choices["eNmeaMsgId"]
_SENTENCES = {  # selectable ones: neither commands nor marks
    number: name
    for number, name in NMEA_MESSAGES.items()
    if (number in SENTENCES or number > 256) and name != "INVALID" and not name.endswith("_START")
}


_RESTARTS = Risk("restarts", "The device restarts; streams that are not saved do not resume.")
_BRIDGE = Risk("cuts-line", "A port becomes a bridge and no longer answers until the device restarts.")
_BOOT = Risk("cuts-line", "The device waits in its bootloader for firmware and does not measure until it restarts.")
_MAKER = Risk("loses-settings", "A manufacturer command; data that it erases cannot be restored by this program.")
_FAULT = Risk("restarts", "Causes a deliberate fault; the device restarts.")
_ZERO = Risk("moves-frame", "The device assumes that it is stationary; if it is moving, its navigation becomes wrong.")
_FLASH = Risk("wears-flash", "Writes to the flash memory, which supports a limited number of writes.")

_RISKS: Mapping[str, Risk] = {
    "SAVE_PERSISTENT_MESSAGES": Risk("wears-flash", "The current streams resume after every restart."),
    "SAVE_FLASH": _FLASH,
    "SAVE_GPS_ASSIST_TO_FLASH_RESET": _RESTARTS,
    "SOFTWARE_RESET": _RESTARTS,
    "ENABLE_BOOTLOADER_AND_RESET": _BOOT,
    "GPX_ENABLE_BOOTLOADER_MODE": _BOOT,
    "GPX_ENABLE_GNSS1_CHIPSET_BOOTLOADER": _BOOT,
    "GPX_ENABLE_GNSS2_CHIPSET_BOOTLOADER": _BOOT,
    "GPX_ENABLE_GNSS1_PASS_THROUGH": _BRIDGE,
    "GPX_ENABLE_GNSS2_PASS_THROUGH": _BRIDGE,
    "GPX_SOFT_RESET_GPX": Risk("restarts", "The GPX restarts; positions pause."),
    "GPX_HARD_RESET_GNSS1": Risk("restarts", "The first receiver restarts; positions pause."),
    "GPX_HARD_RESET_GNSS2": Risk("restarts", "The second receiver restarts; positions pause."),
    "GNSS_RCVR_SOFT_RESET": Risk("restarts", "The receiver restarts; positions pause."),
    "GNSS_RCVR_HARD_RESET": Risk("restarts", "The receiver restarts and discards its satellite data; positions pause."),
    "GNSS_RCVR_QUIET_MODE": Risk("stops-output", "The receiver stops; no positions are available until it is reset."),
    "RESET_EKF_STATES": Risk(
        "moves-frame", "The navigation filter restarts; attitude and position must converge again."
    ),
    "ZERO_MOTION": _ZERO,
    "REF_POINT_STATIONARY": _ZERO,
}

_BY_NUMBER = Risk(
    "loses-settings",
    "Depending on its number, a system command can restart the device, turn a port into a bridge or erase data.",
)
_REPLACES = Risk("stops-output", "These streams replace the current streams of this port.")
_OVERWRITES = Risk(
    "loses-settings", "Overwrites data of the device that cannot be read back and restored by this program."
)
_STORED = ("UCAL", "TCAL", "MCAL", "SCOMP", "TC_BIAS", "MANUFACTURING", "DEV_INFO", "FLASH")
"""Parts of the names of data sets that a device stores; it rejects writes to those that it measures."""

_SIMPLE_COMMANDS = ("SAVE_PERSISTENT_MESSAGES", "SOFTWARE_RESET", "ZERO_MOTION", "RESET_EKF_STATES", "SAVE_FLASH")


ASCE_FIELDS = (
    Field(
        "options",
        "<u4",
        bits=TABLES.words["RMC_OPTIONS"],
        default=0,
        doc="Ports addressed (none: this port), and whether the sentences are saved across restarts.",
    ),
    Field(
        "messages",
        shape=(-1,),
        max_length=20,
        fields=(
            select("id", "Sentence.", _SENTENCES),
            Field("period", "<u2", default=1, doc="Multiple of the source's period; 0 switches the sentence off."),
        ),
        default=(),
        doc="Sentences and their periods; an empty list requests the current ones.",
    ),
)

# -- commands ----------------------------------------------------------------------------------------------------------

_STOPS = Risk("stops-output", "All output on this port stops, including NMEA, until it is requested again.")
_STOPS_ALL = Risk("stops-output", "Output stops on every port of the device, including ports used by other computers.")


def _packets() -> list[Command]:
    get = COMMANDS[GET_DATA]
    did = select("id", "Data set.", DATA_SETS)
    first = get.fields[0]
    arguments = (replace(first, choices=DATA_SETS), *(replace(field, default=0) for field in get.fields[1:]))
    stop = "ACK"
    return [
        Command("GET_DATA", arguments, "ask", G_STREAMS, basic=False, title="Request a data set", doc=get.doc),
        Command(
            "STOP_DID_BROADCAST",
            (replace(did, dtype="u1"),),
            "do",
            G_STREAMS,
            title="Stop one stream",
            doc="The device does not acknowledge this command.",
        ),
        _with_risk(
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
        _with_risk(
            Command(
                "STOP_BROADCASTS_ALL_PORTS",
                (),
                "do",
                G_STREAMS,
                stop,
                basic=False,
                title="Stop all streams of all ports",
                doc=COMMANDS[STOP_ALL_PORTS].doc,
            ),
            _STOPS_ALL,
        ),
    ]


def _with_risk(command: Command, risk: Risk | None) -> Command:
    if risk is None:
        return command
    return replace(command, caution=risk.caution, consequence=risk.consequence)


def _nmea() -> list[Command]:
    rows = (
        Command("ASCE", ASCE_FIELDS, "set", G_NMEA, "ASCB", title="Set NMEA sentences"),
        Command("INFO", (), "ask", G_NMEA, "INFO", title="Device information (text)"),
        _with_risk(Command("PERS", (), "do", G_NMEA, title="Save NMEA sentences"), _RISKS["SAVE_PERSISTENT_MESSAGES"]),
        _with_risk(Command("SRST", (), "do", G_NMEA, basic=False, title="Restart (text)"), _RESTARTS),
        _with_risk(Command("STPB", (), "do", G_NMEA, basic=False, title="Stop all ports (text)"), _STOPS_ALL),
        _with_risk(Command("STPC", (), "do", G_NMEA, title="Stop this port (text)"), _STOPS),
    )
    docs = {
        "ASCE": "Sets the sentences and their periods; an empty list requests the current ones.",
        "INFO": "Requests serial number and versions as a sentence.",
        "SRST": "Restarts the device.",
        "STPB": "Stops binary and text output on every port; supported by every version of the protocol.",
        "STPC": "Stops binary and text output on this port; supported by every version of the protocol.",
        "PERS": "Saves the current streams across restarts.",
    }
    return [replace(row, source=NMEA_SOURCE, doc=docs.get(row.name, "")) for row in rows]


def _risk_of(name: str) -> Risk | None:
    if name in _RISKS:
        return _RISKS[name]
    if "BRIDGE" in name and not name.startswith("DISABLE"):
        return _BRIDGE
    return _MAKER if name.startswith("MANF_") else _FAULT if name.startswith("FAULT_") else None


HARMLESS_COMMANDS = tuple(number for number, name in SYSTEM_COMMANDS.items() if _risk_of(name) is None)


def _system() -> list[Command]:
    commands = []
    for name in SYSTEM_COMMANDS.values():
        risk = _risk_of(name)
        row = Command(
            f"DID_SYS_CMD.{name}",
            (),
            "do",
            G_SYSTEM,
            "ACK",
            basic=name in _SIMPLE_COMMANDS,
            title=constant_label(name),
            doc=_does(name),
            source=SOURCE,
        )
        commands.append(_with_risk(row, risk))
    return commands


def _does(name: str) -> str:
    effect = TABLES.help.get(("eSystemCommand", name), ("", ""))[1]
    if not effect and "_BRIDGE_" in name:
        ends = constant_label(name.partition("_BRIDGE_")[2]).replace(" to ", " and ")
        effect = f"Passes bytes between two ports: {ends}."
    return f"{effect} Sent with its bitwise inverse.".strip()


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
            basic=name in ("INS", "IMX_PPD", "GPX_IMX"),
            title=f"Streams: {name.replace('_', ' ')}",
            doc="Preset of the manufacturer.",
            source=SOURCE,
        )
        for head, presets in (("DID_RMC", PRESETS), ("DID_GPX_RMC", GPX_PRESETS))
        for name in presets
    ]


def _calibrations() -> list[Command]:
    words = {
        "MULTI_AXIS": "calibrate about all axes",
        "SINGLE_AXIS": "calibrate about the vertical axis",
        "ABORT": "abort calibration",
    }
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
            doc="Aborts the calibration and discards it."
            if name == "ABORT"
            else "Turn the device slowly until the progress is 100 %.",
            source=SOURCE,
        )
        for name, how in words.items()
    ]


def _title(did: int) -> str:
    return STORED[did].title if did in STORED else ROWS[did].title


def _requests() -> list[Command]:
    get = COMMANDS[GET_DATA].fields
    arguments = tuple(replace(field, default=0, basic=False) for field in get[1:])
    return [
        Command(
            f"{GET_PREFIX}{name}",
            arguments,
            "ask",
            G_READ,
            name,
            basic=False,
            title=_title(did),
            doc=ROWS[did].doc,
            source=SOURCE,
        )
        for did, name in DATA_SETS.items()
    ]


def _sets() -> list[Command]:
    commands = []
    for did, name in DATA_SETS.items():
        stored = STORED.get(did)
        command = Command(
            f"{SET_PREFIX}{name}",
            fields_of(did),
            "set",
            G_WRITE,
            "ACK",
            basic=False,
            title=_title(did),
            doc=stored.doc if stored and stored.write else f"{ROWS[did].doc} Devices reject writes to read-only data.",
            source=SOURCE,
        )
        if did == SYS_CMD:  # the inverse follows from the command
            command = replace(command, arguments=tuple(one for one in command.arguments if one.name != INVERSE))
            command = replace(_with_risk(command, _BY_NUMBER), harmless_values={"command": HARMLESS_COMMANDS})
        elif did == RMC:
            command = _with_risk(command, _REPLACES)
        elif not (stored and stored.write) and any(part in ROWS[did].name for part in _STORED):
            command = _with_risk(command, _OVERWRITES)
        commands.append(command)
    return commands


COMMAND_ROWS: Mapping[str, Command] = {
    row.name: row for row in (*_packets(), *_presets(), *_nmea(), *_calibrations(), *_system(), *_requests(), *_sets())
}
