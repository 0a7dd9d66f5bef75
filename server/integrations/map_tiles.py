"""Map tiles for the track, fetched from the one configured tile server.

    page ── /api/tiles/{z}/{x}/{y} ──> this ── the configured address, filled in ──> tile server
                                        └─ the last tiles, in memory

The page only connects to its own server (content-security policy), and no requests are made without an address in the
configuration file. Only three integers of a request are inserted into that address, so other hosts cannot be reached:
redirections are not followed, anything but images is dropped, and number, size and time are bounded.
"""

import asyncio
from collections import OrderedDict
from typing import Any

from imuscope.server.errors import DomainError
from imuscope.server.settings.config import MapTiles
from imuscope.server.version import VERSION

MAX_BYTES = 1 << 20  # of one tile; usual ones have some tens of kB
KEPT_BYTES = 32 << 20
MAX_REQUESTS = 4
TIMEOUT_S = 10.0
KINDS = ("image/png", "image/jpeg", "image/webp")

Tile = tuple[str, bytes]
"""Media type and bytes."""


class TileSource:
    """The tiles of the configured server.

    Args:
        settings: address and attribution; without an address there are none.
    """

    def __init__(self, settings: MapTiles) -> None:
        self.settings = settings
        self._cached: OrderedDict[tuple[int, int, int], Tile] = OrderedDict()
        self._kept_bytes = 0
        self._slots = asyncio.Semaphore(MAX_REQUESTS)

    async def tile(self, z: int, x: int, y: int) -> Tile:
        """Get one tile.

        Raises:
            DomainError: the tile does not exist or cannot be fetched.
        """
        entry = self._cached.get((z, x, y))
        if entry is not None:
            self._cached.move_to_end((z, x, y))
            return entry
        address = self.settings.tiles.replace("{z}", str(z)).replace("{x}", str(x)).replace("{y}", str(y))
        async with self._slots:
            entry = await asyncio.to_thread(self._fetch, address)
        self._cache((z, x, y), entry)
        return entry

    def _fetch(self, address: str) -> Tile:
        import urllib.request  # for the first tile: most servers fetch none
        from urllib.error import HTTPError

        class NoRedirect(urllib.request.HTTPRedirectHandler):
            def redirect_request(self, *args: Any, **kwargs: Any) -> None:
                return None

        request = urllib.request.Request(address, headers={"user-agent": f"imuscope/{VERSION}"})
        try:
            with urllib.request.build_opener(NoRedirect).open(request, timeout=TIMEOUT_S) as answer:
                kind = str(answer.headers.get_content_type())
                data = answer.read(MAX_BYTES + 1)
        except HTTPError as error:
            error.close()
            if error.code in (404, 410):
                raise DomainError(
                    "not-found", "The tile server does not have this tile.", "It may cover less."
                ) from None
            raise _unusable(f"answered {error.code}") from None
        except (OSError, ValueError) as error:  # unknown host, refused, time-out, invalid address
            raise _unusable(f"cannot be reached: {getattr(error, 'reason', error)}") from None
        if kind not in KINDS or len(data) > MAX_BYTES:
            raise _unusable("sent data that is not an image of a tile's size")
        return kind, data

    def _cache(self, place: tuple[int, int, int], tile: Tile) -> None:
        before = self._cached.pop(place, None)
        self._cached[place] = tile
        self._kept_bytes += len(tile[1]) - (len(before[1]) if before else 0)
        while self._kept_bytes > KEPT_BYTES:
            _, (_, data) = self._cached.popitem(last=False)
            self._kept_bytes -= len(data)


def _unusable(words: str) -> DomainError:
    hint = "Check the address under [map] in the configuration file. The track works without it."
    return DomainError("tile-server", f"The tile server {words}.", hint)
