"""Vendors' names and numbers in readable form.

Constants as words: GROUND_VEHICLE → "Ground vehicle", ZERO_MOTION → "Zero motion". Only all-capital names are
converted: capitals and digits with underscores, or a single plain English word of `WORDS`. Established names (GNGGA,
PIMU, DID_INS_1, kRun) stay. Identifiers of devices as on their labels.
"""

import re

_UPPER_CASE = """
AHRS BIT BLE CAN CNO CPU DGPS DMA DOP EKF EVB EVB2 GNSS GPS GPIO IMU INS I2C LED LLA NMEA NVR OTP PPD PPS RMC
ROM ROS RTCM3 RTK RTOS RUG3 SBAS SPI SWO TTL UART UBLOX UBX UDP UINS USB UTC VRS WMM XBEE
"""
_WORDS = """
ABORT ALL CANCEL CONTINUOUS DEFAULT DETECTED DISABLE DISABLED DONE ENABLE FAILED FAILURE FAULT FINISHED FINISHING FIX
FLOAT FULL GOOD IDLE INDOOR INVALID MANUFACTURING MARINE NO NONE OFF ON PASSED PEDESTRIAN PORTABLE REPORT RUNNING
SAMPLING SEARCHING STANDBY STATIONARY STOP UNCHANGED UNKNOWN UNUSED WRIST
"""
_EXPANSIONS = """
ACC accelerometer, BARO barometer, CAL calibration, CFG configuration, CUR current, DECL declination, EST estimation,
GYR gyroscope, HDW hardware, INIT initialise, LEDS LEDs, MAG magnetic, MANF manufacturer, NAV navigation, POS position,
RCVR receiver, RECAL recalibration, REF reference, RX receive, STATS statistics, TRIG trigger, TX transmit, WIFI Wi-Fi
"""
_IS_LONG = 0x8000_0000
UPPER_CASE = set(_UPPER_CASE.split())
WORDS = frozenset(_WORDS.split())
EXPANSIONS = dict(entry.split() for entry in _EXPANSIONS.replace("\n", " ").split(","))
_CONSTANT = re.compile(r"[A-Z0-9]+(_[A-Z0-9]+)*\Z")


def add_acronyms(*names: str) -> None:
    """Keep these names unchanged: those of a family's products."""
    UPPER_CASE.update(names)


def device_label(number: int) -> str:
    """The identifier of a device as printed on its label: 0080003A, with 64 bits 0080800001.

    Bit 31 of the low word marks one of 64 bits. Some messages have its low word first (Configuration of Xsens); read as
    one number its words are then swapped.
    """
    high, low = number >> 32, number & 0xFFFF_FFFF
    if high & _IS_LONG and not low & _IS_LONG:
        high, low = low, high
    return f"{high << 32 | low:010X}" if low & _IS_LONG else f"{high << 32 | low:08X}"


def constant_label(name: str) -> str:
    """A constant as words, starting with a capital; any other name unchanged."""
    if not _CONSTANT.match(name) or name.startswith("DID_") or ("_" not in name and name not in WORDS):
        return name
    text = " ".join(_part(part) for part in name.removeprefix("CMD_").removeprefix("MODE_").split("_"))
    return text[:1].upper() + text[1:]


def _part(part: str) -> str:
    if part in EXPANSIONS:
        return EXPANSIONS[part]
    return part if part in UPPER_CASE or any(sign.isdigit() for sign in part) else part.lower()
