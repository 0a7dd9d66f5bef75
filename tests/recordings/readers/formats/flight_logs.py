"""Logs of flight controllers, written after the documents of their formats, without code of the readers."""

import struct

import numpy as np

COUNT, STEP_US, BOOT_US = 400, 10_000, 112_500_000
UTC_US = 1_700_000_000_000_000  # of the fix
RATES = np.sin(4 * np.pi * np.arange(COUNT) / 100).astype(np.float32)


def _message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def ulog(*, with_fix: bool = True, appended: int = 0, unknown: int = 0) -> bytes:
    """A ULog with sensor_combined at 100 Hz, two instances of a nested topic, and a fix after one second."""
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", BOOT_US)]
    out.append(_message("B", bytes(8) + bytes([appended, unknown, *[0] * 6]) + bytes(24)))
    for text in (
        "sensor_combined:uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;uint8_t n;"
        "uint8_t[7] _padding0;",
        "point:float x;float y;",
        "wheels:uint64_t timestamp;point[2] at;char[4] name;",
        "sensor_gps:uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;uint8_t fix_type;uint8_t[3] _padding0;",
    ):
        name, _, fields = text.partition(":")
        out.append(_message("F", f"{name}:{fields}".encode()))
    key = b"char[3] sys_name"
    out.append(_message("I", bytes([len(key)]) + key + b"PX4"))
    key = b"float SENS_X"
    out.append(_message("P", bytes([len(key)]) + key + struct.pack("<f", 1.0)))
    for number, (instance, name) in enumerate(
        ((0, "sensor_combined"), (0, "wheels"), (1, "wheels"), (0, "sensor_gps"))
    ):
        out.append(_message("A", struct.pack("<BH", instance, number) + name.encode()))
    for n in range(COUNT):
        time = BOOT_US + n * STEP_US
        body = struct.pack("<HQ6fB", 0, time, RATES[n], 0, 0, 0.01, 0.02, 9.81, n % 256)
        out.append(_message("D", body))  # without the padding at its end, as PX4 writes it
        if n % 10 == 0:
            out += [_message("D", struct.pack("<HQ4f4s", 1 + one, time, n, 1, 2, 3 + one, b"abc")) for one in (0, 1)]
        if n == 100 and with_fix:
            out.append(_message("D", struct.pack("<HQQiB", 3, time, UTC_US, 480000000, 3)))
        if n == 200:
            out.append(_message("O", struct.pack("<H", 5)))
            out.append(_message("L", b"6" + struct.pack("<Q", time) + b"armed"))
    return b"".join(out)


LENGTHS = {"Q": 8, "f": 4, "B": 1, "I": 4, "H": 2, "L": 4, "c": 2, "N": 16, "Z": 64, "b": 1, "d": 8, "n": 4, "e": 4}


def _record(kind: int, codes: str, *values: object) -> bytes:
    form = {"N": "16s", "Z": "64s", "n": "4s", "L": "i", "c": "h", "e": "i"}
    return struct.pack("<BBB" + "".join(form.get(code, code) for code in codes), 0xA3, 0x95, kind, *values)


def dataflash(*, with_fix: bool = True) -> bytes:
    """A DataFlash log with two IMUs at 100 Hz, units and multipliers, and a fix after one second."""
    kinds = [
        (128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
        (177, "UNIT", "QbZ", "TimeUS,Id,Label"),
        (178, "MULT", "Qbd", "TimeUS,Id,Mult"),
        (179, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
        (10, "IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        (11, "GPS", "QBIHLLe", "TimeUS,Status,GMS,GWk,Lat,Lng,Alt"),
        (12, "BAT", "Qc", "TimeUS,Temp"),
        (13, "MSG", "QZ", "TimeUS,Message"),
        (14, "PARM", "QNf", "TimeUS,Name,Value"),
        (15, "RATE", "QH", "TimeUS,Milli"),
    ]
    out = []
    for kind, name, codes, labels in kinds:
        length = 3 + sum(LENGTHS[code] for code in codes)
        length = 89 if kind == 128 else length
        out.append(
            struct.pack("<BBBBB4s16s64s", 0xA3, 0x95, 128, kind, length, name.encode(), codes.encode(), labels.encode())
        )
    for name, label in (("s", "s"), ("E", "rad/s"), ("o", "m/s/s"), ("#", "instance"), ("x", "furlong")):
        out.append(_record(177, "QbZ", 1, ord(name), label.encode()))
    for name, factor in (("F", 1e-6), ("C", 1e-3), ("-", 0.0)):
        out.append(_record(178, "Qbd", 1, ord(name), factor))
    out.append(_record(179, "QBNN", 1, 10, b"s#EEEooo", b"F-000000"))
    out.append(_record(179, "QBNN", 1, 15, b"sx", b"FC"))
    out.append(_record(14, "QNf", 1, b"SENS_X", 1.0))
    week, ms = divmod(UTC_US // 1000 - 315_964_800_000 + 18_000, 604_800_000)
    for n in range(COUNT):
        time = BOOT_US + n * STEP_US
        for one in (0, 1):
            out.append(_record(10, "QBffffff", time, one, RATES[n] * (1 + one), 0, 0, 0.01, 0.02, 9.81))
        if n == 100 and with_fix:
            out.append(_record(11, "QBIHLLe", time, 3, ms, week, 480000000, 110000000, 5012))
        if n % 10 == 0:
            out += [_record(12, "Qc", time, 2150), _record(13, "QZ", time, b"hello"), _record(15, "QH", time, 1500)]
    return b"".join(out)
