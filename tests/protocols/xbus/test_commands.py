"""Every documented command is in the tables, with products and ranges, and encodes to the right bytes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.schema.fields import Command, Setting
from imuscope.protocols.xbus import commands
from imuscope.protocols.xbus.commands import GROUPS
from imuscope.protocols.xbus.json_codec import frame_from_json, frame_to_json
from imuscope.protocols.xbus.messages import BY_NAME, MESSAGES
from imuscope.protocols.xbus.output_configuration import OUTPUTS
from imuscope.protocols.xbus.products import MODELS, model_of
from tests.protocols.xbus.xbus_values import DRIVER, KNOWN, SWEEP, UNKNOWN, sensible, sync
from tests.protocols.xbus.xbus_vectors import COMMANDS, GOLDEN, everything
from tests.support.each_row import each_row

PRODUCTS: dict[str, dict[str, list[int]]] = json.loads((GOLDEN / "products.json").read_text())

OUTSIDE = {  # of MESSAGES to the device: reserved, or not for these devices
    *(message.name for message in MESSAGES if message.name.startswith("reserved")),
    "SetStealthMode",
    "UpdateFilterProfile",
}


# -- the tables --------------------------------------------------------------------------------------------------------


def test_every_message_to_the_device_is_a_command() -> None:
    subjects = {message.name for message in MESSAGES if message.direction == "to_device"} - OUTSIDE
    forms = {row.message for row in commands.rows(None).values()}
    assert forms == subjects
    titles = {(row.message, row.form) for row in commands.rows(None).values()}
    assert titles == {(name, form) for name in subjects for form in range(len(BY_NAME[name]))}


@each_row("number", MODELS)
def test_a_product_has_the_commands_that_the_document_marks(number: int) -> None:
    marked = {name for name, products in PRODUCTS["messages"].items() if number in products}
    six = MODELS[number].series == 600
    marked |= {"ReqData"} if six else set()  # its product row stops at 710, its sync line does not (errata)
    assert {row.message for row in commands.rows(MODELS[number]).values()} == marked - {"InitBus"}


@each_row("identifier", PRODUCTS["outputs"])
def test_an_output_has_the_products_that_the_document_marks(identifier: str) -> None:
    assert sorted(OUTPUTS[int(identifier, 16)].products) == sorted(PRODUCTS["outputs"][identifier])


def test_every_output_is_in_the_document() -> None:
    assert {f"0x{identifier:04X}" for identifier in OUTPUTS} == set(PRODUCTS["outputs"])


@each_row("name", ["", *KNOWN])
def test_rows_are_complete(name: str) -> None:
    known = KNOWN.get(name, UNKNOWN)
    listed: list[Command | Setting] = [*DRIVER.commands(known), *DRIVER.settings(known)]
    assert len({row.name for row in DRIVER.commands(known)}) == len(DRIVER.commands(known))
    assert len({row.name for row in DRIVER.settings(known)}) == len(DRIVER.settings(known))
    for row in listed:
        assert row.group in GROUPS
        assert row.title
        assert row.doc.endswith(".")
        assert row.source
        assert bool(row.caution) == bool(row.consequence)
        assert row.consequence == "" or row.consequence.endswith(".")


def test_harmful_commands_name_the_harm() -> None:
    dangerous = {row.message for row in commands.rows(None).values() if row.caution}
    assert dangerous >= {
        *("RestoreFactoryDef", "SetBaudrate", "Reset", "SetNoRotation", "SetPortConfig", "SetCanConfig"),
        *("SetStringOutputType", "ForwardGnssData", "SetExtOutputMode", "SetAlignmentRotation", "ResetOrientation"),
    }


def test_a_setting_is_read_and_written_by_commands_that_the_product_has() -> None:
    for name, known in KNOWN.items():
        has = {command.name for command in DRIVER.commands(known)}
        for setting in DRIVER.settings(known):
            assert setting.read in has, (name, setting.name)
            assert setting.write in {*has, ""}, (name, setting.name)


@each_row(
    ("code", "name"),
    [
        ("MTi-630-8A1G6", "MTi-630"),
        ("MTi-630-DK", "MTi-630"),
        ("MTi-G-710-2A8G4      ", "MTi-G-710"),
        ("MTi-680G-8A1G6", "MTi-680G"),
        ("MTi-3-8A7G6", "MTi-3"),
        ("MTi-28A33G85", None),
        ("Awinda", None),
        ("", None),
    ],
)
def test_a_product_code_names_a_product(code: str, name: str | None) -> None:
    model = model_of(code)
    assert (model.name if model else None) == name


# -- frames ------------------------------------------------------------------------------------------------------------


def outputs(args: Mapping[str, Any]) -> dict[str, Any]:
    pairs = [(int(identifier, 16), rate) for identifier, rate in args["list"]]
    return {"outputs": [{"data_identifier": i, "output_frequency": rate} for i, rate in pairs]}


def alignment(args: Mapping[str, Any]) -> dict[str, Any]:
    names = zip(("q0", "q1", "q2", "q3"), args.get("quaternion", ()), strict=False)
    return {"parameter": args["parameter"], **{name: float(value) for name, value in names}}


def place(args: Mapping[str, Any]) -> dict[str, Any]:
    return {"latitude": args["lat"], "longitude": args["lon"], "altitude": args["alt"]}


def utc(args: Mapping[str, Any]) -> dict[str, Any]:
    same = ("year", "month", "day", "hour", "minute", "second")
    return {"nanoseconds": args["nano"], **{name: args[name] for name in same}, "flags": args["valid"]}


def passed_on(args: Mapping[str, Any]) -> dict[str, Any]:
    return {"data": args.get("data_hex") or f"{args['fill']:02x}" * args["data_len"]}


def renamed(**names: str) -> Callable[[Mapping[str, Any]], dict[str, Any]]:
    """Arguments by field name; unnamed ones are omitted."""
    return lambda args: {ours: args[theirs] for ours, theirs in names.items()}


ARGUMENTS: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
    "SetOutputConfiguration": outputs,
    "SetBaudrate": renamed(baudrate_code="code"),
    "SetOptionFlags": renamed(set_flags="set", clear_flags="clear"),
    "SetLocationID": renamed(location_id="id"),
    "SetTransmitDelay": renamed(delay="ticks"),
    "SetSyncSettings": sync,
    "SetFilterProfile": renamed(profile="profile"),
    "SetAlignmentRotation": alignment,
    "ReqAlignmentRotation": alignment,
    "SetLatLonAlt": place,
    "SetUTCTime": utc,
    "AdjustUTCTime": renamed(correction="ticks"),
    "ResetOrientation": renamed(code="code"),
    "SetNoRotation": renamed(duration="seconds"),
    "SetGnssLeverArm": renamed(x="x", y="y", z="z"),
    "IccCommand": renamed(command="command"),
    "SetInitialHeading": renamed(heading="deg"),
    "SetStringOutputType": renamed(string_types="types"),
    "SetPeriod": renamed(period="period"),
    "SetOutputSkipFactor": renamed(skip_factor="skip"),
    "SetPortConfig": renamed(words="words"),
    "SetCanConfig": renamed(word="word"),
    "SetExtOutputMode": renamed(mode="mode"),
    "SetGnssPlatform": renamed(platform="platform"),
    "ForwardGnssData": passed_on,
}
TO_DEVICE = [
    vector for vector in COMMANDS if vector["what"].split()[0] in {row.message for row in commands.rows(None).values()}
]


def same_entry_often(vector: dict[str, Any]) -> bool:
    return "32 entries" in vector["what"]


@each_row("vector", TO_DEVICE, ids=lambda vector: vector["what"][:70])
def test_a_command_of_the_vectors_by_name_and_arguments(vector: dict[str, Any]) -> None:
    """Compared byte for byte. Frames that the driver does not send (another bus, one output 32 times) are composed
    without it.
    """
    name = vector["what"].split()[0]
    values = ARGUMENTS.get(name, renamed())(vector["args"])
    expected = bytes.fromhex(vector["message_hex"])
    bus = vector["args"].get("bid")
    if bus or same_entry_often(vector):
        assert frame_from_json({"message": name, "fields": values, "wire": {"bid": bus} if bus else {}}) == expected
    else:
        assert DRIVER.frame(name, values, UNKNOWN) == expected
    assert DRIVER.name_of(expected) == name


def test_most_vectors_are_commands() -> None:
    assert len(TO_DEVICE) >= 80
    assert len(TO_DEVICE) + sum(vector not in TO_DEVICE for vector in COMMANDS) == len(COMMANDS)


def test_every_vector_composed_from_what_inspect_prints_is_the_frame_again() -> None:
    for frame in everything():
        assert frame_from_json(json.loads(json.dumps(frame_to_json(frame)))) == frame


def test_an_empty_list_is_sent_as_one_entry_that_means_none() -> None:
    """An empty message would be a request."""
    assert DRIVER.frame("SetOutputConfiguration", {"outputs": []}, UNKNOWN).hex() == "faffc0040000" + "00003d"
    assert DRIVER.frame("SetSyncSettings", {"settings": []}, UNKNOWN)[4:-1] == bytes(12)
    assert DRIVER.frame("SetCanOutputConfig", {"outputs": []}, UNKNOWN)[4:-1] == bytes(8)


def test_the_wanted_word_of_option_flags_sets_and_clears() -> None:
    (frame,) = DRIVER.setting_frames("OptionFlags", {"flags": 0x82}, UNKNOWN)
    fields = frame_to_json(frame)["fields"]
    assert fields["set_flags"] == 0x82
    assert fields["clear_flags"] & 0x82 == 0
    assert fields["clear_flags"] | 0x82 == 0x3EFF


def test_an_alignment_is_two_settings() -> None:
    unity = {"q0": 1.0, "q1": 0.0, "q2": 0.0, "q3": 0.0}
    frames = [
        DRIVER.setting_frames(f"AlignmentRotation.{which}", unity, UNKNOWN)[0] for which in ("RotSensor", "RotLocal")
    ]
    assert [frame_to_json(frame)["fields"]["parameter"] for frame in frames] == [0, 1]


# -- every command of every product, as forms ask for it ---------------------------------------------------------------


def test_every_command_of_every_product_is_a_frame_and_back() -> None:
    """Inspect names it, compose makes it again, and its spans cover it."""
    for name, command in SWEEP:
        known = KNOWN.get(name, UNKNOWN)
        frame = DRIVER.frame(command.name, sensible(command, known), known)
        report = frame_to_json(frame)
        assert report["message"] == command.name.split(" (")[0].split(".")[0], (name, command.name)
        assert frame_from_json(report) == frame, (name, command.name)
        spans = DRIVER.annotate(frame)
        assert [span.offset for span in spans] == [sum(s.size for s in spans[:k]) for k in range(len(spans))]
        assert sum(span.size for span in spans) == len(frame)
        assert all(span.size > 0 and span.label for span in spans)


@given(st.binary(max_size=60))
def test_spans_cover_arbitrary_bytes(data: bytes) -> None:
    spans = DRIVER.annotate(data)
    assert sum(span.size for span in spans) == len(data)
    assert DRIVER.name_of(data)


def test_the_bytes_of_an_output_configuration_are_named_as_in_the_form() -> None:
    values = {"outputs": [{"data_identifier": 0x1020, "output_frequency": 0xFFFF}]}
    values["outputs"].append({"data_identifier": 0x2016, "output_frequency": 400})
    spans = DRIVER.annotate(DRIVER.frame("SetOutputConfiguration", values, KNOWN["MTi-630"]))
    assert [(span.path, span.label) for span in spans if span.path.startswith("outputs.1")] == [
        ("outputs.1.data_identifier", "Quaternion, Fp16.32, NED"),
        ("outputs.1.output_frequency", "output_frequency: 400 Hz"),
    ]
