"""Preview of arbitrary client values: problems at their fields, never an internal error; and form contents."""

import re
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.schema.fields import Bits, Field
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.protocols.xbus.family import tables
from imuscope.server.configuration.api_models import PreviewResult
from imuscope.server.configuration.form_builder import field_form, forms_of
from imuscope.server.configuration.preview import DevicePresentState, SerialLine, fit, preview_command, preview_setting
from imuscope.server.configuration.value_format import entry_comment, entry_title, entry_value, key_of, numbers, words
from tests.support.control_harness import outputs
from tests.support.each_row import each_row

XBUS = DevicePresentState(
    PROTOCOLS["xbus"].configuration.driver, DeviceContext(product="MTi-680G"), SerialLine(115_200, 11_520.0)
)  # type: ignore[arg-type]
ISB = DevicePresentState(
    PROTOCOLS["isb"].configuration.driver, DeviceContext(product="IMX-5"), SerialLine(921_600, 92_160.0)
)  # type: ignore[arg-type]
IDTP = DevicePresentState(PROTOCOLS["idtp"].configuration.driver, DeviceContext())  # type: ignore[arg-type]
FAMILIES = {"xbus": XBUS, "isb": ISB, "idtp": IDTP}

anything = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=5,
)


def filled(data: st.DataObject, fields: tuple[Field, ...]) -> dict[str, Any]:
    """Values with valid names and arbitrary contents."""
    values = {}
    for field in fields:
        kind = data.draw(st.integers(0, 3))
        if kind == 1:
            values[field.name] = data.draw(anything)
        elif kind == 2 and field.fields:
            one = filled(data, field.fields)
            values[field.name] = [one] if field.shape else one
        elif kind == 3:
            values[field.name] = data.draw(st.integers(0, 3))
    return values


@each_row(
    ("field", "limited"),
    [
        (Field("period", "<u4"), []),
        (Field("period", "<u4", low=0), []),
        (Field("period", "<u4", low=200), ["low"]),
        (Field("period", "<u4", high=500), ["high"]),
        (Field("angle", "<f4"), []),
        (Field("angle", "<f4", low=-90.0, high=90.0), ["low", "high"]),
        (Field("name", "ascii", (8,)), []),
    ],
)
def test_the_range_of_a_type_is_not_one_of_the_setting(field: Field, limited: list[str]) -> None:
    """Every number of the IMX had "0 to 4 294 967 295 ms" beside it."""
    assert field_form(field).limited == limited


@each_row("family", FAMILIES)
def test_every_form_of_every_family_opens_and_previews(family: str) -> None:
    """A row that cannot be shown, or whose defaults cannot be encoded, would otherwise be found by users only."""
    present = FAMILIES[family]
    sent = TypeAdapter(PreviewResult)
    forms = forms_of(present.driver, family, present.known)
    assert {row.group for row in forms.settings} | {row.group for row in forms.commands} == set(forms.groups)
    for setting in forms.settings:
        own = f"{setting.doc} {setting.consequence}"
        assert not (setting.after and re.search("next reset|takes effect", own, re.I)), (
            "the form says when it takes effect"
        )
        shown = preview_setting(present, setting.name, {})
        assert sent.dump_json(shown)
        nothing = not setting.writable or setting.partial  # to be sent
        assert nothing or shown.problems or shown.frames, setting.name
    for command in forms.commands:
        shown = preview_command(present, command.name, {})
        assert sent.dump_json(shown)
        assert shown.problems or shown.frames, command.name


@each_row("family", FAMILIES)
@given(data=st.data())
def test_any_values_are_previewed_or_refused_at_their_fields(family: str, data: st.DataObject) -> None:
    present = FAMILIES[family]
    commands = list(present.driver.commands(present.known))
    row = data.draw(st.sampled_from(commands))
    answer = preview_command(present, row.name, filled(data, row.arguments))
    assert bool(answer.frames) != bool(answer.problems)
    settings = list(present.driver.settings(present.known))
    if settings:
        setting = data.draw(st.sampled_from(settings))
        shown = preview_setting(present, setting.name, filled(data, setting.fields))
        assert not (shown.frames and shown.problems)


@given(values=anything, baud=st.none() | st.integers(1, 10_000_000))
def test_a_fit_of_anything_is_a_fit_or_refused(values: Any, baud: int | None) -> None:
    try:
        answer = fit(XBUS, "OutputConfiguration", {"outputs": values}, baud)
    except (EncodeError, ValueError):
        return
    assert answer.load.total >= 0


def test_a_fit_states_what_it_lowered() -> None:
    answer = fit(XBUS, "OutputConfiguration", outputs(400), None)
    assert answer.load.total <= 11_520
    assert [line.split(" ")[0] for line in answer.words] == ["Quaternion", "Acceleration"]
    assert fit(XBUS, "OutputConfiguration", outputs(400), 921_600).words == []


@each_row("family", FAMILIES)
def test_every_row_becomes_a_form(family: str) -> None:
    present = FAMILIES[family]
    forms = forms_of(present.driver, family, present.known)
    rows = (*forms.settings, *forms.commands)
    assert all(row.title and row.group in forms.groups for row in rows)
    assert len({row.name for row in forms.settings}) == len(forms.settings)
    assert len({row.name for row in forms.commands}) == len(forms.commands)
    tables = {"xbus": ["OutputConfiguration"], "isb": ["streams"]}.get(family, [])
    assert [form.name for form in forms.settings if form.table is not None] == tables


@each_row(
    ("field", "editor"),
    [
        (Field("a", "u1"), "integer"),
        (Field("a", "u1", low=0, high=1), "bool"),
        (Field("a", "u1", choices={1: "one"}), "choice"),
        (Field("a", "u1", bits=(Bits("A", 0),)), "flags"),
        (Field("a", ">f4"), "number"),
        (Field("a", "fp1220"), "number"),
        (Field("a", ">f4", (3,)), "vector"),
        (Field("a", ">u2", (-1,)), "list"),
        (Field("a", "bytes", (4,)), "hex"),
        (Field("a", "ascii", (-1,)), "text"),
        (Field("a", shape=(-1,), fields=(Field("b", "u1"),)), "list"),
        (Field("a", fields=(Field("b", "u1"),)), "record"),
    ],
)
def test_the_editor_follows_from_the_type(field: Field, editor: str) -> None:
    assert field_form(field).editor == editor


def test_numbers_that_javascript_cannot_hold_come_back_from_text() -> None:
    each = Field("each", shape=(-1,), fields=(Field("n", "u8"),))
    fields = (Field("bits", "<u8"), Field("name", "ascii", (8,)), each)
    source = {"bits": "18446744073709551615", "name": "12", "each": [{"n": "3"}], "other": "4"}
    assert numbers(fields, source) == {"bits": 2**64 - 1, "name": "12", "each": [{"n": 3}], "other": "4"}


def test_values_have_display_text() -> None:
    assert words(Field("a", ">u2", unit="Hz"), 400) == "400 Hz"
    assert words(Field("a", "u1", choices={2: "115 200 Bd"}), 2) == "115 200 Bd"
    assert words(Field("a", "u1", bits=(Bits("A", 0), Bits("B", 1), Bits("C", 2))), 5) == "A, C"
    assert words(Field("a", ">f4", (3,), unit="m"), [0.0, 0.5, 1.0]) == "0, 0.5, 1 m"
    assert words(Field("a", ">f4", unit="°", scale=2.0, decimals=1), 1.5) == "3.0 °"
    assert words(Field("a", ">f4"), {"f32": "7fc00000"}) == "f32 7fc00000"


def test_a_record_with_a_key_that_no_family_knows_is_shown_by_its_number() -> None:
    entry = (Field("stream", ">u4", key_mask=0xFF00), Field("divisor", ">u2"))
    assert key_of(entry) is entry[0]
    assert key_of(entry[1:]) is None
    assert entry_title(entry[0], 0x1200) == "0x00001200"
    assert entry_value({"stream": 0x1200, "divisor": 5}) == ""
    assert entry_comment(entry, {"stream": 0, "divisor": 5}) == "nothing"
    assert entry_comment(entry, {"stream": 0x1200, "divisor": 5}) == "0x00001200"


def test_no_two_outputs_have_one_title() -> None:
    """Regression: two rows were titled "Status" and could be distinguished by identifier only."""
    for product in ("MTi-3", "MTi-300", "MTi-G-710", "MTi-630", "MTi-680G"):
        titles = [row.title for row in tables(DeviceContext(product=product), {})["outputs"].rows]
        assert len(set(titles)) == len(titles), product
        assert "Status" in titles


def test_the_ports_of_an_mti_have_names_and_profiles_have_options() -> None:
    """Ports could be removed and put in another order; a filter profile had to be typed."""
    forms = {form.name: form for form in forms_of(XbusDriver(), "xbus", DeviceContext(product="MTi-630")).settings}
    words = forms["PortConfig"].fields[0]
    assert (words.editor, words.length, words.axes) == ("list", 3, ["RS-232", "UART", "RTCM input"])
    assert "Responsive/NorthReference" in forms["FilterProfile"].fields[0].options
    rates = {one.name: one.choices for one in forms["CanConfig"].fields[0].bits}["Baud"]
    assert rates["12"] == "1 Mbit/s"
