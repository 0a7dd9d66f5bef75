"""The page's own files, from server/page, where `web/build.py` puts them.

Names never become paths unchecked: a request is looked up among the files that are there. Files under `assets/` carry a
hash of their content in their name and may be kept for ever; the others are asked about each time. Where the build has
left a compressed twin (`.br`, `.gz`) beside a file, that is what a browser gets that understands it.

The content-security policy allows this server and nothing else: no inline script, no inline style, no other host.
"""

from __future__ import annotations

import hashlib
import mimetypes
from dataclasses import dataclass
from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response
from starlette.exceptions import HTTPException

FOLDER = Path(__file__).resolve().parent.parent / "page"
POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",
        "font-src 'self'",
        "connect-src 'self'",
        "worker-src 'self'",
        "manifest-src 'self'",
        "frame-src 'self'",
        "base-uri 'none'",
        "form-action 'self'",
        "frame-ancestors 'self'",
    )
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
}
FOR_EVER = "public, max-age=31536000, immutable"
# A browser asks for this name by itself where a document names no icon: a recording's JSON in a tab, a style sheet.
SAME = {"favicon.ico": "icon.svg"}
ENCODINGS = (("br", ".br"), ("gzip", ".gz"))
TYPES = {
    ".js": "text/javascript",
    ".mjs": "text/javascript",
    ".wasm": "application/wasm",
    ".webmanifest": "application/manifest+json",
}

MISSING = """<!doctype html><html lang="en"><meta charset="utf-8"><title>imuscope</title>
<h1>The page has not been built</h1>
<p>This imuscope runs from a source tree whose page was not built yet. The server works; its API is at
<a href="/openapi.json">/openapi.json</a>.</p>
<p>Build the page with <code>python web/build.py</code> (no Node needed), then reload.</p></html>"""

router = APIRouter(include_in_schema=False)


@dataclass(frozen=True, slots=True)
class Asset:
    """A file in memory, as it goes out."""

    stamp: tuple[int, int]  # mtime ns and size of the file when it was read
    data: bytes
    etag: str


class Files:
    """The files of a folder, read when first asked for and again when they change."""

    def __init__(self, folder: Path = FOLDER) -> None:
        self._folder = folder
        self._assets: dict[str, Asset] = {}

    def get(self, name: str) -> Asset | None:
        """A file by its path in the folder, None when there is none of that name."""
        path = self._folder / name
        try:
            if not path.resolve().is_relative_to(self._folder.resolve()) or not path.is_file():
                return None
            stat = path.stat()
            stamp = (stat.st_mtime_ns, stat.st_size)
            known = self._assets.get(name)
            if known is None or known.stamp != stamp:
                data = path.read_bytes()
                known = self._assets[name] = Asset(stamp, data, f'"{hashlib.sha256(data).hexdigest()[:24]}"')
        except (OSError, ValueError):  # a name with a NUL byte, or a file that vanished meanwhile
            return None
        return known


def _accepted(request: Request) -> set[str]:
    parts = request.headers.get("accept-encoding", "").split(",")
    return {part.partition(";")[0].strip() for part in parts if "q=0" not in part.replace(" ", "").split(";")[1:]}


def serve(request: Request, files: Files, name: str) -> Response | None:
    """The response for a file, None when there is none."""
    asset = files.get(name)
    if asset is None:
        return None
    suffix = Path(name).suffix
    kind = TYPES.get(suffix) or mimetypes.guess_type(name)[0] or "application/octet-stream"
    headers = {
        **HEADERS,
        "content-type": f"{kind}; charset=utf-8" if kind.startswith("text/") else kind,
        "cache-control": FOR_EVER if name.startswith("assets/") else "no-cache",
        "vary": "accept-encoding",
    }
    for encoding, ending in ENCODINGS:
        twin = files.get(name + ending) if encoding in _accepted(request) else None
        if twin is not None:
            asset = twin
            headers["content-encoding"] = encoding
            break
    headers["etag"] = asset.etag
    if asset.etag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    return Response(asset.data, headers=headers)


@router.get("/{name:path}")
@router.head("/{name:path}")
async def page(request: Request, name: str) -> Response:
    """A file of the page; its own addresses (no dot in the last part, asked for as HTML) are all index.html."""
    files: Files = request.app.state.files
    is_view = "." not in name.rpartition("/")[2] and "text/html" in request.headers.get("accept", "")
    found = serve(request, files, SAME.get(name, name)) if name else None
    if found is None and (not name or (is_view and not name.startswith("api/"))):
        found = serve(request, files, "index.html") or HTMLResponse(
            MISSING, 503, {**HEADERS, "cache-control": "no-store"}
        )
    if found is None:
        raise HTTPException(404)
    return found
