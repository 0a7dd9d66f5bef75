"""Settings: the command line overrides the file, which overrides defaults; errors are reported."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import pytest
from annotated_types import Ge, Interval, Lt
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from imuscope.server.settings.config import Config, ConfigError, is_loopback, load
from imuscope.server.settings.setting_types import is_allowed, is_of_type, one_of, zero_or
from tests.support.each_row import each_row


def test_the_command_line_wins_over_the_file(tmp_path: Path) -> None:
    file = tmp_path / "imuscope.toml"
    file.write_text('host = "0.0.0.0"\nport = 9000\nhistory_s = 60\nsources = ["sim:xbus"]\n')
    config = load(file, port=9001, host=None)
    assert (config.host, config.port, config.history_s, config.sources) == ("0.0.0.0", 9001, 60.0, ("sim:xbus",))
    assert not config.is_loopback


def test_a_relative_data_folder_is_found_from_everywhere() -> None:
    """Processes that decode and export work in other folders."""
    assert load(data=Path("data")).data == Path.cwd() / "data"


@pytest.mark.parametrize("when", ["first", "second"])
def test_the_default_data_folder_of_a_test_has_nothing_of_an_earlier_one(when: str) -> None:
    """Regression of the tests: a server opened the devices whose transactions an earlier test had left interrupted."""
    folder = load().data
    assert not folder.exists()
    folder.mkdir(parents=True)
    (folder / "devices.json").write_text(when)


def test_a_name_that_is_not_utf_8_is_kept() -> None:
    config = load(sources=["/x/\udcff.bin"], data=Path("/x/\udcff"))
    assert (config.sources, config.data) == (("/x/\udcff.bin",), Path("/x/\udcff"))


def test_defaults_are_loopback() -> None:
    assert replace(load(), extensions=()) == Config()
    assert Config().is_loopback


@each_row(
    ("text", "words"),
    [
        ("prot = 1", "prot is not a valid setting"),
        ('port = "8080"', "port must be a whole number"),
        ("port = true", "port must be a whole number"),
        ("port = 70000", "outside 0"),
        ("history_s = 0", "history_s 0"),
        ("memory_mb = 0", "memory_mb 0"),
        ("recordings_quota_gb = -1", "recordings_quota_gb -1"),
        ("split_mb = 0.01", "split_mb 0.01"),
        ("split_min = 2000000", "split_min 2e"),
        ("sync_s = 0.01", r"sync_s 0.01 is neither 0 \(left to the system\) nor 0.1 … 60 s"),
        ("sync_s = 61", "sync_s 61"),
        ("sync_s = nan", "sync_s nan"),
        ("record = 1", "record must be true or false"),
        ('sources = "one"', "must be a list"),
        ("sources = [1]", "must be a list"),
        ('view_token = "short"', "at least 8"),
        ('view_token = "with a space"', "at least 8"),
        ('view_token = "the-same-1"\ncontrol_token = "the-same-1"', "must differ"),
        ("= 1", "not valid TOML"),
        ('map = "http://a"', "must be a table"),
        ('[map]\ntile = "x"', "map.tile is not a valid setting"),
        ("[map]\ntiles = 3", "map.tiles must be text"),
        ('[map]\ntiles = "http://a/{z}/{x}.png"', "must be an http address"),
        ('[map]\ntiles = "file:///{z}/{x}/{y}"', "must be an http address"),
        ('[map]\ntiles = "http://{x}.a/{z}/{x}/{y}"', "must be an http address"),
    ],
)
def test_errors_are_reported(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "imuscope.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=words):
        load(file)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load(tmp_path / "none.toml")


@each_row("host", ["127.0.0.1", "127.9.9.9", "::1", "[::1]", "localhost"])
def test_loopback(host: str) -> None:
    assert is_loopback(host)


@each_row("host", ["0.0.0.0", "::", "", "192.0.2.1", "robot.local", "localhost.example"])
def test_not_loopback(host: str) -> None:
    assert not is_loopback(host)


SETTINGS: dict[Any, Any] = {
    int: Annotated[int, Interval(ge=0, le=9)],
    float: Annotated[float, zero_or(0.5, 9, "s")],
    str: Annotated[str, one_of("a", "b")],
    bool: bool,
    tuple[str, ...]: tuple[str, ...],
    dict[str, str]: dict[str, str],
    dict[str, tuple[str, ...]]: Annotated[dict[str, tuple[str, ...]], "no constraint"],
}
VALUES = st.one_of(
    st.booleans(),
    st.integers(-2, 12),
    st.floats(-1, 12),
    st.sampled_from(["a", "b", "", None, float("nan"), float("inf"), (), ("a",), (1,)]),
    st.dictionaries(st.sampled_from(["a", "b"]), st.one_of(st.just("a"), st.just(1), st.just(("a",)), st.just((1,)))),
)


@given(st.sampled_from(sorted(SETTINGS, key=str)), VALUES)
def test_values_are_judged_as_pydantic_does(kind: Any, value: object) -> None:
    annotated = SETTINGS[kind]
    try:
        TypeAdapter(annotated).validate_python(value, strict=True)
    except ValidationError:
        assert not (is_of_type(value, kind) and is_allowed(value, annotated))
    else:
        assert is_of_type(value, kind)
        assert is_allowed(value, annotated)


def test_constraints_of_plug_ins_are_checked() -> None:
    assert is_allowed(3, Annotated[int, Ge(3), Lt(4)])
    assert not is_allowed(4, Annotated[int, Ge(3), Lt(4)])
    assert not is_allowed(2, Annotated[int, Ge(3), Lt(4)])
