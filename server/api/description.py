"""How is the API described? /openapi.json is FastAPI's, and names the token that server/auth.py asks for.

On loopback none is needed; a description holds for every server, so an empty requirement stands beside the token's.
"""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI

from server.auth import is_protected

BEARER = {
    "type": "http",
    "scheme": "bearer",
    "description": "The token that the server printed at its start: one to look, one to control. On loopback none.",
}


def install(app: FastAPI) -> None:
    """From here on the description of this application tells how a request is let in."""
    made = app.openapi

    def openapi() -> dict[str, Any]:
        schema = made()
        schema.setdefault("components", {})["securitySchemes"] = {"token": BEARER}
        for path, methods in schema["paths"].items():
            for operation in methods.values():
                operation["security"] = [{"token": []}, {}] if is_protected(path) else []
        return schema

    app.openapi = openapi  # type: ignore[method-assign]
