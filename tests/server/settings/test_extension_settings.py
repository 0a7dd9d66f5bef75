"""Settings of extensions of other packages: those that cannot be used are named, and stop nothing."""

from collections.abc import Iterator

import pytest

from imuscope.protocols.family.plugins import ProtocolPlugin
from imuscope.server.settings import extension_settings


@pytest.fixture(autouse=True)
def declared(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Three packages, of which none can be used."""
    plugins = [
        ProtocolPlugin("gone", "imuscope_of_nobody:Settings", "imuscope-gone 1.0"),
        ProtocolPlugin("other", "json:JSONDecoder", "imuscope-other 1.0"),
        ProtocolPlugin("later", "json:JSONDecoder", "imuscope-later 1.0", 2),
    ]
    monkeypatch.setattr(extension_settings, "plugins_of", lambda group: plugins)
    extension_settings._installed.cache_clear()
    yield
    extension_settings._installed.cache_clear()


def test_each_problem_is_a_sentence() -> None:
    assert extension_settings.extension_settings() == []
    gone, other, later = extension_settings.settings_problems()
    assert gone.startswith("The settings 'gone' of imuscope-gone 1.0 cannot be used: ModuleNotFoundError")
    assert "json:JSONDecoder is not derived from ExtensionSettings" in other
    assert "version 2 of the plug-in API" in later
