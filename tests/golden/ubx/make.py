"""UBX messages with their values, by pyubx2 (BSD licence), which is not a dependency: `pip install pyubx2==1.4.0`.

    python tests/golden/ubx/make.py > tests/golden/ubx/values.json
    python tests/golden/ubx/make.py samples > tests/golden/ubx/samples.json

Values are pyubx2's own: in degrees where it scales, else the wire's integers.
"""

import json
import random
import struct
import sys

from pyubx2 import GET, UBXMessage, UBXReader
from pyubx2 import ubxtypes_get as tables

MESSAGES = (
    *("NAV-POSECEF", "NAV-POSLLH", "NAV-STATUS", "NAV-DOP", "NAV-ATT", "NAV-SOL", "NAV-PVT", "NAV-ODO", "NAV-VELECEF"),
    *("NAV-VELNED", "NAV-HPPOSECEF", "NAV-HPPOSLLH", "NAV-PVAT", "NAV-TIMEGPS", "NAV-TIMEUTC", "NAV-CLOCK", "NAV-COV"),
    *("NAV-SVIN", "NAV-RELPOSNED", "NAV-EELL", "ESF-INS", "ESF-ALG", "HNR-PVT", "HNR-ATT", "HNR-INS", "TIM-TP"),
    *("TIM-TM2", "NAV2-PVT", "NAV2-VELNED"),
)


def size_of(fields):
    """Bytes of a payload without groups."""
    size = 0
    for kind in fields.values():
        one = kind[0] if isinstance(kind, tuple) else kind
        size += int(one[1:])
    return size


def samples():
    """ESF-RAW with samples of some types, and what pyubx2 finds: numbers with their types in groups."""
    rng = random.Random(7)
    made = []
    for count, types in ((10, (14, 13, 5, 16, 17, 18, 12)), (4, (14, 13, 5)), (1, (18,)), (3, (16, 17, 63))):
        payload = bytearray(4)
        for number in range(count):
            for kind in types:
                payload += struct.pack("<II", kind << 24 | rng.getrandbits(24), 4_000_000_000 + 256 * number)
        frame = UBXMessage("ESF", "ESF-RAW", GET, payload=bytes(payload)).serialize()
        parsed = vars(UBXReader.parse(frame, msgmode=GET, parsebitfield=False))
        words = {name: value for name, value in parsed.items() if name.startswith(("data", "sT"))}
        made.append(
            {
                "frame": frame.hex(),
                "words": {
                    name: int.from_bytes(value, "little") if isinstance(value, bytes) else value
                    for name, value in words.items()
                },
            }
        )
    json.dump(made, sys.stdout, indent=0)


def main():
    rng = random.Random(7)
    made = []
    for name in MESSAGES:
        for _ in range(3):
            payload = bytearray(rng.randbytes(size_of(tables.UBX_PAYLOADS_GET[name])))
            if name == "NAV-RELPOSNED":
                payload[0] = 1  # the version with a heading
            if name == "NAV-COV":
                payload[16:] = struct.pack("<12f", *(rng.uniform(-9, 9) for _ in range(12)))
            frame = UBXMessage(name.split("-")[0], name, GET, payload=bytes(payload)).serialize()
            parsed = UBXReader.parse(frame, msgmode=GET, parsebitfield=False)
            values = {}
            for field, value in vars(parsed).items():
                if field.startswith("_") or field.startswith("reserved"):
                    continue
                values[field] = int.from_bytes(value, "little") if isinstance(value, bytes) else value
            made.append({"name": name, "frame": frame.hex(), "values": values})
    json.dump(made, sys.stdout, indent=0)


samples() if sys.argv[1:] == ["samples"] else main()
