"""Check of `imuscope doctor`: can the store of recordings be used?"""

from collections.abc import Iterator
from importlib.util import find_spec

from imuscope.server.diagnostics.checks import Finding
from imuscope.server.extensions.fleet.model.settings import FleetTables
from imuscope.server.extensions.fleet.store.store import PACKAGES
from imuscope.server.settings.config import Config

ABOUT = "store"


def findings(config: Config) -> Iterator[Finding]:
    """Whether the packages that a store needs are installed; nothing without a store."""
    if not config.of(FleetTables).store.url:
        return
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        message = f"Recordings cannot be stored: {', '.join(missing)} not installed."
        yield Finding("problem", ABOUT, message, ("pip install 'imuscope[fleet]'",))
    else:
        yield Finding("ok", ABOUT, "The packages of the store are installed.")
