"""Messages of other protocols as vectors: all u-blox and RTCM 3 messages known to two public libraries.

    uv run --with pyubx2 --with pyrtcm python -m tests.oracles.foreign

writes tests/golden/foreign/computed.json. The names are those of pyubx2 and pyrtcm (BSD-3-Clause), the bytes are made
here: a payload that counts up, and checksums added one byte (or bit) at a time. Nothing is imported from the project.
"""

import json
from importlib.metadata import version
from pathlib import Path

from tests.oracles.checksums import crc24, fletcher

GOLDEN = Path(__file__).parents[1] / "golden" / "foreign"
CLASSES = {0x01, 0x02, 0x04, 0x05, 0x06, 0x09, 0x0A, 0x0D, 0x10, 0x13, 0x21, 0x27, 0x28, 0x29}
PAYLOAD = bytes(range(12))


def ubx(group: int, number: int, payload: bytes = PAYLOAD) -> bytes:
    """One u-blox message."""
    body = bytes([group, number]) + len(payload).to_bytes(2, "little") + payload
    return b"\xb5\x62" + body + fletcher(body)


def rtcm(number: int, payload: bytes = PAYLOAD) -> bytes:
    """One RTCM 3 message."""
    payload = (number << 4).to_bytes(2, "big") + payload
    frame = b"\xd3" + len(payload).to_bytes(2, "big") + payload
    return frame + crc24(frame).to_bytes(3, "big")


def main() -> None:
    """Write the golden file."""
    import pyrtcm  # type: ignore[import-not-found]
    import pyubx2  # type: ignore[import-not-found]

    names: dict[tuple[int, int], str] = {}
    for identity, name in pyubx2.UBX_MSGIDS.items():
        if identity[0] in CLASSES:  # three bytes where a kind has several forms: MGA-GPS-EPH
            short = "-".join(name.split("-")[:2]) if len(identity) > 2 else name
            names.setdefault((identity[0], identity[1]), short)
    rows = [
        {"protocol": "ubx", "id": list(key), "name": name, "source": "computed", "hex": ubx(*key).hex()}
        for key, name in sorted(names.items())
    ]
    numbers = sorted({int(word) for word in pyrtcm.RTCM_MSGIDS if word.isdecimal()} | {4072})
    rows += [
        {"protocol": "rtcm3", "id": number, "name": str(number), "source": "computed", "hex": rtcm(number).hex()}
        for number in numbers
    ]
    about = {"names": {name: version(name) for name in ("pyubx2", "pyrtcm")}}
    GOLDEN.mkdir(exist_ok=True)
    lines = ",\n".join(json.dumps(row) for row in rows)
    (GOLDEN / "computed.json").write_text(f'{{"about": {json.dumps(about)},\n"messages": [\n{lines}\n]}}\n')


if __name__ == "__main__":
    main()
