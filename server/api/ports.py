"""Routes of serial ports: list them, scan them for devices."""

import asyncio

from pydantic import BaseModel, Field

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.links.ports import PortInfo, list_ports, scan

router = lazy_router(prefix="/api/ports", tags=["ports"])


class ScanPortsRequest(BaseModel, extra="forbid"):
    """Choice of serial ports to scan for devices."""

    ports: list[str] | None = Field(None, max_length=64, description="paths; null for every port that is present")


def _in_use(sessions: Sessions) -> list[str]:
    """Paths that sessions have open, or are trying to open."""
    serial = [info.source for info in sessions.infos if info.link == "serial"]
    return [source.removeprefix("serial://").partition("?")[0] for source in serial]


@router.get("")
async def get_ports(services: TheServices) -> list[PortInfo]:
    """The serial ports of this host, without opening them."""
    return await asyncio.to_thread(list_ports, _in_use(services.sessions))


@router.post("/scan", responses=responses(422))
async def scan_ports(services: TheServices, body: ScanPortsRequest | None = None) -> list[PortInfo]:
    """Listen on every free port, at one rate after another; takes some seconds. Ports of sessions are left alone.

    One scan at a time: a second one waits for the first, because a port can be read by only one.
    """
    async with services.sessions.scan_lock:
        known = {info.device for info in await asyncio.to_thread(list_ports)}
        ports = None if body is None or body.ports is None else [port for port in body.ports if port in known]
        return await scan(ports, _in_use(services.sessions))
