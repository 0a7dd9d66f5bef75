"""NMEA sentences are found, checked and decoded at any position and for any chunk boundaries.

The values expected here were worked out by hand from the formats in MT0101P 2020.A, 5.3.5, and NMEA 0183.
"""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from imuscope.protocols.embedded.nmea import MAX_SENTENCE_BYTES, SENTENCES, find_nmea, sentence
from imuscope.protocols.events import ParsedMessage
from tests.protocols.embedded.nmea_sentences import EXAMPLES
from tests.support.each_row import each_row


@each_row("name", EXAMPLES)
def test_every_string_type_is_read(name: str) -> None:
    content, expected = EXAMPLES[name]
    results, stored = find_nmea(sentence(content), final=False)
    assert [(one.name, one.protocol, one.offset, one.size) for one in results] == [(name, "nmea", 0, stored)]
    assert results[0].line == sentence(content).decode().strip()
    read = results[0].fields
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


@each_row("line", [b"$PRDID,-10.37,2.34,230.34\r\n", b"$HEHDT,274.07,T\r\n"])
def test_sentences_without_checksum_in_the_document_are_accepted(line: bytes) -> None:
    assert find_nmea(line, final=False)[0][0].name == line[1:6].decode()


@each_row(
    "line",
    [
        b"$HCHDM,238.50,M*00\r\n",  # wrong
        b"$HCHDM,238.50,M\r\n",  # none
        b"$HCHDM,238.50,M*2\r\n",  # cut
        b"$HCHDM,238.5\xff0,M*2F\r\n",  # a byte that is not text
    ],
)
def test_failed_sentences_have_no_name(line: bytes) -> None:
    results, stored = find_nmea(line, final=False)
    assert [(one.offset, one.name, one.fields) for one in results] == [(0, "", {})]
    assert stored == len(line)


def test_a_sentence_that_breaks_off_does_not_swallow_the_next() -> None:
    good = sentence("HCHDM,1.0,M")
    results, _ = find_nmea(b"$GPGGA,1234" + good + b"noise" + good, final=False)
    assert [(one.offset, one.name) for one in results] == [(0, ""), (11, "HCHDM"), (11 + len(good) + 5, "HCHDM")]


def test_unknown_sentences_keep_their_words() -> None:
    results, _ = find_nmea(sentence("XXFOO,1,,three"), final=False)
    assert results[0].fields == {"field_01": "1", "field_02": None, "field_03": "three"}


def test_a_lone_dollar_is_given_up_after_the_length_of_a_sentence() -> None:
    assert find_nmea(b"$" + b"A" * 50, final=False) == ([], 0)
    assert find_nmea(b"$" + b"A" * 50, final=True) == ([], 51)
    assert find_nmea(b"$" + b"A" * MAX_SENTENCE_BYTES, final=False) == ([], MAX_SENTENCE_BYTES + 1)


def pieces(data: bytes, cuts: list[int]) -> list[ParsedMessage]:
    """Results of `find_nmea` for data in chunks, keeping the requested bytes; offsets in the whole stream."""
    results, start, end = [], 0, 0
    for size in [*cuts, len(data)]:
        end = min(end + size, len(data))
        now, stored = find_nmea(data[start:end], final=end == len(data))
        results += [
            ParsedMessage(one.offset + start, one.size, one.protocol, one.name, one.line, one.fields) for one in now
        ]
        start += stored
    return results


noise = st.binary(max_size=20) | st.sampled_from([b"$", b"!", b"$GP", b"*", b"\r", b"\n", b"\xfa\xff6", b"$$GPGGA,"])
whole = st.sampled_from([sentence(content) for content, _ in EXAMPLES.values()])


@given(st.lists(noise | whole, max_size=8).map(b"".join), st.lists(st.integers(0, 40), max_size=20))
@example(b"$A0", [1])
def test_cutting_changes_nothing(data: bytes, cuts: list[int]) -> None:
    assert pieces(data, cuts) == find_nmea(data, final=True)[0]


@given(st.binary(max_size=60) | st.text(max_size=60).map(lambda text: b"$" + text.encode() + b"\r\n"), st.booleans())
def test_any_bytes_are_survived(data: bytes, final: bool) -> None:
    results, stored = find_nmea(memoryview(data), final=final)
    assert 0 <= stored <= len(data)
    assert len(data) - stored <= MAX_SENTENCE_BYTES
    assert all(0 <= one.offset < one.offset + one.size <= stored for one in results)


words = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E, exclude_characters="$!*,"), max_size=12)


@given(st.sampled_from([*EXAMPLES, "PASHR", "PUBX", "GPGSV", "GNGNS"]), st.lists(words, max_size=16))
def test_any_fields_with_a_valid_checksum_are_accepted(name: str, fields: list[str]) -> None:
    """Pynmeagps meets fields it does not expect: the sentence stands, its words at least are there."""
    content = ",".join([name, *fields])
    if len(content) > MAX_SENTENCE_BYTES - 10:
        return
    results, _ = find_nmea(sentence(content), final=True)
    assert [one.name for one in results] == [name]
