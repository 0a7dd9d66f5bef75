"""Tiles for a map under the track (server/integrations/map_tiles.py)."""

from typing import Annotated

from fastapi import Path
from fastapi.responses import Response
from pydantic import BaseModel

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import bytes_of, responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.errors import DomainError
from imuscope.server.integrations.map_tiles import KINDS

MAX_ZOOM = 22
KEEP = "private, max-age=86400"

router = lazy_router(prefix="/api", tags=["map"])


class MapInfo(BaseModel):
    """Whether a map is configured, and its attribution."""

    tiles: bool
    attribution: str


@router.get("/map")
async def get_map(services: TheServices) -> MapInfo:
    """Whether a tile server is configured, and its attribution."""
    settings = services.tiles.settings
    return MapInfo(tiles=bool(settings.tiles), attribution=settings.attribution)


@router.get("/tiles/{z}/{x}/{y}", response_class=Response, responses={**bytes_of(*KINDS), **responses(404, 422, 502)})
async def get_tile(
    services: TheServices,
    z: Annotated[int, Path(ge=0, le=MAX_ZOOM)],
    x: Annotated[int, Path(ge=0)],
    y: Annotated[int, Path(ge=0)],
) -> Response:
    """An image of 256 by 256 pixels: column x and row y (from the north) of the 2^z by 2^z tiles of the world."""
    if not services.tiles.settings.tiles:
        raise DomainError("not-found", "No tile server is configured.", "See [map] in server/settings/config.py.")
    if x >= 1 << z or y >= 1 << z:
        raise DomainError("not-found", f"Tile {x}, {y} does not exist at zoom {z}.", "Both are less than 2^z.")
    kind, data = await services.tiles.tile(z, x, y)
    return Response(data, media_type=kind, headers={"cache-control": KEEP, "x-content-type-options": "nosniff"})
