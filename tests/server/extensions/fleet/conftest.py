"""Fixtures of the tests of a store."""

from pathlib import Path

import pytest

from tests.recordings.recorded_drive import drive
from tests.server.extensions.fleet.store_fixtures import Commands


@pytest.fixture(scope="session")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Stores of which tests take copies."""
    return tmp_path_factory.mktemp("stores")


@pytest.fixture
def commands(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, stores: Path
) -> Commands:
    """The commands, with a data folder of their own."""
    monkeypatch.setenv("IMUSCOPE_DATA", str(tmp_path / "data"))
    return Commands(capsys, stores)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A recording of four seconds, with a loss and a marker."""
    drive(tmp_path / "drive.mcap")
    return tmp_path / "drive.mcap"


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """A folder that does not exist yet."""
    return tmp_path / "store"
