"""Meaning and allowed values of the fields of settings: words and ranges missing from datasets.txt.

A `FieldNote` narrows and explains a field of a data set that the user may change; `noted` applies it. A field without a
note is described by its type and its words. `read_only` fields are maintained by the device itself (a size, a checksum,
its last place): they are shown and never sent, so that writing back a whole set cannot damage them.

    flash configuration   size checksum key     startupImuDtMs … refLla    lastLla …    … ioConfig2
                          from the device        written, in one piece      read only    written, in one piece

The device computes the checksum of its flash configuration itself; a part is written by its offset alone, as in the
document's example. The key is the maker's means of restoring defaults, so it is not offered.

Rules for editing: a note is a row; `doc` is one sentence for the user. Ranges are those of the vendor's documents, or
of physics if they give none; a wrong note is worse than none.

Source: Inertial Sense user manual, "Data Sets (DIDs)", "System configuration"; inertial-sense-sdk 2.7.1, data_sets.h.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from imuscope.protocols.schema.fields import Field

BAUD_RATES = (9_600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 921_600, 10_000_000)  # SDK: baud_rate_t
CAN_RATES = (20, 33, 50, 83, 100, 125, 200, 250, 500, 1000)  # SDK: can_baudrate_t
_BAUD = {rate: f"{rate:_} Bd".replace("_", " ") for rate in BAUD_RATES}
_CAN = {rate: f"{rate} kbit/s" for rate in CAN_RATES}
_TURN = 2 * math.pi
_FAR_M = 1e4


@dataclass(frozen=True, slots=True)
class FieldNote:
    """Documentation of a field beyond its type; see schema.Field."""

    doc: str
    low: float | None = None
    high: float | None = None
    basic: bool = False
    read_only: bool = False
    choices: Mapping[int, str] | None = None


def _note(doc: str, low: float | None = None, high: float | None = None) -> FieldNote:
    """Note of a basic field."""
    return FieldNote(doc, low, high, basic=True)


def _read_only(doc: str) -> FieldNote:
    return FieldNote(doc, read_only=True)


_GENERAL: Mapping[str, FieldNote] = {
    "size": _read_only("Size of the data set; maintained by the device."),
    "checksum": _read_only("Checksum of the fields after this one; computed by the device."),
    "key": _read_only("Used by the manufacturer to restore defaults; never written by this program."),
    "reserved": _read_only("Reserved."),
    "reserved1": _read_only("Reserved."),
    "reserved2": _read_only("Reserved."),
    "ser0BaudRate": FieldNote("Rate of serial port 0, in effect after a reset.", basic=True, choices=_BAUD),
    "ser1BaudRate": FieldNote("Rate of serial port 1, in effect after a reset.", basic=True, choices=_BAUD),
    "ser2BaudRate": FieldNote("Rate of serial port 2, in effect after a reset.", basic=True, choices=_BAUD),
    "startupGPSDtMs": _note("Period of GNSS solutions, in effect after a reset; the minimum of 200 ms is 5 Hz.", 200),
    "gps1AntOffset": _note("Position of the first antenna relative to the sensor.", -_FAR_M, _FAR_M),
    "gps2AntOffset": _note("Position of the second antenna relative to the sensor.", -_FAR_M, _FAR_M),
    "dynamicModel": _note("Expected motion of the sensor: sets the assumptions of the navigation filter."),
    "gnssSatSigConst": _note("Satellite systems received."),
    "RTKCfgBits": _note("RTK: rover modes, and base output of each port."),
    "sysCfgBits": _note("Inputs and estimates of the navigation filter."),
    "refLla": _note("Origin of the local north, east, down frame."),
    "gpsMinimumElevation": _note("Satellites below this elevation are not used.", 0, math.pi / 2),
    "gnssCn0Minimum": FieldNote("Satellites with a weaker signal are not used."),
    "gnssCn0DynMinOffset": FieldNote("Allowed signal level below the strongest satellites; 0 disables this limit."),
    "gpsTimeSyncPeriodMs": FieldNote("Period of the time synchronisation pulse, in effect after a reset."),
    "gpsTimeUserDelay": FieldNote("Added to the GNSS time to compensate for the delay of the antenna cable."),
    "debug": FieldNote("For the manufacturer."),
    "declination": FieldNote("Estimated magnetic declination; east is positive.", -_TURN, _TURN),
}

_OF_SET: Mapping[tuple[int, str], FieldNote] = {
    (12, "startupImuDtMs"): _note(
        "Sampling period of the sensors, in effect after a reset; at most startupNavDtMs. 0 switches them off."
    ),
    (12, "startupNavDtMs"): _note(
        "Navigation period, in effect after a reset; at least 7 ms for an IMX-5 with GNSS.", 1
    ),
    (12, "insRotation"): _note("Rotation from the sensor frame to the output frame (mounting).", -_TURN, _TURN),
    (12, "insOffset"): _note("Offset from the rotated sensor frame to the output point.", -_FAR_M, _FAR_M),
    (12, "lastLla"): _read_only("Last known position, saved for a faster start."),
    (12, "lastLlaTimeOfWeekMs"): _read_only("Time of week of the last known position."),
    (12, "lastLlaWeek"): _read_only("GPS week of the last known position."),
    (12, "lastLlaUpdateDistance"): FieldNote("Distance to move before the position is saved again.", 0, 1e6),
    (12, "ioConfig"): FieldNote("Pin functions and receiver ports. A wrong value disables the port."),
    (12, "ioConfig2"): FieldNote("Functions of further pins."),
    (12, "platformConfig"): FieldNote("Carrier board of the module; determines the pin functions."),
    (12, "zeroVelRotation"): FieldNote(
        "Rotation from the sensor frame to the zero-velocity frame, in which a vehicle cannot slip.", -_TURN, _TURN
    ),
    (12, "zeroVelOffset"): FieldNote(
        "Offset to the zero-velocity point of the vehicle, which cannot slip.", -_FAR_M, _FAR_M
    ),
    (12, "magDeclination"): _note("Magnetic declination; east is positive.", -_TURN, _TURN),
    (12, "sensorConfig"): FieldNote("Ranges and filters of the sensors, in effect after a reset."),
    (12, "wheelConfig.bits"): FieldNote("Use and direction of the wheel encoders."),
    (12, "wheelConfig.track_width"): FieldNote("Distance between the left and right wheels.", 0, 100),
    (12, "wheelConfig.radius"): FieldNote("Radius of a wheel.", 0, 10),
    (12, "magInterferenceThreshold"): FieldNote(
        "Allowed deviation from the expected field: typically 2 to 10, factory default 3; 1000 disables the check.",
        0,
        1000,
    ),
    (12, "magCalibrationQualityThreshold"): FieldNote(
        "Required quality of a magnetic calibration: typically 10 to 20, factory default 10; 1000 accepts any.", 0, 1000
    ),
    (19, "state"): _note("Starts or aborts a magnetometer calibration."),
    (19, "progress"): _read_only("Progress of the calibration."),
    (19, "declination"): _read_only("Estimated magnetic declination."),
    (8, "options"): _note("Port and persistence: 512 saves the messages across resets."),
    (8, "nmeaBroadcastMsgs"): _note("Message and its period as a multiple of the source's; 0 switches it off."),
    (64, "command"): _note("Starts a built-in test."),
    (64, "lastCommand"): _read_only("Test that was started last."),
    (64, "state"): _read_only("State of the test."),
    (73, "state"): _note("Starts or cancels a survey of the base position."),
    (73, "maxDurationSec"): _note("Maximum duration of the survey.", 0, 1_000_000),
    (73, "minAccuracy"): _note("Accuracy at which the survey ends.", 0, 1000),
    (73, "elapsedTimeSec"): _read_only("Elapsed time of the survey."),
    (73, "hAccuracy"): _read_only("Current accuracy of the position."),
    (73, "lla"): _read_only("Surveyed position."),
    (87, "timeOfWeekMs"): _read_only("Time of week of this state."),
    (87, "status"): _read_only("State of the wheel calibration."),
    (87, "mode"): _note("Starts the wheel calibration."),
    (90, "can_period_mult"): _note(
        "Period of each CAN message as a multiple of the source's; 0 switches it off.", 0, 65_535
    ),
    (90, "can_transmit_address"): FieldNote("CAN identifier of each message."),
    (90, "can_baudrate_kbps"): FieldNote("Rate of the CAN bus.", basic=True, choices=_CAN),
    (90, "can_receive_address"): FieldNote("CAN identifier of received messages."),
    (94, "state"): _note("Starts, samples and saves an in-field calibration."),
    (94, "status"): _read_only("Samples collected so far."),
    (125, "results"): _read_only("Results of the test."),
    (125, "state"): _read_only("State of the test."),
    (125, "detectedHardwareId"): _read_only("Detected hardware."),
}


_MOMENTARY: Mapping[int, tuple[str, ...]] = {
    1: ("hdwRunState",),
    12: ("checksum", "lastLla", "lastLlaTimeOfWeekMs", "lastLlaWeek"),
    73: ("state", "elapsedTimeSec", "hAccuracy", "lla"),
    81: ("checksum",),
    87: ("timeOfWeekMs", "status", "mode"),
    93: ("hdwRunState",),
    120: ("hdwRunState",),
    121: ("checksum",),
}
_ALL_MOMENTARY = (2, 10, 19, 64, 75, 94, 125)
"""Faults, the state of the system, traffic; calibrations and tests, which are started by writing their state."""


def is_momentary(did: int, name: str) -> bool:
    """Whether a field is a momentary state instead of a setting."""
    return did in _ALL_MOMENTARY or name in _MOMENTARY.get(did, ())


LISTS = ((8, "nmeaBroadcastMsgs"),)
SENTENCES = range(20)  # SDK: NMEA_MSG_ID_COUNT; numbers from there on are commands, and ways to send a sentence


def _of_sentence(field: Field) -> Field:
    """A field of an entry of that list, with only the numbers of sentences that a device sends; the number names it."""
    choices = {number: name for number, name in field.choices.items() if number in SENTENCES}
    return replace(field, choices=choices, key_mask=0xFF if field.name == "msgID" else 0)


def noted(did: int, field: Field) -> Field:
    """A field of a data set with its note applied."""
    if not field.title and field.name.isalpha() and field.name.islower():
        field = replace(field, title=field.name.capitalize())  # "state" is a word already
    if is_momentary(did, field.name):
        field = replace(field, momentary=True)
    note = _OF_SET.get((did, field.name)) or _GENERAL.get(field.name)
    if note is None:
        return replace(field, basic=False)
    if (did, field.name) in LISTS:  # only the used entries; the rest is sent empty
        field = replace(field, shape=(-1,), max_length=field.shape[0], fields=tuple(map(_of_sentence, field.fields)))
    return replace(
        field,
        low=note.low,
        high=note.high,
        choices=note.choices or field.choices,
        basic=note.basic,
        read_only=note.read_only,
        doc=note.doc,
    )
