"""The store of a server: `[store]` of the configuration file, and `--store`."""

from pathlib import Path

import pytest

from imuscope.server.extensions.fleet.model.settings import FleetTables, StoreSettings
from imuscope.server.settings.config import ConfigError, load
from tests.server.extensions.fleet.store_fixtures import Commands
from tests.support.each_row import each_row


def test_the_command_line_outdoes_the_url_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "imuscope.toml"
    file.write_text('[store]\nurl = "/srv/drives"\nquery_s = 5.0\nquery_mb = 128\n')
    assert load(file).of(FleetTables).store == StoreSettings("/srv/drives", 5.0, 128)
    assert load(file, store={"url": "/srv/others"}).of(FleetTables).store == StoreSettings("/srv/others", 5.0, 128)
    assert load(store={"url": "/srv/others"}).of(FleetTables).store == StoreSettings("/srv/others")
    assert load().of(FleetTables).store.url == ""


@each_row(
    ("text", "words"),
    [
        ('store = "/srv/drives"', "store must be a table"),
        ('[store]\nurls = "/srv"', "store.urls is not a valid setting"),
        ("[store]\nurl = 5", "store.url must be text"),
        ("[store]\nquery_s = 0.5", "store.query_s 0.5 is outside"),
        ("[store]\nquery_mb = 8", "store.query_mb 8 is outside"),
    ],
)
def test_what_is_not_a_setting_of_a_store(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "imuscope.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=words):
        load(file)


@pytest.mark.parametrize(
    ("url", "words"), [("ftp://host/x", "not a kind of store"), ("s3://key:secret@bucket", "credentials")]
)
def test_a_server_does_not_start_with_what_is_no_store(url: str, words: str, commands: Commands) -> None:
    assert words in commands.refused("serve", "sim:xbus", "--port", "0", "--store", url)
