"""Route /foxglove: the Foxglove WebSocket protocol behind our own port, token and TLS
(server/extensions/foxglove/service.py).
"""

from fastapi import WebSocket

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.errors import DomainError
from imuscope.server.extensions.foxglove.protocol_server import MAX_UP, SUBPROTOCOLS
from imuscope.server.extensions.foxglove.service import Foxglove
from imuscope.server.integrations.proxy import reject, relay

router = lazy_router()

MAX_DOWN = 16 * 1024 * 1024  # all advertised topics come in one message


@router.websocket("/foxglove")
@router.websocket("/foxglove/")
async def foxglove(socket: WebSocket, services: TheServices) -> None:
    """Relay between a Foxglove viewer and the bridge, until either side disconnects."""
    try:
        endpoint = await services.parts.get(Foxglove).endpoint()
    except DomainError as error:
        await reject(socket, error)
        return
    await relay(socket, endpoint, speaks=lambda name: name in SUBPROTOCOLS, most_up=MAX_UP, most_down=MAX_DOWN)
