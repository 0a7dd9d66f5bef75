"""Rules of routes: which paths need a token, which requests carry files, and which change nothing although they are
POST.
"""

import re
from collections.abc import Iterable

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
PLACES = ("/api", "/ws", "/metrics", "/openapi.json", "/extensions")
FILES = (("PUT", "/api/recordings/upload"),)  # whose bodies are not JSON: they check type and size themselves
READ_ONLY_POSTS = tuple(f"/api/devices/{{device}}/{what}" for what in ("preview", "fit-rates", "compare"))


class RouteRules:
    """The rules of the heart, and those that extensions add."""

    def __init__(self) -> None:
        self._places: set[str] = set()
        self._read_only: list[re.Pattern[str]] = []
        self.add(PLACES, READ_ONLY_POSTS)

    def add(self, places: Iterable[str], read_only_posts: Iterable[str]) -> None:
        """Add rules.

        Args:
            places: paths that need a token, with all below them.
            read_only_posts: routes whose POST requests carry values and change nothing: "/api/analysis/{name}".
        """
        self._places |= {*places}
        self._read_only += [re.compile(re.sub(r"\\\{\w+\\\}", "[^/]+", re.escape(one))) for one in read_only_posts]

    def is_protected(self, path: str) -> bool:
        """Whether this path is more than the page's own files."""
        return any(path == place or path.startswith(place + "/") for place in self._places)

    def is_command(self, method: str, path: str) -> bool:
        """Whether a request changes something."""
        reads = method in SAFE_METHODS or (method == "POST" and any(one.fullmatch(path) for one in self._read_only))
        return not reads
