"""Every Xbus message, both directions, as a table.

A message number (MID) may have several forms, distinguished by the payload's size: a request is empty and the set of
the same number is not; an identifier has 4 or 8 bytes. `form(mid, size)` selects the row. Rules:

    - an exact size wins over an open-ended row, and among equals the first row
    - no row fits: the row of the longest fixed form that is shorter than the payload, the rest being trailing bytes;
      else the number's first name with the whole payload as opaque `data`
    - a number without a row is called "0x7A" and keeps its payload as `data`

The answer to Req… and the answer to Set… often share number and form (0xC1); the name is then that of the first row.
The two forms of Configuration have one size; `form_of` checks the identifier, which occurs twice: 8 equal bytes at 0
and 98 on the 600-series, 4 on the others, followed by a sampling period and a length.

A transaction waits for `answers(mid)`, the requested number plus one.

Even numbers go to the device and odd ones to the host, with four exceptions in the table.

Fields carry wire values in the given unit. Text is padded as by devices (`pad`). Rows whose source is "device" are
not in the document; they are known from the devices' own software.

Source: MT0101P 2020.A, sections 5.3.1-5.3.7 and 8, with its errata.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal

from imuscope.protocols.schema.fields import Field, Meaning, Message, TextList
from imuscope.protocols.schema.layouts import form_for_size, is_open, size_of
from imuscope.protocols.xbus.data_identifiers import UTC_FIELDS
from imuscope.protocols.xbus.enums import (
    ALIGNMENTS,
    BAUD_CODES,
    CAN_FORMATS,
    CAN_WORD,
    CLOCK_BIAS,
    DEVICE_ERRORS,
    ERROR_CODES,
    ERROR_MODES,
    EXT_OUTPUT_MODE_BITS,
    FILTER_PROFILES,
    GNSS_PLATFORMS,
    ICC_COMMANDS,
    ICC_DIMENSIONS,
    OPTION_FLAGS,
    POLARITIES,
    PORT_WORD,
    RESET_CODES,
    SELFTEST_BITS,
    STRING_TYPES,
    SYNC_FUNCTIONS,
    SYNC_LINES,
    SYNC_OUT,
    UTC_FLAGS,
    WARNING_CODES,
)
from imuscope.protocols.xbus.frames import MTDATA2

# -- shared payloads ---------------------------------------------------------------------------------------------------

_DATA = (Field("data", "bytes", (-1,), doc="Opaque payload."),)
FAR_M = 1_000.0  # of an antenna: a typing error lies beyond
LOWEST_M, HIGHEST_M = 11_000.0, 100_000.0  # of a place on, below or above the Earth
_BAUD = (Field("baudrate_code", "u1", choices=BAUD_CODES, doc="Baud rate, as a code."),)
_OPTIONS = (Field("flags", ">u4", bits=OPTION_FLAGS, doc="The option flags in effect."),)
_OPTION_CHANGES = (
    Field("set_flags", ">u4", bits=OPTION_FLAGS, doc="Flags to set."),
    Field("clear_flags", ">u4", bits=OPTION_FLAGS, doc="Flags to clear; setting wins where both are given."),
)
_LOCATION = (Field("location_id", ">u2", default=0, doc="User-assigned number."),)
_DELAY = (
    Field(
        "delay",
        ">u2",
        unit="1/29491200 s",
        low=590,
        default=590,
        doc="Minimum pause before a reply on RS-485, in clock ticks; 590 or more.",
    ),
)
_ERROR_MODE = (Field("mode", ">u2", choices=ERROR_MODES, doc="Reaction of the device to an error."),)
_OUTPUT_MODE = (Field("mode", ">u2", doc="Output mode of earlier device generations."),)
_OUTPUT_SETTINGS = (Field("settings", ">u4", doc="Output settings of earlier device generations."),)
_SYNC_WORD = (
    Meaning((CLOCK_BIAS,), "Clock period", "ms", doc="Period of the clock signal at the input."),
    Meaning(
        SYNC_OUT,
        "Offset",
        "ms",
        0.1,
        1,
        -30_000,
        30_000,
        signed=True,
        doc="Delay of the pulse after the sample; a negative value puts the pulse before it.",
    ),
    Meaning((), "Delay", "ms", 0.1, 1, 0, 60_000, doc="Delay from the edge to the action."),
)
_SYNC = (
    Field(
        "settings",
        shape=(-1,),
        max_length=10,
        doc="Sync settings, at most 10. An entry with polarity 0 clears the list.",
        fields=(
            Field("function", "u1", choices=SYNC_FUNCTIONS, doc="Function."),
            Field("line", "u1", choices=SYNC_LINES, doc="Sync line; its meaning depends on the series."),
            Field("polarity", "u1", choices=POLARITIES, default=1, doc="Edge (sync in) or pulse polarity (sync out)."),
            Field("trigger_once", "u1", high=1, default=0, doc="1: act on the first event only."),
            Field("skip_first", ">u2", default=0, doc="Events skipped before the first action."),
            Field("skip_factor", ">u2", default=0, doc="Events skipped after each action."),
            Field(
                "pulse_width",
                ">u2",
                unit="ms",
                scale=0.1,
                decimals=1,
                default=0,
                doc="Pulse width; sync out only.",
            ),
            Field(
                "delay_offset_or_clock_period",
                ">u2",
                default=0,
                meaning_of="function",
                meanings=_SYNC_WORD,
                doc="Sync in: delay, 0 to 6000 ms. Sync out: offset, -3000 to 3000 ms. ClockBiasEstimation: period of "
                "the clock, ms.",
            ),
        ),
    ),
)
_OUTPUTS = (
    Field(
        "outputs",
        shape=(-1,),
        max_length=32,
        doc="Output configuration, at most 32 entries.",
        fields=(
            Field("data_identifier", ">u2", key_mask=0xFFF0, doc="Data identifier with its format bits."),
            Field(
                "output_frequency",
                ">u2",
                unit="Hz",
                doc="Output rate; 65535 selects the maximum rate, or output in every message.",
            ),
        ),
    ),
)
_STRINGS_16 = (Field("string_types", ">u2", bits=STRING_TYPES, doc="String types to output; 0 returns to MTData2."),)
_STRINGS_32 = (
    Field("string_types", ">u4", bits=STRING_TYPES, doc="String types to output; 0 returns to MTData2."),
    Field("frequency", ">u2", unit="Hz", doc="String output rate."),
)
_PERIOD = (
    Field(
        "period",
        ">u2",
        unit="1/115200 s",
        low=225,
        default=1152,
        doc="Sampling period of string output, 225 to 1152. "
        "A multiple of 1152 (10 ms) is stored as 1152 and a skip factor.",
    ),
)
_SKIP = (
    Field("skip_factor", ">u2", default=0, doc="Outputs skipped after each one sent; 65535: output on ReqData only."),
)
_WHICH_ALIGNMENT = (Field("parameter", "u1", choices=ALIGNMENTS, doc="Alignment to read or set."),)
_ALIGNMENT = (
    *_WHICH_ALIGNMENT,
    *(
        Field(
            *(q, ">f4"),
            decimals=4,
            default=float(q == "q0"),
            frame="aligned from native",
            doc="Component of the unit quaternion, scalar first.",
        )
        for q in ("q0", "q1", "q2", "q3")
    ),
)
_EXT_OUTPUT = (Field("mode", ">u2", bits=EXT_OUTPUT_MODE_BITS, doc="Extended output mode."),)
_PORTS = (
    Field(
        *("words", ">u4", (-1,)),
        bits=PORT_WORD,
        max_length=3,
        title="Ports",
        doc="One word per port: RS-232, UART, RS-232 for RTCM input.",
    ),
)
_CAN_OUTPUTS = (
    Field(
        "outputs",
        shape=(-1,),
        max_length=16,
        doc="CAN output configuration, at most 16 entries.",
        fields=(
            Field("can_data_id", "u1", doc="CAN data identifier."),
            Field("frame_format", "u1", choices=CAN_FORMATS, doc="Length of the CAN identifier."),
            Field("can_id", ">u4", doc="CAN identifier."),
            Field("frequency", ">u2", unit="Hz", doc="Rate."),
        ),
    ),
)
_CAN = (Field("word", ">u4", bits=CAN_WORD, doc="Baud code and enable bit of the CAN transceiver."),)
_PLACE = (
    Field("latitude", ">f8", unit="°", low=-90, high=90, decimals=7, doc="Latitude, for gravity and declination."),
    Field("longitude", ">f8", unit="°", low=-180, high=180, decimals=7, doc="Longitude."),
    Field("altitude", ">f8", unit="m", low=-LOWEST_M, high=HIGHEST_M, decimals=2, doc="Altitude."),
)
_PROFILE_LABEL = (
    Field(
        "profile",
        "ascii",
        (-1,),
        low=1,
        max_length=62,
        listed=TextList("AvailableFilterProfiles", "profiles", "label", used="type"),
        doc="Label of the profile, or base/heading.",
    ),
)
_PLATFORM = (Field("platform", ">u2", choices=GNSS_PLATFORMS, doc="Expected motion of the GNSS receiver."),)
_LEVER_ARM = tuple(
    Field(
        axis,
        ">f4",
        unit="m",
        low=-FAR_M,
        high=FAR_M,
        decimals=3,
        default=0.0,
        doc=f"Lever arm, device to GNSS antenna, along {axis}.",
    )
    for axis in "xyz"
)
_UTC_RANGES = ((0, 10**9), (1999, 2099), (1, 12), (1, 31), (0, 23), (0, 59), (0, 59))  # Table 35
_UTC = (
    *(
        replace(field, name="nanoseconds" if field.name == "ns" else field.name, low=low, high=high)
        for field, (low, high) in zip(UTC_FIELDS, _UTC_RANGES, strict=False)
    ),
    Field("flags", "u1", bits=UTC_FLAGS, high=7, default=7, doc="Validity."),
)
_ICC = Field("command", "u1", choices=ICC_COMMANDS, doc="In-run compass calibration command.")

_CONFIGURATION_MIDDLE = (
    Field("syncin_mode", ">u2", doc="Sync-in mode of earlier generations."),
    Field("syncin_skip_factor", ">u2", doc="Sync-in skip factor of earlier generations."),
    Field("syncin_offset", ">u4", doc="Sync-in offset of earlier generations."),
    Field("date", "ascii", (8,), pad=0, doc="Date as YYYYMMDD; may be filled in by the host."),
    Field("time", "ascii", (8,), pad=0, doc="Time as HHMMSSHH; may be filled in by the host."),
    Field("reserved_host", "bytes", (32,), doc="Reserved for the host."),
    Field("reserved_client", "bytes", (32,), doc="Reserved for the client."),
    Field("num_devices", ">u2", doc="Number of devices, 1."),
)
_CONFIGURATION = (
    Field("master_device_id", ">u4", base=16, doc="Identifier of the device."),
    Field("sampling_period", ">u2", unit="1/115200 s", doc="Sampling period."),
    Field("output_skip_factor", ">u2", doc="Output skip factor."),
    *_CONFIGURATION_MIDDLE,
    Field("device_id", ">u4", base=16, doc="Identifier of the device, repeated."),
    Field("data_length", ">u2", doc="Length of an MTData2 message."),
    Field("output_mode", ">u2", doc="Output mode of earlier generations."),
    Field("output_settings", ">u4", doc="Output settings of earlier generations."),
    Field(
        "reserved",
        "bytes",
        (8,),
        doc="Reserved in the document; devices put filter profile, firmware version, filter type and version here.",
    ),
)
_CONFIGURATION_600 = (
    Field("master_device_id", ">u8", base=16, doc="Identifier of the device, 64 bits."),
    *_CONFIGURATION_MIDDLE,
    Field("device_id", ">u8", base=16, doc="Identifier of the device, repeated."),
    Field("reserved", "bytes", (12,), doc="Reserved."),
)

# -- rows --------------------------------------------------------------------------------------------------------------

Kind = Literal["data", "reply", "indication", "command"]


def _to_device(mid: int, name: str, source: str, doc: str, fields: tuple[Field, ...] = (), **more: Any) -> Message:
    return Message(mid, name, fields, kind="command", direction="to_device", doc=doc, source=_source(source), **more)


def _to_host(
    mid: int, name: str, source: str, doc: str, fields: tuple[Field, ...] = (), kind: Kind = "reply", **more: Any
) -> Message:
    return Message(mid, name, fields, kind=kind, direction="to_host", doc=doc, source=_source(source), **more)


def _source(section: str) -> str:
    return f"MT0101P {section}" if section[:1].isdigit() else section


_OLD = "Deprecated: not used by the devices in this document."
_RESERVED = "Reserved."

MESSAGES: tuple[Message, ...] = (
    # 5.3.1 wake-up and state
    _to_host(0x3E, "WakeUp", "5.3.1", "Sent at start-up; WakeUpAck within 500 ms keeps the device in the Config State.",
             kind="indication"),
    _to_device(0x3F, "WakeUpAck", "8.1", "Keeps a device that has just started in the Config State."),
    _to_device(0x30, "GoToConfig", "5.3.1", "Stops measuring and enters the Config State."),
    _to_host(0x31, "GoToConfigAck", "8.1", "The device is in the Config State."),
    _to_device(0x10, "GoToMeasurement", "5.3.1", "Starts measuring with the settings in effect."),
    _to_host(0x11, "GoToMeasurementAck", "8.1", "The device is in the Measurement State."),
    _to_device(0x40, "Reset", "5.3.1", "Restarts the device."),
    _to_host(0x41, "ResetAck", "8.1", "The device is about to restart."),
    # 5.3.2 information
    _to_device(0x00, "ReqDID", "5.3.2", "Requests the device identifier."),
    _to_host(0x01, "DeviceID", "5.3.2", "Device identifier (serial number), 4 bytes on 1-, 10- and 100-series.",
             (Field("device_id", ">u4", base=16, doc="Identifier of the device."),)),
    _to_host(0x01, "DeviceID", "5.3.2", "Device identifier (serial number), 8 bytes on the 600-series.",
             (Field("device_id", ">u8", base=16, doc="Identifier of the device."),)),
    _to_device(0x02, "InitBus", "8.2", "Reserved; sent by the vendor's software when it starts."),
    _to_host(0x03, "InitBusResults", "8.2", _RESERVED, _DATA),
    _to_device(0x1C, "ReqProductCode", "5.3.2", "Requests the product code."),
    _to_host(0x1D, "ProductCode", "5.3.2", "Product code, padded with spaces to 20 characters.",
             (Field("product_code", "ascii", (20,), pad=0x20, doc="Product code, as MTi-630-DK."),)),
    _to_host(0x1D, "ProductCode", "5.3.2", "Product code of another length.",
             (Field("product_code", "ascii", (-1,), doc="Product code, as MTi-630-DK."),)),
    _to_device(0x1E, "ReqHardwareVersion", "5.3.2", "Requests the hardware version."),
    _to_host(0x1F, "HardwareVersion", "5.3.2", "Hardware version.",
             (Field("major", "u1", doc="Major version."), Field("minor", "u1", doc="Minor version."))),
    _to_device(0x12, "ReqFWRev", "5.3.2", "Requests the firmware revision."),
    _to_host(0x13, "FirmwareRev", "5.3.2", "Firmware revision.",
             (Field("major", "u1", doc="Major version."), Field("minor", "u1", doc="Minor version."),
              Field("revision", "u1", doc="Revision."), Field("build", ">u4", doc="Build number."),
              Field("scm_reference", ">u4", doc="Revision in the vendor's source control."))),
    _to_host(0x13, "FirmwareRev", "device", "Firmware revision, short form of older firmware.",
             (Field("major", "u1", doc="Major version."), Field("minor", "u1", doc="Minor version."),
              Field("revision", "u1", doc="Revision."))),
    _to_device(0x24, "RunSelftest", "5.3.2", "Runs the built-in self-test; the answer takes up to 3 s."),
    _to_host(0x25, "SelftestResults", "5.3.2", "Result of the self-test, one bit per sensor.",
             (Field("flags", ">u2", bits=SELFTEST_BITS, doc="Tests passed."),)),
    _to_host(0x42, "Error", "5.3.2", "Error in the last message, or failure of the measurement.",
             (Field("code", "u1", choices=ERROR_CODES, doc="Error code."),), kind="indication", refusals=(4,)),
    _to_host(0x42, "Error", "5.3.2", "Device error with its detail.",
             (Field("code", "u1", choices=ERROR_CODES, doc="Error code."),
              Field("device_error", ">u4", choices=DEVICE_ERRORS, doc="Detail of a device error.")), kind="indication"),
    _to_host(0x42, "Error", "5.3.2", "Error followed by further bytes.",
             (Field("code", "u1", choices=ERROR_CODES, doc="Error code."),
              Field("extra", "bytes", (-1,), doc="Further bytes.")), kind="indication"),
    _to_host(0x43, "Warning", "5.3.2", "A warning from the device.",
             (Field("result", ">u4", choices=WARNING_CODES, doc="Warning code."),
              Field("text", "ascii", (128,), pad=0, doc="Warning text.")), kind="indication"),
    _to_device(0x0A, "reserved 10", "8.2", _RESERVED, _DATA),
    _to_host(0x0B, "reserved 11", "8.2", _RESERVED, _DATA),
    _to_device(0xA6, "reserved 166", "8.2", _RESERVED, _DATA),
    _to_host(0xA7, "reserved 167", "8.2", _RESERVED, _DATA),
    # 5.3.3 device
    _to_device(0x18, "ReqBaudrate", "5.3.3", "Requests the baud rate; deprecated on the 600-series."),
    _to_host(0x19, "ReqBaudrateAck", "8.3", "The baud rate.", _BAUD),
    _to_device(0x18, "SetBaudrate", "5.3.3", "Stores a baud rate; deprecated on the 600-series.", _BAUD),
    _to_host(0x19, "SetBaudrateAck", "8.3", "The baud rate is stored."),
    _to_device(0x48, "ReqOptionFlags", "5.3.3", "Requests the option flags."),
    _to_host(0x49, "ReqOptionFlagsAck", "8.3", "The option flags.", _OPTIONS),
    _to_device(0x48, "SetOptionFlags", "5.3.3", "Sets and clears option flags; flags 0 in both stay unchanged.",
               _OPTION_CHANGES),
    _to_host(0x49, "SetOptionFlagsAck", "8.3", "The option flags are changed."),
    _to_device(0x84, "ReqLocationID", "5.3.3", "Requests the location identifier."),
    _to_host(0x85, "ReqLocationIDAck", "8.3", "The location identifier.", _LOCATION),
    _to_device(0x84, "SetLocationID", "5.3.3", "Stores a user-assigned number.", _LOCATION),
    _to_host(0x85, "SetLocationIDAck", "8.3", "The location identifier is stored."),
    _to_device(0x0E, "RestoreFactoryDef", "5.3.3",
               "Resets all settings to factory defaults, including alignments and filter settings."),
    _to_host(0x0F, "RestoreFactoryDefAck", "device", "The factory settings are restored."),
    _to_device(0xDC, "ReqTransmitDelay", "5.3.3", "Requests the pause before a reply on RS-485."),
    _to_host(0xDD, "ReqTransmitDelayAck", "8.3", "The pause before a reply on RS-485.", _DELAY),
    _to_device(0xDC, "SetTransmitDelay", "5.3.3", "Sets the pause before a reply on RS-485.", _DELAY),
    _to_host(0xDD, "SetTransmitDelayAck", "8.3", "The pause is set."),
    _to_device(0xDA, "ReqErrorMode", "8.3", "Requests the error mode. " + _OLD),
    _to_host(0xDB, "ReqErrorModeAck", "8.3", "The error mode. " + _OLD, _ERROR_MODE),
    _to_device(0xDA, "SetErrorMode", "8.3", "Sets the error mode. " + _OLD, _ERROR_MODE),
    _to_host(0xDB, "SetErrorModeAck", "8.3", "The error mode is set. " + _OLD),
    # 5.3.4 synchronisation
    _to_device(0x2C, "ReqSyncSettings", "5.3.4", "Requests the sync settings."),
    _to_host(0x2D, "SetSyncSettingsAck", "8.4", "The sync settings are stored, or the list is empty."),
    _to_host(0x2D, "ReqSyncSettingsAck", "8.4", "The sync settings.", _SYNC),
    _to_device(0x2C, "SetSyncSettings", "5.3.4", "Replaces the sync settings.", _SYNC),
    _to_device(0xD8, "reserved 216", "8.4", _RESERVED, _DATA),
    _to_host(0xD9, "reserved 217", "8.4", _RESERVED, _DATA),
    # 5.3.5 configuration
    _to_device(0x0C, "ReqConfiguration", "5.3.5", "Requests the configuration, for the header of a log."),
    _to_host(0x0D, "Configuration", "5.3.5", "Configuration; also sent just before measuring starts.", _CONFIGURATION),
    _to_host(0x0D, "Configuration", "5.3.5", "Configuration of a 600-series device.", _CONFIGURATION_600,
             title="Configuration (600-series)"),
    _to_device(0xC0, "ReqOutputConfiguration", "5.3.5", "Requests the output configuration."),
    _to_host(0xC1, "SetOutputConfigurationAck", "8.5", "Output configuration with the actual rates.", _OUTPUTS),
    _to_host(0xC1, "ReqOutputConfigurationAck", "8.5", "Output configuration.", _OUTPUTS),
    _to_device(0xC0, "SetOutputConfiguration", "5.3.5", "Sets the output configuration: data and rates.", _OUTPUTS),
    _to_device(0x8E, "ReqStringOutputType", "5.3.5", "Requests the selected string types."),
    _to_host(0x8F, "ReqStringOutputTypeAck", "8.5", "Selected string types (10- and 100-series).", _STRINGS_16),
    _to_host(0x8F, "ReqStringOutputTypeAck", "8.5", "Selected string types (600-series).", _STRINGS_32),
    _to_device(0x8E, "SetStringOutputType", "5.3.5", "Selects strings in place of MTData2.", _STRINGS_16),
    _to_device(0x8E, "SetStringOutputType", "5.3.5", "Selects strings in place of MTData2 (600-series).", _STRINGS_32,
               title="SetStringOutputType (600-series)"),
    _to_host(0x8F, "SetStringOutputTypeAck", "8.5", "The string types are set."),
    _to_device(0x04, "ReqPeriod", "5.3.5", "Requests the sampling period of string output."),
    _to_host(0x05, "ReqPeriodAck", "8.5", "Sampling period of string output.", _PERIOD),
    _to_device(0x04, "SetPeriod", "5.3.5", "Sets the sampling period of string output.", _PERIOD),
    _to_host(0x05, "SetPeriodAck", "8.5", "The sampling period is set."),
    _to_device(0xD4, "ReqOutputSkipFactor", "5.3.5", "Requests the skip factor of the outputs."),
    _to_host(0xD5, "ReqOutputSkipFactorAck", "5.3.5", "The skip factor of the outputs.", _SKIP),
    _to_device(0xD4, "SetOutputSkipFactor", "5.3.5", "Sets the skip factor of the outputs.", _SKIP),
    _to_host(0xD5, "SetOutputSkipFactorAck", "5.3.5", "The skip factor is set."),
    _to_device(0xEC, "ReqAlignmentRotation", "5.3.5", "Requests one of the two stored alignments.", _WHICH_ALIGNMENT),
    _to_host(0xED, "ReqAlignmentRotationAck", "8.5", "A stored alignment.", _ALIGNMENT),
    _to_device(0xEC, "SetAlignmentRotation", "5.3.5", "Stores an alignment.", _ALIGNMENT),
    _to_host(0xED, "SetAlignmentRotationAck", "8.5", "The alignment is stored."),
    _to_device(0x86, "ReqExtOutputMode", "5.3.5", "Requests the extended output mode."),
    _to_host(0x87, "ExtOutputMode", "8.5", "The extended output mode.", _EXT_OUTPUT),
    _to_device(0x86, "SetExtOutputMode", "5.3.5", "Sets the extended output mode.", _EXT_OUTPUT),
    _to_host(0x87, "SetExtOutputModeAck", "8.5", "The extended output mode is set."),
    _to_device(0x8C, "ReqPortConfig", "5.3.5", "Requests the configuration of the ports."),
    _to_host(0x8D, "SetPortConfigAck", "device", "The ports are configured."),
    _to_host(0x8D, "PortConfig", "device", "The configuration of the ports.", _PORTS),
    _to_device(0x8C, "SetPortConfig", "5.3.5", "Configures the ports.", _PORTS),
    _to_device(0xE8, "ReqCanOutputConfig", "5.3.5", "Requests the CAN output configuration."),
    _to_host(0xE9, "CanOutputConfig", "device", "CAN output configuration.", _CAN_OUTPUTS),
    _to_host(0xE9, "SetCanOutputConfigAck", "device", "CAN output configuration as stored.", _CAN_OUTPUTS),
    _to_device(0xE8, "SetCanOutputConfig", "5.3.5", "Sets the CAN output configuration.", _CAN_OUTPUTS),
    _to_device(0xE6, "ReqCanConfig", "5.3.5", "Requests the configuration of the CAN transceiver."),
    _to_host(0xE7, "CanConfig", "device", "The configuration of the CAN transceiver.", _CAN),
    _to_device(0xE6, "SetCanConfig", "5.3.5", "Configures the CAN transceiver.", _CAN),
    _to_host(0xE7, "SetCanConfigAck", "device", "The CAN transceiver is configured."),
    _to_device(0xD0, "ReqOutputMode", "8.5", "Requests the output mode. " + _OLD),
    _to_host(0xD1, "ReqOutputModeAck", "8.5", "The output mode. " + _OLD, _OUTPUT_MODE),
    _to_device(0xD0, "SetOutputMode", "8.5", "Sets the output mode. " + _OLD, _OUTPUT_MODE),
    _to_host(0xD1, "SetOutputModeAck", "8.5", "The output mode is set. " + _OLD),
    _to_device(0xD2, "ReqOutputSettings", "8.5", "Requests the output settings. " + _OLD),
    _to_host(0xD3, "ReqOutputSettingsAck", "8.5", "The output settings. " + _OLD, _OUTPUT_SETTINGS),
    _to_device(0xD2, "SetOutputSettings", "8.5", "Sets the output settings. " + _OLD, _OUTPUT_SETTINGS),
    _to_host(0xD3, "SetOutputSettingsAck", "8.5", "The output settings are set. " + _OLD),
    _to_device(0xE0, "reserved 224", "8.5", _RESERVED, _DATA),
    _to_host(0xE1, "reserved 225", "8.5", _RESERVED, _DATA),
    # 5.3.6 data
    _to_device(0x34, "ReqData", "5.3.6", "Requests one sample; needs a SendLatest sync setting on the software line."),
    _to_host(0x32, "MTData", "8.6", "Data of earlier device generations; the layout is not transmitted.", _DATA,
             kind="indication"),
    Message(MTDATA2, "MTData2", time="SampleTimeFine", tick_ns=100_000, kind="data", channel_per_field=True,
            title="MTData2", doc="Measured data, one item per quantity.", source="MT0101P 5.3.6"),
    # 5.3.7 filter
    _to_device(0x6E, "ReqLatLonAlt", "5.3.7", "Requests the stored position."),
    _to_host(0x6F, "ReqLatLonAltAck", "5.3.7", "The stored position.", _PLACE),
    _to_device(0x6E, "SetLatLonAlt", "5.3.7", "Stores a position, for local gravity and declination.", _PLACE),
    _to_host(0x6F, "SetLatLonAltAck", "5.3.7", "The position is stored."),
    _to_device(0x62, "ReqAvailableFilterProfiles", "5.3.7", "Requests the available filter profiles."),
    _to_host(0x63, "AvailableFilterProfiles", "5.3.7", "Available filter profiles; unused entries have type 0.",
             (Field("profiles", shape=(-1,), doc="One record per profile.", fields=(
                 Field("type", "u1", doc="Number of the profile."),
                 Field("version", "u1", doc="Version of the profile."),
                 Field("label", "ascii", (20,), pad=0x20, doc="Label of the profile."))),)),
    _to_device(0x64, "ReqFilterProfile", "5.3.7", "Requests the filter profile in use."),
    _to_host(0x65, "ReqFilterProfileAck", "5.3.7", "The filter profile in use, as a number.",
             (Field("version", "u1", doc="Version of the profile."),
              Field("profile", "u1", choices=FILTER_PROFILES, doc="Number of the profile.")),
             title="ReqFilterProfileAck (classic)"),
    _to_host(0x65, "SetFilterProfileAck", "8.7", "The filter profile is set."),
    _to_host(0x65, "ReqFilterProfileAck", "5.3.7", "The filter profile in use, as text (600-series).", _PROFILE_LABEL,
             title="ReqFilterProfileAck (modern)"),
    _to_device(0x64, "SetFilterProfile", "5.3.7", "Chooses a filter profile by number.",
               (Field("profile", ">u2", choices=FILTER_PROFILES, doc="Number of the profile."),),
               title="SetFilterProfile (classic)"),
    _to_device(0x64, "SetFilterProfile", "5.3.7", "Chooses a filter profile by label (600-series).", _PROFILE_LABEL,
               title="SetFilterProfile (modern)"),
    _to_device(0x76, "ReqGnssPlatform", "5.3.7", "Requests the expected motion of the GNSS receiver."),
    _to_host(0x77, "ReqGnssPlatformAck", "5.3.7", "The expected motion of the GNSS receiver.", _PLATFORM),
    _to_device(0x76, "SetGnssPlatform", "5.3.7", "Sets the expected motion of the GNSS receiver.", _PLATFORM),
    _to_host(0x77, "SetGnssPlatformAck", "8.3", "The expected motion is set."),
    _to_device(0x68, "ReqGnssLeverArm", "5.3.7", "Requests the lever arm to the GNSS antenna."),
    _to_host(0x69, "ReqGnssLeverArmAck", "5.3.7", "The lever arm to the GNSS antenna.", _LEVER_ARM),
    _to_device(0x68, "SetGnssLeverArm", "5.3.7", "Stores the lever arm to the GNSS antenna.", _LEVER_ARM),
    _to_host(0x69, "SetGnssLeverArmAck", "5.3.7", "The lever arm is stored."),
    _to_device(0xA4, "ResetOrientation", "5.3.7", "Resets heading, inclination or both, or stores the last reset.",
               (Field("code", ">u2", choices=RESET_CODES, doc="Reset to perform."),)),
    _to_host(0xA5, "ResetOrientationAck", "8.7", "The orientation is reset."),
    _to_device(0x22, "SetNoRotation", "5.3.7", "Starts a gyroscope bias estimation; the device must be at rest.",
               (Field("duration", ">u2", unit="s", low=1, default=10, doc="Duration at rest."),)),
    _to_host(0x23, "SetNoRotationAck", "8.7", "The no-rotation update has started; its result is in the status word."),
    _to_device(0x60, "ReqUTCTime", "5.3.7", "Requests UTC."),
    _to_device(0x60, "SetUTCTime", "5.3.7", "Sets UTC of the device.", _UTC),
    _to_host(0x61, "UTCTime", "5.3.7", "UTC of the device.", _UTC),
    _to_device(0xA8, "AdjustUTCTime", "5.3.7", "Adjusts UTC of the device.",
               (Field("correction", ">i4", unit="0.1 ms", low=-10_000, high=10_000,
                      doc="Correction to apply; must not be 0."),)),
    _to_host(0xA9, "AdjustUTCTimeAck", "device", "UTC is adjusted."),
    _to_device(0x74, "IccCommand", "5.3.7", "Controls in-run compass calibration.", (_ICC,)),
    _to_host(0x75, "IccCommandAck", "5.3.7", "In-run compass calibration has accepted the command.", (_ICC,)),
    _to_host(0x75, "IccCommandAck", "5.3.7", "State of representative motion collection.",
             (_ICC, Field("representative_motion_active", "u1", doc="1: collection is in progress."))),
    _to_host(0x75, "IccCommandAck", "5.3.7", "Result of in-run compass calibration.",
             (_ICC, Field("ddt", ">f4", decimals=3, doc="Ratio of disturbance to noise."),
              Field("dimension", "u1", choices=ICC_DIMENSIONS, doc="Dimension of the estimate."),
              Field("status", "u1", choices={0: "ok", 1: "too much disturbance", 2: "not enough data", 3: "both"},
                    doc="Usability of the result."))),
    _to_device(0xD6, "SetInitialHeading", "5.3.7", "Sets the initial heading of a filter without magnetometer.",
               (Field("heading", ">f4", unit="°", low=-180, high=180, decimals=2, default=0.0,
                      doc="Heading, −180 to 180."),)),
    _to_host(0xD7, "SetInitialHeadingAck", "5.3.7", "The initial heading is set."),
    _to_device(0xE2, "ForwardGnssData", "5.3.7", "Forwards data, usually RTCM, to the GNSS receiver.",
               (Field("data", "bytes", (-1,), low=1, max_length=2048, doc="Complete messages for the receiver."),)),
    _to_host(0xE3, "ForwardGnssDataAck", "5.3.7", "The data are forwarded."),
    _to_device(0x82, "reserved 130", "8.7", _RESERVED, _DATA),
    _to_host(0x83, "reserved 131", "8.7", _RESERVED, _DATA),
    _to_device(0x66, "reserved 102", "8.7", _RESERVED, _DATA),
    _to_host(0x67, "reserved 103", "8.7", _RESERVED, _DATA),
    _to_device(0x6A, "reserved 106", "8.7", _RESERVED, _DATA),
    _to_host(0x6B, "reserved 107", "8.7", _RESERVED, _DATA),
    _to_device(0x20, "reserved 32", "8.7", _RESERVED, _DATA),
    _to_host(0x21, "reserved 33", "8.7", _RESERVED, _DATA),
    # known from devices only
    _to_device(0x90, "ReqEmts", "device", "Requests the device's stored calibration, for the header of a log."),
    _to_host(0x91, "EmtsData", "device", "The device's stored calibration, encrypted.", _DATA, kind="indication",
             sealed=True),
    _to_device(0x4A, "SetStealthMode", "device", "Not applicable to MTi devices.", _DATA),
    _to_device(0x8A, "StoreFilterState", "device", "Stores the filter state."),
    _to_device(0xAC, "ReqGnssReceiverSettings", "device", "Requests the settings of the GNSS receiver."),
    _to_host(0xAD, "GnssReceiverSettingsAck", "device", "The settings of the GNSS receiver.", _DATA),
    _to_device(0xAC, "SetGnssReceiverSettings", "device", "Configures the GNSS receiver.",
               (Field("type", ">u2", doc="Receiver type."),
                Field("baudrate", ">u2", doc="Baud rate of the receiver, as a code."),
                Field("input_rate", ">u2", unit="Hz", doc="Rate of the receiver's solutions."),
                Field("options", ">u4", doc="Options."))),
    _to_device(0x92, "UpdateFilterProfile", "device", "Replaces a filter profile.", _DATA),
)  # fmt: skip

ROWS: dict[int, tuple[Message, ...]] = {}
for _row in MESSAGES:
    ROWS[_row.id] = (*ROWS.get(_row.id, ()), _row)

BY_NAME: dict[str, tuple[Message, ...]] = {}
"""Name → its forms."""
for _row in MESSAGES:
    BY_NAME[_row.name] = (*BY_NAME.get(_row.name, ()), _row)

MTDATA2_ROW = BY_NAME["MTData2"][0]


def answers(mid: int) -> int:
    """The number of the message that acknowledges `mid` (section 5.2)."""
    return mid + 1


@lru_cache(maxsize=4096)
def form(mid: int, size: int) -> tuple[Message, int]:
    """The row for a payload of `size` bytes under `mid`, its open field closed, and the bytes covered by its fields."""
    rows = ROWS.get(mid, ())
    fits = [(row, fields) for row in rows if (fields := form_for_size(row.fields, size)) is not None]
    if fits:
        row, fields = next((pair for pair in fits if not (pair[0].fields and is_open(pair[0].fields[-1]))), fits[0])
        return replace(row, fields=fields), size
    short = [(sum(map(size_of, row.fields)), row) for row in rows if row.fields and not is_open(row.fields[-1])]
    short = [pair for pair in short if pair[0] <= size]
    if short:
        covered, row = max(short, key=lambda pair: pair[0])
        return row, covered
    name, doc = (rows[0].name, rows[0].doc) if rows else (f"0x{mid:02X}", "Unknown message.")
    data = (Field("data", "bytes", (size,), doc="Opaque payload."),) if size else ()
    direction: Literal["to_host", "to_device"] = "to_host" if mid & 1 else "to_device"
    unknown = Message(mid, name, data, kind="reply", direction=direction, doc=doc)
    return (replace(rows[0], fields=data) if rows else unknown), size


_CONFIGURATION_ID = 0x0D
_FORM_600 = BY_NAME["Configuration"][1]


def form_of(mid: int, payload: bytes) -> tuple[Message, int]:
    if mid == _CONFIGURATION_ID and len(payload) == 118 and payload[:8] == payload[98:106]:
        return _FORM_600, 118
    return form(mid, len(payload))
