"""Decode options of a source: on the command line, in the source, over HTTP; and that a key is told to nobody."""

from __future__ import annotations

from pathlib import Path

import pytest

from server.api.devices import DecodeOptionsBody
from server.commands import arguments as options
from server.commands.common import decode_options_of
from server.config import ConfigError, load
from server.devices.decode_options import (
    DecodeOptions,
    ReadingError,
    key_text,
    parse_source_options,
    reading,
    schema_text,
)

KEY = "00112233445566778899aabbccddeeff"
SCHEMA = """
[[message]]
type = 0x80
name = "Wheels"
[[message.field]]
name = "Speed"
type = "i16"
"""


def test_words_become_a_reading() -> None:
    said = reading("idtp", KEY, "safety", True, SCHEMA)
    assert (said.protocol, said.key, said.min_mode, said.unverified) == ("idtp", bytes.fromhex(KEY), 1, True)
    assert said.schema is not None
    assert said.schema[0x80].name == "Wheels"
    assert reading() == DecodeOptions()


def test_a_protocol_gets_only_options_it_knows() -> None:
    said = reading("", KEY, "lite", schema=SCHEMA)
    assert said.settings(()) == {}
    assert said.settings(("key", "min_mode")) == {"key": bytes.fromhex(KEY), "min_mode": 0}
    assert DecodeOptions().settings(("key", "min_mode", "replay_check")) == {"replay_check": True}


@pytest.mark.parametrize(
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
    with pytest.raises(ReadingError, match=words) as caught:
        reading(**arguments)  # type: ignore[arg-type]
    if "key" in arguments:
        assert arguments["key"] not in str(caught.value)


def test_a_source_says_more_of_itself() -> None:
    rest, said = parse_source_options(f"udp://:5000?protocol=idtp&key={KEY}&min_mode=secure", DecodeOptions("isb"))
    assert (rest, said) == ("udp://:5000", DecodeOptions("idtp", bytes.fromhex(KEY), 2))
    rest, said = parse_source_options("sim:idtp?mode=secure&unverified=1&rate=50", DecodeOptions())
    assert (rest, said.unverified) == ("sim:idtp?mode=secure&rate=50", True)
    assert parse_source_options("/dev/ttyUSB0?protocol=auto&baud=9600", DecodeOptions("isb")) == (
        "/dev/ttyUSB0?baud=9600",
        DecodeOptions(),
    )
    with pytest.raises(ReadingError) as caught:
        parse_source_options("udp://:1?key=secret", DecodeOptions())
    assert "secret" not in str(caught.value)


def test_the_unit_of_timestamps_and_the_direction_of_the_quaternion_could_not_be_set() -> None:
    """Neither by the source, nor on the command line, in the settings or over HTTP: all of them say the same."""
    wanted = DecodeOptions("idtp", time_unit="ms", rotation="body_from_enu")
    rest, said = parse_source_options("udp://:5000?time_unit=ms&rotation=body_from_enu", DecodeOptions("idtp"))
    assert (rest, said) == ("udp://:5000", wanted)
    words = "serve udp://:5000 --protocol idtp --time-unit ms --rotation body_from_enu"
    assert decode_options_of(options.parse(words.split()), "idtp") == wanted
    assert load(protocol="idtp", time_unit="ms", rotation="body_from_enu").reading() == wanted
    assert DecodeOptionsBody(protocol="idtp", time_unit="ms", rotation="body_from_enu").reading() == wanted
    assert wanted.settings(("time_unit", "rotation")) == {"time_unit": "ms", "rotation": "body_from_enu"}
    for wrong in ("time_unit=min", "rotation=inverse"):
        with pytest.raises(ReadingError, match="not one of"):
            parse_source_options(f"udp://:5000?{wrong}", DecodeOptions())


def test_a_file_whose_name_has_a_question_mark(tmp_path: Path) -> None:
    path = tmp_path / "odd?key=00"
    path.touch()
    assert parse_source_options(str(path), DecodeOptions()) == (str(path), DecodeOptions())


def test_files(tmp_path: Path) -> None:
    path = tmp_path / "robot.key"
    path.write_text(f"{KEY}\n")
    assert key_text(f"@{path}") == KEY
    assert key_text(KEY) == KEY
    path.write_bytes(b"\xff")
    for missing in (path, tmp_path / "none"):
        with pytest.raises(ReadingError):
            key_text(f"@{missing}")
    with pytest.raises(ReadingError, match="cannot be read"):
        schema_text(str(tmp_path / "none"))


def test_a_configuration_holds_them(tmp_path: Path) -> None:
    (tmp_path / "schema.toml").write_text(SCHEMA)
    config = load(key=KEY, min_mode="safety", schema=str(tmp_path / "schema.toml"), unverified=True)
    said = config.reading()
    assert (said.key, said.min_mode, said.unverified, len(said.schema or {})) == (bytes.fromhex(KEY), 1, True, 1)
    assert KEY not in repr(config)
    assert KEY not in repr(said)
    with pytest.raises(ConfigError) as caught:
        load(key=123456)
    assert "123456" not in str(caught.value)
