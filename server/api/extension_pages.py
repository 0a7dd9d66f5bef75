"""Routes of the parts of the page that extensions of other packages bring.

    GET /api/extensions              installed extensions, and which of them have a part of the page
    GET /extensions/NAME/index.js    that part; the page imports it after its first picture

imuscope's own extensions are built into the page (web/src/extensions).
"""

import functools
from dataclasses import dataclass

from fastapi import Request, Response
from starlette.exceptions import HTTPException

from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.api.static_files import serve
from imuscope.server.http.page_files import Files
from imuscope.server.services.extension import extensions

router = lazy_router(tags=["build"])

MODULE = "index.js"


@dataclass(frozen=True, slots=True)
class InstalledExtension:
    """An installed extension.

    Args:
        package: name and version of the distribution that declares it; "" for imuscope's own.
        module: path of the module that adds its panels to the page; "" if it has none.
    """

    name: str
    title: str
    package: str
    module: str


@router.get("/api/extensions")
async def list_extensions() -> list[InstalledExtension]:
    """Installed extensions, each after those that it requires."""
    return [
        InstalledExtension(one.name, one.title, one.package, f"extensions/{one.name}/{MODULE}" if one.page else "")
        for one in extensions()
    ]


@functools.cache
def _files() -> dict[str, Files]:
    """Files of the page's parts, by extension."""
    folders = {one.name: one.page_folder for one in extensions()}
    return {name: Files(folder) for name, folder in folders.items() if folder is not None}


@router.get("/extensions/{name}/{path:path}", include_in_schema=False)
async def get_page_file(request: Request, name: str, path: str) -> Response:
    """A file of the page's part of an extension."""
    files = _files().get(name)
    response = serve(request, files, path) if files is not None else None
    if response is None:
        raise HTTPException(404)
    return response
