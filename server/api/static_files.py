"""The page's own files, from server/page, where `web/build.py` puts them.

A name never becomes a path: a request is looked up among the existing files. Files under `assets/` have a hash of their
content in their name and are cached for ever; the others are revalidated each time. Where the build has written a
compressed copy (`.br`, `.gz`) of a file, browsers that support it get that copy.

The content-security policy allows this server only: no inline script, no inline style, no other host.
"""

import mimetypes
from pathlib import Path

from fastapi import Request
from fastapi.responses import HTMLResponse, Response
from starlette.exceptions import HTTPException

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.http.page_files import Files

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
# Browsers request this name for documents without an icon: a recording's JSON in a tab, a style sheet.
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

router = lazy_router(include_in_schema=False)


def _accepted(request: Request) -> set[str]:
    parts = request.headers.get("accept-encoding", "").split(",")
    return {part.partition(";")[0].strip() for part in parts if "q=0" not in part.replace(" ", "").split(";")[1:]}


def serve(request: Request, files: Files, name: str) -> Response | None:
    """The response for a file, or None if it does not exist."""
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
        compressed = files.get(name + ending) if encoding in _accepted(request) else None
        if compressed is not None:
            asset = compressed
            headers["content-encoding"] = encoding
            break
    headers["etag"] = asset.etag
    if asset.etag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    return Response(asset.data, headers=headers)


@router.get("/{name:path}")
@router.head("/{name:path}")
async def page(request: Request, name: str, services: TheServices) -> Response:
    """A file of the page. Any other single word without a dot returns index.html where HTML is accepted.

    The page names its files relative to its own address, as a proxy may have put it below a path.
    """
    files = services.page_files
    is_view = not {".", "/"} & {*name} and "text/html" in request.headers.get("accept", "")
    answer = serve(request, files, SAME.get(name, name)) if name else None
    if answer is None and (not name or is_view):
        answer = serve(request, files, "index.html") or HTMLResponse(
            MISSING, 503, {**HEADERS, "cache-control": "no-store"}
        )
    if answer is None:
        raise HTTPException(404)
    return answer
