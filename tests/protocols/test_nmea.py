"""Are sentences found, checked and read, wherever they begin and however they are cut?

The values expected here were worked out by hand from the formats in MT0101P 2020.A, 5.3.5, and NMEA 0183.
"""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from protocols.nmea import LONGEST, SENTENCES, ParsedMessage, checksum, find_nmea


def sentence(content: str) -> bytes:
    raw = content.encode()
    return b"$" + raw + b"*%02X\r\n" % checksum(raw)


EXAMPLES: dict[str, tuple[str, dict[str, Any]]] = {
    "HCHDM": ("HCHDM,238.50,M", {"headingM": 238.5, "headingMag": "M"}),
    "HCHDG": (
        "HCHDG,98.3,1.5,E,12.6,W",
        {"headingM": 98.3, "deviation": 1.5, "deviationEW": "E", "variation": 12.6, "variationEW": "W"},
    ),
    "PHTRO": ("PHTRO,10.37,P,177.62,T", {"pitch": 10.37, "pitchSide": "P", "roll": 177.62, "rollSide": "T"}),
    "PRDID": ("PRDID,-10.37,2.34,230.34", {"pitch": -10.37, "roll": 2.34, "headingT": 230.34}),
    "PSONCMS": (
        "PSONCMS,0.0905,0.4217,0.9020,-0.0196,-09.1585,-00.2743,-03.3479,-00.0082,00.0025,-00.0046,00.0148,-00.3885,"
        "-00.6203,30.5",
        {
            **{"q0": 0.0905, "q1": 0.4217, "q2": 0.902, "q3": -0.0196},
            **{"accX": -9.1585, "accY": -0.2743, "accZ": -3.3479, "gyrX": -0.0082, "gyrY": 0.0025, "gyrZ": -0.0046},
            **{"magX": 0.0148, "magY": -0.3885, "magZ": -0.6203, "temp": 30.5},
        },
    ),
    "HCMTW": ("HCMTW,23.4,C", {"temp": 23.4, "tempu": "C"}),
    "HEHDT": ("HEHDT,274.07,T", {"headingT": 274.07, "headingTu": "T"}),
    "HEROT": ("HEROT,-012.3,A", {"rot": -12.3, "valid": "A"}),
    "GPGGA": (
        "GPGGA,172814.00,3723.46587704,N,12202.26957864,W,2,6,1.2,18.893,M,-25.669,M,,",
        {
            **{"time": "17:28:14", "lat": 37 + 23.46587704 / 60, "NS": "N", "lon": -(122 + 2.26957864 / 60), "EW": "W"},
            **{"quality": 2, "numSV": 6, "HDOP": 1.2, "alt": 18.893, "altUnit": "M", "sep": -25.669, "sepUnit": "M"},
            **{"diffAge": None, "diffStation": None},
        },
    ),
    "PTCF": (
        "PTCF,110.8,T, 001.9,-00.6,-000.1, 000.0",
        {"heading": 110.8, "headingRef": "T", "roll": 1.9, "pitch": -0.6, "rollRate": -0.1, "pitchRate": 0.0},
    ),
    "PIMU": (
        "PIMU,3218.543,0.0017,-0.0059,-0.0077,-1.417,-1.106,-9.524",
        {
            **{"time": 3218.543, "pqrX": 0.0017, "pqrY": -0.0059, "pqrZ": -0.0077},
            **{"accX": -1.417, "accY": -1.106, "accZ": -9.524},
        },
    ),
    "PRIMU": ("PRIMU,1.5,0.1,0.2,0.3,1.0,2.0,9.8", {"time": 1.5, "pqrX": 0.1, "accZ": 9.8}),
    "PPIMU": (
        "PPIMU,1.5,0.0001,0.0002,0.0003,0.01,0.02,0.098,0.010",
        {"dthetaX": 0.0001, "dvelZ": 0.098, "dt": 0.01},
    ),
    "PINS1": (
        "PINS1,244272.398,2021,427888998,805306448,0.1244,-0.0665,-2.6127,0.277,-0.147,-0.089,40.05574940,"
        "-111.65861580,1438.451,0.001,0.002,0.003",
        {
            **{"timeOfWeek": 244272.398, "week": 2021, "insStatus": 427888998, "hdwStatus": 805306448},
            **{"thetaRoll": 0.1244, "thetaPitch": -0.0665, "thetaYaw": -2.6127, "uvwX": 0.277, "uvwZ": -0.089},
            **{"lat": 40.0557494, "lon": -111.6586158, "hae": 1438.451, "nedN": 0.001, "nedD": 0.003},
        },
    ),
    "PINS2": (
        "PINS2,244272.398,2021,427888998,805306448,0.9996,0.0249,-0.0116,0.0081,0.277,-0.147,-0.089,40.05574940,"
        "-111.65861580,1438.451",
        {"week": 2021, "q0": 0.9996, "q3": 0.0081, "uvwY": -0.147, "hae": 1438.451},
    ),
    "PGPSP": (
        "PGPSP,337272200,2031,1075643160,40.33057800,-111.72581630,1406.39,1425.18,0.95,0.37,0.55,-0.02,0.02,-0.03,"
        "0.17,39.5,337182.4521,18",
        {
            **{"timeOfWeekMs": 337272200, "week": 2031, "status": 1075643160, "lat": 40.330578, "hae": 1406.39},
            **{"hMSL": 1425.18, "pDop": 0.95, "hAcc": 0.37, "vAcc": 0.55, "velX": -0.02, "velZ": -0.03, "sAcc": 0.17},
            **{"cnoMean": 39.5, "towOffset": 337182.4521, "leapS": 18},
        },
    ),
    "PSTRB": ("PSTRB,2031,337272200,9,3", {"week": 2031, "timeOfWeekMs": 337272200, "pin": 9, "count": 3}),
    "INFO": (
        "INFO,62123,5.0.4.0,2.7.1.0,7,2.0.0.0,654364672,Inertial Sense Inc,2026-01-01,12:30:00.00,twin,3,2,r",
        {
            **{"serialNumber": 62123, "hardwareVer": "5.0.4.0", "firmwareVer": "2.7.1.0", "buildNumber": 7},
            **{"manufacturer": "Inertial Sense Inc", "buildDate": "2026-01-01", "hardwareType": 3, "buildType": "r"},
        },
    ),
    "ASCE": ("ASCE,0,4,1,7,5", {"options": 0, "id_1": 4, "period_1": 1, "id_2": 7, "period_2": 5}),
    "ASCB": ("ASCB,512,13,2", {"options": 512, "id_1": 13, "period_1": 2}),
    "INTEL": (
        "INTEL,KIM,1.2.3.4,337272,2031,18,0.5,-0.5,0,0.1,0.2,0.3,1.1,1.2,1.3",
        {"id": "KIM", "timeOfWeek": 337272, "leapS": 18, "ppsPhase2": -0.5, "velX": 0.1, "velN": 1.1, "velD": 1.3},
    ),
    "POWGPS": (
        "POWGPS,1,2360,337272200000,1,18,0",
        {"timeValid": 1, "week": 2360, "timeOfWeekUs": 337272200000, "leapS": 18, "holdover": 0},
    ),
    "POWTLV": (
        "POWTLV,1,2360,337272200000,1,18,0,4003.34496,N,11139.51695,W,1438.451,1457.2,0.5,0.1,90.0",
        {"latDegMin": 4003.34496, "NS": "N", "lonDegMin": 11139.51695, "EW": "W", "hae": 1438.451, "course": 90.0},
    ),
    "XSVEL": ("XSVEL, 001.2345,-002.0000, 000.125", {"velX": 1.2345, "velY": -2.0, "velZ": 0.125}),
    "GPZDA": (
        "GPZDA,201530.00,04,07,2020,00,00",
        {"time": "20:15:30", "day": 4, "month": 7, "year": 2020, "ltzh": "00", "ltzn": "00"},
    ),
    "GPRMC": (
        "GPRMC,123519,A,4807.03,N,01131.00,W,022.4,084.4,230320,003.1,W,",
        {
            **{"time": "12:35:19", "status": "A", "lat": 48 + 7.03 / 60, "NS": "N", "lon": -(11 + 31 / 60), "EW": "W"},
            **{"spd": 22.4, "cog": 84.4, "date": "2020-03-23", "mv": 3.1, "mvEW": "W"},
        },
    ),
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_string_type_is_read(name: str) -> None:
    content, expected = EXAMPLES[name]
    found, kept = find_nmea(sentence(content), final=False)
    assert [(one.name, one.protocol, one.offset, one.size) for one in found] == [(name, "nmea", 0, kept)]
    assert found[0].line == sentence(content).decode().strip()
    read = found[0].fields
    for field, value in expected.items():
        assert read[field] == pytest.approx(value, abs=1e-9) if isinstance(value, float) else read[field] == value, (
            field
        )


def test_every_row_has_an_example() -> None:
    assert set(SENTENCES) <= set(EXAMPLES)


def test_a_known_checksum() -> None:
    """The sentence with which NMEA checksums are usually explained."""
    line = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n"
    assert find_nmea(line, final=False)[0][0].name == "GPGGA"


@pytest.mark.parametrize("line", [b"$PRDID,-10.37,2.34,230.34\r\n", b"$HEHDT,274.07,T\r\n"])
def test_what_the_document_prints_without_checksum_is_taken_without(line: bytes) -> None:
    assert find_nmea(line, final=False)[0][0].name == line[1:6].decode()


@pytest.mark.parametrize(
    "line",
    [
        b"$HCHDM,238.50,M*00\r\n",  # wrong
        b"$HCHDM,238.50,M\r\n",  # none
        b"$HCHDM,238.50,M*2\r\n",  # cut
        b"$HCHDM,238.5\xff0,M*2F\r\n",  # a byte that is no text
    ],
)
def test_what_fails_is_found_without_a_name(line: bytes) -> None:
    found, kept = find_nmea(line, final=False)
    assert [(one.offset, one.name, one.fields) for one in found] == [(0, "", {})]
    assert kept == len(line)


def test_a_sentence_that_breaks_off_does_not_swallow_the_next() -> None:
    good = sentence("HCHDM,1.0,M")
    found, _ = find_nmea(b"$GPGGA,1234" + good + b"noise" + good, final=False)
    assert [(one.offset, one.name) for one in found] == [(0, ""), (11, "HCHDM"), (11 + len(good) + 5, "HCHDM")]


def test_unknown_sentences_keep_their_words() -> None:
    found, _ = find_nmea(sentence("XXFOO,1,,three"), final=False)
    assert found[0].fields == {"field_01": "1", "field_02": None, "field_03": "three"}


def test_a_lone_dollar_is_not_waited_for_longer_than_a_sentence() -> None:
    assert find_nmea(b"$" + b"A" * 50, final=False) == ([], 0)
    assert find_nmea(b"$" + b"A" * 50, final=True) == ([], 51)
    assert find_nmea(b"$" + b"A" * LONGEST, final=False) == ([], LONGEST + 1)


def pieces(data: bytes, cuts: list[int]) -> list[ParsedMessage]:
    """What `find_nmea` gives when the data come in chunks and it keeps what it asks for; offsets in the whole."""
    found, start, end = [], 0, 0
    for size in [*cuts, len(data)]:
        end = min(end + size, len(data))
        now, kept = find_nmea(data[start:end], final=end == len(data))
        found += [
            ParsedMessage(one.offset + start, one.size, one.protocol, one.name, one.line, one.fields) for one in now
        ]
        start += kept
    return found


noise = st.binary(max_size=20) | st.sampled_from([b"$", b"!", b"$GP", b"*", b"\r", b"\n", b"\xfa\xff6", b"$$GPGGA,"])
whole = st.sampled_from([sentence(content) for content, _ in EXAMPLES.values()])


@given(st.lists(noise | whole, max_size=8).map(b"".join), st.lists(st.integers(0, 40), max_size=20))
@example(b"$A0", [1])
def test_cutting_changes_nothing(data: bytes, cuts: list[int]) -> None:
    assert pieces(data, cuts) == find_nmea(data, final=True)[0]


@given(st.binary(max_size=60) | st.text(max_size=60).map(lambda text: b"$" + text.encode() + b"\r\n"), st.booleans())
def test_any_bytes_are_survived(data: bytes, final: bool) -> None:
    found, kept = find_nmea(memoryview(data), final=final)
    assert 0 <= kept <= len(data)
    assert len(data) - kept <= LONGEST
    assert all(0 <= one.offset < one.offset + one.size <= kept for one in found)


words = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E, exclude_characters="$!*,"), max_size=12)


@given(st.sampled_from([*EXAMPLES, "PASHR", "PUBX", "GPGSV", "GNGNS"]), st.lists(words, max_size=16))
def test_any_words_under_a_true_checksum_are_survived(name: str, fields: list[str]) -> None:
    """pynmeagps meets fields it does not expect: the sentence stands, its words at least are there."""
    content = ",".join([name, *fields])
    if len(content) > LONGEST - 10:
        return
    found, _ = find_nmea(sentence(content), final=True)
    assert [one.name for one in found] == [name]
