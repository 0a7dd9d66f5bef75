"""One value, one unit: each scaled field of each setting and command, as inspect, compose, form and refusal show it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.protocols.schema.shown_values import meant, to_shown, to_wire
from imuscope.protocols.schema.validation import find_problems
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.server.commands.inspect_table import _words
from imuscope.server.configuration.form_builder import field_form
from imuscope.server.configuration.value_format import shown, words
from tests.support.each_row import each_row


def records(fields: tuple[Field, ...]) -> Iterator[tuple[Field, dict[str, Any], tuple[Field, ...]]]:
    """Each scaled number with the record that gives it its meaning, and the fields of that record."""
    for field in fields:
        if field.fields:
            yield from records(field.fields)
        elif field.meaning_of:
            for meaning in field.meanings:
                yield field, {field.meaning_of: meaning.values[0] if meaning.values else 8}, fields
        elif (field.scale != 1 or field.bias) and field.dtype not in ("bytes", "ascii"):
            yield field, {}, fields


def rows() -> dict[str, tuple[Field, dict[str, Any], tuple[Field, ...]]]:
    results = {}
    for family in PROTOCOLS.values():
        driver = family.configuration.driver
        for known in (DeviceContext(), DeviceContext(product="MTi-300"), DeviceContext(product="MTi-680G")):
            if driver is None:
                continue
            tables = [(row.name, row.fields) for row in driver.settings(known)]
            tables += [(row.name, row.arguments) for row in driver.commands(known)]
            for name, fields in tables:
                for field, record, all_ in records(fields):
                    results[f"{family.name} {name} {field.name} {record}"] = field, record, all_
    return results


ROWS = rows()
WIRE = (15, 40)


def number_of(text: str) -> float:
    match = re.search(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", text)
    assert match is not None, text
    return float(match[0])


@each_row("name", ROWS)
def test_a_scaled_value_has_one_unit_wherever_it_is_shown(name: str) -> None:
    """A sync line was composed in ms, printed as 64536 without a unit, and refused as "given 654360"."""
    field, record, fields = ROWS[name]
    row = meant(field, record)
    signed = row.low is not None and row.low < 0
    for number in (*WIRE, 64_536) if signed and field.dtype == ">u2" else WIRE:
        whole = [number] * (field.shape[0] if field.shape and field.shape[0] > 0 else 1) if field.shape else number
        values = {**record, field.name: whole}
        form = field_form(field)
        in_form = to_shown(fields, values)[field.name]
        assert to_wire(fields, {**record, field.name: in_form})[field.name] == pytest.approx(whole)  # compose
        listed = _words(values, {one.name: one for one in fields}, {}, "")[-1].removeprefix(f"{field.name} ")
        compared = words(field, whole, values)
        first = in_form[0] if isinstance(in_form, list) else in_form
        assert number_of(listed) == pytest.approx(number_of(compared), rel=1e-4) == pytest.approx(first, rel=1e-4)
        unit = shown(row).unit
        assert unit in listed
        assert unit in compared
        assert form.unit == unit or form.meanings


@each_row("name", ROWS)
def test_a_refusal_has_the_unit_of_the_form(name: str) -> None:
    field, record, fields = ROWS[name]
    row = meant(field, record)
    beyond = 70_000 if row.high is None else int(row.high) + 1
    wrong = [beyond] * max(field.shape[0], 1) if field.shape else beyond
    problems = list(find_problems(fields, {**record, field.name: wrong}, partial=True))
    for problem in problems:
        if problem.path.startswith(field.name) and "lies between" in problem.message:
            assert row.unit in problem.message
            source = number_of(problem.message.partition("given ")[2])
            assert source == pytest.approx(beyond * row.scale + row.bias, rel=1e-6)


@each_row(
    ("function", "wire", "text"),
    [(4, 64_536, "-100.0 ms"), (3, 5000, "500.0 ms"), (9, 1000, "1000 ms"), (4, 65_436, "-10.0 ms")],
)
def test_the_word_of_a_sync_line_is_read_by_its_function(function: int, wire: int, text: str) -> None:
    [field] = next(one for one in XbusDriver().settings(DeviceContext()) if one.name == "SyncSettings").fields
    word = field.fields[-1]
    record: Mapping[str, Any] = {"function": function, word.name: wire}
    assert words(word, wire, record) == text
    assert number_of(_words(record, {one.name: one for one in field.fields}, {}, "")[-1]) == float(text.split()[0])


def test_an_offset_out_of_range_is_refused_in_ms() -> None:
    entry = dict.fromkeys(("trigger_once", "skip_first", "skip_factor", "pulse_width"), 0)
    entry |= {"function": 4, "line": 7, "polarity": 1, "delay_offset_or_clock_period": 654_360}
    with pytest.raises(EncodeError, match=r"lies between -3000 and 3000 ms, given 65436 ms"):
        XbusDriver().setting_frames("SyncSettings", {"settings": [entry]}, DeviceContext(product="MTi-630"))


def test_an_angle_is_refused_in_degrees_as_well() -> None:
    driver = PROTOCOLS["isb"].configuration.driver
    assert driver is not None
    with pytest.raises(EncodeError, match=r"6\.28319 rad \(-360 and 360 °\), given 7\.0 rad \(401\.07 °\)"):
        driver.setting_frames("DID_FLASH_CONFIG", {"insRotation": [7.0, 0.0, 0.0]}, DeviceContext())
