"""What sentences measure: units as the sentence's own table has them, vectors whole, headings that wrap."""

from __future__ import annotations

import numpy as np
import pytest

from protocols.events import Text
from protocols.nmea import SENTENCES
from protocols.schema import Message
from protocols.sentences import Sentences


def text(name: str, offset: int = 0, **fields: object) -> Text:
    return Text("nmea", name, "", offset, 1, 1_000 + offset, fields)


@pytest.mark.parametrize("row", SENTENCES.values(), ids=lambda row: row.name)
def test_every_number_of_an_mti_has_its_unit(row: Message) -> None:
    numbers = {field.name: float(i) for i, field in enumerate(row.fields) if field.dtype == "f8"}
    (batch,) = Sentences().batches([text(row.name, **numbers)])
    shown = sorted(field.unit for field in batch.message.fields if field.unit)
    kinds = {(field.name.rstrip("XYZ"), field.unit) for field in row.fields if field.dtype == "f8" and field.unit}
    assert shown == sorted(unit for _, unit in kinds)
    for field in batch.message.fields:
        assert field.period == (360 if field.name.startswith("heading") else 0)


def test_numbers_along_axes_are_one_quantity() -> None:
    names = ["q0", "q1", "q2", "q3", *(f"{kind}{axis}" for kind in ("acc", "gyr", "mag") for axis in "XYZ"), "temp"]
    texts = [text("PSONCMS", k, **{name: float(i + k) for i, name in enumerate(names)}) for k in range(3)]
    (batch,) = Sentences().batches(texts)
    assert list(batch.columns) == ["Quaternion", "Acceleration", "RateOfTurn", "MagneticField", "temp"]
    assert batch.columns["Quaternion"].shape == (3, 4)
    assert batch.columns["Acceleration"][2].tolist() == [6, 7, 8]
    assert batch.message.apart == ("Quaternion", "Acceleration", "RateOfTurn", "MagneticField")
    assert batch.offset.tolist() == [0, 1, 2]


def test_a_sentence_keeps_its_message_and_words_alone_make_none() -> None:
    sentences = Sentences()
    (first,) = sentences.batches([text("HCHDM", headingM=354.0, ref="M")])
    more = [text("HCHDM", headingM=1.0), text("GPTXT", text="hello"), text("X", a=np.int64(1))]
    second, other = sentences.batches(more)
    assert first.message is second.message
    assert first.message.fields[0].title == "Heading, magnetic"
    assert (other.message.title, other.message.fields[0].name) == ("NMEA X", "a")
    assert sentences.batches([text("", headingM=1.0)]) == []
