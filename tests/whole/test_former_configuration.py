"""Configuration files of former versions, with settings of extensions."""

from __future__ import annotations

from pathlib import Path

from imuscope.server.extensions.foxglove.settings import FoxgloveSettings
from imuscope.server.extensions.rerun.settings import RerunSettings
from imuscope.server.settings.config import MapTiles, load
from tests.support.decode_options import decode_options
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

PREVIOUS = ROOT / "tests" / "golden" / "previous_formats"


@each_row("format_", sorted(path.name for path in PREVIOUS.iterdir() if (path / "imuscope.toml").is_file()))
def test_a_configuration_file_of_a_former_version_is_read(format_: str) -> None:
    config = load(PREVIOUS / format_ / "imuscope.toml")
    assert (config.host, config.port, config.data) == ("0.0.0.0", 8081, Path("/var/lib/imuscope"))
    assert config.sources == ("/dev/ttyUSB0", "tcp://10.0.0.7:4000")
    assert config.reading() == decode_options("xbus", key=bytes(range(16)), min_mode="safety")
    assert (config.rollback_s, config.history_s, config.memory_mb) == (30, 300, 128)
    assert (config.view_token, config.control_token) == ("look-but-do-not-touch", "touch-if-you-must")
    assert (config.record, config.recordings_quota_gb, config.split_mb, config.split_min) == (True, 20, 2000, 60)
    assert config.of(FoxgloveSettings).foxglove == 8765
    assert config.of(RerunSettings).rerun_connect == "rerun+http://desk.local:9876/proxy"
    assert config.map == MapTiles("http://maps.local/{z}/{x}/{y}.png", "© OpenStreetMap contributors")
