"""The finding of `imuscope doctor` about the store."""

import pytest

from imuscope.server.extensions.fleet.model.settings import FleetTables, StoreSettings
from imuscope.server.extensions.fleet.robot import diagnosis
from imuscope.server.settings.config import Config


def test_packages_that_are_missing_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    config = Config().having(FleetTables(store=StoreSettings(url="s3://bucket/prefix")))
    assert [one.status for one in diagnosis.findings(config)] == ["ok"]
    monkeypatch.setattr(diagnosis, "PACKAGES", ("deltalake", "imuscope_of_nobody"))
    [finding] = diagnosis.findings(config)
    assert (finding.status, finding.message) == (
        "problem",
        "Recordings cannot be stored: imuscope_of_nobody not installed.",
    )
    assert finding.todo == ("pip install 'imuscope[fleet]'",)


def test_nothing_without_a_store() -> None:
    assert list(diagnosis.findings(Config())) == []
