"""Decode options of a source: on the command line, in the source and over HTTP; keys are never revealed."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from imuscope.protocols.family.decode_options import RESERVED, DecodeOption, merged
from imuscope.protocols.family.info import ProtocolInfo
from imuscope.protocols.idtp.custom_payloads import parse
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.schema.fields import Field, Message
from imuscope.server.api.devices import DecodeOptionsBody
from imuscope.server.commands import arguments as options
from imuscope.server.commands.common import decode_options_of
from imuscope.server.devices.decode.decode_options import (
    DecodeOptionError,
    DecodeOptions,
    changed,
    checked_options,
    declared_options,
    file_text,
    parse_source_options,
    secret_text,
    url_options,
)
from imuscope.server.links.registry import link_kinds
from imuscope.server.links.simulated_device import simulators
from imuscope.server.settings.config import ConfigError, load, setting_names
from tests.support.decode_options import decode_options
from tests.support.each_row import each_row

KEY = "00112233445566778899aabbccddeeff"
SCHEMA = """
[[message]]
type = 0x80
name = "Wheels"
[[message.field]]
name = "Speed"
type = "i16"
"""


def test_words_become_settings_of_a_decoder() -> None:
    texts = {"key": KEY, "min_mode": "safety", "unverified": "1", "no_replay_check": "1", "time_unit": ""}
    message = checked_options("idtp", texts)
    expected = {"key": bytes.fromhex(KEY), "min_mode": 1, "show_unverified": True, "replay_check": False}
    assert (message.protocol, message.settings("idtp")) == ("idtp", expected)
    [row] = checked_options("idtp", {"schema": SCHEMA}).settings("idtp")["schema"].values()
    assert row.name == "Wheels"
    assert checked_options() == DecodeOptions()
    assert checked_options("", {"key": "00 aA"}) == checked_options("", {"key": "00AA"}), "one notation"


def test_a_protocol_gets_only_options_it_knows() -> None:
    message = checked_options("", {"key": KEY, "min_mode": "lite", "schema": SCHEMA})
    assert message.settings("xbus") == message.settings("unknown") == {}
    assert message.settings("idtp").keys() == {"key", "min_mode", "schema"}
    assert DecodeOptions().settings("idtp") == {}


def test_what_may_be_shown_and_what_is_recorded() -> None:
    texts = {"key": KEY, "min_mode": "lite", "schema": SCHEMA, "time_unit": "ms"}
    message = checked_options("idtp", texts)
    assert (message.secrets, message.shown) == ({"key": KEY}, {"min_mode": "lite", "time_unit": "ms"})
    assert message.recorded.keys() == {"schema", "time_unit"}
    assert KEY not in repr(message)
    assert "schema" not in url_options(), "a source, which HTTP can name, opens no other file"


def family_with(*options: DecodeOption) -> ProtocolInfo:
    xbus = PROTOCOLS["xbus"]
    return replace(xbus, name="other", decoding=replace(xbus.decoding, options=options))


def test_families_share_a_name_and_keep_their_own_values() -> None:
    mine = DecodeOption("min_mode", "choice", "", (("strict", "Strict"), ("lite", "Lite")))
    both = merged([*PROTOCOLS["idtp"].decoding.options, mine])["min_mode"]
    assert both.values == ("lite", "safety", "secure", "strict")
    assert family_with(mine).settings({"min_mode": "strict", "key": KEY}) == {"min_mode": "strict"}
    assert family_with(mine).settings({"min_mode": "secure"}) == {}
    with pytest.raises(ValueError, match="min_mode is a flag; another family's is a choice"):
        merged([*PROTOCOLS["idtp"].decoding.options, DecodeOption("min_mode", "flag", "")])


@each_row("name", ["protocol", "Key", "2d", "tls-key", "baud", "sources"])
def test_names_that_an_option_cannot_have(name: str) -> None:
    with pytest.raises(ValueError, match="cannot be the name"):
        DecodeOption(name, "flag", "")


def test_a_secret_is_not_in_the_description_of_options() -> None:
    def read(text: str) -> str:
        raise ValueError(f"{text} is too short")

    with pytest.raises(ValueError, match="the pin is not valid") as caught:
        DecodeOption("pin", "secret", "", read=read).checked("1234")
    assert "1234" not in str(caught.value)


def test_the_names_of_the_program_are_reserved() -> None:
    """No option of a family can stand for one of the program: all flags, settings and source options are listed."""
    commands = options.parser(with_help=False).commands.values()
    flags = {action.dest for command in commands for action in command._actions} - declared_options().keys()
    forms = " ".join(text for kind in link_kinds() for usage in kind.usage for text in usage)
    of_families = {one.name for family in simulators().values() for one in family.options}
    queries = {*re.findall(r"([a-z_]+)=", forms)} - of_families
    assert not (flags | setting_names() | queries) - RESERVED


@each_row(
    ("arguments", "words"),
    [
        ({"key": "0g"}, "hex digits"),
        ({"key": "123"}, "even number"),
        ({"min_mode": "strong"}, "lite, safety, secure"),
        ({"schema": "type ="}, "the schema cannot be used"),
        ({"schema": "[[message]]\ntype = 1"}, "the schema cannot be used"),
    ],
)
def test_unusable_options(arguments: dict[str, str], words: str) -> None:
    with pytest.raises(DecodeOptionError, match=words) as caught:
        checked_options("", arguments)
    if "key" in arguments:
        assert arguments["key"] not in str(caught.value)


def test_a_source_carries_decode_options() -> None:
    rest, message = parse_source_options(f"udp://:5000?protocol=idtp&key={KEY}&min_mode=secure", DecodeOptions("isb"))
    assert (rest, message) == ("udp://:5000", decode_options("idtp", key=KEY, min_mode="secure"))
    rest, message = parse_source_options("sim:idtp?mode=secure&unverified=1&rate=50", DecodeOptions())
    assert (rest, message) == ("sim:idtp?mode=secure&rate=50", decode_options(unverified=True))
    assert parse_source_options("sim:idtp?unverified=0", message) == ("sim:idtp", DecodeOptions())
    assert parse_source_options("/dev/ttyUSB0?protocol=auto&baud=9600", DecodeOptions("isb")) == (
        "/dev/ttyUSB0?baud=9600",
        DecodeOptions(),
    )
    with pytest.raises(DecodeOptionError) as caught:
        parse_source_options("udp://:1?key=secret", DecodeOptions())
    assert "secret" not in str(caught.value)


def test_timestamp_unit_and_quaternion_direction_can_be_set() -> None:
    """The same message for the source, the command line, the settings and HTTP."""
    expected = decode_options("idtp", time_unit="ms", rotation="body_from_enu")
    rest, message = parse_source_options("udp://:5000?time_unit=ms&rotation=body_from_enu", DecodeOptions("idtp"))
    assert (rest, message) == ("udp://:5000", expected)
    words = "serve udp://:5000 --protocol idtp --time-unit ms --rotation body_from_enu"
    assert decode_options_of(options.parse(words.split()), "idtp") == expected
    assert load(protocol="idtp", time_unit="ms", rotation="body_from_enu").reading() == expected
    assert DecodeOptionsBody.model_validate({"protocol": "idtp", **expected.values}).reading() == expected
    assert expected.settings("idtp") == {"time_unit": "ms", "rotation": "body_from_enu"}
    for wrong in ("time_unit=min", "rotation=inverse"):
        with pytest.raises(DecodeOptionError, match="not one of"):
            parse_source_options(f"udp://:5000?{wrong}", DecodeOptions())


def test_a_file_whose_name_has_a_question_mark(tmp_path: Path) -> None:
    path = tmp_path / "odd?key=00"
    path.touch()
    assert parse_source_options(str(path), DecodeOptions()) == (str(path), DecodeOptions())


def test_files(tmp_path: Path) -> None:
    path = tmp_path / "robot.key"
    path.write_text(f"{KEY}\n")
    assert secret_text(f"@{path}") == KEY
    assert secret_text(KEY) == KEY
    path.write_bytes(b"\xff")
    for missing in (path, tmp_path / "none"):
        with pytest.raises(DecodeOptionError):
            secret_text(f"@{missing}")
    with pytest.raises(DecodeOptionError, match="cannot be read"):
        file_text(str(tmp_path / "none"), "schema")


def test_a_configuration_holds_them(tmp_path: Path) -> None:
    (tmp_path / "schema.toml").write_text(SCHEMA)
    config = load(key=KEY, min_mode="safety", schema=str(tmp_path / "schema.toml"), unverified=True)
    message = config.reading()
    assert message == decode_options(key=KEY, min_mode="safety", schema=parse(SCHEMA), unverified=True)
    assert KEY not in repr(config)
    assert KEY not in repr(message)
    with pytest.raises(ConfigError) as caught:
        load(key=123456)
    assert "123456" not in str(caught.value)


def test_given_options_change_and_the_rest_stays() -> None:
    speed = Field("Speed", dtype="<i2")
    row, other, newer = (Message(number, name, (speed,)) for number, name in ((0x80, "A"), (0x81, "B"), (0x80, "C")))
    old = decode_options("idtp", key=b"k", min_mode="safety", schema={0x80: row})
    rekeyed = decode_options("idtp", key=b"new", min_mode="safety", schema={0x80: row})
    assert changed(old, decode_options(key=b"new"), {"key"}) == rekeyed
    added = changed(old, decode_options(schema={0x81: other, 0x80: newer}), {"schema"})
    assert {row.id: row.name for row in added.settings("idtp")["schema"].values()} == {0x80: "C", 0x81: "B"}
    assert added.settings("idtp")["key"] == b"k"
    assert changed(added, DecodeOptions(), {"schema", "min_mode"}).values.keys() == {"key", "schema"}
