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

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from protocols.schema import Field

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
    "size": _read_only("Size of the set; the device's own."),
    "checksum": _read_only("Checksum over all behind it; the device computes it anew."),
    "key": _read_only("The maker's way to restore defaults; never written here."),
    "reserved": _read_only("Reserved."),
    "reserved1": _read_only("Reserved."),
    "reserved2": _read_only("Reserved."),
    "ser0BaudRate": FieldNote("Rate of serial port 0, in effect after a reset.", basic=True, choices=_BAUD),
    "ser1BaudRate": FieldNote("Rate of serial port 1, in effect after a reset.", basic=True, choices=_BAUD),
    "ser2BaudRate": FieldNote("Rate of serial port 2, in effect after a reset.", basic=True, choices=_BAUD),
    "startupGPSDtMs": _note("Period of GNSS solutions, in effect after a reset; 200 is 5 Hz, the fastest.", 200),
    "gps1AntOffset": _note("Where the first antenna is, seen from the sensor.", -_FAR_M, _FAR_M),
    "gps2AntOffset": _note("Where the second antenna is, seen from the sensor.", -_FAR_M, _FAR_M),
    "dynamicModel": _note("How the sensor is moved: sets what the navigation filter believes."),
    "gnssSatSigConst": _note("Which satellite systems are received."),
    "RTKCfgBits": _note("RTK: rover modes, and what a base sends on which port."),
    "sysCfgBits": _note("What the navigation filter uses and estimates."),
    "refLla": _note("Origin of north, east and down."),
    "gpsMinimumElevation": _note("Satellites lower than this are not used.", 0, math.pi / 2),
    "gnssCn0Minimum": FieldNote("Satellites weaker than this are not used."),
    "gnssCn0DynMinOffset": FieldNote("How far below the strongest satellites one may be; 0 switches this off."),
    "gpsTimeSyncPeriodMs": FieldNote("Period of the time synchronisation pulse, in effect after a reset."),
    "gpsTimeUserDelay": FieldNote("Added to the GNSS time, to make up for the delay of an antenna cable."),
    "debug": FieldNote("For the maker."),
    "declination": FieldNote("Magnetic declination as estimated; east is positive.", -_TURN, _TURN),
}

_OF_SET: Mapping[tuple[int, str], FieldNote] = {
    (12, "startupImuDtMs"): _note(
        "Sampling period of the sensors, in effect after a reset; not above startupNavDtMs. 0 switches them off."
    ),
    (12, "startupNavDtMs"): _note(
        "Period of navigation, in effect after a reset; an IMX-5 with GNSS updates every 7 ms at the fastest.", 1
    ),
    (12, "insRotation"): _note("From the sensor to what is put out: how it is mounted.", -_TURN, _TURN),
    (12, "insOffset"): _note("From the turned sensor to the point that is put out.", -_FAR_M, _FAR_M),
    (12, "lastLla"): _read_only("Where it last was, kept for a faster start."),
    (12, "lastLlaTimeOfWeekMs"): _read_only("When that was."),
    (12, "lastLlaWeek"): _read_only("When that was."),
    (12, "lastLlaUpdateDistance"): FieldNote("How far it must move before the place is kept again.", 0, 1e6),
    (12, "ioConfig"): FieldNote("What the pins do, which receiver is on which port. A wrong one cuts the port off."),
    (12, "ioConfig2"): FieldNote("What further pins do."),
    (12, "platformConfig"): FieldNote("Which board the module is on; sets the pins."),
    (12, "zeroVelRotation"): FieldNote("From the sensor to the frame in which a vehicle cannot slip.", -_TURN, _TURN),
    (12, "zeroVelOffset"): FieldNote("To the point of the vehicle that cannot slip.", -_FAR_M, _FAR_M),
    (12, "magDeclination"): _note("Magnetic declination; east is positive.", -_TURN, _TURN),
    (12, "sensorConfig"): FieldNote("Ranges and filters of the sensors, in effect after a reset."),
    (12, "wheelConfig.bits"): FieldNote("Whether wheel encoders are used, and how they turn."),
    (12, "wheelConfig.track_width"): FieldNote("Between the left and the right wheel.", 0, 100),
    (12, "wheelConfig.radius"): FieldNote("Of a wheel.", 0, 10),
    (12, "magInterferenceThreshold"): FieldNote(
        "How much the field may differ from the expected: usually 2 to 10, 3 at the factory; 1000 switches this off.",
        0,
        1000,
    ),
    (12, "magCalibrationQualityThreshold"): FieldNote(
        "How good a magnetic calibration must be: usually 10 to 20, 10 at the factory; 1000 takes every one.", 0, 1000
    ),
    (19, "state"): _note("Starts or aborts a calibration of the magnetometers."),
    (19, "progress"): _read_only("How far the calibration is."),
    (19, "declination"): _read_only("Magnetic declination as estimated."),
    (8, "options"): _note("Port and persistence: 512 keeps the messages over a reset."),
    (8, "nmeaBroadcastMsgs"): _note("Message and period, a multiple of its source's; 0 switches it off."),
    (64, "command"): _note("Starts a built-in test."),
    (64, "lastCommand"): _read_only("The last one started."),
    (64, "state"): _read_only("What the test is at."),
    (73, "state"): _note("Starts or cancels a survey of the base's place."),
    (73, "maxDurationSec"): _note("Longest time of the survey.", 0, 1_000_000),
    (73, "minAccuracy"): _note("Accuracy at which the survey is over.", 0, 1000),
    (73, "elapsedTimeSec"): _read_only("How long it has lasted."),
    (73, "hAccuracy"): _read_only("How accurate the place is now."),
    (73, "lla"): _read_only("The place as surveyed."),
    (87, "timeOfWeekMs"): _read_only("When this was."),
    (87, "status"): _read_only("What the calibration of the wheels is at."),
    (87, "mode"): _note("Calibrates the wheels."),
    (90, "can_period_mult"): _note(
        "Period of each CAN message, a multiple of its source's; 0 switches it off.", 0, 65_535
    ),
    (90, "can_transmit_address"): FieldNote("CAN identifier of each message."),
    (90, "can_baudrate_kbps"): FieldNote("Rate of the CAN bus.", basic=True, choices=_CAN),
    (90, "can_receive_address"): FieldNote("CAN identifier that it listens to."),
    (94, "state"): _note("Starts, samples and saves a calibration in the field."),
    (94, "status"): _read_only("What has been sampled."),
    (125, "results"): _read_only("What the test found."),
    (125, "state"): _read_only("What the test is at."),
    (125, "detectedHardwareId"): _read_only("The hardware that it found."),
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
    """A field of an entry of that list, with only the numbers of sentences that a device sends."""
    return replace(field, choices={number: name for number, name in field.choices.items() if number in SENTENCES})


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
