"""Reference pages at /docs. They contain no device data, so like the page's own files they need no token."""

import hashlib
import re

from fastapi import Request
from fastapi.responses import Response
from starlette.exceptions import HTTPException

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.api.static_files import HEADERS
from imuscope.server.reference.pages import PAGES

router = lazy_router(include_in_schema=False)

TEMPLATE = "docs.html"  # part of the built page: its styles, and a placeholder for the content
PLACE = "<!-- content -->"
_ON_SERVER = re.compile(r'\b(href|src)="\.?/')  # relative to this page, as a proxy may have put it below a path
PLAIN = f"""<!doctype html><html lang="en"><meta charset="utf-8"><title>Reference · imuscope</title>
<main>{PLACE}</main></html>"""


@router.get("/docs")
@router.get("/docs/{name}")
@router.head("/docs")
@router.head("/docs/{name}")
def get_page(request: Request, services: TheServices, name: str = "") -> Response:
    """One page; without a name, the list of pages."""
    if name and name not in PAGES:
        raise HTTPException(404)
    template = services.page_files.get(TEMPLATE)
    around = template.data.decode() if template else PLAIN
    title = PAGES[name].title if name else "Reference"
    text = around.replace("<title>Reference", f"<title>{title}")
    text = text.replace(PLACE, request.app.state.reference.html(name, request.app.openapi))
    body = _ON_SERVER.sub(r'\1="../' if name else r'\1="./', text).encode()
    headers = {**HEADERS, "cache-control": "no-cache", "etag": f'"{hashlib.sha256(body).hexdigest()[:24]}"'}
    if headers["etag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    return Response(body, media_type="text/html", headers=headers)
