"""Quantities from sentences: units of the sentence's table, complete vectors, wrapping headings."""

import numpy as np
import pytest

from imuscope.protocols.embedded import nmea
from imuscope.protocols.embedded.nmea import SENTENCES, SOURCE, checksum, find_nmea, sentence
from imuscope.protocols.embedded.quantities import NmeaQuantities
from imuscope.protocols.events import Text
from imuscope.protocols.isb import sentences
from imuscope.protocols.schema.fields import Message
from tests.protocols.embedded.vectornav_sentences import VECTORNAV
from tests.support.each_row import each_row


def text(name: str, offset: int = 0, **fields: object) -> Text:
    return Text("nmea", name, "", offset, 1, 1_000 + offset, fields)


@each_row("row", sentences.ROWS, ids=lambda row: row.name)
def test_every_quantity_of_an_imx_has_its_unit(row: Message) -> None:
    """Regression: fields were named field_01, field_02 … and were text, without plots and units."""
    numbers = {field.name: float(i) for i, field in enumerate(row.fields) if field.dtype != "ascii"}
    (batch,) = NmeaQuantities().batches([text(row.name, **numbers)])
    shown = {field.unit for field in batch.message.fields if field.unit}
    assert shown == {field.unit for field in row.fields if field.unit}
    vectors = {name[:-1] for name in numbers if name.endswith("X")}
    assert sum(len(field.axes) == 3 for field in batch.message.fields) >= len(vectors)


@each_row("row", [row for row in SENTENCES.values() if row.source == SOURCE], ids=lambda row: row.name)
def test_every_number_of_an_mti_has_its_unit(row: Message) -> None:
    numbers = {field.name: float(i) for i, field in enumerate(row.fields) if field.dtype == "f8"}
    (batch,) = NmeaQuantities().batches([text(row.name, **numbers)])
    shown = sorted(field.unit for field in batch.message.fields if field.unit)
    kinds = {(field.name.rstrip("XYZ"), field.unit) for field in row.fields if field.dtype == "f8" and field.unit}
    assert shown == sorted(unit for _, unit in kinds)
    for field in batch.message.fields:
        assert field.period == (360 if field.name.startswith("heading") else 0)


def test_numbers_along_axes_are_one_quantity() -> None:
    names = ["q0", "q1", "q2", "q3", *(f"{kind}{axis}" for kind in ("acc", "gyr", "mag") for axis in "XYZ"), "temp"]
    texts = [text("PSONCMS", k, **{name: float(i + k) for i, name in enumerate(names)}) for k in range(3)]
    (batch,) = NmeaQuantities().batches(texts)
    assert list(batch.columns) == ["Quaternion", "Acceleration", "RateOfTurn", "MagneticField", "temp"]
    assert batch.columns["Quaternion"].shape == (3, 4)
    assert batch.columns["Acceleration"][2].tolist() == [6, 7, 8]
    assert batch.message.separate_channels == ("Quaternion", "Acceleration", "RateOfTurn", "MagneticField")
    assert batch.offset.tolist() == [0, 1, 2]


def test_a_known_sentence_has_its_message_and_unknown_fields_have_none() -> None:
    sentences = NmeaQuantities()
    (first,) = sentences.batches([text("HCHDM", headingM=354.0, ref="M")])
    more = [text("HCHDM", headingM=1.0), text("GPTXT", text="hello"), text("X", a=np.int64(1))]
    second, other = sentences.batches(more)
    assert first.message is second.message
    assert first.message.fields[0].title == "Heading, magnetic"
    assert (other.message.title, other.message.fields[0].name) == ("NMEA X", "a")
    assert sentences.batches([text("", headingM=1.0)]) == []


@each_row(
    ("line", "expected"),
    [
        ("PHTRO,10.37,P,177.62,T", {"pitch": -10.37, "roll": 177.62}),
        ("PHTRO,10.37,M,17.62,B", {"pitch": 10.37, "roll": -17.62}),
        ("HCHDG,101.1,7.5,W,3.2,E", {"deviation": -7.5, "variation": 3.2}),
        ("HCHDG,101.1,7.5,E,3.2,W", {"deviation": 7.5, "variation": -3.2}),
        (
            "GPRMC,081836,A,3751.65,S,14507.36,E,000.0,360.0,130998,011.3,W",
            {"lat": -37.860833, "lon": 145.122667, "mv": -11.3},
        ),
        ("GPRMC,081836,A,3751.65,N,14507.36,W,000.0,360.0,130998,011.3,E", {"lon": -145.122667, "mv": 11.3}),
        ("GPXTE,A,A,0.67,L,N", {"ctrkerr": -0.67}),
        ("GPDTM,W84,,0.5,S,0.25,W,1.0,W84", {"latOfset": -0.5, "lonOfset": -0.25}),
        ("HCHDM,354.0,M", {"headingM": 354.0}),
    ],
)
def test_a_sign_that_is_a_letter_is_not_lost(line: str, expected: dict[str, float]) -> None:
    """Regression: pitch and roll of $PHTRO, deviation and variation were positive regardless of the
    direction letter.
    """
    raw = f"${line}*{checksum(line.encode()):02X}\r\n".encode()
    (result,), _ = find_nmea(raw, final=True)
    (batch,) = NmeaQuantities().batches([Text("nmea", result.name, result.line, 0, len(raw), 0, result.fields)])
    assert {name: float(batch.columns[name][0]) for name in expected} == pytest.approx(expected)
    assert result.line == raw.decode().strip()


@each_row("name", [row.name for row in nmea.VECTORNAV])
def test_every_number_of_vectornav_has_its_unit(name: str) -> None:
    [parsed], _ = find_nmea(sentence(VECTORNAV[name][0]), final=True)
    row = SENTENCES[name]
    assert len(parsed.fields) == len(row.fields)
    assert None not in parsed.fields.values()
    (batch,) = NmeaQuantities().batches([text(name, **parsed.fields)])
    units = {field.unit for field in row.fields if field.unit}
    assert {field.unit for field in batch.message.fields if field.unit} == units
    assert not batch.message.doc
    assert all(len(field.axes) > 1 for field in batch.message.fields if field.name.startswith(("Rate", "Euler")))


def test_angles_and_quaternion_of_vectornav_agree() -> None:
    """The manual prints both, of one sensor a moment apart."""
    angles, quaternion = (
        NmeaQuantities().batches([text(name, **find_nmea(sentence(VECTORNAV[name][0]), final=True)[0][0].fields)])[0]
        for name in ("VNYMR", "VNQTN")
    )
    w, x, y, z = quaternion.columns["Quaternion"][0]
    roll, pitch, yaw = angles.columns["EulerAngles"][0]
    assert w == 0.998255
    assert np.degrees(np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))) == pytest.approx(roll, abs=0.2)
    assert np.degrees(np.arcsin(2 * (w * y - z * x))) == pytest.approx(pitch, abs=0.2)
    assert np.degrees(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))) == pytest.approx(yaw, abs=0.2)


def unknown(*lines: str) -> list[Text]:
    parsed, _ = find_nmea(b"".join(sentence(line) for line in lines), final=True)
    return [text(one.name, number, **one.fields) for number, one in enumerate(parsed)]


def test_numbers_of_an_unknown_sentence_are_shown_by_their_places() -> None:
    quantities = NmeaQuantities()
    (batch,) = quantities.batches(unknown("PTNTHPR,85.9,N,-0.9,N,0.8,N", "PTNTHPR,86.9,N,,N,0.9,N"))
    assert (batch.message.name, list(batch.columns)) == ("PTNTHPR", ["field_01", "field_03", "field_05"])
    np.testing.assert_array_equal(batch.columns["field_03"], [-0.9, np.nan])
    assert "does not know this sentence" in batch.message.doc
    (later,) = quantities.batches(unknown("PTNTHPR,87.9,N,-0.8,N,0.8,N"))
    assert later.message is batch.message
    assert quantities.batches(unknown("PTEXT,hello,N", "PMTK010")) == []


PRESENT_OR_EMPTY = [  # lines of one sentence, and what the first ones lack
    ("GPRMC,100000,A,4800.0,N,01100.0,E,0.02,,020326,,,A", "GPRMC,100001,A,4800.0,N,01100.0,E,1.5,91,020326,,,A"),
    ("GPRMC,100000,A,4800.0,N,01100.0,E,0.02,,020326", "GPRMC,100001,A,4800.0,N,01100.0,E,1.5,91,020326,1.0,W,A,V"),
    ("GNRMC,,V,,,,,,,,,,N", "GNRMC,100001,A,4800.0,N,01100.0,E,1.5,91,020326,,,A"),
    ("GNGGA,,,,,,0,00,99.9,,,,,,", "GNGGA,100001,4800.0,N,01100.0,E,1,08,1.0,5.0,M,47.0,M,1.0,0001"),
    ("GPGSV,2,2,05,01,,,", "GPGSV,2,1,05,01,5,6,40,02,5,6,,03,5,6,41,04,5,6,42", "GPGSV,1,1,00"),
    ("GNGSA,A,1,,,,,,,,,,,,,99.9,99.9,99.9", "GNGSA,A,3,01,02,,,,,,,,,,,1.0,1.1,1.2,1"),
    ("GPVTG,,T,,M,0.02,N,0.04,K,A", "GPVTG,91.0,T,90.0,M,1.5,N,2.8,K,A"),
    ("GPGST,100000,,,,,,,", "GPGST,100001,1.0,2.0,1.0,45.0,1.0,1.0,2.0"),
    ("PUBX,00,100000,,,,,,NF,,,,,,,,,,0,0,0", "PUBX,00,100001,4800.0,N,01100.0,E,5.0,G3,1,2,3,4,5,,1,1,1,9,0,0"),
    ("PASHR,100000,,T,,,,,,,0", "PASHR,100001,224.19,T,-1.26,0.83,0.00,0.101,0.113,0.267,1,0"),
    ("HCHDG,101.1,,,,", "HCHDG,101.1,7.5,W,3.2,E"),
    ("PSONCMS,0.99,0.01,,,,,,,,,,,,", "PSONCMS,0.99,0.01,0,0,0,0,9.81,0,0,0,1,0,0,25.0"),
    ("VNYPR,,,", "VNYPR,1.0,2.0,3.0"),
    ("PTNTHPR,,N,-0.9,N,nan,N", "PTNTHPR,86.9,N,,N,0.9,N"),
    ("YXXDR,A,,D,PTCH,A,2.0,D,ROLL", "YXXDR,A,1.0,D,PTCH,A,,D,ROLL"),
]


@each_row("lines", PRESENT_OR_EMPTY, ids=lambda lines: lines[0].partition(",")[0])
def test_a_sentence_with_an_empty_field_is_not_split_into_two_messages(lines: tuple[str, ...]) -> None:
    """Regression: an RMC without a course, at rest, was another message than the others: columns lat and lat #2."""
    for order in (lines, lines[::-1]):
        quantities = NmeaQuantities()
        batches = [batch for line in order for batch in quantities.batches(unknown(line))]
        assert len({id(batch.message) for batch in batches}) == 1
        assert [len(batch) for batch in batches] == [1] * len(lines)


def test_two_transducers_are_not_one_column() -> None:
    batches = NmeaQuantities().batches(unknown("YXXDR,A,1.0,D,PTCH", "YXXDR,A,2.0,D,ROLL", "YXXDR,A,3.0,D,PTCH"))
    values = {batch.message.name: batch.columns["data_01"].tolist() for batch in batches}
    assert values == {"YXXDR_PTCH": [1.0, 3.0], "YXXDR_ROLL": [2.0]}


def test_measurements_of_one_sensor_do_not_depend_on_those_of_another() -> None:
    """Regression: in ESF-MEAS, the sensors that a message happened to hold were its layout."""
    turn, force = {"gyroX": 1.0, "gyroY": 2.0, "gyroZ": 3.0}, {"accelX": 4.0, "accelY": 5.0, "accelZ": 6.0}
    fields = [turn, {**force, **turn}, {"speed": 1.0, **turn}]
    batches = NmeaQuantities().batches([Text("ubx", "ESF-MEAS", "", at, 1, 1, one) for at, one in enumerate(fields)])
    assert sorted(len(batch) for batch in batches) == [1, 1, 3]


def test_packed_bits_are_no_numbers() -> None:
    ais = Text("nmea", "AIVDM", "!AIVDM,1,1,,A,177KQJ5000G?tO`K>RA1wUbN0TKH,0*5C", 0, 1, 1, {"field_01": "1"})
    assert NmeaQuantities().batches([ais]) == []


def test_a_word_ahead_makes_another_sentence() -> None:
    batches = NmeaQuantities().batches(unknown("PIXSE,ATITUD,-1.6,-0.5", "PIXSE,POSITI,48.1,-4.5,0.0", "PSAT,HPR,1,2"))
    assert [(one.message.name, len(one.columns)) for one in batches] == [
        ("PIXSE_ATITUD", 2),
        ("PIXSE_POSITI", 3),
        ("PSAT_HPR", 2),
    ]


def test_unknown_sentences_take_no_memory_without_limit() -> None:
    quantities = NmeaQuantities()
    for number in range(1000):
        quantities.batches(unknown(f"P{number},1.0".replace("P", "PX")))
    assert len(quantities._places) <= 256
