"""`python -m imuscope.server.generators.ts_types`: all TypeScript files generated from the server.

server/wire/ and the models of two pages ─> web/src/wire/{,form-,recording-}types.ts   server/reference/typescript.py
/openapi.json                              ─> web/src/wire/routes.ts                    server/generators/route_types.py

python -m imuscope.server.generators.ts_types            write the files
python -m imuscope.server.generators.ts_types --check    exit status 1 when one is stale
"""

import re
import sys

from imuscope.server.generators import route_types as generate_route_types
from imuscope.server.generators.files import write
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
    files = [*((target.path, generate(target)) for target in TARGETS), (ROUTES, generate_routes())]
    raise SystemExit(write(files, sys.argv[1:], "generators.ts_types"))
