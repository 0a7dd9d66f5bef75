"""/foxglove: the Foxglove WebSocket protocol behind our own port, token and TLS (server/integrations/foxglove.py)."""

from __future__ import annotations

from fastapi import APIRouter, WebSocket

from server.integrations.foxglove import Foxglove
from server.integrations.foxglove_server import MOST_UP, SUBPROTOCOLS
from server.integrations.proxy import ViewError, reject, relay

router = APIRouter()

MOST_DOWN = 16 * 1024 * 1024  # what is advertised comes in one message


@router.websocket("/foxglove")
@router.websocket("/foxglove/")
async def foxglove(socket: WebSocket) -> None:
    """A viewer that speaks the protocol, for as long as both sides want."""
    bridge: Foxglove = socket.app.state.foxglove
    try:
        door = await bridge.door()
    except ViewError as error:
        await reject(socket, error)
        return
    await relay(socket, door, speaks=lambda name: name in SUBPROTOCOLS, most_up=MOST_UP, most_down=MOST_DOWN)
