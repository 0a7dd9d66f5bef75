"""Settings of shared ports, from the file and from the command line."""

from pathlib import Path

import pytest

from imuscope.server.extensions.shares.settings import ShareSettings, check_sources
from imuscope.server.settings.config import ConfigError, load
from tests.support.each_row import each_row


def test_shares_belong_to_sources(tmp_path: Path) -> None:
    toml = tmp_path / "imuscope.toml"
    toml.write_text('sources = ["/dev/a", "/dev/b"]\n[shares]\n"/dev/b" = ["/run/imu0", "tcp://:4001?mode=read"]\n')
    config = load(toml)
    check_sources(config)
    assert config.of(ShareSettings).shares == {"/dev/b": ("/run/imu0", "tcp://:4001?mode=read")}


def test_shares_of_a_source_that_is_not_opened_are_refused() -> None:
    with pytest.raises(ValueError, match="not among the sources: /dev/a"):
        check_sources(load(sources=["/dev/a"], shares={"/dev/c": ["/run/imu0"]}))


@each_row(
    ("shares", "words"),
    [
        ({"/dev/a": ["imu0"]}, "absolute path"),
        ({"/dev/a": ["/run/imu0", "/run/imu0?mode=read"]}, "/run/imu0 twice"),
        ({"/dev/a": "/run/imu0"}, "a table of lists of strings"),
        (["/run/imu0"], "a table of lists of strings"),
    ],
)
def test_wrong_shares_are_refused(shares: object, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load(sources=["/dev/a"], shares=shares)
