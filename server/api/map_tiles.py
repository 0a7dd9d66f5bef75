"""Is there a map under the track, and what is on it? Tiles of the one tile server that the configuration names.

    page ── /api/tiles/{z}/{x}/{y} ──> this ── the configured address, filled in ──> tile server
                                        └─ the last tiles, in memory

The page asks nobody but its own server (content-security policy), and nothing is asked of anybody unless a person wrote
an address into the configuration file. Only three whole numbers of a request reach that address, so this is no way to
other hosts: redirections are not followed, what is no picture is not passed on, and number, size and time are bounded.
"""

from __future__ import annotations

import asyncio
import urllib.error
import urllib.request
from collections import OrderedDict
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response
from pydantic import BaseModel

from server.api.errors import ApiError, bytes_of, responses
from server.config import MapTiles
from server.version import VERSION

DEEPEST = 22
MOST_BYTES = 1 << 20  # of one tile; usual ones have some tens of kB
KEPT_BYTES = 32 << 20
AT_ONCE = 4
TIMEOUT_S = 10.0
KINDS = ("image/png", "image/jpeg", "image/webp")
KEEP = "private, max-age=86400"

router = APIRouter(prefix="/api", tags=["map"])
Tile = tuple[str, bytes]
"""Media type and bytes."""


class MapInfo(BaseModel):
    """Whether a map can be shown."""

    tiles: bool
    attribution: str


class NoRedirect(urllib.request.HTTPRedirectHandler):
    """A tile server that points elsewhere is not followed there."""

    def redirect_request(self, *args: Any, **kwargs: Any) -> None:
        return None


class TileSource:
    """The tiles of the configured server.

    Args:
        settings: address and attribution; without an address there are none.
    """

    def __init__(self, settings: MapTiles) -> None:
        self.settings = settings
        self._kept: OrderedDict[tuple[int, int, int], Tile] = OrderedDict()
        self._kept_bytes = 0
        self._turns = asyncio.Semaphore(AT_ONCE)
        self._opener = urllib.request.build_opener(NoRedirect)

    async def tile(self, z: int, x: int, y: int) -> Tile:
        """One tile.

        Raises:
            ApiError: there is none, or it cannot be had.
        """
        found = self._kept.get((z, x, y))
        if found is not None:
            self._kept.move_to_end((z, x, y))
            return found
        address = self.settings.tiles.replace("{z}", str(z)).replace("{x}", str(x)).replace("{y}", str(y))
        async with self._turns:
            found = await asyncio.to_thread(self._fetch, address)
        self._keep((z, x, y), found)
        return found

    def _fetch(self, address: str) -> Tile:
        request = urllib.request.Request(address, headers={"user-agent": f"imuscope/{VERSION}"})
        try:
            with self._opener.open(request, timeout=TIMEOUT_S) as answer:
                kind = str(answer.headers.get_content_type())
                data = answer.read(MOST_BYTES + 1)
        except urllib.error.HTTPError as error:
            error.close()
            if error.code in (404, 410):
                raise ApiError(404, "not-found", "The tile server has no such tile.", "It may cover less.") from None
            raise _unusable(f"answered {error.code}") from None
        except (OSError, ValueError) as error:  # no such host, refused, too slow, an address that is none
            raise _unusable(f"cannot be reached: {getattr(error, 'reason', error)}") from None
        if kind not in KINDS or len(data) > MOST_BYTES:
            raise _unusable("sent what is no picture of a tile's size")
        return kind, data

    def _keep(self, place: tuple[int, int, int], tile: Tile) -> None:
        before = self._kept.pop(place, None)
        self._kept[place] = tile
        self._kept_bytes += len(tile[1]) - (len(before[1]) if before else 0)
        while self._kept_bytes > KEPT_BYTES:
            _, (_, data) = self._kept.popitem(last=False)
            self._kept_bytes -= len(data)


def _unusable(words: str) -> ApiError:
    hint = "Is the address under [map] in the configuration file right? The track works without it."
    return ApiError(502, "tile-server", f"The tile server {words}.", hint)


@router.get("/map")
async def get_map(request: Request) -> MapInfo:
    """Whether a tile server is configured, and whom its tiles are owed to."""
    source: TileSource = request.app.state.tiles
    return MapInfo(tiles=bool(source.settings.tiles), attribution=source.settings.attribution)


@router.get("/tiles/{z}/{x}/{y}", response_class=Response, responses={**bytes_of(*KINDS), **responses(404, 422, 502)})
async def get_tile(
    request: Request,
    z: Annotated[int, Path(ge=0, le=DEEPEST)],
    x: Annotated[int, Path(ge=0)],
    y: Annotated[int, Path(ge=0)],
) -> Response:
    """A picture of 256 by 256 pixels: column x and row y (from the north) of the 2^z by 2^z tiles of the world."""
    source: TileSource = request.app.state.tiles
    if not source.settings.tiles:
        raise ApiError(404, "not-found", "No tile server is configured.", "See [map] in server/config.py.")
    if x >= 1 << z or y >= 1 << z:
        raise ApiError(404, "not-found", f"There is no tile {x}, {y} at zoom {z}.", "Both are less than 2^z.")
    kind, data = await source.tile(z, x, y)
    return Response(data, media_type=kind, headers={"cache-control": KEEP, "x-content-type-options": "nosniff"})
