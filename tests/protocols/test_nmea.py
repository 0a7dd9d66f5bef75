"""Are sentences found, checked and read, wherever they begin and however they are cut?

The values expected here were worked out by hand from the formats in MT0101P 2020.A, 5.3.5, and NMEA 0183.
"""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from protocols.nmea import LONGEST, SENTENCES, Found, checksum, find


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
    found, kept = find(sentence(content), final=False)
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
    assert find(line, final=False)[0][0].name == "GPGGA"


@pytest.mark.parametrize("line", [b"$PRDID,-10.37,2.34,230.34\r\n", b"$HEHDT,274.07,T\r\n"])
def test_what_the_document_prints_without_checksum_is_taken_without(line: bytes) -> None:
    assert find(line, final=False)[0][0].name == line[1:6].decode()


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
    found, kept = find(line, final=False)
    assert [(one.offset, one.name, one.fields) for one in found] == [(0, "", {})]
    assert kept == len(line)


def test_a_sentence_that_breaks_off_does_not_swallow_the_next() -> None:
    good = sentence("HCHDM,1.0,M")
    found, _ = find(b"$GPGGA,1234" + good + b"noise" + good, final=False)
    assert [(one.offset, one.name) for one in found] == [(0, ""), (11, "HCHDM"), (11 + len(good) + 5, "HCHDM")]


def test_unknown_sentences_keep_their_words() -> None:
    found, _ = find(sentence("XXFOO,1,,three"), final=False)
    assert found[0].fields == {"field_01": "1", "field_02": None, "field_03": "three"}


def test_a_lone_dollar_is_not_waited_for_longer_than_a_sentence() -> None:
    assert find(b"$" + b"A" * 50, final=False) == ([], 0)
    assert find(b"$" + b"A" * 50, final=True) == ([], 51)
    assert find(b"$" + b"A" * LONGEST, final=False) == ([], LONGEST + 1)


def pieces(data: bytes, cuts: list[int]) -> list[Found]:
    """What `find` gives when the data come in chunks and it keeps what it asks for; offsets in the whole."""
    found, start, end = [], 0, 0
    for size in [*cuts, len(data)]:
        end = min(end + size, len(data))
        now, kept = find(data[start:end], final=end == len(data))
        found += [Found(one.offset + start, one.size, one.protocol, one.name, one.line, one.fields) for one in now]
        start += kept
    return found


noise = st.binary(max_size=20) | st.sampled_from([b"$", b"!", b"$GP", b"*", b"\r", b"\n", b"\xfa\xff6", b"$$GPGGA,"])
whole = st.sampled_from([sentence(content) for content, _ in EXAMPLES.values()])


@given(st.lists(noise | whole, max_size=8).map(b"".join), st.lists(st.integers(0, 40), max_size=20))
@example(b"$A0", [1])
def test_cutting_changes_nothing(data: bytes, cuts: list[int]) -> None:
    assert pieces(data, cuts) == find(data, final=True)[0]


@given(st.binary(max_size=60) | st.text(max_size=60).map(lambda text: b"$" + text.encode() + b"\r\n"), st.booleans())
def test_any_bytes_are_survived(data: bytes, final: bool) -> None:
    found, kept = find(memoryview(data), final=final)
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
    found, _ = find(sentence(content), final=True)
    assert [one.name for one in found] == [name]
