"""Messages of other protocols on a port: sentences, u-blox, RTCM 3, strings of an MTi; valid, damaged and unusual.

Checksums are computed plainly, not by the project's own functions.
"""

from functools import reduce
from operator import xor
from random import Random

from tests.oracles.checksums import crc24, fletcher

_SENTENCES = (
    b"GNGGA,092725.00,4717.11399,N,00833.91590,E,1,08,1.01,499.6,M,48.0,M,,",
    b"GPRMC,083559.00,A,4717.11437,N,00833.91522,E,0.004,77.52,091202,,,A",
    b"HCHDM,123.45,M",
    b"GPZDA,082710.00,16,09,2002,00,00",
    b"GPGSV,1,1,01,23,38,230,44",
    b"PSONCMS,0.7,0.1,0.2,0.6,1.0,2.0,9.81,0.1,0.2,0.3,0.4,0.5,0.6,21.3",
    b"PHTRO,1.23,M,-2.5,T",
    b"PTCF,10.1,T,1.2,-3.4,0.1,0.2",
    b"XSVEL,1.234,-0.5,0.0001",
    b"PRDID,1.0,-2.0,359.9",
    b"ASCE,0,GPGGA,1",
    b"STPB",
    b"PIMU,1.0,0.1,0.2,0.3,0.4,0.5,9.8",
)
_ODD_WORDS = (
    b"nan",
    b"inf",
    b"-inf",
    b"1e999",
    b"",
    b"-",
    b"999999999999",
    b"\xb2",
    b"0x10",
    b"1_0",
    b" 1",
    b"+",
    b"A",
)


def sentence(random: Random) -> bytes:
    """An NMEA sentence; one in two has a field replaced, one in four a wrong checksum or end."""
    words = random.choice(_SENTENCES).split(b",")
    while random.random() < 0.5:
        at = random.randrange(len(words))
        words[at] = random.choice(_ODD_WORDS) if at or random.random() < 0.2 else words[at]
    content = b",".join(words)
    total = reduce(xor, content, 0)
    if random.random() < 0.15:
        total ^= random.randrange(1, 256)
    start = random.choice((b"$", b"$", b"$", b"!"))
    end = random.choice((b"\r\n", b"\r\n", b"\r\n", b"\n", b"\r", b"", b"$"))
    return start + content + b"*%02X" % total + end


def ubx(random: Random) -> bytes:
    """A u-blox message; its length may lie."""
    payload = random.randbytes(random.choice((0, 2, 20, 92, 300)))
    length = len(payload) if random.random() < 0.8 else random.choice((0, 1, 8192, 8193, 0xFFFF))
    body = bytes([random.choice((1, 2, 5, 0x13, 0x99)), random.randrange(256)]) + length.to_bytes(2, "little") + payload
    low, high = fletcher(body)
    if random.random() < 0.15:
        low ^= 1
    return b"\xb5\x62" + body + bytes([low, high])


def rtcm(random: Random) -> bytes:
    """An RTCM 3 message; its length may lie."""
    number = random.choice((1005, 1074, 1077, 1230, 4072, 4095, 0))
    payload = (number << 4).to_bytes(2, "big") + random.randbytes(random.choice((0, 4, 19, 200)))
    payload = payload[: random.choice((0, 1, 2, 1023, 1023, 1023))]
    length = len(payload) if random.random() < 0.8 else random.choice((0, 1, 1023))
    frame = b"\xd3" + length.to_bytes(2, "big") + payload
    return frame + crc24(frame).to_bytes(3, "big")


def string(random: Random) -> bytes:
    """One of an MTi's two binary strings, several in a row."""
    if random.random() < 0.5:
        one = b":%05d %c%04dF%c%04d %c%04dH" % (
            *(random.randrange(40000), random.choice(b" -"), random.randrange(100), random.choice(b" -")),
            *(random.randrange(2000), random.choice(b" -"), random.randrange(2000)),
        )
        return (one + random.choice((b"\r\n", b"", b"\r"))) * random.choice((1, 2))
    one = (
        b"\x00\x90"
        + random.randbytes(1)
        + b"\x01"
        + random.randbytes(1)
        + b"\x02\x00\x00"
        + random.randbytes(1)
        + b"\x05"
    )
    return b"".join(one + random.randbytes(random.choice((0, 0, 3))) for _ in range(random.choice((1, 2, 3, 5))))


def make(random: Random) -> bytes:
    """One of all that; sometimes cut short."""
    one = random.choice((sentence, sentence, ubx, rtcm, string))(random)
    return one if random.random() < 0.85 else one[: random.randint(0, len(one))]
