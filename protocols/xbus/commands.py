"""Commands and settings of an MTi. Tables; the engine that reads them is at the end.

    _ROWS      one per message to the device: heading, effect, products, possible harm
    _SETTINGS  one per setting: the message pair that reads and writes it
    fitted     a row's fields for one product: its option flags, sync functions and lines, filter profiles

Names, fields and sections come from messages.py; a name with two forms (string output, filter profile) has the
product's form, or both, distinguished by title, if the product is unknown.

A command's row gives the required state of the device (`CommandState`); most need the config state.

Rules for editing: a row holds no code; a field's range belongs to messages.py, product dependencies to `fitted`.

Source: MT0101P 2020.A, 5.3.1 to 5.3.7, tables 8, 11, 12 and 30; time-outs as in the vendor's own software.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Literal

from imuscope.protocols.schema.fields import Caution, Command, Field, Message, Setting
from imuscope.protocols.xbus.messages import BY_NAME, ROWS, answers
from imuscope.protocols.xbus.product_options import fitted
from imuscope.protocols.xbus.products import ALL, CLASSIC, FILTER, NO_PRODUCTS, ONE, RTK, SIX, Model, has, model_of

CommandState = Literal["config", "measuring", "any"]

OUTPUT, FRAME, PROFILE, SYNC, PORT, RECEIVER, HEADING, IDENTITY, COMMANDS = GROUPS = (
    "Output configuration",
    "Frame and mounting",
    "Filter profile",
    "Sync and triggers",
    "Port and baud rate",
    "GNSS and RTK input",
    "Heading and no-rotation",
    "Identity and firmware",
    "Commands",
)
"""Headings of the groups, in order."""


RESET_AND_STORE = "ResetOrientation.Stored"
_NOT_STORED = "The orientation reset is not stored: it is discarded when the device next starts measuring."
_CALIBRATION = {
    0: "Representative motion is being collected for the compass calibration: it ends when the device stops measuring.",
    1: "The result of the compass calibration is not stored: it may be lost when the device next starts measuring.",
    2: "",
}


@dataclass(frozen=True, slots=True)
class CommandRow:
    """One message to the device.

    Args:
        message: its name in messages.py.
        form: which of the rows of that name.
        products: products that have it.
        state: state in which it is valid; ResetOrientation and IccCommand decide by their argument (see `state_of`).
        name: of the command, if different from the message's: one action of several messages (driver.py).
        harmless_values: as in imuscope.protocols.schema.fields.Command.
    """

    message: str
    kind: Literal["ask", "set", "do"]
    group: str
    title: str
    products: frozenset[int] = ALL
    form: int = 0
    state: CommandState = "config"
    timeout_s: float = 0.5
    caution: Caution = ""
    consequence: str = ""
    basic: bool = True
    name: str = ""
    harmless_values: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    @property
    def row(self) -> Message:
        return BY_NAME[self.message][self.form]


def _request_row(message: str, group: str, title: str, on: frozenset[int] = ALL, **more: Any) -> CommandRow:
    return CommandRow(message, "ask", group, title, on, basic=False, **more)


def _set(message: str, group: str, title: str, on: frozenset[int] = ALL, **more: Any) -> CommandRow:
    return CommandRow(message, "set", group, title, on, **more)


def _do(message: str, group: str, title: str, on: frozenset[int] = ALL, **more: Any) -> CommandRow:
    return CommandRow(message, "do", group, title, on, **more)


_CUTS = "After its restart, a cable or program that does not use the new settings loses the connection."
_GNSS_HEADING = frozenset({710, 670, 680})
_PLATFORM = frozenset({7, 710})

_ROWS: tuple[CommandRow, ...] = (
    _request_row("ReqOutputConfiguration", OUTPUT, "Read the output configuration"),
    _set("SetOutputConfiguration", OUTPUT, "Set the output configuration"),
    _request_row("ReqStringOutputType", OUTPUT, "Read the string output", ALL - ONE),
    _set("SetStringOutputType", OUTPUT, "Set the string output", CLASSIC, form=0, caution="stops-output",
         consequence="The device sends text lines in place of MTData2; 0 returns to MTData2."),
    _set("SetStringOutputType", OUTPUT, "Set the string output", SIX, form=1, caution="stops-output",
         consequence="The device sends text lines in place of MTData2; 0 returns to MTData2."),
    _request_row("ReqPeriod", OUTPUT, "Read the string output period", CLASSIC),
    _set("SetPeriod", OUTPUT, "Set the string output period", CLASSIC, basic=False),
    _request_row("ReqOutputSkipFactor", OUTPUT, "Read the string output skip factor", CLASSIC),
    _set("SetOutputSkipFactor", OUTPUT, "Set the string output skip factor", CLASSIC, basic=False),
    _request_row("ReqCanOutputConfig", OUTPUT, "Read the CAN output configuration", SIX),
    _set("SetCanOutputConfig", OUTPUT, "Set the CAN output configuration", SIX, basic=False),
    _request_row("ReqConfiguration", OUTPUT, "Read the configuration (log header)", timeout_s=5.0),
    _do("ReqData", OUTPUT, "Request one sample", state="measuring", basic=False),
    # frame
    _request_row("ReqAlignmentRotation", FRAME, "Read an alignment"),
    _set("SetAlignmentRotation", FRAME, "Set an alignment", caution="moves-frame",
         consequence="Vectors and orientation are given in another frame; every consumer of the data must be adapted."),
    _request_row("ReqLatLonAlt", FRAME, "Read the stored position"),
    _set("SetLatLonAlt", FRAME, "Store a position"),
    # filter
    _request_row("ReqAvailableFilterProfiles", PROFILE, "List the filter profiles", FILTER),
    _request_row("ReqFilterProfile", PROFILE, "Read the filter profile", FILTER),
    _set("SetFilterProfile", PROFILE, "Set the filter profile", FILTER - SIX, form=0),
    _set("SetFilterProfile", PROFILE, "Set the filter profile", FILTER & SIX, form=1),
    _request_row("ReqOptionFlags", PROFILE, "Read the option flags"),
    _set("SetOptionFlags", PROFILE, "Set and clear option flags"),
    # sync
    _request_row("ReqSyncSettings", SYNC, "Read the sync settings"),
    _set("SetSyncSettings", SYNC, "Replace the sync settings"),
    _request_row("ReqUTCTime", SYNC, "Read UTC"),
    _set("SetUTCTime", SYNC, "Set UTC"),
    _do("AdjustUTCTime", SYNC, "Adjust UTC", basic=False),
    # port
    _request_row("ReqBaudrate", PORT, "Read the baud rate"),
    _set("SetBaudrate", PORT, "Set the baud rate", timeout_s=1.0, caution="cuts-line", consequence=_CUTS),
    _request_row("ReqPortConfig", PORT, "Read the port configuration", SIX),
    _set("SetPortConfig", PORT, "Configure the ports", SIX, caution="cuts-line", consequence=_CUTS),
    _request_row("ReqCanConfig", PORT, "Read the CAN transceiver", SIX),
    _set("SetCanConfig", PORT, "Configure the CAN transceiver", SIX, basic=False, caution="cuts-line",
         consequence="A CAN connection is lost if the rate changes or the transceiver is switched off."),
    _request_row("ReqExtOutputMode", PORT, "Read the extended output mode", CLASSIC),
    _set("SetExtOutputMode", PORT, "Set the extended output mode", CLASSIC, basic=False, caution="cuts-line",
         consequence="With the alternative UART selected, the device no longer answers on its main serial line."),
    _request_row("ReqTransmitDelay", PORT, "Read the RS-485 delay", CLASSIC),
    _set("SetTransmitDelay", PORT, "Set the RS-485 delay", CLASSIC, basic=False),
    # receiver
    _request_row("ReqGnssPlatform", RECEIVER, "Read the expected motion", _PLATFORM),
    _set("SetGnssPlatform", RECEIVER, "Set the expected motion", _PLATFORM, basic=False),
    _request_row("ReqGnssLeverArm", RECEIVER, "Read the antenna lever arm", RTK),
    _set("SetGnssLeverArm", RECEIVER, "Set the antenna lever arm", RTK),
    _do("ForwardGnssData", RECEIVER, "Forward data to the GNSS receiver", RTK, state="measuring", caution="moves-frame",
        consequence="Incorrect data shift the position; the receiver does not verify them."),
    _request_row("ReqGnssReceiverSettings", RECEIVER, "Read the GNSS receiver settings", NO_PRODUCTS),
    _set("SetGnssReceiverSettings", RECEIVER, "Configure the GNSS receiver", NO_PRODUCTS, basic=False),
    # heading
    _do("ResetOrientation", HEADING, "Reset the orientation and store it", FILTER, state="measuring",
        name=RESET_AND_STORE, caution="moves-frame",
        consequence="Heading or orientation jumps permanently to a new reference; all data consumers are affected. "
        "Storing interrupts the data briefly."),
    _do("ResetOrientation", HEADING, "Reset the orientation", FILTER, state="measuring", caution="moves-frame",
        consequence="Heading or orientation jumps to a new reference; all data consumers are affected. The reset is "
        "discarded when the device next starts measuring, unless it is stored (0) first."),
    _do("SetNoRotation", HEADING, "Estimate the gyroscope bias at rest", FILTER, state="measuring",
        caution="moves-frame",
        consequence="If the device moves during the estimation, the bias is wrong and the orientation drifts."),
    _do("IccCommand", HEADING, "In-run compass calibration", FILTER, state="measuring", timeout_s=3.5, basic=False,
        caution="moves-frame",
        consequence="A stored calibration changes the magnetic field, and therefore the heading.",
        harmless_values={"command": (0, 1, 3)}),
    _do("SetInitialHeading", HEADING, "Set the initial heading", _GNSS_HEADING, caution="moves-frame",
        consequence="The filter starts with this heading; a wrong one persists until the filter has corrected it."),
    _do("StoreFilterState", HEADING, "Store the filter state", NO_PRODUCTS, basic=False, caution="wears-flash",
        consequence="Each call writes to the flash memory."),
    # identity
    _request_row("ReqDID", IDENTITY, "Read the serial number"),
    _request_row("ReqProductCode", IDENTITY, "Read the product code"),
    _request_row("ReqHardwareVersion", IDENTITY, "Read the hardware version"),
    _request_row("ReqFWRev", IDENTITY, "Read the firmware revision"),
    _request_row("ReqLocationID", IDENTITY, "Read the location identifier"),
    _set("SetLocationID", IDENTITY, "Set the location identifier"),
    _request_row("ReqEmts", IDENTITY, "Read the stored calibration", NO_PRODUCTS, timeout_s=5.0),
    _do("RunSelftest", IDENTITY, "Run the self-test", timeout_s=3.0),
    # commands
    _do("GoToConfig", COMMANDS, "Stop measuring", state="any", caution="stops-output",
        consequence="The device sends no data until it is set to measure again."),
    _do("GoToMeasurement", COMMANDS, "Measure", state="any"),
    _do("Reset", COMMANDS, "Restart the device", state="any", caution="restarts",
        consequence="The device sends no data for about two seconds; clock, counter and filter restart."),
    _do("RestoreFactoryDef", COMMANDS, "Restore the factory settings", timeout_s=2.0, caution="loses-settings",
        consequence="All settings, alignments and filter settings return to factory defaults; the baud rate returns to "
        "115 200 Bd at the next reset."),
    _do("WakeUpAck", COMMANDS, "Keep a starting device in the config state", state="any", basic=False),
    _do("InitBus", COMMANDS, "Initialise the bus", NO_PRODUCTS, basic=False),
    _request_row("ReqErrorMode", COMMANDS, "Read the error mode", NO_PRODUCTS),
    _set("SetErrorMode", COMMANDS, "Set the error mode", NO_PRODUCTS, basic=False),
    _request_row("ReqOutputMode", COMMANDS, "Read the output mode", NO_PRODUCTS),
    _set("SetOutputMode", COMMANDS, "Set the output mode", NO_PRODUCTS, basic=False),
    _request_row("ReqOutputSettings", COMMANDS, "Read the output settings", NO_PRODUCTS),
    _set("SetOutputSettings", COMMANDS, "Set the output settings", NO_PRODUCTS, basic=False),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class StoredSetting:
    """One setting.

    Args:
        read, write: messages; write "" for read-only values.
        only: names of its fields; () for all of the answer's.
        momentary: those of its fields that give a momentary state.
        fixed: fixed arguments of both messages (which of two alignments).
        per_sensor: as for a setting.
    """

    name: str
    read: str
    write: str = ""
    group: str = ""
    title: str = ""
    products: frozenset[int] = ALL
    editor: str = ""
    after: Literal["", "measurement", "reset"] = ""
    basic: bool = True
    only: tuple[str, ...] = ()
    read_only_fields: tuple[str, ...] = ()
    momentary: tuple[str, ...] = ()
    fixed: Mapping[str, int] = field(default_factory=dict)
    per_sensor: bool = False


_Q = ("q0", "q1", "q2", "q3")

_SETTINGS: tuple[StoredSetting, ...] = (
    StoredSetting("OutputConfiguration", "ReqOutputConfiguration", "SetOutputConfiguration", OUTPUT,
                  "Output configuration", editor="outputs", after="measurement"),
    StoredSetting("StringOutputType", "ReqStringOutputType", "SetStringOutputType", OUTPUT,
                  "String output", ALL - ONE, after="measurement", basic=False),
    StoredSetting("Period", "ReqPeriod", "SetPeriod", OUTPUT, "String output period", CLASSIC, after="measurement",
                  basic=False),
    StoredSetting("OutputSkipFactor", "ReqOutputSkipFactor", "SetOutputSkipFactor", OUTPUT,
                  "String output skip factor", CLASSIC, after="measurement", basic=False),
    StoredSetting("CanOutputConfig", "ReqCanOutputConfig", "SetCanOutputConfig", OUTPUT, "CAN output configuration",
                  SIX, after="measurement", basic=False),
    StoredSetting("AlignmentRotation.RotSensor", "ReqAlignmentRotation", "SetAlignmentRotation", FRAME,
                  "Sensor frame to object frame", after="measurement", only=_Q, fixed={"parameter": 0}),
    StoredSetting("AlignmentRotation.RotLocal", "ReqAlignmentRotation", "SetAlignmentRotation", FRAME,
                  "Local frame alignment", after="measurement", only=_Q, fixed={"parameter": 1}),
    StoredSetting("LatLonAlt", "ReqLatLonAlt", "SetLatLonAlt", FRAME, "Position for gravity and declination"),
    StoredSetting("FilterProfile", "ReqFilterProfile", "SetFilterProfile", PROFILE, "Filter profile", FILTER,
                  after="measurement", read_only_fields=("version",)),
    StoredSetting("AvailableFilterProfiles", "ReqAvailableFilterProfiles", "", PROFILE,
                  "Available filter profiles", FILTER, basic=False),
    StoredSetting("OptionFlags", "ReqOptionFlags", "SetOptionFlags", PROFILE, "Option flags"),
    StoredSetting("SyncSettings", "ReqSyncSettings", "SetSyncSettings", SYNC, "Sync in and out", after="measurement"),
    StoredSetting("Baudrate", "ReqBaudrate", "SetBaudrate", PORT, "Baud rate", ALL - SIX, after="reset"),
    StoredSetting("PortConfig", "ReqPortConfig", "SetPortConfig", PORT, "Ports", SIX, after="reset"),
    StoredSetting("CanConfig", "ReqCanConfig", "SetCanConfig", PORT, "CAN transceiver", SIX, after="reset",
                  basic=False),
    StoredSetting("ExtOutputMode", "ReqExtOutputMode", "SetExtOutputMode", PORT, "Extended output mode", CLASSIC,
                  after="reset", basic=False),
    StoredSetting("TransmitDelay", "ReqTransmitDelay", "SetTransmitDelay", PORT, "RS-485 delay", CLASSIC, basic=False),
    StoredSetting("GnssPlatform", "ReqGnssPlatform", "SetGnssPlatform", RECEIVER, "Expected motion", _PLATFORM,
                  basic=False),
    StoredSetting("GnssLeverArm", "ReqGnssLeverArm", "SetGnssLeverArm", RECEIVER, "Antenna lever arm", RTK),
    StoredSetting("LocationID", "ReqLocationID", "SetLocationID", IDENTITY, "Location identifier",
                  per_sensor=True),
    StoredSetting("DeviceID", "ReqDID", "", IDENTITY, "Serial number"),
    StoredSetting("ProductCode", "ReqProductCode", "", IDENTITY, "Product code"),
    StoredSetting("HardwareVersion", "ReqHardwareVersion", "", IDENTITY, "Hardware version"),
    StoredSetting("FirmwareRev", "ReqFWRev", "", IDENTITY, "Firmware revision"),
    StoredSetting("Configuration", "ReqConfiguration", "", IDENTITY, "Configuration (log header)",
                  basic=False, momentary=("date", "time")),
)  # fmt: skip


# -- the tables, per product -------------------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def rows(model: Model | None) -> Mapping[str, CommandRow]:
    """The commands of a product by name, in table order; of all products if it is unknown."""
    by_name: dict[str, CommandRow] = {}
    for row in _ROWS:
        if has(model, row.products):
            name = row.name or row.message
            by_name[name if name not in by_name else row.row.title] = row
    return by_name


@lru_cache(maxsize=64)
def stored_settings(model: Model | None) -> Mapping[str, StoredSetting]:
    """The settings of a product by name, in table order."""
    return {one.name: one for one in _SETTINGS if has(model, one.products)}


@lru_cache(maxsize=64)
def commands(product: str) -> tuple[Command, ...]:
    """The commands of a product, for forms."""
    model = model_of(product)
    return tuple(_command(name, row, model) for name, row in rows(model).items())


def _command(name: str, row: CommandRow, model: Model | None) -> Command:
    return Command(
        name,
        arguments(row, model),
        kind=row.kind,
        group=row.group,
        reply="MTData2" if row.message == "ReqData" else reply_name(row),
        timeout_s=row.timeout_s,
        caution=row.caution,
        consequence=row.consequence,
        basic=row.basic and bool(row.products),
        title=row.title,
        doc=row.row.doc,
        source=row.row.source,
        harmless_values=row.harmless_values,
    )


def arguments(row: CommandRow, model: Model | None) -> tuple[Field, ...]:
    """Arguments to fill in, for this product."""
    return tuple(fitted(row.name or row.message, field, model) for field in row.row.fields)


def reply_name(row: CommandRow) -> str:
    """The message that acknowledges it; "" for none."""
    forms = ROWS.get(answers(row.row.id), ())
    if row.kind == "set":
        return next((form.name for form in forms if form.name.startswith("Set")), forms[0].name if forms else "")
    return next((form.name for form in forms if form.fields), forms[0].name if forms else "")


def reply_form(read: str, model: Model | None) -> Message:
    """The answer with a setting's values, for this product."""
    forms = [form for form in ROWS[answers(BY_NAME[read][0].id)] if form.fields]
    if len(forms) > 1 and read in _BY_SERIES:
        six = model is None or model.series == 600
        return forms[-1] if six else forms[0]
    return forms[0]


_BY_SERIES = ("ReqDID", "ReqStringOutputType", "ReqFilterProfile", "ReqConfiguration")


@lru_cache(maxsize=64)
def settings(product: str) -> tuple[Setting, ...]:
    model = model_of(product)
    return tuple(_setting(one, model) for one in stored_settings(model).values())


def _setting(one: StoredSetting, model: Model | None) -> Setting:
    answer = reply_form(one.read, model)
    fields = answer.fields
    writer = write_row(one, model)
    if writer is not None and one.name != "OptionFlags":
        known = {field.name: field for field in arguments(writer, model)}
        fields = tuple(known.get(field.name, field) for field in fields)
    elif writer is not None:
        fields = tuple(fitted("SetOptionFlags", field, model) for field in fields)
    if one.only:
        fields = tuple(field for field in fields if field.name in one.only)
    if writer is None:
        fields = tuple(replace(field, read_only=True) for field in fields)
    fields = tuple(replace(field, read_only=True) if field.name in one.read_only_fields else field for field in fields)
    fields = tuple(replace(field, momentary=True) if field.name in one.momentary else field for field in fields)
    return Setting(
        one.name,
        fields,
        read=one.read,
        write=one.write,
        per_sensor=one.per_sensor,
        editor=one.editor,
        after=one.after,
        caution=writer.caution if writer else "",
        consequence=writer.consequence if writer else "",
        group=one.group,
        basic=one.basic,
        title=one.title,
        doc=writer.row.doc if writer else answer.doc,
        source=writer.row.source if writer else answer.source,
    )


def write_row(one: StoredSetting, model: Model | None) -> CommandRow | None:
    """The command that writes a setting, in the product's form (the 600-series' if it is unknown)."""
    matches = [row for row in _ROWS if row.message == one.write and has(model, row.products)]
    return matches[-1] if matches else None


def continues(row: CommandRow) -> bool:
    """Whether it continues or begins work that a change of state discards (an orientation reset, a calibration).

    Commands valid during measurement begin or continue such work: entering the config state and returning would discard
    the result of a reset.
    """
    return row.state == "measuring" and row.name != RESET_AND_STORE


def unfinished(command: str, values: Mapping[str, Any]) -> str | None:
    """See imuscope.protocols.commands.transactions.DeviceDriver.unfinished (5.3.7)."""
    if command in ("ResetOrientation", RESET_AND_STORE):
        stored = command == RESET_AND_STORE or values.get("code") == 0
        return "" if stored else _NOT_STORED
    if command == "IccCommand":
        return _CALIBRATION.get(int(values.get("command", 3)))
    return None


def alters(command: str, values: Mapping[str, Any], model: Model | None) -> tuple[str, ...]:
    """See transactions.DeviceDriver.alters. A reset of the orientation is in the alignments once stored (5.3.7)."""
    if command == "RestoreFactoryDef":
        return tuple(stored_settings(model))
    if command in ("SetSyncSettings", "SetPeriod", "SetOutputSkipFactor"):
        return ("Configuration",)  # contains a copy of it
    if command == RESET_AND_STORE or (command == "ResetOrientation" and values.get("code", 0) == 0):
        return tuple(name for name, one in stored_settings(model).items() if one.write == "SetAlignmentRotation")
    return ()


def state_of(row: CommandRow, values: Mapping[str, Any]) -> CommandState:
    """The state in which a command is valid with these arguments."""
    if row.message == "ResetOrientation" and values.get("code") == 0:
        return "config"  # stores the reset
    if row.message == "IccCommand" and values.get("command") == 2:
        return "config"
    return row.state
