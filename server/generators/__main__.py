"""`python -m imuscope.server.generators`: the files generated from the server that are not in git.

server/wire/ and the models of two pages ─> web/src/wire/{,form-,recording-}types.ts   server/reference/typescript.py
/openapi.json                              ─> web/src/wire/routes.ts                    server/generators/route_types.py
                                           ─> docs/http-api.md                          server/generators/docs.py

`web/build.py --modules` does it, for the check. The page is built without them: to build it, types are removed.
"""

import re

from imuscope.server.generators import route_types as generate_route_types
from imuscope.server.generators.docs import HTTP_API, documents
from imuscope.server.generators.files import document, write
from imuscope.server.reference.typescript import PAGE, TARGETS, generate

ROUTES = PAGE / "wire" / "routes.ts"
_EXPORT = re.compile(r"^export (?:interface|type) (\w+)", re.MULTILINE)


def generate_routes() -> str:
    """The whole of routes.ts."""
    sources: dict[str, str] = {}
    for target in TARGETS:
        folder = target.path.parent
        module = f"./{target.path.stem}" if folder == ROUTES.parent else f"../{folder.name}/types"
        for name in _EXPORT.findall(generate(target)):
            sources.setdefault(name, module)
    return generate_route_types.generate(sources)


if __name__ == "__main__":
    write((target.path, generate(target)) for target in TARGETS)
    write([(ROUTES, generate_routes())])
    write((path, text) for path, text in documents(document()) if path.name == HTTP_API)
