"""Route of the capabilities: protocols, export formats, kinds of links."""

from __future__ import annotations

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.wire.capabilities import Capabilities

router = lazy_router(prefix="/api/capabilities", tags=["build"])


@router.get("")
async def get_capabilities(services: TheServices) -> Capabilities:
    """Everything that is registered, as sent to the page in `hello`."""
    return services.telemetry.clients.capabilities
