"""The services of the server, for routes and WebSockets; the client of a request, and work that ends with it."""

import asyncio
from collections.abc import Coroutine
from typing import Annotated, Any, TypeVar

from fastapi import Depends, Request
from fastapi.requests import HTTPConnection

from imuscope.server.access.login_throttle import client_group
from imuscope.server.services.services import Services

T = TypeVar("T")
CLIENT_GONE = 499  # status of a response that no client reads


async def services_of(connection: HTTPConnection) -> Services:
    services: Services = connection.app.state.services
    return services


TheServices = Annotated[Services, Depends(services_of)]


def user_of(request: Request) -> str:
    """The user of a request, for turns: address and role of the client."""
    return f"{request.state.role}@{client_group(request.client.host if request.client else '')}"


async def while_connected(request: Request, work: Coroutine[Any, Any, T]) -> T | None:
    """The result of work that is cancelled when the client closes the connection: then None."""
    working = asyncio.ensure_future(work)
    gone = asyncio.ensure_future(_is_gone(request))
    try:
        await asyncio.wait({working, gone}, return_when=asyncio.FIRST_COMPLETED)
        return await working if working.done() else None
    finally:
        gone.cancel()
        if not working.done():
            working.cancel()
            await asyncio.wait({working})


async def _is_gone(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
